//! From a depth image to labels of what stands on a table, and to a grid about each object.

use crate::arrays::{Three, array, depth_image, fixed, label_image, vector};
use crate::failures::invalid;
use beo_camera::{Frame, FrameGrids, GridOptions, Intrinsics, Lens, Observer, Segmentation, lay_grids};
use beo_core::grid::{Dims, Observation};
use nalgebra::{Unit, Vector3};
use pyo3::exceptions::PyUserWarning;
use pyo3::prelude::*;
use std::ffi::CString;

/// A partial grid about one object of a depth image, and where it lies. Model.perceive and Observer.observe take it as it is.
#[pyclass(frozen, module = "beo")]
pub struct CarvedGrid {
    /// The voxels.
    pub observation: Observation,
    /// Where it lies, and what is known of its readings.
    pub place: beo_ipc::CarvedGrid,
}

#[pymethods]
impl CarvedGrid {
    /// The label of the object.
    #[getter]
    fn label(&self) -> u64 {
        self.place.object_id
    }

    /// uint8 [x][y][z], z up: 0 empty, 1 filled, 255 unknown.
    #[getter]
    fn voxels(&self, py: Python<'_>) -> PyResult<Py<PyAny>> {
        let dims = self.observation.dims();
        let mut bytes = vec![0_u8; dims.voxels()];
        self.observation.write(&mut bytes);
        array(py, &bytes, <[usize; 3]>::from(dims))
    }

    /// Edge of a voxel, metres.
    #[getter]
    fn voxel_size_m(&self) -> f64 {
        self.place.voxel_size_m
    }

    /// The grid's centre in the camera's frame (x right, y down, z along the optical axis), (3,) metres.
    #[getter]
    fn position_m(&self, py: Python<'_>) -> PyResult<Py<PyAny>> {
        vector(py, &self.place.position_m)
    }

    /// Takes grid axes to axes of the camera's frame: a unit quaternion x, y, z, w.
    #[getter]
    fn orientation(&self, py: Python<'_>) -> PyResult<Py<PyAny>> {
        vector(py, &self.place.orientation)
    }

    /// Where the camera is in the grid's frame, (3,) metres from its centre along its axes.
    #[getter]
    fn camera_position_m(&self, py: Python<'_>) -> PyResult<Py<PyAny>> {
        vector(py, &self.place.camera_position_m)
    }

    /// What cuts the object off: "border" (of the image), "occluder" (something nearer), both, or nothing.
    #[getter]
    fn cut(&self) -> Vec<&'static str> {
        beo_ipc::cut::words(self.place.cut).collect()
    }

    fn __repr__(&self) -> String {
        let millimetres = 1e3 * self.place.voxel_size_m;
        format!("CarvedGrid(label {}, {} voxels of {millimetres:.1} mm)", self.place.object_id, self.observation.dims())
    }
}

/// Labels what stands on the table of a depth image: each object's pixels have its number, from 1 on, all others 0.
///
/// depth: an image (rows, columns) along the optical axis: floats in metres (0, NaN: no reading), or integers that count `depth_scale` metres.
/// intrinsics: (fx, fy, cx, cy) in pixels, counted from the centre of the first, or the 3 x 3 camera matrix.
/// distortion: k1, k2, p1, p2 and perhaps k3 of the lens (plumb_bob), where the image is not rectified.
/// up: direction of up in the camera's frame, where it is known; else the camera is taken to be upright and to look down on the table.
///
/// Returns uint16 (rows, columns); all are 0 where there is no table.
#[pyfunction]
#[pyo3(signature = (depth, intrinsics, *, distortion=None, up=None, depth_scale=0.001))]
pub fn segment(
    py: Python<'_>,
    depth: &Bound<'_, PyAny>,
    intrinsics: &Bound<'_, PyAny>,
    distortion: Option<Vec<f64>>,
    up: Option<Three>,
    depth_scale: f64,
) -> PyResult<Py<PyAny>> {
    let (size, depth) = depth_image(depth, depth_scale)?;
    let camera = camera(size, intrinsics, distortion)?;
    let options = GridOptions { gravity: gravity(up)?, ..GridOptions::new([Dims::MIN; 3]) };
    let labels = py.detach(|| Observer::new(options).segment_table(&camera, &depth));
    array(py, &labels, [size[1] as usize, size[0] as usize])
}

