//! Noise and missing readings of a real depth sensor, modelled on structured light of the first Kinect's kind.
//!
//! In this order: strips without reading where the projector's light is blocked, edges that are missing or lie between the surfaces,
//! grazing and random dropout, Gaussian noise by depth, steps of disparity, the range. The defaults are what 12 frames of such a camera
//! show (0.5 to 1.5 m): on planes 1.7 mm/m² · z² altogether, neighbours correlated by 0.65, 2.85 mm/m² · z² from step to step.

use super::{DepthImage, SyntheticCamera};
use beo_camera::{Intrinsics, SensorModel};
use nalgebra::Vector3;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

/// Faults of a depth sensor. [`NoiseModel::NONE`] has none.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NoiseModel {
    /// Standard deviation of the Gaussian noise by depth (its number of deviations is not used); default 0.2 mm + 1.5 mm/m² · z².
    /// Neighbouring pixels share it in part, as they share what the sensor matches: their correlation is 2/3 along rows and columns.
    pub sensor: SensorModel,
    /// Inverse depths are rounded to multiples of this, 1 / metres, so that steps of depth grow with z²; 0 for none; default 0.00285.
    pub inverse_depth_step_per_m: f64,
    /// Nearest and farthest reading, metres; default 0.35 to 4.
    pub range_m: [f64; 2],
    /// Share of all pixels without reading; default 0.0003.
    pub dropout: f64,
    /// Angles between the surface's normal and the ray from which on some and all readings are missing, radians; default 75° and 87°.
    pub grazing_rad: [f64; 2],
    /// How far the projector is to the right of the camera, metres (left if negative): what it does not light has no reading; 0 for none;
    /// default 0.05.
    pub baseline_m: f64,
    /// Share of the pixels at edges of depth without reading; default 0.35.
    pub edge_dropout: f64,
    /// Share of the pixels at edges of depth that show something between the near and the far surface; default 0.1.
    pub flying: f64,
}

/// Numbers that describe no sensor.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("the noise model's {field} is {value}: {expected}")]
pub struct NoiseModelError {
    /// Which number.
    pub field: &'static str,
    /// Its value.
    pub value: f64,
    /// The condition that it breaks.
    pub expected: &'static str,
}

impl Default for NoiseModel {
    fn default() -> Self {
        Self {
            sensor: SensorModel { constant_m: 0.0002, quadratic_per_m: 0.0015, deviations: 2.0 },
            inverse_depth_step_per_m: 0.00285,
            range_m: [0.35, 4.0],
            dropout: 0.0003,
            grazing_rad: [75_f64.to_radians(), 87_f64.to_radians()],
            baseline_m: 0.05,
            edge_dropout: 0.35,
            flying: 0.1,
        }
    }
}

/// Neighbours whose depths differ by more than this share lie on different surfaces.
const EDGE: f32 = 0.02;

impl NoiseModel {
    /// A perfect sensor.
    pub const NONE: Self = Self {
        sensor: SensorModel { constant_m: 0.0, quadratic_per_m: 0.0, deviations: 0.0 },
        inverse_depth_step_per_m: 0.0,
        range_m: [0.0, f64::INFINITY],
        dropout: 0.0,
        grazing_rad: [std::f64::consts::PI; 2],
        baseline_m: 0.0,
        edge_dropout: 0.0,
        flying: 0.0,
    };

