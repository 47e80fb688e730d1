//! The camera's side: depth images in, partial grids out. The geometry is the crate `beo_camera`'s; here is what needs files, shapes and
//! threads.
//!
//! | file | what |
//! | --- | --- |
//! | `carving` | a grid carved by all threads |
//! | `simulation` | what a camera sees of a complete voxel object |
//! | `synthetic` | a camera that renders depth of meshes and voxels, with a sensor's faults |

mod carving;
pub mod simulation;
pub mod synthetic;

pub use carving::carve;
