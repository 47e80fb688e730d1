//! Faults of real depth sensors and of masks of real scenes, by kind of sensor, drawn at random for each view.
//!
//! | failure | where it comes from |
//! | --- | --- |
//! | noise that neighbours share, steps of depth | Nguyen, Izadi and Lovell, "Modeling Kinect sensor noise", 3DIMPVT 2012 |
//! | rounded edges and flattened bends | the window over which patterns are matched, nine pixels and more in structured light and stereo |
//! | no reading at grazing angles, on glossy lids and sides, inside vessels | light that is mirrored away, or blocked by the wall |
//! | readings between two surfaces at edges | a pixel that sees both |
//! | masks that are shifted, too wide or too narrow | hand-drawn and learned segmentation |
//! | the lowest readings are not taken for the object's | they cannot be told from the table's |
//!
//! Lengths are in metres here; [`super::Conditions`] has them as shares of the object's longest side.

use super::conditions::Conditions;
use rand::{Rng, RngExt};

/// A kind of depth sensor.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SensorKind {
    /// Structured light of the first Kinect's kind.
    StructuredLight,
    /// Active stereo of RealSense's kind.
    Stereo,
    /// Time of flight, as of the Azure Kinect.
    TimeOfFlight,
}

/// Under which conditions training views are seen.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Sensing {
    /// No faults and nothing else in view, near by.
    Ideal,
    /// Little noise, near by, masks without faults: for shapes whose size is not known.
    #[default]
    Mild,
    /// As on real tables, by one kind of sensor.
    Of(SensorKind),
    /// As on real tables, by all kinds of sensors in turn.
    Mixed,
}

/// Distances of cameras from things on tables, metres; but never nearer than so many longest sides.
const DISTANCES_M: [f64; 2] = [0.40, 1.50];
/// In longest sides of the object.
const SIDES: [f64; 2] = [2.5, 20.0];
/// The same of sensors that have few faults or none.
const NEAR_SIDES: std::ops::Range<f64> = SIDES[0]..6.0;
/// Focal lengths of depth cameras, pixels.
const FOCALS: [f64; 2] = [420.0, 620.0];
/// Readings lower than this above the table are not told from the table's, metres.
const CUT_M: [f64; 2] = [0.003, 0.014];

/// Angles between normal and ray from which on a shiny surface gives no readings, degrees.
const SHINY_GRAZING_DEG: [f64; 2] = [35.0, 70.0];

/// Of so many vessels the floor is known for the vessel's.
const FLOORS_KEPT: f64 = 0.7;

impl Sensing {
    /// Distance of the camera in longest sides of an object that measures `side_m` metres, if that is known, and what it meets there.
    pub fn draw(self, side_m: Option<f64>, rng: &mut impl Rng) -> (f64, Conditions) {
        let kind = match self {
            Self::Ideal => return (rng.random_range(NEAR_SIDES), Conditions::default()),
            Self::Mild => {
                let conditions = Conditions::draw(rng);
                return (rng.random_range(NEAR_SIDES), conditions);
            }
            Self::Of(kind) => kind,
            Self::Mixed => {
                let kinds = [SensorKind::StructuredLight, SensorKind::StructuredLight, SensorKind::Stereo, SensorKind::TimeOfFlight];
                kinds[rng.random_range(0..kinds.len())]
            }
        };
        let mut between = |[low, high]: [f64; 2]| -> f64 { low + (high - low) * rng.random_range(0.0..1.0) };
        // Of a size that is not known, any that stands on tables.
        let side = side_m.unwrap_or_else(|| between([0.07_f64.ln(), 0.30_f64.ln()]).exp());
        let distance_m = between(DISTANCES_M.map(f64::ln)).exp();
        let sides = (distance_m / side).clamp(SIDES[0], SIDES[1]);
        let z = sides * side;
        let mut conditions = Conditions::draw(rng);
        let mut chance = |p: f64| rng.random_range(0.0..1.0) < p;
        conditions.table = chance(0.95);
        let (deviation, step, strip, grazing) = match kind {
            SensorKind::StructuredLight => (0.0005 + 0.0015 * z * z, 0.00285 * z * z, true, [68.0, 85.0]),
            SensorKind::Stereo => (0.001 + 0.003 * z * z, 0.0, chance(0.5), [72.0, 86.0]),
            SensorKind::TimeOfFlight => (0.002 + 0.001 * z, 0.0, false, [60.0, 84.0]),
        };
        let (occluded, glossy, inside, shiny) = (chance(0.2), chance(0.25), chance(0.4), chance(0.3));
        if !occluded {
            conditions.occluder = None;
        }
        let mut between = |[low, high]: [f64; 2]| -> f64 { low + (high - low) * rng.random_range(0.0..1.0) };
        conditions.noise = deviation * between([0.5, 1.5]) / side;
        conditions.step = step / side;
        if !strip {
            conditions.strip = 0.0;
        }
        conditions.shared_noise = true;
        conditions.keeps_floors = between([0.0, 1.0]) < FLOORS_KEPT;
        conditions.window = if kind == SensorKind::TimeOfFlight { 0 } else { between([0.0, 3.5]) as u32 };
        conditions.grazing_rad = grazing.map(f64::to_radians);
        conditions.lid = if glossy { between([0.2, 1.0]) } else { 0.0 };
        if shiny {
            conditions.gloss = between([0.1, 0.5]);
            // Light that is mirrored comes back from what faces the sensor alone: of a cylinder a strip is left.
            let some = between(SHINY_GRAZING_DEG);
            let shiny = [some, some + 15.0].map(f64::to_radians);
            conditions.grazing_rad = std::array::from_fn(|n| shiny[n].min(conditions.grazing_rad[n]));
        }
        conditions.inside = if inside { between([0.2, 1.0]) } else { 0.0 };
        conditions.smear = between([0.0, 0.6]);
        conditions.mask_shift = [between([-1.0, 1.0]), between([-1.0, 1.0])].map(|v: f64| 2.5 * v.powi(3));
        conditions.mask_growth = between([-2.0, 2.5]).round() as i32;
        conditions.cut = between(CUT_M) / side;
        conditions.pixels = Some(between(FOCALS) / sides);
        (sides, conditions)
    }
}

