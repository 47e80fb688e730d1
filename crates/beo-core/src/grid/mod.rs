//! Voxel grids: complete objects (two-valued), observations (three-valued), index order, rotation, views, distances.
//!
//! Index order everywhere is C order `[x][y][z]`, z fastest and up, so that NumPy reads a payload with `reshape(nx, ny, nz)`.

mod dims;
mod distance;
mod height_map;
mod observation;
mod occupancy;
mod placed;
mod pooling;
mod raycast;
mod rotation;
mod runs;
mod shrinking;
mod turn;
mod view;

pub use dims::{Dims, DimsError, longest_side};
pub use distance::distance_transform;
pub use height_map::HeightMap;
pub use observation::{EMPTY, FILLED, Observation, ObservationError, UNKNOWN};
pub use occupancy::Occupancy;
pub use placed::Placed;
pub use pooling::Pooling;
pub use raycast::RayCaster;
pub use rotation::{Rotation, cube_rotations, from_xyzw, mean_rotation, to_xyzw, uniform_rotation, yaw, yaw_of};
pub use runs::for_each_run;
pub use shrinking::{Counts, Shrinking};
pub(crate) use turn::{ALONE, nearest};
pub use turn::{Outside, Turn, for_each_column_source};
pub use view::View;
