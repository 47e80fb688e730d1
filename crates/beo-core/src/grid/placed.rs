//! How an object lies in a grid: turned, scaled, shifted.

use super::rotation::Rotation;
use nalgebra::{Matrix3, Vector3};

/// Takes the object's canonical grid to another grid: g = scale · R p + shift, both in voxels of their own grid, from its centre.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Placed {
    /// R: object axes to grid axes.
    pub rotation: Rotation,
    /// Edge of a voxel of the canonical grid, in voxels of the other.
    pub scale: f64,
    /// Where the centre of the canonical grid lies, in voxels.
    pub shift: Vector3<f64>,
}

impl Default for Placed {
    fn default() -> Self {
        Self::turned(Rotation::identity())
    }
}

impl Placed {
    /// Turned about the centre, neither scaled nor shifted.
    pub fn turned(rotation: Rotation) -> Self {
        Self { rotation, scale: 1.0, shift: Vector3::zeros() }
    }

    /// Whether nothing is scaled or shifted.
    pub fn is_turned_only(&self) -> bool {
        self.scale == 1.0 && self.shift == Vector3::zeros()
    }

    /// A point of the object's canonical grid, in the other.
    pub fn place(&self, point: &Vector3<f64>) -> Vector3<f64> {
        self.rotation * point * self.scale + self.shift
    }

    /// Matrix and offset that take a point of the canonical grid to the other.
    pub fn map(&self) -> (Matrix3<f64>, Vector3<f64>) {
        (self.rotation.to_rotation_matrix().matrix() * self.scale, self.shift)
    }

    /// Those of the way back.
    pub fn inverse_map(&self) -> (Matrix3<f64>, Vector3<f64>) {
        let back = self.rotation.inverse().to_rotation_matrix().matrix() / self.scale;
        (back, -(back * self.shift))
    }
}
