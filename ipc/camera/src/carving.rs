//! Which voxels of a grid are filled, empty or unknown, given one depth image.
//!
//! A voxel is seen at the pixel that its centre projects to. Against the reading there it is
//! - **empty** where it lies in front of the surface by more than the band, whatever the surface belongs to;
//! - **filled** where it lies within the band and the pixel belongs to the object;
//! - **unknown** behind, within the band of something else, and where there is no reading or no pixel.
//!
//! The band is the sensor's, but never thinner than the voxel along the optical axis. What lies below the support plane is no part of the
//! object that stands on it: with a plane, such voxels are empty unless the object is seen there.

use crate::{Frame, Plane, SensorModel};
use nalgebra::{Isometry3, Point3, Vector3};

/// Voxel code: known to be empty.
pub const EMPTY: u8 = 0;
/// Voxel code: known to be filled.
pub const FILLED: u8 = 1;
/// Voxel code: not seen.
pub const UNKNOWN: u8 = 255;

/// Most voxels along a side.
const LONGEST_SIDE: usize = 256;

/// Where a grid lies: its size, and its frame (origin at the centre, axes along the indices) in the camera's.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Grid {
    dims: [usize; 3],
    voxel_size_m: f64,
    grid_to_camera: Isometry3<f64>,
}

/// Numbers that describe no grid.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum GridError {
    /// A side is out of range.
    #[error("a grid of {0:?} voxels is not supported: every side must be from 8 to 256")]
    Dims([usize; 3]),
    /// Not positive and finite.
    #[error("the voxels' edge is {0} m: it must be positive and finite")]
    VoxelSize(f64),
    /// Not finite.
    #[error("the grid's place is not finite")]
    Place,
    /// The buffer does not fit.
    #[error("{found} bytes for {expected} voxels of one byte each")]
    Length {
        /// Bytes given.
        found: usize,
        /// Bytes needed.
        expected: usize,
    },
}

impl Grid {
    /// A grid of `dims` voxels with edges of `voxel_size_m` metres; `grid_to_camera` takes its frame to the camera's.
    pub fn new(dims: [usize; 3], voxel_size_m: f64, grid_to_camera: Isometry3<f64>) -> Result<Self, GridError> {
        if dims.iter().any(|side| !(8..=LONGEST_SIDE).contains(side)) {
            return Err(GridError::Dims(dims));
        }
        if !(voxel_size_m.is_finite() && voxel_size_m > 0.0) {
            return Err(GridError::VoxelSize(voxel_size_m));
        }
        if !grid_to_camera.to_homogeneous().iter().all(|v| v.is_finite()) {
            return Err(GridError::Place);
        }
        Ok(Self { dims, voxel_size_m, grid_to_camera })
    }

    /// Voxels along x, y, z.
    pub fn dims(&self) -> [usize; 3] {
        self.dims
    }

    /// Number of voxels.
    pub fn voxels(&self) -> usize {
        self.dims.iter().product()
    }

    /// Edge of a voxel, metres.
    pub fn voxel_size_m(&self) -> f64 {
        self.voxel_size_m
    }

    /// Takes the grid's frame to the camera's.
    pub fn grid_to_camera(&self) -> &Isometry3<f64> {
        &self.grid_to_camera
    }

    /// Where the camera is in the grid's frame, metres.
    pub fn camera(&self) -> Point3<f64> {
        self.grid_to_camera.inverse_transform_point(&Point3::origin())
    }

    /// Centre of a voxel in the camera frame.
    pub fn centre(&self, voxel: [usize; 3]) -> Point3<f64> {
        let place = |axis: usize| (voxel[axis] as f64 + 0.5 - self.dims[axis] as f64 / 2.0) * self.voxel_size_m;
        self.grid_to_camera * Point3::new(place(0), place(1), place(2))
    }
}

/// Carves the grid of one object out of one frame.
#[derive(Clone, Copy, Debug)]
pub struct Carver<'a> {
    /// The image.
    pub frame: Frame<'a>,
    /// Label of the object.
    pub object: u16,
    /// How far readings may be from the surface.
    pub sensor: SensorModel,
    /// The plane that the object stands on, in the camera frame, if voxels below it are to be empty.
    pub support: Option<Plane>,
    /// Where the grid lies.
    pub grid: Grid,
}

impl Carver<'_> {
    /// Writes every voxel of the grid, C order `[x][y][z]`.
    pub fn carve(&self, voxels: &mut [u8]) -> Result<(), GridError> {
        let expected = self.grid.voxels();
        if voxels.len() != expected {
            return Err(GridError::Length { found: voxels.len(), expected });
        }
        voxels.chunks_exact_mut(self.layer()).enumerate().for_each(|(i, layer)| self.carve_layer(i, layer));
        Ok(())
    }

    /// Voxels of one layer of constant x: what [`Self::carve_layer`] writes. Layers can be carved in parallel.
    pub fn layer(&self) -> usize {
        self.grid.dims[1] * self.grid.dims[2]
    }

    /// Writes the voxels of layer `i` of constant x, y before z. `layer` has [`Self::layer`] bytes.
    pub fn carve_layer(&self, i: usize, layer: &mut [u8]) {
        let grid = &self.grid;
        let [_, ny, nz] = grid.dims;
        assert_eq!(layer.len(), ny * nz, "one byte per voxel of a layer");
        let up: Vector3<f64> = grid.grid_to_camera * Vector3::z() * grid.voxel_size_m;
        // Half of what a voxel measures along the optical axis.
        let thinnest = 0.5 * grid.voxel_size_m * grid.grid_to_camera.inverse_transform_vector(&Vector3::z()).abs().sum();
        // Projected column by column, so that the divisions are done several at a time.
        let mut at = [[f64::NAN; 2]; LONGEST_SIDE];
        for (j, column) in layer.chunks_exact_mut(nz).enumerate() {
            let bottom = grid.centre([i, j, 0]);
            let (height, rise) = self.support.map_or((f64::INFINITY, 0.0), |plane| (plane.height(&bottom), plane.normal().dot(&up)));
            self.frame.intrinsics().project_line(&bottom, &up, &mut at[..nz]);
            for (k, (code, at)) in column.iter_mut().zip(at).enumerate() {
                let seen = self.code(at, bottom.z + up.z * k as f64, thinnest);
                *code = if seen != FILLED && height + rise * (k as f64) < 0.0 { EMPTY } else { seen };
            }
        }
    }

    /// The code of a voxel that is seen at `at` (not a number: nowhere), `z` metres along the optical axis.
    #[inline]
    fn code(&self, at: [f64; 2], z: f64, thinnest: f64) -> u8 {
        let Some(pixel) = self.frame.intrinsics().pixel(at) else { return UNKNOWN };
        let Some(depth) = self.frame.depth(pixel) else { return UNKNOWN };
        let (behind, band) = (z - depth, self.sensor.half_band(depth).max(thinnest));
        if behind < -band {
            EMPTY
        } else if behind <= band && self.frame.label(pixel) == self.object {
            FILLED
        } else {
            UNKNOWN
        }
    }
}
