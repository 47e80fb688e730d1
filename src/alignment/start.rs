//! The pose of every shape on its own: centre of mass, size, principal axes, and which ways round these leave open.
//!
//! Principal axes leave open which end is which: four ways by signs, 24 with the order of the axes, which is uncertain where two are
//! nearly as long.

use super::descent::Stage;
use super::transform::Pose;
use crate::grid::{Rotation, yaw};
use nalgebra::{Unit, Vector3};
use std::f64::consts::{FRAC_PI_2, TAU};

/// Turns about the vertical that are tried where up is known.
const YAWS: usize = 16;

/// The ways round that are tried, the first of them none: the 24 rotations of the cube, or turns about z.
pub(super) fn ways(keep_up: bool) -> Vec<Rotation> {
    if keep_up {
        return (0..YAWS).map(|n| yaw(TAU * n as f64 / YAWS as f64)).collect();
    }
    let quarter = |axis: Unit<Vector3<f64>>, turns: usize| Rotation::from_axis_angle(&axis, turns as f64 * FRAC_PI_2);
    // Where the top goes, then a turn about the vertical before it goes there.
    let (x, y) = (Vector3::x_axis(), Vector3::y_axis());
    let tops = [quarter(x, 0), quarter(x, 1), quarter(x, 2), quarter(x, 3), quarter(y, 1), quarter(y, 3)];
    tops.iter().flat_map(|top| (0..4).map(move |turns| top * quarter(Vector3::z_axis(), turns))).collect()
}

impl Stage<'_> {
    /// Every shape along its principal axes, about the origin, all of one root mean square radius.
    pub fn normalised(&self) -> Vec<Pose> {
        let pose = |rotation| Pose { rotation, log_scale: 0.0, centre: Vector3::zeros() };
        self.solids.iter().map(|solid| pose(solid.principal(self.settings.keep_up))).collect()
    }
}