/// A field over the image that varies over about an eighth of it, in \[0, 1\]: where a sensor fails, it fails in patches.
pub(super) struct Patches {
    knots: Vec<f64>,
}

/// Knots along a side.
const KNOTS: usize = 9;

impl Patches {
    pub fn new(rng: &mut impl Rng) -> Self {
        Self { knots: (0..KNOTS * KNOTS).map(|_| rng.random_range(0.0..1.0)).collect() }
    }

    /// At a place of the image, shares of its sides.
    pub fn at(&self, [u, v]: [f64; 2]) -> f64 {
        let place = |share: f64| {
            let at = share.clamp(0.0, 1.0) * (KNOTS - 1) as f64;
            let low = (at as usize).min(KNOTS - 2);
            (low, at - low as f64)
        };
        let ((i, s), (j, t)) = (place(u), place(v));
        let knot = |i: usize, j: usize| self.knots[j * KNOTS + i];
        (1.0 - t) * ((1.0 - s) * knot(i, j) + s * knot(i + 1, j)) + t * ((1.0 - s) * knot(i, j + 1) + s * knot(i + 1, j + 1))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;

    #[test]
    fn patches_lie_between_their_knots_and_pass_through_them() {
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let patches = Patches::new(&mut rng);
        assert!((patches.at([0.0, 0.0]) - patches.knots[0]).abs() < 1e-12);
        assert!((patches.at([1.0, 1.0]) - patches.knots[KNOTS * KNOTS - 1]).abs() < 1e-12);
        let middle = patches.at([0.5 / 8.0, 0.0]);
        assert!((middle - 0.5 * (patches.knots[0] + patches.knots[1])).abs() < 1e-12);
    }

    #[test]
    fn far_things_are_noisier_in_their_own_measure_and_distances_are_those_of_tables() {
        for kind in [SensorKind::StructuredLight, SensorKind::Stereo, SensorKind::TimeOfFlight] {
            let mut rng = ChaCha8Rng::seed_from_u64(2);
            let (mut small, mut large) = (0.0, 0.0);
            for _ in 0..200 {
                let (sides, a) = Sensing::Of(kind).draw(Some(0.08), &mut rng);
                assert!((5.0 - 1e-9..=20.0).contains(&sides) && a.noise > 0.0 && a.cut * 0.08 <= CUT_M[1]);
                let (sides, b) = Sensing::Of(kind).draw(Some(0.30), &mut rng);
                assert!((2.5..=5.0 + 1e-9).contains(&sides));
                (small, large) = (small + a.noise, large + b.noise);
            }
            assert!(small > 2.0 * large, "{kind:?}");
        }
        let (sides, ideal) = Sensing::Ideal.draw(Some(0.3), &mut ChaCha8Rng::seed_from_u64(3));
        assert!((2.5..6.0).contains(&sides) && ideal.noise == 0.0 && ideal.dropout == 0.0 && ideal.occluder.is_none() && !ideal.table);
        let (sides, mild) = Sensing::Mild.draw(None, &mut ChaCha8Rng::seed_from_u64(3));
        assert!((2.5..6.0).contains(&sides) && mild.step == 0.0 && mild.pixels.is_none() && mild.mask_growth == 0);
    }
}
