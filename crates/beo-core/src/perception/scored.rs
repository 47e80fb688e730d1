//! Scores as the decision takes them over, and the decision: class, pose hypotheses and how the object lies.

use super::densities::log_sum::most_probable;
use super::pose::posterior::{Modes, Sample};
use super::{Hypothesis, ObjectBox, Percept, PoseSearch, Query};
use crate::grid::{Placed, Rotation};

/// Which classes take part, one value per class.
pub(super) type ClassMask = [bool];

/// Rotations of a class within this of a mode belong to it, radians.
pub(super) const MODE_RADIUS: f64 = 15.0 / 180.0 * std::f64::consts::PI;

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
    pub placement: Option<(Placed, ObjectBox)>,
    /// Its component among those of the model, if resting poses were searched.
    pub resting_pose: Option<usize>,
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
    }
}

/// Decides: writes the most probable class, the modes of the posterior over class and pose, and how the object lies.
pub(super) fn decide(query: &Query, scored: &Scored, modes: &mut Modes, percept: &mut Percept) {
    percept.informed = scored.informed;
    (percept.none_probability, percept.fit, percept.resting_pose) = (None, None, scored.resting_pose);
    percept.scores.clear();
    // A class that was left out has no score: zero, not minus infinity.
    percept.scores.extend(scored.scores.iter().map(|score| if score.is_finite() { *score } else { 0.0 }));
    percept.posterior.clone_from(&scored.posterior);
    percept.log_evidence.clone_from(&scored.log_evidence);
    let class = most_probable(&percept.posterior);
    percept.class = class;
    if scored.samples.is_empty() {
        percept.rotation_spread_rad = 0.0;
        percept.hypotheses.clear();
        percept.hypotheses.push(Hypothesis { rotation: Rotation::identity(), class, probability: percept.posterior[class] });
    } else {
        let averaged = !matches!(query.pose, PoseSearch::Full);
        percept.rotation_spread_rad = modes.hypotheses(&scored.samples, &percept.posterior, MODE_RADIUS, averaged, &mut percept.hypotheses);
    }
    percept.object_box = None;
    if let Some((placed, object_box)) = scored.placement {
        // The hypothesis that was refined says so.
        let near = percept.hypotheses.iter_mut().filter(|h| h.class == class);
        if let Some(nearest) = near.min_by(|a, b| a.rotation.angle_to(&placed.rotation).total_cmp(&b.rotation.angle_to(&placed.rotation))) {
            nearest.rotation = placed.rotation;
        }
        (percept.rotation, percept.placed, percept.object_box) = (placed.rotation, placed, Some(object_box));
        return;
    }
    percept.rotation = match query.pose {
        PoseSearch::Known => Rotation::identity(),
        _ => percept.hypotheses.iter().find(|h| h.class == class).map_or(Rotation::identity(), |h| h.rotation),
    };
    percept.placed = Placed::turned(percept.rotation);
}
