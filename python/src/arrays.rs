//! NumPy arrays in and out: what they may hold, and what is said of those that hold something else.
//!
//! Arrays cross by their bytes, through NumPy's own calls: a copy of some tens of kilobytes a grid, for which neither NumPy's C interface nor
//! its version matters.

use crate::failures::invalid;
use beo_core::grid::{Dims, Observation, Occupancy, Rotation, to_xyzw};
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use pyo3::types::{PyByteArray, PyBytes};

/// Voxels as bytes, with their shape, whatever their layout in memory. Arrays of bool are 0 and 1.
pub fn bytes(array: &Bound<'_, PyAny>, name: &str) -> PyResult<(Vec<usize>, Vec<u8>)> {
    let shape = match (kind_of(array, name)?.as_str(), array.getattr("itemsize")?.extract::<usize>()?) {
        // Bytes that claim to be bool may hold more than 0 and 1; whoever reads them looks.
        ("u" | "b", 1) => array.getattr("shape")?.extract()?,
        _ => {
            let dtype = array.getattr("dtype")?;
            return Err(PyTypeError::new_err(format!("`{name}` is an array of {dtype}: use uint8 or bool, as by `.astype(\"uint8\")`")));
        }
    };
    Ok((shape, content(array)?))
}

/// The size of a grid.
pub fn dims(shape: &[usize], name: &str) -> PyResult<Dims> {
    let [x, y, z] = *shape else {
        return Err(invalid(format!("`{name}` has the shape {shape:?}: a grid has three axes, x, y, z")));
    };
    Dims::new(x, y, z).map_err(|error| invalid(format!("`{name}`: {error}")))
}

/// A grid of 0 (empty), 1 (filled) and 255 (unknown) [x][y][z].
pub fn observation(array: &Bound<'_, PyAny>) -> PyResult<Observation> {
    let (shape, bytes) = bytes(array, "grid")?;
    Observation::from_bytes(dims(&shape, "grid")?, &bytes).map_err(invalid)
}

/// A complete shape of 0 (empty) and 1 (filled) [x][y][z].
pub fn occupancy(dims: Dims, bytes: &[u8], name: &str) -> PyResult<Occupancy> {
    if let Some(place) = bytes.iter().position(|byte| *byte > 1) {
        let [i, j, k] = dims.coordinates(place);
        let found = bytes[place];
        return Err(invalid(format!("{name}: voxel ({i}, {j}, {k}) holds {found}: a complete shape has 0 (empty) and 1 (filled) alone")));
    }
    Ok(Occupancy::from_fn(dims, |i, j, k| bytes[dims.index(i, j, k)] == 1))
}

/// A depth image as metres, row by row, with its width and height. Integers are multiples of `depth_scale` metres.
pub fn depth_image(array: &Bound<'_, PyAny>, depth_scale: f64) -> PyResult<([u32; 2], Vec<f32>)> {
    let scale = match kind_of(array, "depth")?.as_str() {
        "f" => 1.0,
        "u" | "i" if depth_scale.is_finite() && depth_scale > 0.0 => depth_scale,
        "u" | "i" => return Err(invalid(format!("`depth_scale` is {depth_scale}: metres per step, positive and finite, as 0.001"))),
        _ => {
            let dtype = array.getattr("dtype")?;
            return Err(PyTypeError::new_err(format!(
                "`depth` is an array of {dtype}: use float32 in metres or uint16 with `depth_scale`"
            )));
        }
    };
    let size = image_size(array, "depth")?;
    let bytes = content(&array.call_method1("astype", ("<f4",))?)?;
    let metres = |value: &[u8; 4]| (f64::from(f32::from_le_bytes(*value)) * scale) as f32;
    Ok((size, bytes.as_chunks().0.iter().map(metres).collect()))
}

/// A label image, row by row, with its width and height.
pub fn label_image(array: &Bound<'_, PyAny>) -> PyResult<([u32; 2], Vec<u16>)> {
    if !matches!(kind_of(array, "labels")?.as_str(), "u" | "i" | "b") {
        let dtype = array.getattr("dtype")?;
        return Err(PyTypeError::new_err(format!("`labels` is an array of {dtype}: use uint16, 0 where there is no object")));
    }
    let size = image_size(array, "labels")?;
    let bytes = content(&array.call_method1("astype", ("<i8",))?)?;
    let short = |value: &[u8; 8]| {
        let label = i64::from_le_bytes(*value);
        u16::try_from(label).map_err(|_| invalid(format!("`labels` holds {label}: use 0 to 65535")))
    };
    Ok((size, bytes.as_chunks().0.iter().map(short).collect::<PyResult<_>>()?))
}

