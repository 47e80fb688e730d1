//! A query about one observation: the estimator, and knowledge of class, pose, size and place.

mod expected;
mod method;
mod paper;
mod pose_search;
mod rotation_prior;

pub use expected::ExpectedPlacement;
pub use method::Method;
pub use paper::{PaperPose, Projection};
pub use pose_search::PoseSearch;
pub use rotation_prior::RotationPrior;

use crate::grid::{Outside, View};
use nalgebra::Vector3;

/// In which frame a completion is wanted.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum CompletionFrame {
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

/// A question about one observation.
#[derive(Clone, Debug, Default)]
pub struct Query {
    /// The estimator.
    pub method: Method,
    /// Knowledge of the rotation.
    pub pose: PoseSearch,
    /// P(r) over the rotations that are searched.
    pub rotation_prior: RotationPrior,
    /// How an object that was answered before is to be expected, before a camera.
    pub expected: Option<ExpectedPlacement>,
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
    /// The object is cut off, by the border of the image or by something nearer, so that it goes on where nothing is known: of what a
    /// camera sees.
    pub is_cut: bool,
    /// Edge of a voxel of the observation, metres, if it is known: true sizes then count.
    pub voxel_size_m: Option<f64>,
    /// log P(s) per class, up to a constant; empty for a uniform prior. Classes with −∞ are left out.
    pub log_prior: Vec<f64>,
    /// Whether the hidden part is asked for.
    pub completion: bool,
    /// The frame of the completion.
    pub frame: CompletionFrame,
    /// How the paper's method projects.
    pub projection: Projection,
    /// How the paper's method finds the pose.
    pub paper_pose: PaperPose,
}

impl Query {
    /// Becomes another query, in the memory that this one has.
    pub(super) fn set(&mut self, other: &Self) {
        let (mut log_prior, mut rotation_prior) = (std::mem::take(&mut self.log_prior), std::mem::take(&mut self.rotation_prior));
        log_prior.clone_from(&other.log_prior);
        rotation_prior.set(&other.rotation_prior);
        *self = Self { log_prior, rotation_prior, ..*other };
    }

    /// log P(s) of a class, up to a constant.
    pub(super) fn log_prior(&self, class: usize) -> f64 {
        self.log_prior.get(class).copied().unwrap_or(0.0)
    }
}
