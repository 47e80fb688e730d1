//! An image as depth in metres along the optical axis: units, codes for "no reading", range, and distances along the ray.

use super::{Image, Raster, problem};
use beo_camera::{Intrinsics, SensorModel};
use beo_shapes::FormatError;

/// Metres per unit of depth images of whole numbers, where nothing else is said: millimetres.
pub const MILLIMETRE: f64 = 0.001;

/// Metres per unit of a depth image.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DepthUnit {
    /// Of images of whole numbers.
    pub whole_m: f64,
    /// Of images of floating-point numbers.
    pub float_m: f64,
}

impl Default for DepthUnit {
    /// Millimetres in whole numbers, metres in floating-point ones.
    fn default() -> Self {
        Self { whole_m: MILLIMETRE, float_m: 1.0 }
    }
}

impl DepthUnit {
    /// The same for every type.
    pub fn all(metres: f64) -> Self {
        Self { whole_m: metres, float_m: metres }
    }

    /// That of an image.
    pub fn of(&self, raster: &Raster) -> f64 {
        if matches!(raster, Raster::Floats(_)) { self.float_m } else { self.whole_m }
    }
}

/// The length that depth images hold.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum DepthAlong {
    /// The coordinate along the optical axis, as depth cameras and renderers give it.
    #[default]
    Axis,
    /// The distance from the camera, as lidars and some simulators give it.
    Ray,
}

impl Raster {
    /// Depth in metres, 0 where there is no reading: at values that are 0, negative or not finite, at the largest value of a type of whole
    /// numbers, and at the values in `no_reading` (in the image's own units).
    ///
    /// # Errors
    /// Images that hold no depth: 8 bits a pixel, colours, JPEG.
    pub fn into_depth(self, unit: &DepthUnit, no_reading: &[f64]) -> Result<Image<f32>, FormatError> {
        let metres = unit.of(&self);
        let none = |value: f64| value <= 0.0 || no_reading.contains(&value);
        let scaled = |value: f64| if none(value) { 0.0 } else { (value * metres) as f32 };
        match self {
            Self::Words(image) => Ok(image.map(|value| if value == u16::MAX { 0.0 } else { scaled(value.into()) })),
            Self::Integers { image, largest } if largest > 255 => {
                Ok(image.map(|value| if value == largest { 0.0 } else { scaled(value as f64) }))
            }
            // Written so that NaN is none either.
            Self::Floats(image) => Ok(image.map(|value| if value.is_finite() { scaled(value.into()) } else { 0.0 })),
            Self::Bytes(_) | Self::Indexed { .. } | Self::Integers { .. } => {
                Err(problem("depth", "8 bits a pixel: depth needs 16 bits, or floating-point metres".into()))
            }
            Self::Colours(_) => {
                Err(problem("depth", "an image in colours: depth has one channel of 16 bits, or floating-point metres".into()))
            }
            Self::Lossy(_) => Err(problem("depth", "JPEG changes values: save depth as PNG of 16 bits, TIFF or .npy".into())),
        }
    }
}

/// Takes distances along the rays to depths along the optical axis. What no ray leads to has no reading.
pub fn z_of_distances(depth: &mut Image<f32>, camera: &Intrinsics) {
    let width = depth.width.max(1) as usize;
    for (index, reading) in depth.values.iter_mut().enumerate().filter(|(_, reading)| **reading > 0.0) {
        let ray = camera.unproject([(index % width) as f64, (index / width) as f64]);
        *reading = ray.map_or(0.0, |ray| (f64::from(*reading) / ray.norm()) as f32);
    }
}

/// Leaves the readings from `near_m` to `far_m`.
pub fn limited(depth: &mut Image<f32>, near_m: f64, far_m: f64) {
    let outside = |reading: f32| !(f64::from(reading) >= near_m && f64::from(reading) <= far_m);
    depth.values.iter_mut().filter(|reading| outside(**reading)).for_each(|reading| *reading = 0.0);
}

/// Largest deviation of a reading that is used, as a share of its depth.
const LARGEST_DEVIATION: f64 = 0.02;

