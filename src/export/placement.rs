//! Where a grid lies in the frame of the sensor or the world, as an observation's header says it.

use beo_core::grid::{Dims, Rotation};
use nalgebra::{Point3, Vector3};

/// Takes places in a grid to the frame that the observation named.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GridPlacement {
    /// The grid's centre, metres.
    pub position_m: [f64; 3],
    /// Turns the grid's axes into those of the frame.
    pub orientation: Rotation,
    /// Edge of a voxel, metres; 1 where the scale is not known: lengths then count voxels.
    pub voxel_size_m: f64,
}

impl Default for GridPlacement {
    /// About the origin, along the axes; lengths count voxels.
    fn default() -> Self {
        Self { position_m: [0.0; 3], orientation: Rotation::identity(), voxel_size_m: 1.0 }
    }
}

impl GridPlacement {
    /// The place in the frame of a point of a grid, in voxels from the grid's corner: the centre of voxel (i, j, k) is at
    /// (i + ½, j + ½, k + ½).
    pub fn place(&self, dims: Dims, [x, y, z]: [f64; 3]) -> Point3<f64> {
        let middle = Vector3::from(<[usize; 3]>::from(dims).map(|side| side as f64 / 2.0));
        Point3::from(self.position_m) + self.orientation * ((Vector3::new(x, y, z) - middle) * self.voxel_size_m)
    }

    /// The same grid of a completion in the object's frame: the object's axes take the place of the grid's.
    pub fn turned_by(self, rotation_object_to_grid: &Rotation) -> Self {
        Self { orientation: self.orientation * rotation_object_to_grid, ..self }
    }
}
