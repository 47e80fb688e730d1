//! Scores of classes and poses, as the decision takes them over.

use super::percept::ObjectBox;
use super::query::ExpectedPlacement;
use crate::grid::{Rotation, Similarity};

/// Which classes take part, one value per class.
pub(super) type ClassMask = [bool];

/// Rotations of a class within this of a mode belong to it, radians.
pub(super) const MODE_RADIUS: f64 = 15.0 / 180.0 * std::f64::consts::PI;

/// A rotation of a class that stands for those around it.
#[derive(Clone, Copy, Debug)]
pub struct Sample {
    /// From object axes to grid axes.
    pub rotation: Rotation,
    /// The class.
    pub class: usize,
    /// Logarithm of the density at this rotation, up to a constant within the class.
    pub log_density: f64,
    /// Share of the searched rotations that it stands for.
    pub share: f64,
}

/// The scores of classes and poses. Keeps its memory from query to query.
#[derive(Default)]
pub(crate) struct Scored {
    /// Whether anything is seen: else the posterior is the prior.
    pub informed: bool,
    /// Raw score of each class, in unknown pose at its best; −∞ for classes that are left out.
    pub scores: Vec<f64>,
    /// P(s | query).
    pub posterior: Vec<f64>,
    /// Log evidence of the classes for which it was computed in the pose in which the observation came, else 0.
    pub log_evidence: Vec<f64>,
    /// Weighted rotations of every class; none in known pose.
    pub samples: Vec<Sample>,
    /// How the object of the most probable class lies, if size and place were refined.
    pub placement: Option<(Similarity, ObjectBox)>,
    /// Its component among those of the model, if resting poses were searched.
    pub resting_pose: Option<usize>,
    /// How it is to be expected in the next frame, if size and place were refined.
    pub expected: Option<ExpectedPlacement>,
    /// Probability that the thing belongs to no class, if the model has learned to tell.
    pub none_probability: Option<f64>,
}

impl Scored {
    /// Begins a query to a model of so many classes.
    pub fn start(&mut self, classes: usize, informed: bool) {
        self.informed = informed;
        self.scores.clear();
        self.posterior.clear();
        self.log_evidence.clear();
        self.log_evidence.resize(classes, 0.0);
        self.samples.clear();
        self.placement = None;
        self.resting_pose = None;
        self.expected = None;
        self.none_probability = None;
    }
}