    /// Checks the numbers.
    pub fn check(&self) -> Result<(), NoiseModelError> {
        let fields = [
            ("constant noise", self.sensor.constant_m),
            ("quadratic noise", self.sensor.quadratic_per_m),
            ("step of inverse depth", self.inverse_depth_step_per_m),
            ("nearest reading", self.range_m[0]),
            ("first grazing angle", self.grazing_rad[0]),
            ("second grazing angle", self.grazing_rad[1]),
        ];
        for (field, value) in fields {
            if !(value.is_finite() && value >= 0.0) {
                return Err(NoiseModelError { field, value, expected: "it must be finite and not negative" });
            }
        }
        for (field, value) in [("dropout", self.dropout), ("dropout at edges", self.edge_dropout), ("share of flying pixels", self.flying)]
        {
            if !(0.0..=1.0).contains(&value) {
                return Err(NoiseModelError { field, value, expected: "a share lies from 0 to 1" });
            }
        }
        if !self.baseline_m.is_finite() {
            return Err(NoiseModelError { field: "baseline", value: self.baseline_m, expected: "it must be finite" });
        }
        for (field, [low, high]) in [("farthest reading", self.range_m), ("second grazing angle", self.grazing_rad)] {
            if high.is_nan() || high < low {
                return Err(NoiseModelError { field, value: high, expected: "it must not be less than the first" });
            }
        }
        Ok(())
    }

    /// Turns an exact image of this camera into what the sensor would deliver; labels stay. The same seed gives the same image.
    ///
    /// # Panics
    /// If the image is another camera's.
    pub fn apply(&self, camera: &SyntheticCamera, image: &mut DepthImage, seed: u64) {
        assert_eq!(camera.intrinsics(), image.intrinsics(), "an image of this camera");
        let intrinsics = *image.intrinsics();
        let (width, height) = (intrinsics.width() as usize, intrinsics.height() as usize);
        let exact = image.depth().to_vec();
        let white = WhiteNoise::new(width, height, seed);
        let (depth, _) = image.parts_mut();
        depth.par_chunks_exact_mut(width).enumerate().for_each(|(row, readings)| {
            let mut random = row_generator(seed, row, Purpose::Faults);
            let lit = self.lit(&intrinsics, &exact[row * width..][..width]);
            for (column, reading) in readings.iter_mut().enumerate() {
                // As many numbers for every pixel, whatever becomes of it.
                let [dropped, at_edge, mix, grazed] = [0; 4].map(|_| f64::from(random.random::<f32>()));
                let pixel = Pixel { exact: &exact, camera, row, column };
                let mut z = pixel.depth();
                if z <= 0.0 {
                    continue;
                }
                let mut is_missing = !lit[column] || dropped < self.dropout;
                if let Some(other) = pixel.other_surface() {
                    is_missing |= at_edge < self.edge_dropout;
                    if other > 0.0 && at_edge >= 1.0 - self.flying {
                        z = other + mix * (z - other);
                    }
                }
                is_missing |= grazed < self.grazing(&pixel);
                z += self.sensor.deviation(z) * white.correlated(row, column);
                if self.inverse_depth_step_per_m > 0.0 {
                    let step = self.inverse_depth_step_per_m;
                    z = 1.0 / ((1.0 / z / step).round() * step);
                }
                is_missing |= !(z > 0.0 && z >= self.range_m[0] && z <= self.range_m[1]);
                *reading = if is_missing { 0.0 } else { z as f32 };
            }
        });
    }

    /// Probability that a reading is missing because the surface is seen at a grazing angle.
    fn grazing(&self, pixel: &Pixel<'_>) -> f64 {
        let [some, all] = self.grazing_rad;
        if some >= std::f64::consts::FRAC_PI_2 {
            return 0.0;
        }
        let angle = pixel.angle();
        if angle >= all { 1.0 } else { ((angle - some) / (all - some)).max(0.0) }
    }