/// Width and height of an image.
fn image_size(array: &Bound<'_, PyAny>, name: &str) -> PyResult<[u32; 2]> {
    let shape: Vec<usize> = array.getattr("shape")?.extract()?;
    let &[rows, columns] = &shape[..] else {
        return Err(invalid(format!("`{name}` has the shape {shape:?}: an image has two axes, rows and columns")));
    };
    let side = |side: usize| u32::try_from(side).map_err(|_| invalid(format!("`{name}` has a side of {side} pixels")));
    Ok([side(columns)?, side(rows)?])
}

/// The bytes of an array in C order.
fn content(array: &Bound<'_, PyAny>) -> PyResult<Vec<u8>> {
    Ok(array.call_method0("tobytes")?.cast::<PyBytes>()?.as_bytes().to_vec())
}

/// NumPy's letter for the kind of number.
fn kind_of(array: &Bound<'_, PyAny>, name: &str) -> PyResult<String> {
    if !is_array(array)? {
        let found = array.get_type().name()?;
        return Err(PyTypeError::new_err(format!("`{name}` is of the type {found}: use a NumPy array")));
    }
    array.getattr("dtype")?.getattr("kind")?.extract()
}

/// Whether it is an array of NumPy.
pub fn is_array(value: &Bound<'_, PyAny>) -> PyResult<bool> {
    value.is_instance(&value.py().import("numpy")?.getattr("ndarray")?)
}

/// Numbers that arrays for Python hold.
pub trait Number: Copy {
    /// NumPy's name of the type, little-endian.
    const DTYPE: &str;
    /// Its bytes, little-endian.
    fn append_to(self, bytes: &mut Vec<u8>);
}

macro_rules! numbers {
    ($($number:ty: $dtype:literal),+) => {
        $(impl Number for $number {
            const DTYPE: &str = $dtype;
            fn append_to(self, bytes: &mut Vec<u8>) {
                bytes.extend_from_slice(&self.to_le_bytes());
            }
        })+
    };
}
numbers! { u8: "u1", u16: "<u2", f32: "<f4", f64: "<f8" }

/// An array for Python, of this shape in C order, which may be written to.
pub fn array<T: Number, const N: usize>(py: Python<'_>, values: &[T], shape: [usize; N]) -> PyResult<Py<PyAny>> {
    let mut bytes = Vec::with_capacity(size_of_val(values));
    values.iter().for_each(|value| value.append_to(&mut bytes));
    let flat = py.import("numpy")?.call_method1("frombuffer", (PyByteArray::new(py, &bytes), T::DTYPE))?;
    Ok(flat.call_method1("reshape", (shape.to_vec(),))?.unbind())
}

/// A vector for Python.
pub fn vector(py: Python<'_>, values: &[f64]) -> PyResult<Py<PyAny>> {
    array(py, values, [values.len()])
}

/// A unit quaternion x, y, z, w for Python.
pub fn quaternion(py: Python<'_>, rotation: &Rotation) -> PyResult<Py<PyAny>> {
    vector(py, &to_xyzw(rotation))
}

/// Three numbers, as a tuple, a list or an array has them.
#[derive(Clone, Copy, Debug)]
pub struct Three(pub [f64; 3]);

impl<'a, 'py> FromPyObject<'a, 'py> for Three {
    type Error = PyErr;

    fn extract(value: Borrowed<'a, 'py, PyAny>) -> PyResult<Self> {
        fixed(&value, "three numbers").map(Self)
    }
}

/// As many numbers as there must be, of anything that can be gone through.
pub fn fixed<const N: usize>(value: &Bound<'_, PyAny>, what: &str) -> PyResult<[f64; N]> {
    let numbers: Vec<f64> = value.try_iter()?.map(|item| item?.extract()).collect::<PyResult<_>>()?;
    <[f64; N]>::try_from(numbers).map_err(|numbers| invalid(format!("there are {} numbers: give {what}", numbers.len())))
}
