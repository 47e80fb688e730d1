//! The pose of every shape on its own: centre of mass, size, principal axes, and which ways round these leave open.
//!
//! Principal axes leave open which end is which: four ways by signs, 24 with the order of the axes, which is uncertain where two are
//! nearly as long.

use super::descent::Stage;
use super::transform::Pose;
use beo_core::grid::{Rotation, cube_rotations, yaw};
use nalgebra::Vector3;
use std::f64::consts::TAU;

/// Turns about the vertical that are tried where up is known.
const YAWS: usize = 16;

/// The ways round that are tried, the first of them none: the 24 rotations of the cube, or turns about z.
pub(super) fn ways(keep_up: bool) -> Vec<Rotation> {
    if keep_up {
        return (0..YAWS).map(|n| yaw(TAU * n as f64 / YAWS as f64)).collect();
    }
    cube_rotations()
}

impl Stage<'_> {
    /// Every shape along its principal axes, about the origin, all of one root mean square radius.
    pub fn normalised(&self) -> Vec<Pose> {
        let pose = |rotation| Pose { rotation, log_scale: 0.0, centre: Vector3::zeros() };
        self.solids.iter().map(|solid| pose(solid.principal(self.settings.keep_up))).collect()
    }
}