    /// Which pixels of a row the projector lights: a nearest-depth buffer along the projector's row. The projector's row is taken to be
    /// the camera's, which is exact without distortion.
    fn lit(&self, intrinsics: &Intrinsics, exact: &[f32]) -> Vec<bool> {
        let mut lit = vec![true; exact.len()];
        if self.baseline_m == 0.0 {
            return lit;
        }
        // Where the projector sees a pixel's point, in columns of the camera; `shift` keeps them from being negative.
        let focal_baseline = intrinsics.focal()[0] * self.baseline_m;
        let Some(nearest) = exact.iter().copied().filter(|z| *z > 0.0).reduce(f32::min) else { return lit };
        let shift = (focal_baseline.abs() / f64::from(nearest)).ceil().min(4.0 * exact.len() as f64) + 2.0;
        let column = |n: usize, z: f32| n as f64 - focal_baseline / f64::from(z) + shift;
        let mut buffer = vec![f32::INFINITY; exact.len() + 2 * shift as usize + 2];
        let last = buffer.len() - 1;
        for (n, z) in exact.iter().copied().enumerate().filter(|(_, z)| *z > 0.0) {
            let at = column(n, z).max(0.0);
            // Both columns that it touches, so that surfaces have no holes.
            for cell in [at.floor() as usize, at.ceil() as usize] {
                let cell = &mut buffer[cell.min(last)];
                *cell = cell.min(z);
            }
        }
        for (n, z) in exact.iter().copied().enumerate().filter(|(_, z)| *z > 0.0) {
            let before = buffer[(column(n, z).max(0.0).round() as usize).min(last)];
            lit[n] = before >= z * (1.0 - EDGE);
        }
        lit
    }
}

/// One pixel of an exact image with its neighbours.
struct Pixel<'a> {
    exact: &'a [f32],
    camera: &'a SyntheticCamera,
    row: usize,
    column: usize,
}

/// Steps to the four neighbours: columns to the right, rows down.
const NEIGHBOURS: [[isize; 2]; 4] = [[-1, 0], [1, 0], [0, -1], [0, 1]];

impl Pixel<'_> {
    fn depth(&self) -> f64 {
        f64::from(self.at([0, 0]).unwrap_or(0.0))
    }

    fn index(&self, [right, down]: [isize; 2]) -> Option<usize> {
        let width = self.camera.intrinsics().width() as usize;
        let (column, row) = (self.column.checked_add_signed(right)?, self.row.checked_add_signed(down)?);
        (column < width).then_some(row * width + column)
    }

    /// Depth so many columns to the right and rows down; `None` outside of the image.
    fn at(&self, step: [isize; 2]) -> Option<f32> {
        self.exact.get(self.index(step)?).copied()
    }

    /// Whether the neighbour shows the same surface: about as deep, or on a line with the pixel beyond it (on planes, inverse depth is
    /// linear in the image).
    fn continues(&self, step: [isize; 2], neighbour: f32) -> bool {
        let own = self.depth() as f32;
        if neighbour <= 0.0 || (neighbour - own).abs() <= EDGE * own.min(neighbour) {
            return neighbour > 0.0;
        }
        let beyond = self.at(step.map(|n| 2 * n)).filter(|z| *z > 0.0);
        beyond.is_some_and(|beyond| {
            let (jump, next) = (1.0 / own - 1.0 / neighbour, 1.0 / neighbour - 1.0 / beyond);
            (jump - next).abs() < 0.5 * jump.abs()
        })
    }

    /// Depth of the most different surface among the four neighbours; 0 for nothing; `None` if they all show the same.
    fn other_surface(&self) -> Option<f64> {
        let own = self.depth() as f32;
        let neighbours = NEIGHBOURS.into_iter().filter_map(|step| Some((step, self.at(step)?)));
        let others = neighbours.filter(|(step, z)| !self.continues(*step, *z)).map(|(_, z)| z);
        others.max_by(|a, b| (a - own).abs().total_cmp(&(b - own).abs())).map(f64::from)
    }

    fn point(&self, step: [isize; 2]) -> Option<Vector3<f64>> {
        let n = self.index(step)?;
        let [x, y] = self.camera.rays()[n];
        Some(Vector3::new(x, y, 1.0) * f64::from(self.exact[n]))
    }

    /// Angle between the ray and the normal of the surface through the neighbours, radians; 0 where they do not tell.
    fn angle(&self) -> f64 {
        let neighbour = |step| self.at(step).filter(|z| self.continues(step, *z)).and_then(|_| self.point(step));
        // Across the pixel if both sides show its surface, else to the one that does.
        let difference = |step: [isize; 2]| match (neighbour(step), neighbour(step.map(|n| -n))) {
            (Some(after), Some(before)) => Some(after - before),
            (Some(after), None) => Some(after - self.point([0, 0])?),
            (None, Some(before)) => Some(self.point([0, 0])? - before),
            (None, None) => None,
        };
        let (Some(across), Some(down), Some(ray)) = (difference([1, 0]), difference([0, 1]), self.point([0, 0])) else { return 0.0 };
        let normal = across.cross(&down);
        let length = normal.norm() * ray.norm();
        if length > 0.0 { (normal.dot(&ray).abs() / length).min(1.0).acos() } else { 0.0 }
    }
}

