//! Conditions under which an object is seen.

use nalgebra::{Rotation3, Vector3};
use rand::{Rng, RngExt};

/// Surroundings of the object, and faults of sensor and mask. Lengths are shares of the object's longest side.
#[derive(Clone, Debug, Default)]
pub struct Conditions {
    /// Whether the object stands on a table.
    pub table: bool,
    /// Standard deviation of a reading.
    pub noise: f64,
    /// Width of the strip beside the object in which there are no readings; negative for the left side.
    pub strip: f64,
    /// Share of the pixels without a reading.
    pub dropout: f64,
    /// Part of the image that something before the object covers: left, right, top, bottom, as shares of the object's extent in the image.
    pub occluder: Option<[f64; 4]>,
    /// Whether neighbouring pixels share their noise, as they share what the sensor matches.
    pub shared_noise: bool,
    /// Half the width of the window over which a sensor that matches patterns averages, pixels: edges are rounded, bends flattened.
    pub window: u32,
    /// Depths are rounded to multiples of this.
    pub step: f64,
    /// Angles between the surface's normal and the ray from which on some and all readings are missing, radians; zeros for none.
    pub grazing_rad: [f64; 2],
    /// Share of the surfaces that face up without a reading, in patches.
    pub lid: f64,
    /// Share of all surfaces without a reading, in patches: metal and foil mirror the light away.
    pub gloss: f64,
    /// Where a shiny surface must face to give readings.
    pub shine: Option<Shine>,
    /// Share of the insides of vessels without a reading, in patches.
    pub inside: f64,
    /// Share of the pixels at the object's outline whose reading lies between it and what is behind.
    pub smear: f64,
    /// How far the mask is off, pixels.
    pub mask_shift: [f64; 2],
    /// By how many pixels the mask is too wide; negative where it is too narrow.
    pub mask_growth: i32,
    /// Readings of the mask lower than this above the table are not taken for the object's.
    pub cut: f64,
    /// Whether the floors of vessels are taken for the object's all the same: they are enclosed by its rim.
    pub keeps_floors: bool,
    /// Pixels that the longest side spans; `None` for most of the image.
    pub pixels: Option<f64>,
}

/// The direction that a shiny surface must face to give readings.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shine {
    /// How far it is turned from the ray, to the right and downwards in the image, radians.
    pub towards_rad: [f64; 2],
    /// How far a normal may be from it, radians; over 15 degrees beyond, readings become fewer.
    pub within_rad: f64,
}

impl Shine {
    /// From some readings to none, radians.
    const SOFT_RAD: f64 = 15.0 * std::f64::consts::PI / 180.0;

    /// Share of the readings that are lost where the surface has this normal and is met by this ray, both of length one in the camera's frame.
    pub(super) fn lost(&self, normal: &Vector3<f64>, ray: &Vector3<f64>) -> f64 {
        let [right, down] = self.towards_rad;
        let facing = if normal.dot(ray) < 0.0 { -normal } else { *normal };
        let towards = Rotation3::from_axis_angle(&Vector3::x_axis(), -down) * Rotation3::from_axis_angle(&Vector3::y_axis(), right) * ray;
        let angle = facing.dot(&towards).clamp(-1.0, 1.0).acos();
        ((angle - self.within_rad) / Self::SOFT_RAD).clamp(0.0, 1.0)
    }
}

impl Conditions {
    /// Conditions as cameras meet them, drawn at random.
    pub fn draw(rng: &mut impl Rng) -> Self {
        let chance = |rng: &mut dyn FnMut() -> f64, p: f64| rng() < p;
        let mut uniform = || rng.random_range(0.0..1.0);
        let table = chance(&mut uniform, 0.8);
        let noise = if chance(&mut uniform, 0.5) { 0.015 * uniform() } else { 0.0 };
        let strip = if chance(&mut uniform, 0.5) { 0.16 * (uniform() - 0.5) } else { 0.0 };
        let dropout = if chance(&mut uniform, 0.3) { 0.05 * uniform() } else { 0.0 };
        let occluder = chance(&mut uniform, 0.15).then(|| {
            // From one side, over at most two fifths of the object.
            let reach = 0.05 + 0.35 * uniform();
            match (4.0 * uniform()) as u32 {
                0 => [-1.0, reach, -1.0, 2.0],
                1 => [1.0 - reach, 2.0, -1.0, 2.0],
                2 => [reach, 2.0, 1.0 - reach, 2.0],
                _ => [-1.0, reach, 1.0 - reach, 2.0],
            }
        });
        Self { table, noise, strip, dropout, occluder, ..Self::default() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Of an upright cylinder ahead, turned 0, 40 and −40 degrees from the camera: with the light to the right only the right side is seen.
    #[test]
    fn a_shiny_surface_is_seen_only_where_it_faces() {
        let ray = Vector3::z();
        let at = |degrees: f64| {
            let angle = degrees.to_radians();
            Vector3::new(angle.sin(), 0.0, angle.cos())
        };
        let ahead = Shine { towards_rad: [0.0; 2], within_rad: 30_f64.to_radians() };
        assert_eq!([0.0, 29.0, -29.0, 46.0, -46.0].map(|degrees| ahead.lost(&at(degrees), &ray)), [0.0, 0.0, 0.0, 1.0, 1.0]);
        let right = Shine { towards_rad: [30_f64.to_radians(), 0.0], ..ahead };
        assert_eq!([59.0, 1.0, -20.0].map(|degrees| right.lost(&at(degrees), &ray)), [0.0, 0.0, 1.0]);
        // A normal has no side.
        assert_eq!(right.lost(&-at(59.0), &ray), 0.0);
    }
}
