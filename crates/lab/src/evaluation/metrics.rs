//! Figures of merit. Accuracies are fractions.

use beo_core::grid::{Observation, Occupancy};
use serde::Serialize;

/// How far posteriors can be believed.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct CalibrationFigures {
    /// Expected calibration error of the top label, 15 bins of equal width.
    pub ece: f64,
    /// Mean squared distance between the posterior and the one-hot truth, summed over classes.
    pub brier: f64,
    /// Mean negative log posterior of the truth, in nats.
    pub log_loss: f64,
}

/// Calibration of posteriors (one row per query) against the true classes.
pub fn calibration(posteriors: &[Vec<f64>], truth: &[usize]) -> CalibrationFigures {
    const BINS: usize = 15;
    let n = posteriors.len().max(1) as f64;
    let mut bins = [(0.0, 0.0); BINS]; // summed confidence, right answers
    let (mut brier, mut log_loss) = (0.0, 0.0);
    for (posterior, &truth) in posteriors.iter().zip(truth) {
        let top = (0..posterior.len()).max_by(|a, b| posterior[*a].total_cmp(&posterior[*b]).then(b.cmp(a))).unwrap_or(0);
        let bin = &mut bins[((posterior[top] * BINS as f64) as usize).min(BINS - 1)];
        bin.0 += posterior[top];
        bin.1 += f64::from(u8::from(top == truth));
        let one_hot = |s: usize| f64::from(u8::from(s == truth));
        brier += posterior.iter().enumerate().map(|(s, p)| (p - one_hot(s)).powi(2)).sum::<f64>();
        log_loss -= posterior[truth].max(1e-12).ln();
    }
    let ece = bins.iter().map(|(confidence, right)| (confidence - right).abs()).sum::<f64>() / n;
    CalibrationFigures { ece, brier: brier / n, log_loss: log_loss / n }
}

/// How far one estimate of a rotation is from the truth.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct PoseErrors {
    /// Angle between estimate and truth, degrees.
    pub raw_deg: f64,
    /// The same to the nearest rotation that looks like the truth (see `symmetry`), degrees.
    pub symmetry_aware_deg: f64,
}

/// Rotation errors over all queries in degrees, those of wrong class included.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct PoseFigures {
    /// Median.
    pub median: f64,
    /// Mean.
    pub mean: f64,
    /// 90th percentile.
    pub p90: f64,
    /// Median where rotations that leave the object as it is count as equal.
    pub symmetry_aware_median: f64,
}

/// Percentiles of the time of one query in milliseconds: one at a time, reading excluded, completion included.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Milliseconds {
    /// Median.
    pub p50: f64,
    /// 90th percentile.
    pub p90: f64,
    /// 99th percentile.
    pub p99: f64,
}

/// Summary of rotation errors.
pub fn pose_figures(errors: &[PoseErrors]) -> PoseFigures {
    let raw: Vec<f64> = errors.iter().map(|e| e.raw_deg).collect();
    let aware: Vec<f64> = errors.iter().map(|e| e.symmetry_aware_deg).collect();
    PoseFigures {
        median: percentile(&raw, 50.0),
        mean: raw.iter().sum::<f64>() / raw.len().max(1) as f64,
        p90: percentile(&raw, 90.0),
        symmetry_aware_median: percentile(&aware, 50.0),
    }
}

/// Summary of times in milliseconds.
pub fn milliseconds(times: &[f64]) -> Milliseconds {
    Milliseconds { p50: percentile(times, 50.0), p90: percentile(times, 90.0), p99: percentile(times, 99.0) }
}

/// Percentile of values by linear interpolation (`numpy.percentile`); 0 without values.
pub fn percentile(values: &[f64], percent: f64) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let Some(last) = sorted.len().checked_sub(1) else { return 0.0 };
    let position = percent / 100.0 * last as f64;
    let (low, high) = (position.floor() as usize, position.ceil() as usize);
    sorted[low] + (sorted[high] - sorted[low]) * (position - low as f64)
}

/// Intersection over union of two binary sets given as counts; two empty sets agree.
pub fn iou(both: usize, either: usize) -> f64 {
    if either == 0 { 1.0 } else { both as f64 / either as f64 }
}

/// How well one completion agrees with the truth.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct CompletionErrors {
    /// Intersection over union over the unknown voxels.
    pub iou_unknown: f64,
    /// The same over all voxels, observed ones as observed.
    pub iou_all: f64,
    /// Euclidean distance to the truth over all voxels.
    pub l2: f64,
}

