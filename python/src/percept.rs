//! The answers of a model in this process.

use crate::arrays::{array, quaternion, vector};
use crate::question::Question;
use beo_core::grid::{Dims, from_xyzw};
use beo_core::perception;
use nalgebra::Vector3;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyList};

/// One way in which the object may be turned, with the class that this pose belongs to.
#[pyclass(frozen, get_all, module = "beo")]
pub struct Hypothesis {
    /// Name of the class.
    class_name: String,
    /// Posterior probability of this class, turned so or nearly so.
    probability: f64,
    /// Takes object axes to grid axes: a unit quaternion x, y, z, w.
    rotation: Py<PyAny>,
}

impl Hypothesis {
    /// From its parts.
    pub fn new(class_name: String, probability: f64, rotation: Py<PyAny>) -> Self {
        Self { class_name, probability, rotation }
    }
}

#[pymethods]
impl Hypothesis {
    fn __repr__(&self) -> String {
        format!("Hypothesis({}, {:.1} %)", self.class_name, 100.0 * self.probability)
    }
}

/// What a model says of one grid: class, pose and completed shape, each with its uncertainty.
///
/// Lengths that end in `_voxels` count voxels of the grid that was asked about, from its centre along its axes. Those that end in `_m` are
/// metres, and None where the edge of a voxel is not known.
#[pyclass(frozen, get_all, module = "beo")]
pub struct Percept {
    /// Name of the most probable class; None where nothing of an object is seen (no voxel is filled).
    class_name: Option<String>,
    /// Probability of every class, by name, given that the object is of one of them.
    probabilities: Py<PyDict>,
    /// Log score of every class before calibration, by name; only differences have a meaning.
    log_scores: Py<PyDict>,
    /// Probability that the object is of none of the classes; None where the model cannot say.
    none_probability: Option<f64>,
    /// How well the object fits its class, 0 to 1; None where it was not computed.
    fit: Option<f64>,
    /// How it may be turned, a list of Hypothesis, the most probable first.
    hypotheses: Py<PyList>,
    /// The pose that is answered and completed: takes object axes to grid axes, a unit quaternion x, y, z, w.
    rotation: Py<PyAny>,
    /// Expected angle to the first hypothesis, radians; 0 in known pose.
    rotation_spread_rad: f64,
    /// Edge of a voxel of the object's canonical grid, in voxels of the grid; 1 where the size is known.
    scale: f64,
    /// Where the centre of the object's box lies, (3,) voxels; 0 where the place is known.
    translation_voxels: Py<PyAny>,
    /// Lengths of the object's box along its own axes, (3,) voxels; None where they were not estimated.
    extent_voxels: Option<Py<PyAny>>,
    /// Their standard deviations, (3,) voxels.
    extent_deviation_voxels: Option<Py<PyAny>>,
    /// Lengths of the object's box along its own axes, (3,) metres.
    extent_m: Option<Py<PyAny>>,
    /// The centre of the object's box in the camera's frame, (3,) metres; None but for a CarvedGrid.
    position_m: Option<Py<PyAny>>,
    /// Which of its class's resting poses the object lies in; None where these were not searched.
    resting_pose: Option<usize>,
    /// The completed shape: probability that each voxel is filled, float32 [x][y][z]; None where it was not asked for.
    occupancy: Option<Py<PyAny>>,
    /// Standard deviation of that probability, float32 [x][y][z]; 0 where the voxel was seen.
    deviation: Option<Py<PyAny>>,
}

impl Percept {
    /// The answer for Python.
    pub fn new(py: Python<'_>, names: &[String], dims: Dims, question: &Question, answer: perception::Percept) -> PyResult<Self> {
        let by_name = |values: &[f64]| -> PyResult<Py<PyDict>> {
            let dict = PyDict::new(py);
            names.iter().zip(values).try_for_each(|(name, value)| dict.set_item(name, value))?;
            Ok(dict.unbind())
        };
        let hypothesis =
            |h: &perception::Hypothesis| Py::new(py, Hypothesis::new(names[h.class].clone(), h.probability, quaternion(py, &h.rotation)?));
        let informed = answer.informed;
        let hypotheses: Vec<Py<Hypothesis>> = match informed {
            true => answer.hypotheses.iter().map(hypothesis).collect::<PyResult<_>>()?,
            false => Vec::new(),
        };
        let found = answer.object_box.filter(|_| informed);
        let metres = |lengths: [f64; 3], voxel: f64| vector(py, &lengths.map(|v| v * voxel));
        let position = |place: &beo_ipc::CarvedGrid| {
            let along = answer.placed.translation_voxels * place.voxel_size_m;
            vector(py, (Vector3::from(place.position_m) + from_xyzw(place.orientation) * along).as_slice())
        };
        let sides = <[usize; 3]>::from(dims);
        let voxels = |values: Vec<f32>| (informed && values.len() == dims.voxels()).then(|| array(py, &values, sides)).transpose();
        Ok(Self {
            class_name: informed.then(|| names[answer.class].clone()),
            probabilities: by_name(&answer.posterior)?,
            log_scores: by_name(&answer.scores)?,
            none_probability: answer.none_probability.filter(|_| informed),
            fit: answer.fit.filter(|_| informed),
            hypotheses: PyList::new(py, hypotheses)?.unbind(),
            rotation: quaternion(py, &answer.rotation_object_to_grid)?,
            rotation_spread_rad: answer.rotation_spread_rad,
            scale: answer.placed.scale,
            translation_voxels: vector(py, answer.placed.translation_voxels.as_slice())?,
            extent_voxels: found.map(|found| vector(py, &found.extent_voxels)).transpose()?,
            extent_deviation_voxels: found.map(|found| vector(py, &found.extent_deviation_voxels)).transpose()?,
            extent_m: found.zip(question.voxel_size_m).map(|(found, voxel)| metres(found.extent_voxels, voxel)).transpose()?,
            position_m: question.carved.as_ref().filter(|_| informed).map(position).transpose()?,
            resting_pose: answer.resting_pose.filter(|_| informed),
            occupancy: voxels(answer.occupancy)?,
            deviation: voxels(answer.deviation)?,
        })
    }
}

#[pymethods]
impl Percept {
    fn __repr__(&self, py: Python<'_>) -> PyResult<String> {
        let Some(name) = &self.class_name else { return Ok("Percept(nothing is seen)".into()) };
        let probability: f64 = self.probabilities.bind(py).get_item(name)?.map_or(Ok(0.0), |p| p.extract())?;
        let none = self.none_probability.map_or(String::new(), |p| format!(", none of the classes {:.1} %", 100.0 * p));
        let completed = if self.occupancy.is_some() { ", completed" } else { "" };
        Ok(format!("Percept({name} {:.1} %{none}{completed})", 100.0 * probability))
    }
}