/// The use of a row's random numbers.
#[derive(Clone, Copy)]
enum Purpose {
    Faults,
    White,
}

/// Rows have generators of their own, so that threads do not matter.
fn row_generator(seed: u64, row: usize, purpose: Purpose) -> ChaCha8Rng {
    let mut generator = ChaCha8Rng::seed_from_u64(seed);
    generator.set_stream(2 * row as u64 + purpose as u64);
    generator
}

/// Independent Gaussian numbers, one per pixel and one pixel beyond each border.
struct WhiteNoise {
    values: Vec<f32>,
    stride: usize,
}

impl WhiteNoise {
    fn new(width: usize, height: usize, seed: u64) -> Self {
        let stride = width + 2;
        let mut values = vec![0.0; stride * (height + 2)];
        values.par_chunks_exact_mut(stride).enumerate().for_each(|(row, values)| {
            let mut random = row_generator(seed, row, Purpose::White);
            for pair in values.chunks_mut(2) {
                // Box and Muller.
                let radius = (-2.0 * (1.0 - random.random::<f32>()).ln()).sqrt();
                let (sin, cos) = (std::f32::consts::TAU * random.random::<f32>()).sin_cos();
                pair.iter_mut().zip([radius * cos, radius * sin]).for_each(|(value, number)| *value = number);
            }
        });
        Self { values, stride }
    }

    /// A standard normal number; those of neighbours are correlated by 2/3: the binomial filter 1 2 1 of both directions.
    fn correlated(&self, row: usize, column: usize) -> f64 {
        const WEIGHTS: [f32; 3] = [1.0, 2.0, 1.0];
        let mut sum = 0.0;
        for (down, by_row) in WEIGHTS.iter().enumerate() {
            let values = &self.values[(row + down) * self.stride + column..][..3];
            sum += by_row * (values[0] + 2.0 * values[1] + values[2]);
        }
        // √(1 + 4 + 1) of each direction.
        f64::from(sum) / 6.0
    }
}

#[cfg(test)]
mod tests {
    use super::super::{Scene, orbit};
    use super::*;
    use nalgebra::{Isometry3, Point3};

    const WIDTH: usize = 640;

    fn camera() -> SyntheticCamera {
        SyntheticCamera::new(Intrinsics::new(WIDTH as u32, 480, [525.0; 2], [319.5, 239.5], [0.0; 5]).unwrap())
    }

    /// A wall across the optical axis at `z`, and in front of its right half another at `near`.
    fn walls(z: f64, near: Option<f64>) -> DepthImage {
        let mut scene = Scene::new();
        scene.add_table([100.0; 2], Isometry3::translation(0.0, 0.0, z), 1);
        if let Some(near) = near {
            scene.add_table([100.0; 2], Isometry3::translation(50.0, 0.0, near), 2);
        }
        camera().render(&scene, &Isometry3::identity())
    }

    fn applied(model: NoiseModel, mut image: DepthImage) -> Vec<f64> {
        model.check().unwrap();
        model.apply(&camera(), &mut image, 5);
        image.depth().iter().map(|z| f64::from(*z)).collect()
    }