/// Lays a grid about each object of a depth image and carves it: empty in front of the measured surface, filled at it, else unknown.
///
/// depth, intrinsics, distortion, up, depth_scale: as for segment.
/// labels: integers (rows, columns): which object each pixel belongs to, 0 for none; without them, what stands on the table is found.
/// dims: voxels of the grids, as the model has them (Model.dims).
/// support_label: the label of the table, where it has one.
///
/// Returns a list of CarvedGrid, by label. Objects with too few readings have none, and a warning says why.
#[pyfunction]
#[pyo3(signature = (depth, intrinsics, labels=None, *, dims=(30, 30, 30), support_label=None, distortion=None, up=None, depth_scale=0.001))]
#[expect(clippy::too_many_arguments, reason = "keyword arguments of Python")]
pub fn carve(
    py: Python<'_>,
    depth: &Bound<'_, PyAny>,
    intrinsics: &Bound<'_, PyAny>,
    labels: Option<&Bound<'_, PyAny>>,
    dims: (usize, usize, usize),
    support_label: Option<u16>,
    distortion: Option<Vec<f64>>,
    up: Option<Three>,
    depth_scale: f64,
) -> PyResult<Vec<CarvedGrid>> {
    let (size, depth) = depth_image(depth, depth_scale)?;
    let camera = camera(size, intrinsics, distortion)?;
    let labels = labels.map(label_image).transpose()?;
    if let Some((found, _)) = labels.as_ref().filter(|(found, _)| *found != size) {
        let text = format!("`labels` has {} x {} pixels, `depth` {} x {} (columns x rows)", found[0], found[1], size[0], size[1]);
        return Err(invalid(text));
    }
    let dims = Dims::new(dims.0, dims.1, dims.2).map_err(|error| invalid(format!("dims: {error}")))?;
    let segmentation = if labels.is_some() { Segmentation::Labels } else { Segmentation::Table };
    let options = GridOptions { segmentation, support_label, gravity: gravity(up)?, ..GridOptions::new(dims.into()) };
    let labels = labels.map_or_else(|| vec![0; depth.len()], |(_, labels)| labels);
    let frame = Frame::new(&camera, &depth, &labels).map_err(invalid)?;
    let (carved, left_out) = py.detach(|| carved(&lay_grids(frame, &options), dims));
    for reason in left_out {
        let text = CString::new(reason).map_err(invalid)?;
        PyErr::warn(py, &py.get_type::<PyUserWarning>(), &text, 1)?;
    }
    Ok(carved)
}

/// The carved grids of a frame, and why objects have none.
fn carved(grids: &FrameGrids, dims: Dims) -> (Vec<CarvedGrid>, Vec<String>) {
    let (mut carved, mut left_out, mut voxels) = (Vec::new(), Vec::new(), vec![0; dims.voxels()]);
    for object in &grids.objects {
        let observed = match &object.grid {
            Ok(observed) => observed,
            Err(reason) => {
                left_out.push(reason.to_string());
                continue;
            }
        };
        let read = grids.carver(object.object, observed).carve(&mut voxels).map_err(|error| error.to_string());
        match read.and_then(|()| Observation::from_bytes(dims, &voxels).map_err(|error| error.to_string())) {
            Ok(observation) => {
                let place = beo_ipc::CarvedGrid::from(&observed.grid).with_quality(&observed.quality);
                carved.push(CarvedGrid { observation, place: beo_ipc::CarvedGrid { object_id: object.object.into(), ..place } });
            }
            Err(reason) => left_out.push(format!("object {}: {reason}", object.object)),
        }
    }
    (carved, left_out)
}

/// The camera of an image.
fn camera([width, height]: [u32; 2], intrinsics: &Bound<'_, PyAny>, distortion: Option<Vec<f64>>) -> PyResult<Intrinsics> {
    let wanted = || invalid("intrinsics: give (fx, fy, cx, cy) in pixels, or a 3 x 3 camera matrix without skew");
    let [fx, fy, cx, cy] = match intrinsics.len()? {
        3 => {
            let rows: Vec<[f64; 3]> =
                intrinsics.try_iter()?.map(|row| fixed(&row?, "3 x 3")).collect::<PyResult<_>>().map_err(|_| wanted())?;
            match rows[..] {
                [[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]] => [fx, fy, cx, cy],
                _ => return Err(wanted()),
            }
        }
        _ => fixed(intrinsics, "four").map_err(|_| wanted())?,
    };
    let distortion = distortion.unwrap_or_default();
    let lens = match distortion[..] {
        [] => Lens::Straight,
        [k1, k2, p1, p2] => Lens::PlumbBob([k1, k2, p1, p2, 0.0]),
        [k1, k2, p1, p2, k3] => Lens::PlumbBob([k1, k2, p1, p2, k3]),
        _ => return Err(invalid(format!("distortion has {} numbers: give k1, k2, p1, p2 and perhaps k3", distortion.len()))),
    };
    Intrinsics::with_lens(width, height, [fx, fy], [cx, cy], lens).map_err(|error| invalid(format!("intrinsics: {error}")))
}

/// Down, from a direction up of any length.
fn gravity(up: Option<Three>) -> PyResult<Option<Unit<Vector3<f64>>>> {
    let Some(Three(up)) = up else { return Ok(None) };
    let direction = Unit::try_new(-Vector3::from(up), 1e-9).filter(|direction| direction.iter().all(|v| v.is_finite()));
    direction
        .map(Some)
        .ok_or_else(|| invalid(format!("up is {up:?}: a direction in the camera's frame, three finite numbers that are not all 0")))
}
