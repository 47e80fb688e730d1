//! Shapes in: meshes and voxel files of many formats become complete objects on a grid.
//!
//! [`read_shape`] reads one file, [`library::scan`] and [`library::load`] a folder `DIR/<class>/<split>/*` or `DIR/*`. Every `parse_*`
//! function takes untrusted bytes: it neither panics nor allocates more than a small multiple of their number (and of the
//! largest grid).

pub mod alignment;
mod alignment_file;
mod binvox;
mod error;
pub mod household;
pub mod library;
mod mesh;
mod npy;
mod obj;
mod off;
mod ply;
mod read;
mod stl;
mod units;
mod voxelise;

pub use alignment_file::{ALIGNMENT_FILE, AlignedClass, AlignedFile, Alignment, AlignmentFileError, is_placed};
pub use beo_core::furniture;
pub use beo_core::grid::longest_side;
pub use binvox::{binvox_scale, parse_binvox, write_binvox, write_binvox_scaled};
pub use error::{FormatError, ReadError};
pub use mesh::{Mesh, MeshError, Up};
pub use npy::check_npy_header;
pub use npy::{parse_npy, parse_npy_observation, write_npy_observation};
pub use obj::parse_obj;
pub use off::{parse_off, write_off};
pub use ply::parse_ply;
pub use read::read_bytes;
pub use read::{Content, Format, Placing, ReadOptions, parse, read_observation, read_shape, read_sized_shape};
pub use stl::parse_stl;
pub use units::{UNITS_FILE, Units, UnitsError};
pub use voxelise::{surface, voxelise, voxelise_unit_cube};
