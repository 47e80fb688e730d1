//! The posterior over class and rotation, as weighted samples, and what is published of it: a few hypotheses and a spread.

use crate::grid::{Rotation, mean_rotation};
use crate::perception::percept::Hypothesis;
use crate::perception::scored::Sample;
use crate::perception::search::merging::Merging;

/// Most hypotheses of an answer.
pub const MOST_HYPOTHESES: usize = 8;

/// Samples of a mode within this of its peak, in nats …
const TOP_DEPTH: f64 = 1.0;
/// … and this near to it, in radians, are averaged.
const TOP_RADIUS: f64 = 8.0 / 180.0 * std::f64::consts::PI;

/// Merges samples into modes. Keeps its memory from query to query.
#[derive(Clone, Debug, Default)]
pub struct Modes {
    /// Samples with their weights, and by falling density.
    weighted: Vec<(f64, Sample)>,
    order: Vec<usize>,
    sorted: Vec<(f64, Sample)>,
    merging: Merging,
}

impl Modes {
    /// `classes` holds P(s | query); within a class the samples share it in proportion to density × share. A mode is a peak with
    /// all samples of its class that lie within `radius` radians of it.
    ///
    /// The rotation of a mode is its peak's, or with `averaged` the middle of the peak's flat top: samples beside each other,
    /// rather than refined ones, tell no more.
    ///
    /// Gives at most [`MOST_HYPOTHESES`], most probable first, and the spread: the expected angle to the first of them, radians.
    pub fn hypotheses(&mut self, samples: &[Sample], classes: &[f64], radius: f64, averaged: bool, out: &mut Vec<Hypothesis>) -> f64 {
        out.clear();
        out.reserve(MOST_HYPOTHESES + 1);
        let Self { weighted, order, sorted, merging } = self;
        weighted.clear();
        for (class, p) in classes.iter().enumerate().filter(|(_, p)| **p > 0.0) {
            let of_class = || samples.iter().filter(|s| s.class == class && s.log_density.is_finite());
            let peak = of_class().map(|s| s.log_density).fold(f64::NEG_INFINITY, f64::max);
            let weight = |s: &Sample| (s.log_density - peak).exp() * s.share;
            let total: f64 = of_class().map(weight).sum();
            if total > 0.0 {
                let shift = p.ln() - peak - total.ln();
                weighted.extend(of_class().map(|s| (p * weight(s) / total, Sample { log_density: s.log_density + shift, ..*s })));
            }
        }
        // Peaks first: by density, so that a narrow sample on top of a mode stands for it; ties in the order of the samples.
        order.clear();
        order.extend(0..weighted.len());
        order.sort_unstable_by(|a, b| weighted[*b].1.log_density.total_cmp(&weighted[*a].1.log_density).then(a.cmp(b)));
        sorted.clear();
        sorted.extend(order.iter().map(|place| weighted[*place]));
        let weighted = &*sorted;
        let nearest = (radius / 2.0).cos();
        merging.start(weighted.len());
        let total: f64 = weighted.iter().map(|(weight, _)| weight).sum();
        let mut left = total;
        let near = |peak: usize, other: usize| {
            let (peak, other) = (&weighted[peak].1, &weighted[other].1);
            other.class == peak.class && other.rotation.coords.dot(&peak.rotation.coords).abs() >= nearest
        };
        loop {
            // What is left cannot make a hypothesis that would be reported.
            let least = if out.len() < MOST_HYPOTHESES { 1e-6 * total } else { out[MOST_HYPOTHESES - 1].probability };
            if left <= least {
                break;
            }
            let mut probability = 0.0;
            let Some(place) = merging.next(near, |member| probability += weighted[member].0) else { break };
            left -= probability;
            let peak = &weighted[place].1;
            let rotation = if averaged { middle(&weighted[place..], peak) } else { peak.rotation };
            let place = out.iter().position(|h| h.probability < probability).unwrap_or(out.len());
            out.insert(place, Hypothesis { rotation, class: peak.class, probability });
            out.truncate(MOST_HYPOTHESES);
        }
        let Some(first) = out.first() else { return 0.0 };
        weighted.iter().map(|(weight, sample)| weight * first.rotation.angle_to(&sample.rotation)).sum::<f64>() / total
    }
}

/// The mean of the samples at the top of a mode, which is flat where a small turn changes no voxel. `from` begins with the
/// peak, and falls in density. The neighbourhood that is averaged moves with its mean, so that of a flat top it is the centre.
fn middle(from: &[(f64, Sample)], peak: &Sample) -> Rotation {
    let nearest = (TOP_RADIUS / 2.0).cos();
    let top = from.iter().take_while(|(_, s)| s.log_density >= peak.log_density - TOP_DEPTH).filter(|(_, s)| s.class == peak.class);
    let mut centre = peak.rotation;
    for _ in 0..5 {
        let near = top.clone().filter(|(_, s)| s.rotation.coords.dot(&centre.coords).abs() >= nearest);
        centre = mean_rotation(&centre, near.map(|(weight, s)| (s.rotation, *weight)));
    }
    centre
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::yaw;
    use std::f64::consts::{FRAC_PI_2, PI, TAU};

    fn circle(log_density: impl Fn(f64) -> f64) -> Vec<Sample> {
        let sample = |i: usize| {
            let angle = i as f64 * TAU / 360.0;
            Sample { rotation: yaw(angle), class: 0, log_density: log_density(angle), share: 1.0 / 360.0 }
        };
        (0..360).map(sample).collect()
    }

    #[test]
    fn four_equal_modes_are_four_hypotheses() {
        let mut out = Vec::new();
        let spread =
            Modes::default().hypotheses(&circle(|a| 50.0 * (4.0 * (a - 0.3)).cos()), &[0.8, 0.2], 15_f64.to_radians(), true, &mut out);
        assert_eq!(out.len(), 4);
        for h in &out {
            assert!((h.probability - 0.2).abs() < 0.002, "{h:?}");
            let turns = (crate::grid::yaw_of(&h.rotation) - 0.3) / FRAC_PI_2;
            assert!((turns - turns.round()).abs() < 0.02, "{turns}");
        }
        // Two neighbours at 90 degrees, one opposite, and itself.
        assert!((spread - FRAC_PI_2).abs() < 0.03, "{spread}");
    }

    #[test]
    fn a_flat_posterior_says_that_nothing_is_known() {
        let mut out = Vec::new();
        let spread = Modes::default().hypotheses(&circle(|_| 0.0), &[1.0], 15_f64.to_radians(), true, &mut out);
        assert_eq!(out.len(), MOST_HYPOTHESES);
        assert!(out.iter().all(|h| h.probability < 0.09));
        assert!((spread - PI / 2.0).abs() < 1e-3, "{spread}");
    }

    #[test]
    fn a_class_without_samples_or_without_probability_is_left_out() {
        let mut out = Vec::new();
        assert_eq!(Modes::default().hypotheses(&[], &[1.0], 0.2, true, &mut out), 0.0);
        assert!(out.is_empty());
        Modes::default().hypotheses(&circle(|a| 100.0 * a.cos()), &[0.0, 1.0], 0.2, true, &mut out);
        assert!(out.is_empty());
    }
}