/// Farthest depth at which the deviation of a reading is at most two hundredths of it, σ(z) = c + q z² ≤ 0.02 z: 10.5 m for the
/// default sensor. Infinite where σ does not grow, or nowhere is so small.
pub fn farthest_m(sensor: &SensorModel) -> f64 {
    let (constant, quadratic) = (sensor.constant_m, sensor.quadratic_per_m);
    let discriminant = LARGEST_DEVIATION * LARGEST_DEVIATION - 4.0 * constant * quadratic;
    if quadratic <= 0.0 || discriminant < 0.0 {
        return f64::INFINITY;
    }
    (LARGEST_DEVIATION + discriminant.sqrt()) / (2.0 * quadratic)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row<T>(values: Vec<T>) -> Image<T> {
        Image::new(values.len() as u32, 1, values).unwrap()
    }

    fn depth(raster: Raster, unit: DepthUnit, no_reading: &[f64]) -> Vec<f32> {
        raster.into_depth(&unit, no_reading).unwrap().into_values()
    }

    #[test]
    fn whole_numbers_are_millimetres_and_floats_metres_unless_a_unit_is_given_for_both() {
        let (words, floats) = (|| Raster::Words(row(vec![0, 1500])), || Raster::Floats(row(vec![0.5, 750.0])));
        assert_eq!(depth(words(), DepthUnit::default(), &[]), [0.0, 1.5]);
        assert_eq!(depth(floats(), DepthUnit::default(), &[]), [0.5, 750.0]);
        // The PrimeSense convention of 0.1 mm; floating-point millimetres.
        assert_eq!(depth(words(), DepthUnit::all(1e-4), &[]), [0.0, 0.15]);
        assert_eq!(depth(floats(), DepthUnit::all(1e-3), &[]), [0.0005, 0.75]);
    }

    #[test]
    fn the_largest_value_of_the_type_and_those_named_are_no_reading() {
        assert_eq!(depth(Raster::Words(row(vec![65535, 65534, 32767])), DepthUnit::default(), &[65534.0]), [0.0, 0.0, 32.767]);
        let integers = Raster::Integers { image: row(vec![32767, 1000, -1]), largest: 32767 };
        assert_eq!(depth(integers, DepthUnit::default(), &[]), [0.0, 1.0, 0.0]);
        let floats = vec![f32::NAN, f32::INFINITY, -1.0, 9999.0, 2.0];
        assert_eq!(depth(Raster::Floats(row(floats)), DepthUnit::default(), &[9999.0]), [0.0, 0.0, 0.0, 0.0, 2.0]);
    }

    #[test]
    fn what_holds_no_depth_is_refused_with_the_reason() {
        let error = |raster: Raster| raster.into_depth(&DepthUnit::default(), &[]).unwrap_err().to_string();
        assert!(error(Raster::Bytes(row(vec![7]))).contains("16 bits"));
        assert!(error(Raster::Integers { image: row(vec![7]), largest: 127 }).contains("16 bits"));
        assert!(error(Raster::Colours(row(vec![[7; 4]]))).contains("colours"));
        assert!(error(Raster::Lossy(row(vec![7]))).contains("JPEG"));
    }

    #[test]
    fn a_distance_along_the_ray_is_that_of_the_same_point() {
        // Pixel (3, 0) of a camera with focal length 2 and centre (1, 0): the ray (1, 0, 1), of length √2.
        let camera = Intrinsics::new(4, 1, [2.0; 2], [1.0, 0.0], [0.0; 5]).unwrap();
        let mut depth = row(vec![0.0, 1.0, 1.0, 2.0_f32.sqrt()]);
        z_of_distances(&mut depth, &camera);
        assert_eq!((depth.values()[0], depth.values()[1]), (0.0, 1.0));
        assert!((depth.values()[3] - 1.0).abs() < 1e-6 && depth.values()[2] < 1.0);
    }

    #[test]
    fn readings_out_of_range_are_none() {
        let mut depth = row(vec![0.0, 0.1, 0.3, 10.0, 11.0]);
        limited(&mut depth, 0.3_f32.into(), 10.0);
        assert_eq!(depth.values(), [0.0, 0.0, 0.3, 10.0, 0.0]);
    }

    #[test]
    fn the_far_limit_is_where_the_deviation_is_two_hundredths_of_the_depth() {
        let sensor = SensorModel::default();
        let far = farthest_m(&sensor);
        assert!((far - 10.476).abs() < 1e-3 && (sensor.deviation(far) / far - 0.02).abs() < 1e-9, "{far}");
        assert_eq!(farthest_m(&SensorModel { quadratic_per_m: 0.0, ..sensor }), f64::INFINITY);
        assert_eq!(farthest_m(&SensorModel { constant_m: 1.0, ..sensor }), f64::INFINITY);
    }
}
