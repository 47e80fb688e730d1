//! Hill climbing by steps along axes, and the top of a parabola at its end: what every search refines by.

/// Which neighbours along an axis are looked at before the best of them is taken.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Neighbours {
    /// The one ahead, and the one behind only if that is no better.
    First,
    /// The one behind and the one ahead.
    Both,
}

/// Climbs from a point and its value by one step at a time along each of the `axes`, until a sweep over all of them brings nothing or `sweeps`
/// are done. `look` gives the neighbour on one side (±1) of a point along an axis with its value, or `None` where there is none.
pub fn climb<P: Copy, E>(
    start: (P, f64),
    axes: &[usize],
    sweeps: usize,
    neighbours: Neighbours,
    mut look: impl FnMut(&P, usize, f64) -> Result<Option<(P, f64)>, E>,
) -> Result<(P, f64), E> {
    let (mut at, mut best) = start;
    for _ in 0..sweeps {
        let before = best;
        for &axis in axes {
            let from = at;
            for side in if neighbours == Neighbours::First { [1.0, -1.0] } else { [-1.0, 1.0] } {
                let Some((next, value)) = look(&from, axis, side)? else { continue };
                if value > best {
                    (at, best) = (next, value);
                    if neighbours == Neighbours::First {
                        break;
                    }
                }
            }
        }
        if best == before {
            break;
        }
    }
    Ok((at, best))
}

/// Where the parabola through (−1, `low`), (0, `middle`) and (1, `high`) has its top, and its second difference there, which is negative;
/// `None` if it opens upwards.
pub fn parabola(low: f64, middle: f64, high: f64) -> Option<(f64, f64)> {
    let bend = low - 2.0 * middle + high;
    (bend < 0.0).then(|| (0.5 * (low - high) / bend, bend))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::convert::Infallible;

    fn value(at: &[i32; 2]) -> f64 {
        -f64::from((at[0] - 3).pow(2) + (at[1] + 2).pow(2))
    }

    #[test]
    fn a_hill_is_climbed_to_its_top_by_either_rule() {
        for neighbours in [Neighbours::First, Neighbours::Both] {
            let look = |at: &[i32; 2], axis: usize, side: f64| {
                let mut next = *at;
                next[axis] += side as i32;
                Ok::<_, Infallible>(Some((next, value(&next))))
            };
            assert_eq!(climb(([0, 0], value(&[0, 0])), &[0, 1], 9, neighbours, look).unwrap(), ([3, -2], 0.0));
            assert_eq!(climb(([0, 0], value(&[0, 0])), &[0, 1], 1, neighbours, look).unwrap().0, [1, -1]);
        }
    }

    #[test]
    fn the_top_of_a_parabola_is_found_and_a_valley_has_none() {
        let f = |x: f64| 1.0 - 2.0 * (x - 0.3).powi(2);
        let (top, bend) = parabola(f(-1.0), f(0.0), f(1.0)).unwrap();
        assert!((top - 0.3).abs() < 1e-12 && (bend + 4.0).abs() < 1e-12);
        assert_eq!(parabola(1.0, 0.0, 1.0), None);
    }
}