/// Compares a completion with the truth: `occupancy` is the probability that a voxel is filled, and one half counts as filled.
pub fn completion_errors(truth: &Occupancy, observation: &Observation, occupancy: impl Fn(usize) -> f32) -> CompletionErrors {
    let (mut l2, mut both, mut either) = (0.0, 0, 0);
    for voxel in 0..truth.dims().voxels() {
        let (p, filled) = (occupancy(voxel), truth.bits().contains(voxel));
        l2 += (f64::from(p) - f64::from(u8::from(filled))).powi(2);
        if !observation.known().contains(voxel) {
            both += usize::from(filled && p >= 0.5);
            either += usize::from(filled || p >= 0.5);
        }
    }
    let observed = observation.filled().count_ones(..);
    CompletionErrors { iou_unknown: iou(both, either), iou_all: iou(both + observed, either + observed), l2: l2.sqrt() }
}

/// Errors of size and place of one query. Lengths are shares of the object's longest side.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PlacementErrors {
    /// Distance of the centre of the object's canonical grid from the true one.
    pub centre: f64,
    /// Logarithm of the ratio of the sizes, without its sign.
    pub size: f64,
    /// Mean error of the lengths of the object's box.
    pub extent: f64,
    /// Errors of the centre along the grid's axes, in deviations that were answered.
    pub centre_deviations: [f64; 3],
    /// The same of the lengths along the object's axes.
    pub extent_deviations: [f64; 3],
}

/// Errors of size and place of many queries.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct PlacementFigures {
    /// Median distance of the centre, as a share of the object's longest side.
    pub centre_median: f64,
    /// Median of |ln size ratio|.
    pub size_median: f64,
    /// Median error of the box's lengths, as a share of the longest.
    pub extent_median: f64,
    /// Share of the errors of the centre that are within one deviation that was answered (68 % of a Gaussian's).
    pub centre_within_one_deviation: f64,
    /// The same of the lengths.
    pub extent_within_one_deviation: f64,
}

/// Sums up errors of size and place.
pub fn placement_figures(errors: &[PlacementErrors]) -> PlacementFigures {
    let median_of = |value: fn(&PlacementErrors) -> f64| {
        let mut values: Vec<f64> = errors.iter().map(value).collect();
        values.sort_by(f64::total_cmp);
        if values.is_empty() { 0.0 } else { values[values.len() / 2] }
    };
    let within = |value: fn(&PlacementErrors) -> [f64; 3]| {
        let all = errors.iter().flat_map(value);
        all.filter(|v| v.abs() <= 1.0).count() as f64 / (3 * errors.len()).max(1) as f64
    };
    PlacementFigures {
        centre_median: median_of(|e| e.centre),
        size_median: median_of(|e| e.size),
        extent_median: median_of(|e| e.extent),
        centre_within_one_deviation: within(|e| e.centre_deviations),
        extent_within_one_deviation: within(|e| e.extent_deviations),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use beo_core::grid::{Dims, View};

    #[test]
    fn completion_errors_are_those_of_a_hand_computation() {
        let dims = Dims::cube(8).unwrap();
        // One column filled at z = 1, 2 and 5, seen from above: z = 0 to 4 are unknown.
        let truth = Occupancy::from_fn(dims, |i, j, k| (i, j) == (3, 4) && [1, 2, 5].contains(&k));
        let observation = View::Top.of(&truth);
        let column = |k: usize| [0.4, 0.6, 0.3, 0.9, 0.0, 1.0, 0.0, 0.0][k];
        let occupancy = |v: usize| if v / 8 == 3 * 8 + 4 { column(v % 8) } else { 0.0 };
        let errors = completion_errors(&truth, &observation, occupancy);
        // Filled are 1 and 2, predicted 1 and 3.
        assert_eq!((errors.iou_unknown, errors.iou_all), (1.0 / 3.0, 2.0 / 4.0));
        let squares: f64 = 0.16 + 0.16 + 0.49 + 0.81;
        assert!((errors.l2 - squares.sqrt()).abs() < 1e-6, "{}", errors.l2);
    }

    #[test]
    fn calibration_is_that_of_a_hand_computation() {
        // Two sure and right, one of 0.6 and wrong, one of 0.6 and right.
        let posteriors = vec![vec![1.0, 0.0], vec![0.0, 1.0], vec![0.6, 0.4], vec![0.4, 0.6]];
        let figures = calibration(&posteriors, &[0, 1, 1, 1]);
        assert!((figures.ece - 0.2 / 4.0).abs() < 1e-12, "{figures:?}");
        assert!((figures.brier - (0.72 + 0.32) / 4.0).abs() < 1e-12);
        assert!((figures.log_loss + (0.4_f64.ln() + 0.6_f64.ln()) / 4.0).abs() < 1e-12);
    }

    #[test]
    fn percentiles_are_those_of_numpy() {
        let values = [4.0, 1.0, 3.0, 2.0];
        assert_eq!(percentile(&values, 50.0), 2.5);
        assert!((percentile(&values, 90.0) - 3.7).abs() < 1e-12);
        assert_eq!(percentile(&[], 50.0), 0.0);
    }
}
