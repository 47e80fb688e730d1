//! Medians of repeated measurements, and how they grow.

use serde::Serialize;

/// How the time of one stage grows with one size.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Line {
    /// The stage.
    pub name: String,
    /// Unit of what was measured.
    pub unit: &'static str,
    /// Size and median.
    pub points: Vec<(f64, f64)>,
    /// e of the power law time ∝ size^e that fits best; `None` where there are not two sizes.
    pub exponent: Option<f64>,
    /// The exponent to be expected of large sizes.
    pub expected: f64,
}

/// Measurements over one size.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Series {
    /// The varied quantity.
    pub name: String,
    /// The quantities kept fixed.
    pub setting: String,
    /// Why the expected exponents are what they are.
    pub why: String,
    /// One for each stage.
    pub lines: Vec<Line>,
}

impl Line {
    /// Times in microseconds, with the exponent that fits them.
    pub fn new(name: &str, expected: f64, points: Vec<(f64, f64)>) -> Self {
        Self::of(name, "µs", expected, points)
    }

    /// The measured quantity in its unit, with the exponent that fits it.
    pub fn of(name: &str, unit: &'static str, expected: f64, points: Vec<(f64, f64)>) -> Self {
        Self { name: name.into(), unit, exponent: exponent(&points), expected, points }
    }
}

/// Slope of the least-squares line through (ln x, ln y); `None` where fewer than two sizes have a positive time.
fn exponent(points: &[(f64, f64)]) -> Option<f64> {
    let logs: Vec<(f64, f64)> = points.iter().filter(|(x, y)| *x > 0.0 && *y > 0.0).map(|(x, y)| (x.ln(), y.ln())).collect();
    let n = logs.len() as f64;
    let (mx, my) = (logs.iter().map(|p| p.0).sum::<f64>() / n, logs.iter().map(|p| p.1).sum::<f64>() / n);
    let spread: f64 = logs.iter().map(|(x, _)| (x - mx).powi(2)).sum();
    let slope = logs.iter().map(|(x, y)| (x - mx) * (y - my)).sum::<f64>() / spread;
    (logs.len() > 1 && spread > 1e-12).then_some(slope)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_exponent_is_that_of_the_power_law() {
        for e in [-1.0, 0.0, 0.7, 3.0] {
            let points: Vec<_> = [1.0, 2.0, 5.0, 64.0].map(|x: f64| (x, 3.5 * x.powf(e))).into();
            assert!((Line::new("", e, points).exponent.unwrap() - e).abs() < 1e-12);
        }
        // numpy.polyfit(log([1, 2, 4]), log([1, 3, 5]), 1)
        assert!((exponent(&[(1.0, 1.0), (2.0, 3.0), (4.0, 5.0)]).unwrap() - 1.160_964_047_443_681_3).abs() < 1e-12);
    }

    #[test]
    fn one_size_has_no_exponent() {
        assert_eq!(exponent(&[]), None);
        assert_eq!(exponent(&[(2.0, 5.0)]), None);
        assert_eq!(exponent(&[(2.0, 5.0), (2.0, 6.0)]), None);
        assert_eq!(exponent(&[(2.0, 5.0), (0.0, 6.0)]), None);
    }
}
