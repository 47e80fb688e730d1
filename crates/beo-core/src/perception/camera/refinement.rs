//! How an upright object lies in what a camera sees, refined: yaw, size and place, coarse to fine along one axis after the other, from
//! where the view's density expects it.

use crate::perception::search::climb::{Neighbours, climb, parabola};

/// Yaw (radians), logarithm of the scale (units per voxel), place x, y, z (units), all in the view's frame.
pub type Parameters = [f64; 5];

/// Steps of the search along each axis, in expected deviations …
const STEPS: [f64; 2] = [1.0, 0.5];
/// … and those of the parabola at its end.
const LAST: f64 = 0.35;
/// No deviation is reported that is smaller than this share of the expected one.
const LEAST: f64 = 0.3;

/// Where the search begins.
#[derive(Clone, Copy, Debug)]
pub struct PlacementPrior {
    /// Expected values.
    pub expected: Parameters,
    /// Their standard deviations; 0 for what is known.
    pub deviations: Parameters,
}

impl PlacementPrior {
    /// How well parameters agree with what is expected, up to a constant.
    pub fn log_density(&self, at: &Parameters) -> f64 {
        (0..at.len())
            .filter(|axis| self.deviations[*axis] > 0.0)
            .map(|axis| -0.5 * ((at[axis] - self.expected[axis]) / self.deviations[axis]).powi(2))
            .sum()
    }
}

/// Where it ended.
#[derive(Clone, Copy, Debug)]
pub struct RefinedPlacement {
    /// The best parameters.
    pub parameters: Parameters,
    /// Their standard deviations, by the curvature there.
    pub deviations: Parameters,
    /// The log density there.
    pub value: f64,
}

impl PlacementPrior {
    /// The axes along which something is to be found, and how many they are.
    fn free(&self) -> ([usize; 5], usize) {
        let (mut axes, mut free) = ([0; 5], 0);
        for axis in (0..axes.len()).filter(|axis| self.deviations[*axis] > 0.0) {
            axes[free] = axis;
            free += 1;
        }
        (axes, free)
    }

    /// Whether nothing is to be found.
    pub fn is_known(&self) -> bool {
        self.free().1 == 0
    }

    /// Climbs on the log density `log_likelihood` plus the expectation's own, by whole steps; gives the best parameters and the value there.
    pub fn climb<E>(&self, mut log_likelihood: impl FnMut(&Parameters) -> Result<f64, E>) -> Result<(Parameters, f64), E> {
        let mut value_of = |at: &Parameters| -> Result<f64, E> { Ok(log_likelihood(at)? + self.log_density(at)) };
        let mut best = (self.expected, value_of(&self.expected)?);
        let (axes, free) = self.free();
        for step in STEPS {
            best = climb(best, &axes[..free], 1, Neighbours::First, |at, axis, side| {
                let mut next = *at;
                next[axis] += side * step * self.deviations[axis];
                value_of(&next).map(|found| Some((next, found)))
            })?;
        }
        Ok(best)
    }

    /// Ends a climb: the top of a parabola along each axis after the other, and the deviations by its curvature.
    pub fn settle<E>(&self, at: &Parameters, mut log_likelihood: impl FnMut(&Parameters) -> Result<f64, E>) -> Result<RefinedPlacement, E> {
        let mut value_of = |at: &Parameters| -> Result<f64, E> { Ok(log_likelihood(at)? + self.log_density(at)) };
        let (mut best, mut value) = (*at, value_of(at)?);
        let (axes, free) = self.free();
        let mut deviations = [0.0; 5];
        for &axis in &axes[..free] {
            let step = LAST * self.deviations[axis];
            let mut beside = |by: f64| {
                let mut next = best;
                next[axis] += by * step;
                value_of(&next).map(|found| (next, found))
            };
            let (low, high) = (beside(-1.0)?, beside(1.0)?);
            let widest = self.deviations[axis];
            deviations[axis] = widest;
            let mut seen = [None, Some(low), Some(high)];
            if let Some((top, bend)) = parabola(low.1, value, high.1) {
                let curvature = -bend / (step * step);
                deviations[axis] = curvature.sqrt().recip().clamp(LEAST * widest, widest);
                seen[0] = Some(beside(top.clamp(-1.0, 1.0))?);
            }
            for (next, found) in seen.into_iter().flatten() {
                if found > value {
                    (best, value) = (next, found);
                }
            }
        }
        Ok(RefinedPlacement { parameters: best, deviations, value })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::convert::Infallible;

    /// A Gaussian likelihood times the Gaussian expectation is a Gaussian: its mean and deviations are known.
    #[test]
    fn a_gaussian_is_climbed_to_its_top() {
        let start = PlacementPrior { expected: [0.1, 0.0, 1.0, -1.0, 0.0], deviations: [0.1, 0.1, 1.0, 1.0, 0.0] };
        let (truth, sharp): ([f64; 5], [f64; 5]) = ([0.2, -0.1, 1.8, -1.0, 9.0], [0.1, 0.1, 0.5, 1.0, 1.0]);
        let likelihood =
            |at: &Parameters| -> Result<f64, Infallible> { Ok((0..5).map(|i| -0.5 * ((at[i] - truth[i]) / sharp[i]).powi(2)).sum()) };
        let (climbed, reached) = start.climb(likelihood).unwrap();
        let found = start.settle(&climbed, likelihood).unwrap();
        assert!(found.value >= reached);
        for i in 0..4 {
            let (a, b) = (1.0 / start.deviations[i].powi(2), 1.0 / sharp[i].powi(2));
            let mean = (a * start.expected[i] + b * truth[i]) / (a + b);
            let deviation = (a + b).sqrt().recip();
            assert!((found.parameters[i] - mean).abs() < 0.05 * deviation, "{i}: {} {mean}", found.parameters[i]);
            assert!((found.deviations[i] / deviation - 1.0).abs() < 0.05, "{i}: {} {deviation}", found.deviations[i]);
        }
        assert_eq!((found.parameters[4], found.deviations[4]), (0.0, 0.0), "what is known stays");
    }

    #[test]
    fn an_error_of_the_likelihood_is_passed_on() {
        let start = PlacementPrior { expected: [0.0; 5], deviations: [1.0; 5] };
        let likelihood = |at: &Parameters| if at[2] > 0.1 { Err("no") } else { Ok(0.0) };
        assert_eq!(start.climb(likelihood).unwrap_err(), "no");
        assert_eq!(start.settle(&[0.0; 5], likelihood).unwrap_err(), "no");
    }
}
