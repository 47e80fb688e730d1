//! Complete shapes, from files and made up, and what is seen of them from above.

use crate::arrays::{array, bytes, dims, occupancy};
use crate::failures::{invalid, of_shape_file};
use beo_core::grid::{Dims, Occupancy, View};
use beo_shapes::{ReadOptions, Up, household, read_shape};
use pyo3::prelude::*;
use std::path::PathBuf;

/// Reads a complete shape onto a grid: a mesh or a voxel file (.off, .obj, .stl, .ply, .glb, .gltf, .binvox, .npy, .npz).
///
/// dims: voxels along x, y, z. The longest side of a mesh has four fifths of the grid.
/// up: the axis of the file that points up, "z" or "y"; by default that of its format.
///
/// Returns uint8 [x][y][z], z up: 0 empty, 1 filled. Raises OSError where the file cannot be read and ValueError where it is no shape.
#[pyfunction]
#[pyo3(name = "read_shape", signature = (path, dims=(30, 30, 30), *, up=None))]
pub fn read_shape_file(py: Python<'_>, path: PathBuf, dims: (usize, usize, usize), up: Option<String>) -> PyResult<Py<PyAny>> {
    let up = match up.as_deref() {
        None => None,
        Some("z") => Some(Up::Z),
        Some("y") => Some(Up::Y),
        Some(other) => return Err(invalid(format!("up is {other:?}: use \"z\" or \"y\""))),
    };
    let options = ReadOptions { up, ..ReadOptions::new(sides(dims)?) };
    let read = || options.for_file(&path).and_then(|options| read_shape(&path, &options));
    filled(py, &py.detach(read).map_err(|error| of_shape_file(&error))?)
}

/// A made-up thing of the household: "bottle", "bowl", "box", "can", "cutlery_box", "mug" or "plate". The same seed gives the same thing.
///
/// Returns uint8 [x][y][z], z up: 0 empty, 1 filled.
#[pyfunction]
#[pyo3(signature = (class_name, seed=0, dims=(30, 30, 30)))]
pub fn household_shape(py: Python<'_>, class_name: String, seed: u64, dims: (usize, usize, usize)) -> PyResult<Py<PyAny>> {
    let dims = sides(dims)?;
    let made = py.detach(|| household::make(&class_name, dims, seed));
    let classes = household::CLASSES.join(", ");
    filled(py, &made.ok_or_else(|| invalid(format!("there is no class {class_name:?}: use one of {classes}")))?)
}

/// What is seen of a complete shape straight from above: in each column the first filled voxel from above is filled, those over it are
/// empty, those under it unknown; a column without a filled voxel is empty.
///
/// shape: uint8 or bool [x][y][z], 1 where filled. Returns uint8 [x][y][z]: 0 empty, 1 filled, 255 unknown.
#[pyfunction]
pub fn view_from_above(py: Python<'_>, shape: &Bound<'_, PyAny>) -> PyResult<Py<PyAny>> {
    let (sides, bytes) = bytes(shape, "shape")?;
    let dims = dims(&sides, "shape")?;
    let seen = View::Top.of(&occupancy(dims, &bytes, "shape")?);
    let mut bytes = bytes;
    seen.write(&mut bytes);
    array(py, &bytes, <[usize; 3]>::from(dims))
}

fn sides((x, y, z): (usize, usize, usize)) -> PyResult<Dims> {
    Dims::new(x, y, z).map_err(|error| invalid(format!("dims: {error}")))
}

fn filled(py: Python<'_>, object: &Occupancy) -> PyResult<Py<PyAny>> {
    let dims = object.dims();
    let mut bytes = vec![0_u8; dims.voxels()];
    object.bits().ones().for_each(|voxel| bytes[voxel] = 1);
    array(py, &bytes, <[usize; 3]>::from(dims))
}
