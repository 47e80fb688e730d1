//! How an upright object lies in what a camera sees, refined: yaw, size and place, coarse to fine along one axis after the other, from
//! where the view's density expects it.

use super::scores::{Cell, Told};

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
pub struct Placement {
    /// Expected values.
    pub expected: Parameters,
    /// Their standard deviations; 0 for what is known.
    pub deviations: Parameters,
}

impl Placement {
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
pub struct Refined {
    /// The best parameters.
    pub parameters: Parameters,
    /// Their standard deviations, by the curvature there.
    pub deviations: Parameters,
    /// The log density there.
    pub value: f64,
}

/// Where the search of a cell begins: what is told has no deviation.
pub fn start(cell: &Cell, told: &Told) -> Placement {
    let (place, scale) = (cell.place(), cell.scale());
    let mut start = Placement {
        expected: [cell.yaw(), scale.ln(), place.x, place.y, place.z],
        deviations: std::array::from_fn(|axis| cell.deviations[axis]),
    };
    let told = [told.yaw, told.scale.map(f64::ln), told.place.map(|p| p.x), told.place.map(|p| p.y), told.place.map(|p| p.z)];
    for (axis, value) in told.into_iter().enumerate() {
        if let Some(value) = value {
            (start.expected[axis], start.deviations[axis]) = (value, 0.0);
        }
    }
    start
}

/// Climbs from `start` on the log density `log_likelihood` plus the expectation's own.
pub fn refine<E>(start: &Placement, mut log_likelihood: impl FnMut(&Parameters) -> Result<f64, E>) -> Result<Refined, E> {
    let mut value_of = |at: &Parameters| -> Result<f64, E> { Ok(log_likelihood(at)? + start.log_density(at)) };
    let mut best = start.expected;
    let mut value = value_of(&best)?;
    let free = || (0..best.len()).filter(|axis| start.deviations[*axis] > 0.0);
    let axes: Vec<usize> = free().collect();
    for step in STEPS {
        for &axis in &axes {
            for side in [1.0, -1.0] {
                let mut next = best;
                next[axis] += side * step * start.deviations[axis];
                let found = value_of(&next)?;
                if found > value {
                    (best, value) = (next, found);
                    break;
                }
            }
        }
    }
    let mut deviations = [0.0; 5];
    for &axis in &axes {
        let step = LAST * start.deviations[axis];
        let mut beside = |side: f64| {
            let mut next = best;
            next[axis] += side * step;
            value_of(&next).map(|found| (next, found))
        };
        let (low, high) = (beside(-1.0)?, beside(1.0)?);
        let curvature = (2.0 * value - low.1 - high.1) / (step * step);
        let widest = start.deviations[axis];
        deviations[axis] = if curvature > 0.0 { curvature.sqrt().recip().clamp(LEAST * widest, widest) } else { widest };
        if curvature > 0.0 {
            // The top of the parabola through the three.
            let mut next = best;
            next[axis] += (0.5 * (high.1 - low.1) / (curvature * step)).clamp(-step, step);
            let found = value_of(&next)?;
            if found > value {
                (best, value) = (next, found);
            }
        }
        for (next, found) in [low, high] {
            if found > value {
                (best, value) = (next, found);
            }
        }
    }
    Ok(Refined { parameters: best, deviations, value })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::{CameraDensities, OFFSETS};
    use std::convert::Infallible;

    /// A Gaussian likelihood times the Gaussian expectation is a Gaussian: its mean and deviations are known.
    #[test]
    fn a_gaussian_is_climbed_to_its_top() {
        let start = Placement { expected: [0.1, 0.0, 1.0, -1.0, 0.0], deviations: [0.1, 0.1, 1.0, 1.0, 0.0] };
        let (truth, sharp): ([f64; 5], [f64; 5]) = ([0.2, -0.1, 1.8, -1.0, 9.0], [0.1, 0.1, 0.5, 1.0, 1.0]);
        let likelihood =
            |at: &Parameters| -> Result<f64, Infallible> { Ok((0..5).map(|i| -0.5 * ((at[i] - truth[i]) / sharp[i]).powi(2)).sum()) };
        let found = refine(&start, likelihood).unwrap();
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
    fn what_is_told_is_not_searched() {
        let cell = Cell {
            class: 0,
            component: 0,
            resting: Default::default(),
            log_prior: 0.0,
            step: 6,
            score: 0.0,
            offsets: [0.1, -0.2, 1.0, 2.0, 3.0, 9.0, 9.0, 9.0],
            deviations: [0.5; OFFSETS],
        };
        let free = start(&cell, &Told::default());
        assert!((free.expected[0] - (CameraDensities::yaw(6) + 0.1)).abs() < 1e-12);
        let same = |a: &[f64], b: &[f64]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-12);
        assert!(same(&free.expected[1..], &[-0.2, 1.0, 2.0, 3.0]) && free.deviations == [0.5; 5]);
        let told = Told { yaw: Some(1.0), scale: Some(1.0), ..Told::default() };
        let some = start(&cell, &told);
        assert_eq!((some.expected, some.deviations), ([1.0, 0.0, 1.0, 2.0, 3.0], [0.0, 0.0, 0.5, 0.5, 0.5]));
    }

    #[test]
    fn an_error_of_the_likelihood_is_passed_on() {
        let start = Placement { expected: [0.0; 5], deviations: [1.0; 5] };
        assert_eq!(refine(&start, |at| if at[2] > 0.5 { Err("no") } else { Ok(0.0) }).unwrap_err(), "no");
    }
}
