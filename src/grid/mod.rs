//! Voxel grids: complete objects (two-valued), observations (three-valued), index order and views.
//!
//! Index order everywhere is C order `[x][y][z]`, z fastest and up, so that NumPy reads a payload with `reshape(nx, ny, nz)`.

mod dims;
mod observation;
mod occupancy;
mod runs;
mod view;

pub use dims::{Dims, DimsError};
pub use observation::{EMPTY, FILLED, Observation, ObservationError, UNKNOWN};
pub use occupancy::Occupancy;
pub use runs::for_each_run;
pub use view::View;
