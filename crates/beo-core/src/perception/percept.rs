//! A query about one observation, and the percept that answers it.

use crate::grid::{Outside, Placed, Rotation, View};
use crate::perception::{Hypothesis, Method, PaperPose, PoseSearch, Projection, RotationPrior, Timings};
use nalgebra::Vector3;

/// In which frame a completion is wanted.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Frame {
    /// The observation's grid, so that it can be laid over what was seen.
    #[default]
    Grid,
    /// The canonical orientation of the training shapes.
    Object,
}

/// Knowledge of the object's size and of its place in the grid.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum ScaleSearch {
    /// They are those of the training shapes: the grid lies about the object as theirs do.
    #[default]
    Known,
    /// The place is to be found, and the size unless it is told.
    Search {
        /// The object's longest side, in voxels of the grid.
        side: Option<f64>,
    },
}

/// The box about the object, along its own axes, as a camera's view and the search for size and place give it. Lengths in voxels of the
/// observation's grid.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ObjectBox {
    /// Lengths along the object's axes.
    pub extent_voxels: [f64; 3],
    /// Their standard deviations.
    pub extent_deviation_voxels: [f64; 3],
    /// Standard deviations of the box's centre along the grid's axes; 0 where it was not searched.
    pub position_deviation_voxels: [f64; 3],
}

/// A question about one observation.
#[derive(Clone, Debug, Default)]
pub struct Query {
    /// The estimator.
    pub method: Method,
    /// Knowledge of the rotation.
    pub pose: PoseSearch,
    /// P(r) over the rotations that are searched.
    pub rotation_prior: RotationPrior,
    /// Content of the space outside the grid: it enters when the observation is turned.
    pub outside: Outside,
    /// From where the object was seen; `None`: found out from the observation.
    pub view: Option<View>,
    /// Where the camera was, in voxels from the grid's centre along its axes, if it was one.
    pub camera: Option<Vector3<f64>>,
    /// Knowledge of the object's size and place.
    pub scale: ScaleSearch,
    /// Before a turn about z, the object may rest in any of the poses that the model knows of its class; else it stands upright. Of what a
    /// camera sees.
    pub lying: bool,
    /// Edge of a voxel of the observation, metres, if it is known: true sizes then count.
    pub voxel_size_m: Option<f64>,
    /// log P(s) per class, up to a constant; empty for a uniform prior. Classes with −∞ are left out.
    pub log_prior: Vec<f64>,
    /// Whether the hidden part is asked for.
    pub completion: bool,
    /// The frame of the completion.
    pub frame: Frame,
    /// How the paper's method projects.
    pub projection: Projection,
    /// How the paper's method finds the pose.
    pub paper_pose: PaperPose,
}

impl Query {
    /// log P(s) of a class, up to a constant.
    pub(super) fn log_prior(&self, class: usize) -> f64 {
        self.log_prior.get(class).copied().unwrap_or(0.0)
    }
}

/// The answer. Vectors are reused from query to query.
#[derive(Clone, Debug, Default)]
pub struct Percept {
    /// Index of the most probable class.
    pub class: usize,
    /// P(s | query), one value per class; sums to one. In unknown pose, marginal over the pose.
    pub posterior: Vec<f64>,
    /// The method's raw class scores, before calibration: log density, log evidence, or negative squared distance. In unknown
    /// pose, each class's at its best pose.
    pub scores: Vec<f64>,
    /// log p(known voxels | s) of the classes whose evidence was computed, at the pose that was answered, else 0.
    pub log_evidence: Vec<f64>,
    /// The pose that is answered and completed: the most probable one of the most probable class, from object axes to grid axes.
    pub rotation: Rotation,
    /// How the object lies in the grid: `rotation`, and size and place where they were searched. Its shift is where the centre of the
    /// object's box lies.
    pub placed: Placed,
    /// The object's box; `None` where it was not estimated.
    pub object_box: Option<ObjectBox>,
    /// Modes of the posterior over class and pose, most probable first.
    pub hypotheses: Vec<Hypothesis>,
    /// Expected angle to the first hypothesis, radians: 0 in known pose.
    pub rotation_spread_rad: f64,
    /// Probability that each voxel is filled, d values: observed voxels 0 or 1. Empty when not asked for.
    pub occupancy: Vec<f32>,
    /// Standard deviation of that probability, d values: 0 for observed voxels.
    pub deviation: Vec<f32>,
    /// Whether the observation said something. Where it is false nothing was seen: the posterior is the prior, and `class` means nothing.
    pub informed: bool,
    /// Probability that the object is of none of the model's classes; `None` where the model cannot tell.
    pub none_probability: Option<f64>,
    /// How well the object of the answered class explains what was seen, from 0 to 1; `None` where it was not computed.
    pub fit: Option<f64>,
    /// Which of the class's resting poses the object lies in; `None` where the search did not go over these.
    pub resting_pose: Option<usize>,
    /// When each stage was done.
    pub timings: Timings,
}
