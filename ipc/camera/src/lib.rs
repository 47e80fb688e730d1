//! From a depth image with an instance mask to a partial voxel grid of one object, ready for the daemon.
//!
//! | file | what |
//! | --- | --- |
//! | `intrinsics`, `lens` | the pinhole camera with lens distortion |
//! | `frame` | one depth image with its labels |
//! | `segments` | the pixels of each label |
//! | `sensor` | how far a reading may be from the surface, by depth |
//! | `support` | the plane that objects stand on, and what is up |
//! | `placement` | where the grid of an object lies and how big it is |
//! | `carving` | which voxels are filled, empty, unknown |
//! | `grids` | from a frame to the grids of all its objects |
//! | `parallel` | a grid carved by all threads (feature `parallel`) |
//! | `fusion` | several carved grids of one object in one |
//! | `fused` | several views of all objects, none of which moves |
//!
//! Knows nothing of shared memory, models and files, so that it can be linked anywhere: by the program `beo`, by `libbeo` for C and C++,
//! by a driver. Frames: the camera frame is the optical one (x right, y down, z along the optical axis; metres), pixels count from the
//! centre of the first one; a grid's frame has its origin at the grid's centre, axes along the indices, z up.

mod carving;
mod frame;
mod fused;
mod fusion;
mod grids;
mod intrinsics;
mod lens;
mod parallel;
mod placement;
mod segments;
mod sensor;
mod support;

pub use carving::{Carver, EMPTY, FILLED, Grid, GridError, UNKNOWN};
pub use frame::{Frame, FrameError};
pub use fused::FusedObjects;
pub use fusion::{Fusion, FusionError};
pub use grids::{BelowSupport, FrameGrids, GridOptions, NoGrid, ObjectGrid, lay_grids};
pub use intrinsics::{Intrinsics, IntrinsicsError};
pub use lens::Lens;
pub use parallel::carve;
pub use placement::{Placement, PlacementError, place, place_in};
pub use segments::Segments;
pub use sensor::{SensorModel, SensorModelError};
pub use support::{Plane, PlaneSearch, fit_support, fit_support_in, up_axis};
