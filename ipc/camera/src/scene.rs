//! A frame, and the support plane of an object in it, as the readings of an object are told from others.

use crate::SensorModel;
use crate::joining::Joint;
use crate::rays::Rays;
use crate::support::Plane;

/// A support plane where one object stands.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LocalSupport {
    /// The plane.
    pub plane: Plane,
    /// Scatter of the readings around the object about it, metres: one standard deviation.
    pub deviation_m: f64,
}

/// A frame that is looked at, object by object.
pub struct Scene<'a> {
    /// Directions of the pixels.
    pub rays: &'a Rays,
    /// Readings, metres; 0 for none.
    pub depth: &'a [f32],
    /// The mask's labels.
    pub labels: &'a [u16],
    /// The sensor.
    pub sensor: &'a SensorModel,
    /// The rule by which neighbours are on one surface.
    pub joint: Joint,
}
