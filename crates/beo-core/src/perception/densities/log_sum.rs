//! Sums and normalisation of probabilities that are kept as logarithms.

/// log Σ exp(x); −∞ where no value is finite.
pub fn log_sum_exp(values: impl Iterator<Item = f64> + Clone) -> f64 {
    let peak = values.clone().fold(f64::NEG_INFINITY, f64::max);
    if peak.is_finite() { peak + values.map(|value| (value - peak).exp()).sum::<f64>().ln() } else { peak }
}

/// exp(x) / Σ exp(x) in place; all-equal if no value is finite.
pub fn softmax(values: &mut [f64]) {
    let peak = values.iter().copied().filter(|v| v.is_finite()).fold(f64::NEG_INFINITY, f64::max);
    let count = values.len() as f64;
    for value in values.iter_mut() {
        *value = if value.is_finite() { (*value - peak).exp() } else { 0.0 };
    }
    let sum: f64 = values.iter().sum();
    values.iter_mut().for_each(|value| *value = if sum > 0.0 { *value / sum } else { 1.0 / count });
}

/// The first of the most probable classes; 0 where there is none.
pub fn most_probable(posterior: &[f64]) -> usize {
    (0..posterior.len()).max_by(|a, b| posterior[*a].total_cmp(&posterior[*b]).then(b.cmp(a))).unwrap_or(0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sums_of_exponentials_neither_overflow_nor_vanish() {
        // scipy.special.logsumexp([1000, 1001, -inf])
        let found = log_sum_exp([1000.0, 1001.0, f64::NEG_INFINITY].into_iter());
        assert!((found - 1_001.313_261_687_518_2).abs() < 1e-10, "{found}");
        assert_eq!(log_sum_exp([f64::NEG_INFINITY].into_iter()), f64::NEG_INFINITY);
        assert_eq!(log_sum_exp(std::iter::empty()), f64::NEG_INFINITY);
    }

    #[test]
    fn softmax_survives_what_is_not_finite() {
        let mut values = [f64::NEG_INFINITY, f64::NAN];
        softmax(&mut values);
        assert_eq!(values, [0.5, 0.5]);
        let mut values = [-1e6, f64::NEG_INFINITY];
        softmax(&mut values);
        assert_eq!(values, [1.0, 0.0]);
    }

    #[test]
    fn of_classes_alike_the_first_is_the_most_probable() {
        assert_eq!((most_probable(&[0.2, 0.4, 0.4]), most_probable(&[])), (1, 0));
    }
}
