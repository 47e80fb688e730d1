//! Conditions under which an object is seen.

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
