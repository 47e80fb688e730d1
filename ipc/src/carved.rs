//! The header of an observation that was carved from a depth frame: one place for what every camera driver says of its grids.

use crate::codes::{Outside, PoseSearch, ScaleSearch, Unit, View, tasks};
use crate::limits::{MAX_DIM, MIN_DIM, voxel_count};
use crate::messages::ObservationHeader;
use crate::text::to_field;
use crate::validate::{Refusal, validate};

/// A grid that was carved from a depth frame, in plain numbers: metres, unit quaternions x, y, z, w. Its own frame has its origin at the
/// grid's centre and its axes along the indices, z up.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CarvedGrid {
    /// Voxels along x, y, z.
    pub dims: [u32; 3],
    /// Edge of a voxel, metres.
    pub voxel_size_m: f64,
    /// The grid's centre in the camera's frame, metres.
    pub position_m: [f64; 3],
    /// Turns grid axes into axes of the camera's frame.
    pub orientation: [f64; 4],
    /// Where the camera is in the grid's frame, metres.
    pub camera_position_m: [f64; 3],
    /// The producer's own name for the object.
    pub object_id: u64,
    /// The causes that cut the object off: bits of [`crate::cut`].
    pub cut: u32,
    /// Share of the mask's readings that were left out as the support's, 0 to 1.
    pub share_support: f64,
    /// Share that was left out as lying at an edge in depth, 0 to 1.
    pub share_edge: f64,
    /// Share that was left out as not hanging together with the object, 0 to 1.
    pub share_far: f64,
    /// Standard deviation of the surface's position after consensus, metres; 0 where it is not said.
    pub surface_deviation_m: f64,
    /// The object's longest side, metres, where it is known; 0 where it is to be found.
    pub known_side_m: f64,
    /// Standard deviation of `known_side_m`, metres; 0: exact.
    pub known_side_deviation_m: f64,
}

impl CarvedGrid {
    /// A whole object in a grid of `dims` whose centre is the camera's, of which nothing more is said: to be filled in.
    pub const fn new(dims: [u32; 3]) -> Self {
        Self {
            dims,
            voxel_size_m: 0.0,
            position_m: [0.0; 3],
            orientation: [0.0, 0.0, 0.0, 1.0],
            camera_position_m: [0.0; 3],
            object_id: 0,
            cut: 0,
            share_support: 0.0,
            share_edge: 0.0,
            share_far: 0.0,
            surface_deviation_m: 0.0,
            known_side_m: 0.0,
            known_side_deviation_m: 0.0,
        }
    }
}

#[cfg(feature = "camera")]
impl CarvedGrid {
    /// The same, with what was found out about the object's readings.
    #[must_use]
    pub fn with_quality(self, quality: &beo_camera::Quality) -> Self {
        let bit = |is_set: bool, bit: u32| if is_set { bit } else { 0 };
        Self {
            cut: bit(quality.cut.border, crate::codes::cut::BORDER) | bit(quality.cut.occluder, crate::codes::cut::OCCLUDER),
            share_support: quality.share_support,
            share_edge: quality.share_edge,
            share_far: quality.share_far,
            surface_deviation_m: quality.surface_deviation_m,
            ..self
        }
    }
}

#[cfg(feature = "camera")]
impl From<&beo_camera::Grid> for CarvedGrid {
    /// Where the grid lies; of what it holds, nothing is said yet.
    fn from(grid: &beo_camera::Grid) -> Self {
        let place = grid.grid_to_camera();
        Self {
            voxel_size_m: grid.voxel_size_m(),
            position_m: place.translation.vector.into(),
            orientation: place.rotation.coords.into(),
            camera_position_m: grid.camera().into(),
            ..Self::new(grid.dims().map(|side| side as u32))
        }
    }
}

/// Why there is no header for a grid.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum CarvedGridError {
    /// A side is outside the limits.
    #[error("dims are {0:?}; each axis must have {MIN_DIM} to {MAX_DIM} voxels")]
    Dims([u32; 3]),
    /// The daemon would refuse it; lengths are told in 32-bit numbers of metres.
    #[error("the grid cannot be told to a daemon: {0}")]
    Refused(#[from] Refusal),
}

