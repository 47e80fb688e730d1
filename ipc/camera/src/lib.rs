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
//! | `rays`, `blocks` | directions of the pixels; small flat squares of the image |
//! | `planes`, `supports` | the planes of a frame; those that objects stand on, and what is up |
//! | `plan_view`, `table_surface` | points as seen from above a plane; a table as the sensor bends it, and its outline |
//! | `tables`, `tracking` | objects without masks: what stands on a plane; their numbers from frame to frame |
//! | `joining`, `links`, `own_readings` | which neighbours lie on one surface; which readings of a mask are the object's own |
//! | `patch` | a rectangle of the depth image about some pixels |
//! | `regions` | pixels that hang together along rows and columns |
//! | `interior` | low readings that an object encloses: the floors of vessels |
//! | `consensus`, `cut` | the surface by neighbouring readings; what cuts an object off |
//! | `grids` | the one road, from a frame to the grids of all its objects |
//! | `parallel` | a grid carved by all threads (feature `parallel`) |
//! | `fusion` | several carved grids of one object in one |
//! | `fused` | several views of all objects, none of which moves |
//!
//! Knows nothing of shared memory, models and files, so that it can be linked anywhere: by the program `beo`, by `libbeo` for C and C++,
//! by a driver. Frames: the camera frame is the optical one (x right, y down, z along the optical axis; metres), pixels count from the
//! centre of the first one; a grid's frame has its origin at the grid's centre, axes along the indices, z up.

mod blocks;
mod carving;
mod consensus;
mod cut;
mod frame;
mod fused;
mod fusion;
mod grids;
mod interior;
mod intrinsics;
mod joining;
mod lens;
mod links;
mod own_readings;
mod parallel;
mod patch;
mod placement;
mod plan_view;
mod planes;
mod rays;
mod regions;
mod scene;
mod segments;
mod sensor;
mod support;
mod supports;
mod table_surface;
mod tables;
#[cfg(test)]
mod test_scene;
mod tracking;

pub use carving::{Carver, EMPTY, FILLED, Grid, GridError, UNKNOWN};
pub use cut::Cut;
pub use frame::{Frame, FrameError};
pub use fused::FusedObjects;
pub use fusion::{Fusion, FusionError};
pub use grids::{BelowSupport, FrameGrids, GridOptions, NoGrid, ObjectGrid, ObservedGrid, Observer, Quality, lay_grids};
pub use intrinsics::{Intrinsics, IntrinsicsError};
pub use lens::Lens;
pub use parallel::carve;
pub use placement::{Placement, PlacementError, place, place_in, reach_down};
pub use segments::Segments;
pub use sensor::{SensorModel, SensorModelError};
pub use support::{Plane, PlaneSearch, fit_support, fit_support_in, up_axis};
pub use tables::Segmentation;
