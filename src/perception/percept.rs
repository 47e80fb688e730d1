//! What is asked, and what is answered.

use super::{Method, Projection};
use crate::grid::View;

/// A question about one observation.
#[derive(Clone, Debug, Default)]
pub struct Query {
    /// The estimator.
    pub method: Method,
    /// From where the object was seen; `None`: found out from the observation.
    pub view: Option<View>,
    /// log P(s) per class, up to a constant; empty for a uniform prior.
    pub log_prior: Vec<f64>,
    /// Whether the hidden part is asked for.
    pub completion: bool,
    /// How the paper's method projects.
    pub projection: Projection,
}

/// The answer. Vectors are reused from query to query.
#[derive(Clone, Debug, Default)]
pub struct Percept {
    /// Index of the most probable class.
    pub class: usize,
    /// P(s | query), one value per class; sums to one.
    pub posterior: Vec<f64>,
    /// The method's raw class scores, before calibration: log density, log evidence, or negative squared distance.
    pub scores: Vec<f64>,
    /// log p(known voxels | s) of the classes whose evidence was computed, else 0.
    pub log_evidence: Vec<f64>,
    /// Probability that each voxel is filled, d values: observed voxels 0 or 1. Empty when not asked for.
    pub occupancy: Vec<f32>,
    /// Standard deviation of that probability, d values: 0 for observed voxels.
    pub deviation: Vec<f32>,
    /// Whether the observation said something: with no filled voxel the answer is the prior.
    pub informed: bool,
}
