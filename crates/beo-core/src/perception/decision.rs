//! The decision: class, pose hypotheses and how the object lies.

use super::densities::log_sum::most_probable;
use super::percept::{Hypothesis, Percept};
use super::pose::posterior::Modes;
use super::query::{PoseSearch, Query};
use super::scored::{MODE_RADIUS, Scored};
use crate::grid::{Rotation, Similarity};

/// Decides: writes the most probable class, the modes of the posterior over class and pose, and how the object lies.
pub(super) fn decide(query: &Query, scored: &Scored, modes: &mut Modes, percept: &mut Percept) {
    percept.informed = scored.informed;
    (percept.none_probability, percept.resting_pose) = (scored.none_probability, scored.resting_pose);
    percept.expected = scored.expected;
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
        (percept.rotation_object_to_grid, percept.placed, percept.object_box) = (placed.rotation, placed, Some(object_box));
        return;
    }
    percept.rotation_object_to_grid = match query.pose {
        PoseSearch::Known => Rotation::identity(),
        _ => percept.hypotheses.iter().find(|h| h.class == class).map_or(Rotation::identity(), |h| h.rotation),
    };
    percept.placed = Similarity::turned(percept.rotation_object_to_grid);
}
