//! Drawing one of several at random.

use rand::{Rng, RngExt};

/// One of several, drawn in proportion to its weight; `None` if there are none.
pub fn draw_by<'a, T>(of: &'a [T], weight: impl Fn(&T) -> f64, rng: &mut impl Rng) -> Option<&'a T> {
    let mut left = of.iter().map(&weight).sum::<f64>() * rng.random_range(0.0..1.0);
    let drawn = of.iter().find(|one| {
        left -= weight(one);
        left <= 0.0
    });
    // Rounding may leave a trace of the last one's weight.
    drawn.or(of.last())
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;

    #[test]
    fn each_is_drawn_in_proportion_to_its_weight() {
        let (weights, mut counts, mut rng) = ([0.5, 0.0, 1.5], [0; 3], ChaCha8Rng::seed_from_u64(1));
        for _ in 0..4000 {
            counts[*draw_by(&[0, 1, 2], |n| weights[*n], &mut rng).unwrap()] += 1;
        }
        // Four standard deviations of a binomial of 4000 and 1/4.
        assert!(counts[1] == 0 && (900..1100).contains(&counts[0]), "{counts:?}");
        assert!(draw_by(&[0; 0], |_| 1.0, &mut rng).is_none());
    }
}