    #[test]
    fn gaussian_noise_has_the_stated_deviation_and_correlation() {
        let sensor = SensorModel { constant_m: 0.001, quadratic_per_m: 0.002, deviations: 2.0 };
        for z in [0.5, 1.0, 2.0] {
            let errors: Vec<f64> = applied(NoiseModel { sensor, ..NoiseModel::NONE }, walls(z, None)).iter().map(|d| d - z).collect();
            let n = errors.len() as f64;
            let mean = errors.iter().sum::<f64>() / n;
            let variance = errors.iter().map(|e| e * e).sum::<f64>() / n;
            let expected = 0.001 + 0.002 * z * z;
            assert!(mean.abs() < 0.02 * expected, "{mean}");
            assert!((variance.sqrt() / expected - 1.0).abs() < 0.01, "{} {expected}", variance.sqrt());
            let product = |step: usize| errors.windows(step + 1).map(|w| w[0] * w[step]).sum::<f64>() / n / variance;
            assert!((product(1) - 2.0 / 3.0).abs() < 0.02 && (product(WIDTH) - 2.0 / 3.0).abs() < 0.02 && product(3).abs() < 0.02);
        }
    }

    #[test]
    fn disparity_has_steps_that_grow_with_the_square_of_the_depth() {
        let step = 0.003;
        let sensor = SensorModel { constant_m: 0.0, quadratic_per_m: 0.004, deviations: 2.0 };
        let model = NoiseModel { sensor, inverse_depth_step_per_m: step, ..NoiseModel::NONE };
        for z in [0.6, 1.5] {
            let mut depths = applied(model, walls(z, None));
            assert!(depths.iter().all(|d| ((1.0 / d / step).round() - 1.0 / d / step).abs() < 1e-3));
            depths.sort_by(f64::total_cmp);
            depths.dedup();
            let gaps: Vec<f64> = depths.windows(2).map(|w| w[1] - w[0]).filter(|gap| *gap > 1e-5).collect();
            assert!(gaps.len() > 4 && gaps.iter().all(|gap| (gap / (step * z * z) - 1.0).abs() < 0.1), "{gaps:?}");
        }
    }

    #[test]
    fn readings_are_missing_at_random_and_out_of_range() {
        let missing = |model, image| applied(model, image).iter().filter(|d| **d == 0.0).count();
        let pixels = WIDTH * 480;
        let dropped = missing(NoiseModel { dropout: 0.02, ..NoiseModel::NONE }, walls(1.0, None)) as f64 / pixels as f64;
        assert!((dropped - 0.02).abs() < 0.002, "{dropped}");
        let model = NoiseModel { range_m: [0.4, 3.0], ..NoiseModel::NONE };
        assert_eq!([0.39, 0.41, 2.99, 3.01].map(|z| missing(model, walls(z, None))), [pixels, 0, 0, pixels]);
        assert_eq!(missing(NoiseModel::NONE, walls(1.0, Some(0.5))), 0);
    }

    #[test]
    fn the_projector_casts_a_shadow_on_the_left_of_what_is_near() {
        let image = walls(1.2, Some(0.6));
        let depths = applied(NoiseModel { baseline_m: 0.06, ..NoiseModel::NONE }, image.clone());
        // f b (1 / near − 1 / far), the pixels that the far wall loses left of the edge.
        let width = 525.0 * 0.06 * (1.0 / 0.6 - 1.0 / 1.2);
        let row = &depths[100 * WIDTH..101 * WIDTH];
        let edge = image.labels()[100 * WIDTH..101 * WIDTH].iter().position(|label| *label == 2).unwrap();
        let missing: Vec<usize> = (0..WIDTH).filter(|n| row[*n] == 0.0).collect();
        assert!((missing.len() as f64 - width).abs() <= 1.5, "{} {width}", missing.len());
        assert!(missing.iter().all(|n| (edge - width as usize - 2..edge).contains(n)), "{missing:?} {edge}");
        // A pole in the air hides the wall only where its shadow falls.
        let mut scene = Scene::new();
        scene.add_table([100.0; 2], Isometry3::translation(0.0, 0.0, 2.0), 1);
        scene.add_table([0.01, 100.0], Isometry3::translation(0.0, 0.0, 0.5), 2);
        let pole = camera().render(&scene, &Isometry3::identity());
        let depths = applied(NoiseModel { baseline_m: 0.06, ..NoiseModel::NONE }, pole);
        let missing = depths[..WIDTH].iter().filter(|d| **d == 0.0).count();
        assert!((9..=13).contains(&missing), "as wide as the pole, 10.5 pixels: {missing}");
    }

