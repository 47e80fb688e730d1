//! The camera's side: depth images in, partial grids out. The geometry is the crate `beo_camera`'s; here is what needs files, shapes and
//! threads.
//!
//! | file | what |
//! | --- | --- |
//! | `carving` | a grid carved by all threads |
//! | `simulation` | what a camera sees of a complete voxel object |

mod carving;
pub mod simulation;

pub use carving::carve;
