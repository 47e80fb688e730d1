//! Models: loaded, trained, saved, asked.

use crate::arrays::Three;
use crate::failures::{of_model_file, of_perceiving};
use crate::percept::Percept;
use crate::question::{Asked, Question};
use crate::training;
use beo_core::model::save;
use beo_core::perception::{self, Perceiver, Workspace};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::path::PathBuf;
use std::sync::{Mutex, PoisonError};

/// A trained model: what it knows of its classes, ready for questions. It can be asked by several threads at a time.
#[pyclass(frozen, module = "beo")]
pub struct Model {
    perceiver: Perceiver,
    names: Vec<String>,
    /// Scratch memory that is at hand; as much as was used at a time.
    workspaces: Mutex<Vec<Workspace>>,
}

impl Model {
    /// Ready for questions.
    pub fn new(perceiver: Perceiver) -> Self {
        let names = perceiver.model().class_names().map(str::to_owned).collect();
        Self { perceiver, names, workspaces: Mutex::default() }
    }

    fn answer(&self, question: &Question) -> Result<perception::Percept, perception::PerceiveError> {
        let at_hand = || self.workspaces.lock().unwrap_or_else(PoisonError::into_inner);
        let mut work = at_hand().pop().unwrap_or_else(|| self.perceiver.workspace());
        let (query, mut percept) = (question.query(), perception::Percept::default());
        let outcome =
            self.perceiver.classify(&question.observation, &query, &mut work, &mut percept).and_then(|classified| {
                match classified.percept().informed && query.completion {
                    true => classified.complete(),
                    false => Ok(()),
                }
            });
        at_hand().push(work);
        outcome.map(|()| percept)
    }
}

#[pymethods]
impl Model {
    /// Loads a model file.
    ///
    /// Raises FileNotFoundError or another OSError where it cannot be read, ValueError where it is no usable model, and MemoryError where
    /// there is too little memory for it.
    #[staticmethod]
    fn load(py: Python<'_>, path: PathBuf) -> PyResult<Self> {
        py.detach(|| Perceiver::open(&path)).map(Self::new).map_err(|error| of_perceiving(&error))
    }

    /// Learns a model from complete shapes.
    ///
    /// shapes: for each class its shapes, an array (n, x, y, z) of bool or uint8, or a sequence of n arrays (x, y, z), 1 where filled; n is at
    ///     least 4, all grids have one size, 8 to 256 voxels a side, z up, and shapes stand as those of their class do. Shapes that are there
    ///     twice are learned once.
    /// poses: whether unknown poses can be asked for afterwards; without, training is faster.
    /// components: least and most components of a class basis.
    /// seed: of the cross-validation by which the model is calibrated. The same shapes and arguments give the same model.
    /// progress: called as progress(step, done, total) at the beginning of each step.
    ///
    /// What cameras see is not learned here: `beo train --views camera` of the program does that.
    ///
    /// Raises TypeError and ValueError for shapes that cannot be learned. Ctrl-C ends it at the next step.
    #[staticmethod]
    #[pyo3(signature = (shapes, *, poses=true, components=(30, 70), seed=0, progress=None))]
    fn train(
        py: Python<'_>,
        shapes: &Bound<'_, PyDict>,
        poses: bool,
        components: (usize, usize),
        seed: u64,
        progress: Option<Py<PyAny>>,
    ) -> PyResult<Self> {
        let set = training::shapes(shapes)?;
        let options = training::options(&set, poses, components, seed)?;
        training::learn(py, &set, &options, progress.as_ref()).map(Self::new)
    }

    /// Writes the model to a file, which appears when it is whole. OSError where that is not possible.
    fn save(&self, py: Python<'_>, path: PathBuf) -> PyResult<()> {
        py.detach(|| save(self.perceiver.model(), &path)).map_err(|error| of_model_file(&error))
    }

    /// Names of the classes, sorted.
    #[getter]
    fn classes(&self) -> Vec<String> {
        self.names.clone()
    }

    /// Voxels of the grids that it answers, along x, y, z.
    #[getter]
    fn dims(&self) -> (usize, usize, usize) {
        <[usize; 3]>::from(self.perceiver.model().dims()).into()
    }

    /// Whether what cameras see was learned, so that grids of depth images can be asked about.
    #[getter]
    fn has_cameras(&self) -> bool {
        let model = self.perceiver.model();
        let level = model.levels().first().map(|level| level.camera_densities().is_some());
        level.unwrap_or(model.camera_densities().is_some())
    }

    /// Share of the training shapes whose class was found when they were held out; the calibration comes from these.
    #[getter]
    fn held_out_accuracy(&self) -> f64 {
        self.perceiver.model().metadata.calibration.accuracy
    }

    /// Says what a grid shows: class, pose, completed shape.
    ///
    /// grid: an array [x][y][z], z up, of uint8: 0 empty, 1 filled, 255 unknown (or of bool: all known); or a CarvedGrid of a depth image.
    /// pose: "known" (the grid stands as the training shapes do), "yaw" (turned about z by any angle), "full" (turned in any way), or "rest"
    ///     (in any of the poses in which its class can rest, turned about z; of what a camera sees). By default "known", for a CarvedGrid
    ///     "rest".
    /// yaw_span_deg: with pose "yaw", angles from 0 to this are searched.
    /// view: "top" where the grid is seen straight from above; by default that is found out.
    /// camera: where the camera is, voxels from the grid's centre along its axes; nothing is then known of what is outside of the grid.
    /// size: "search" where a camera's object has any size and place in the grid; else "known", as the training shapes have them.
    /// voxel_size_m: edge of a voxel, metres, where it is known: true sizes then count.
    /// completion: whether the hidden part is wanted.
    /// frame: of the completion: "grid", that of the grid, or "object", the canonical one of the training shapes.
    ///
    /// Raises TypeError and ValueError for what cannot be asked.
    #[pyo3(signature = (
        grid, *, pose=None, yaw_span_deg=360.0, view=None, camera=None, size=None, voxel_size_m=None, completion=true, frame="grid".to_owned()
    ))]
    #[expect(clippy::too_many_arguments, reason = "keyword arguments of Python")]
    fn perceive(
        &self,
        py: Python<'_>,
        grid: &Bound<'_, PyAny>,
        pose: Option<String>,
        yaw_span_deg: f64,
        view: Option<String>,
        camera: Option<Three>,
        size: Option<String>,
        voxel_size_m: Option<f64>,
        completion: bool,
        frame: String,
    ) -> PyResult<Percept> {
        let question = Question::read(grid, &Asked { pose, yaw_span_deg, view, camera, size, voxel_size_m, completion, frame })?;
        let answer = py.detach(|| self.answer(&question)).map_err(|error| of_perceiving(&error))?;
        Percept::new(py, &self.names, self.perceiver.model().dims(), &question, answer)
    }

    fn __repr__(&self) -> String {
        format!("Model({} classes on {} voxels: {})", self.names.len(), self.perceiver.model().dims(), self.names.join(", "))
    }
}
