//! Geometry for other programs: completions as surfaces, observations as points, both in metres where the grid lies, and as PLY files for
//! RViz, MeshLab and Blender.
//!
//! | file | what |
//! | --- | --- |
//! | `placement` | where a grid lies |
//! | `surface` | the surface of a completion, by surface nets |
//! | `points` | the filled voxels of an observation as points |
//! | `ply` | both as binary PLY |

mod placement;
mod ply;
mod points;
mod surface;

pub use placement::GridPlacement;
pub use ply::{PlyError, ply_of_points, ply_of_surface, save};
pub use points::{Point, points_of};
pub use surface::{Surface, Vertex, surface_of};
