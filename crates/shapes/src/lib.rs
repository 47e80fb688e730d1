//! Shapes in: meshes and voxel files of many formats become complete objects on a grid.
//!
//! [`read_shape`] reads one file, [`library::scan`] and [`library::load`] a folder `DIR/<class>/<split>/*` or `DIR/*`. Every `parse_*`
//! function takes untrusted bytes: it neither panics nor allocates more than a small multiple of their number (and of the
//! largest grid).

pub mod alignment;
mod alignment_file;
mod binvox;
mod bytes;
mod closing;
mod content;
mod error;
mod gltf;
pub mod household;
pub mod library;
mod lines;
mod mesh;
mod models;
pub mod npy;
mod obj;
mod off;
mod placing;
mod ply;
mod polygon;
mod read;
mod resample;
mod stl;
mod units;
mod voxelise;

pub use alignment_file::{ALIGNMENT_FILE, AlignedClass, AlignedFile, Alignment, is_placed};
pub use beo_core::furniture;
pub use beo_core::grid::longest_side;
pub use binvox::{binvox_scale, parse_binvox, write_binvox, write_binvox_scaled};
pub use bytes::read_bytes;
pub use closing::Close;
pub use content::Content;
pub use error::{AlignmentFileError, FormatError, ReadError};
pub use gltf::parse_gltf;
pub use mesh::{Mesh, MeshError, PointCloud, Up};
pub use npy::{parse_npy, parse_npy_observation, parse_npz, parse_npz_observation, write_npy_labels, write_npy_observation};
pub use obj::parse_obj;
pub use off::{parse_off, write_off};
pub use placing::Placing;
pub use ply::parse_ply;
pub use read::{Format, HOW_TO_CLOSE, Note, ReadOptions, Reading};
pub use read::{parse, read_content, read_observation, read_shape, read_shape_noted, usual_up};
pub use stl::parse_stl;
pub use units::{UNITS_FILE, Units, UnitsError};
pub use voxelise::{surface, voxelise, voxelise_unit_cube};