    #[test]
    fn pixels_at_edges_fly_between_the_surfaces_or_are_missing() {
        let image = walls(1.2, Some(0.6));
        let depths = applied(NoiseModel { flying: 0.3, edge_dropout: 0.2, ..NoiseModel::NONE }, image.clone());
        let edge = image.labels()[..WIDTH].iter().position(|label| *label == 2).unwrap();
        let beside = |d: &(usize, &f64)| [edge - 1, edge].contains(&(d.0 % WIDTH));
        let (at, elsewhere): (Vec<_>, Vec<_>) = depths.iter().enumerate().partition(beside);
        assert!(elsewhere.iter().all(|(_, d)| (**d - 0.6).abs() < 1e-6 || (**d - 1.2).abs() < 1e-6));
        let share = |what: &dyn Fn(f64) -> bool| at.iter().filter(|(_, d)| what(**d)).count() as f64 / at.len() as f64;
        assert!((share(&|d| d == 0.0) - 0.2).abs() < 0.05);
        assert!((share(&|d| d > 0.601 && d < 1.199) - 0.3).abs() < 0.06);
    }

    #[test]
    fn surfaces_at_grazing_angles_are_lost() {
        let camera = camera();
        let share = |elevation: f64| {
            let mut scene = Scene::new();
            scene.add_table([40.0; 2], Isometry3::identity(), 1);
            let mut image = camera.render(&scene, &orbit(&Point3::origin(), 1.0, 0.0, elevation.to_radians()));
            // The middle row, where the angle is what the elevation says.
            let model = NoiseModel { grazing_rad: [70_f64.to_radians(), 80_f64.to_radians()], ..NoiseModel::NONE };
            model.apply(&camera, &mut image, 5);
            let rows = &image.depth()[238 * WIDTH..242 * WIDTH];
            rows.iter().filter(|d| **d == 0.0).count() as f64 / rows.len() as f64
        };
        assert_eq!(share(45.0), 0.0);
        assert_eq!(share(5.0), 1.0);
        // 75° in the middle, more at the sides, where the table is as far below but farther away: the mean over a row.
        let at = |column: usize| {
            let x = (column as f64 - 319.5) / 525.0;
            let angle = (15_f64.to_radians().sin() / (1.0 + x * x).sqrt()).acos().to_degrees();
            ((angle - 70.0) / 10.0).clamp(0.0, 1.0)
        };
        let expected = (0..WIDTH).map(at).sum::<f64>() / WIDTH as f64;
        assert!((share(15.0) - expected).abs() < 0.03, "{} {expected}", share(15.0));
    }

    #[test]
    fn the_same_seed_gives_the_same_image_on_any_number_of_threads() {
        let image = |seed| {
            let mut image = walls(1.2, Some(0.6));
            NoiseModel::default().apply(&camera(), &mut image, seed);
            image
        };
        let alone = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
        assert_eq!(alone.install(|| image(3)), image(3));
        assert_ne!(image(3).depth(), image(4).depth());
        assert_eq!(image(3).labels(), walls(1.2, Some(0.6)).labels());
    }

    #[test]
    fn numbers_that_describe_no_sensor_are_named() {
        let message = |model: NoiseModel| model.check().unwrap_err().to_string();
        let good = NoiseModel::default();
        assert!(good.check().is_ok() && NoiseModel::NONE.check().is_ok());
        assert!(message(NoiseModel { dropout: 1.5, ..good }).contains("dropout is 1.5"));
        assert!(message(NoiseModel { range_m: [2.0, 1.0], ..good }).contains("farthest reading"));
        assert!(message(NoiseModel { baseline_m: f64::NAN, ..good }).contains("baseline"));
        assert!(message(NoiseModel { inverse_depth_step_per_m: -1.0, ..good }).contains("step of inverse depth"));
    }
}