impl ObservationHeader {
    /// The header of a grid that was carved from a camera's frame: where it lies in the frame named "camera", in metres; where the camera
    /// is; size, place and rotation to be found (only the place and rotation where the longest side is known), the object resting on its
    /// support in any way that the model has learned, upright if it has learned none; class,
    /// pose and completion asked for; outside of the grid unknown. Frame name, stamps and any other wish are then the caller's to set.
    ///
    /// # Errors
    /// [`CarvedGridError`] if a daemon would refuse it: numbers that are not finite, out of range, or too small or large for 32 bits.
    pub fn of_grid(grid: &CarvedGrid) -> Result<Self, CarvedGridError> {
        let voxels = voxel_count(grid.dims).ok_or(CarvedGridError::Dims(grid.dims))?;
        let header = Self {
            object_id: grid.object_id,
            pose_search: PoseSearch::Rest.code(),
            position_m: grid.position_m,
            orientation: grid.orientation,
            voxel_size_m: grid.voxel_size_m as f32,
            tasks: tasks::ALL,
            outside: Outside::Unknown.code(),
            view: View::Camera.code(),
            frame_id: to_field("camera"),
            sensor_position_m: grid.camera_position_m.map(|metres| metres as f32),
            scale_search: ScaleSearch::Search.code(),
            known_side_m: grid.known_side_m as f32,
            known_side_deviation_m: grid.known_side_deviation_m as f32,
            unit: Unit::Metres.code(),
            cut: grid.cut,
            share_support: grid.share_support as f32,
            share_edge: grid.share_edge as f32,
            share_far: grid.share_far as f32,
            surface_deviation_m: grid.surface_deviation_m as f32,
            ..Self::new(grid.dims)
        };
        validate(&header, voxels)?;
        Ok(header)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cut;

    fn grid() -> CarvedGrid {
        CarvedGrid {
            voxel_size_m: 0.005,
            position_m: [0.1, -0.2, 0.9],
            orientation: [0.6, 0.0, 0.8, 0.0],
            camera_position_m: [-0.8, 0.0, 0.4],
            object_id: 7,
            cut: cut::BORDER,
            share_support: 0.25,
            share_edge: 0.125,
            share_far: 0.0625,
            surface_deviation_m: 0.002,
            known_side_m: 0.125,
            known_side_deviation_m: 0.01,
            ..CarvedGrid::new([30, 20, 10])
        }
    }

    #[test]
    fn the_header_says_all_that_the_driver_knows_and_leaves_the_rest_to_be_found() {
        let header = ObservationHeader::of_grid(&grid()).unwrap();
        assert_eq!((header.dims, header.voxel_size_m, header.object_id), ([30, 20, 10], 0.005, 7));
        assert_eq!((header.position_m, header.orientation), (grid().position_m, grid().orientation));
        assert_eq!((header.view, header.sensor_position_m), (View::Camera.code(), [-0.8, 0.0, 0.4]));
        assert_eq!((header.pose_search, header.scale_search), (PoseSearch::Rest.code(), ScaleSearch::Search.code()));
        assert_eq!((header.outside, header.unit, header.tasks), (Outside::Unknown.code(), Unit::Metres.code(), tasks::ALL));
        assert_eq!((header.cut, header.surface_deviation_m), (cut::BORDER, 0.002));
        assert_eq!([header.share_support, header.share_edge, header.share_far], [0.25, 0.125, 0.0625]);
        assert_eq!((header.known_side_m, header.known_side_deviation_m), (0.125, 0.01));
        assert_eq!(crate::text::from_field(&header.frame_id), "camera");
    }

    #[test]
    fn what_a_daemon_would_refuse_is_refused_here() {
        let refusal = |change: fn(&mut CarvedGrid)| {
            let mut grid = grid();
            change(&mut grid);
            ObservationHeader::of_grid(&grid).unwrap_err().to_string()
        };
        for (change, word) in [
            (|grid| grid.dims[1] = 7, "dims"),
            (|grid| grid.voxel_size_m = 1e-60, "voxel_size_m is 0;"),
            (|grid| grid.position_m[0] = f64::NAN, "position_m is not finite"),
            (|grid| grid.orientation = [0.0; 4], "orientation"),
            (|grid| grid.camera_position_m[2] = 1e60, "sensor_position_m is not finite"),
            (|grid| grid.camera_position_m = [0.0; 3], "sensor_position_m"),
            (|grid| grid.cut = 8, "cut"),
            (|grid| grid.share_edge = 2.0, "share_edge"),
            (|grid| grid.known_side_m = f64::INFINITY, "known_side_m"),
            (|grid| grid.surface_deviation_m = -1.0, "surface_deviation_m"),
        ] as [(fn(&mut CarvedGrid), &str); 10]
        {
            let text = refusal(change);
            assert!(text.contains(word), "{word}: {text}");
        }
    }
}
