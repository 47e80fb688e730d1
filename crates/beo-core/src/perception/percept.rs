//! The percept that answers a query.

use crate::grid::{Rotation, Similarity};
use crate::perception::query::ExpectedPlacement;
use crate::perception::timings::Timings;

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

/// How the object may be turned.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hypothesis {
    /// From object axes to grid axes.
    pub rotation: Rotation,
    /// The class that this pose belongs to.
    pub class: usize,
    /// Posterior probability of this class, turned so or nearly so.
    pub probability: f64,
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
    pub rotation_object_to_grid: Rotation,
    /// How the object lies in the grid: its rotation, and size and place where they were searched. Its translation is where the centre of the
    /// object's box lies.
    pub placed: Similarity,
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
    /// How well the answered class explains what was seen: the share of the filled voxels, 0 to 1, that lie within a voxel of the class's
    /// reconstruction of the observation. `None` where nothing was seen, for models that are read in place, and where the class was not conditioned
    /// on the observation as it was answered: in a search over poses from above without a completion.
    pub fit: Option<f64>,
    /// Which of the class's resting poses the object lies in; `None` where the search did not go over these.
    pub resting_pose: Option<usize>,
    /// How the object is to be expected in the next frame; `None` where size and place were not searched before a camera.
    pub expected: Option<ExpectedPlacement>,
    /// When each stage was done.
    pub timings: Timings,
}
