//! How far a reading may be from the surface, by depth.

/// Standard deviation of a reading: σ(z) = constant + quadratic · z², metres. The band within which a voxel counts as filled is so many
/// of it, and never thinner than the voxel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SensorModel {
    /// At depth 0, metres.
    pub constant_m: f64,
    /// Growth with the squared depth, 1 / metres: of stereo and structured light, disparity noise × pixel / (focal length × baseline).
    pub quadratic_per_m: f64,
    /// Half the width of the band, in standard deviations.
    pub deviations: f64,
}

/// Numbers that describe no sensor.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("the sensor model's {field} is {value}: it must be finite and not negative")]
pub struct SensorModelError {
    /// Which number.
    pub field: &'static str,
    /// Its value.
    pub value: f64,
}

impl Default for SensorModel {
    /// A structured-light camera of the first Kinect's kind: 1 mm + 1.9 mm/m² (after Nguyen, Izadi and Lovell, "Modeling Kinect sensor
    /// noise for improved 3D reconstruction and tracking", 3DIMPVT 2012), two deviations.
    fn default() -> Self {
        Self { constant_m: 0.001, quadratic_per_m: 0.0019, deviations: 2.0 }
    }
}

impl SensorModel {
    /// Checks the numbers.
    pub fn new(constant_m: f64, quadratic_per_m: f64, deviations: f64) -> Result<Self, SensorModelError> {
        for (field, value) in [("constant", constant_m), ("quadratic term", quadratic_per_m), ("number of deviations", deviations)] {
            if !(value.is_finite() && value >= 0.0) {
                return Err(SensorModelError { field, value });
            }
        }
        Ok(Self { constant_m, quadratic_per_m, deviations })
    }

    /// Standard deviation of a reading of `depth` metres, metres.
    #[inline]
    pub fn deviation(&self, depth: f64) -> f64 {
        self.constant_m + self.quadratic_per_m * depth * depth
    }

    /// Half the width of the band at that depth, metres.
    #[inline]
    pub fn half_band(&self, depth: f64) -> f64 {
        self.deviations * self.deviation(depth)
    }
}
