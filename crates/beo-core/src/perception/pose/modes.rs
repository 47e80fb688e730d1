//! Peaks among scored rotations, and the mean rotation of what lies around them.

use crate::grid::{Rotation, mean_rotation};
use crate::perception::search::merging::Merging;

/// Rotations within this of a better one belong to its mode.
const RADIUS: f64 = 25.0 / 180.0 * std::f64::consts::PI;

/// A rotation with a score.
#[derive(Clone, Copy, Debug)]
pub struct Candidate {
    /// Where it stands among others: these decide what lies near.
    pub cell: Rotation,
    /// The best guess of the rotation from there.
    pub rotation: Rotation,
    /// Higher is better.
    pub score: f64,
}

/// A peak.
#[derive(Clone, Debug)]
pub struct Mode {
    /// Mean rotation, weighted by exp(score / temperature).
    pub rotation: Rotation,
    /// Score of the best candidate.
    pub score: f64,
    /// Its candidates, best first.
    pub members: Vec<usize>,
}

/// The best `most` modes of `candidates`, which are sorted by falling score: greedily, the best that is left with all near it.
pub fn modes(candidates: &[Candidate], temperature: f64, most: usize) -> Vec<Mode> {
    let nearest = (RADIUS / 2.0).cos();
    let near = |peak: usize, other: usize| candidates[other].cell.coords.dot(&candidates[peak].cell.coords).abs() >= nearest;
    let mut merging = Merging::default();
    merging.start(candidates.len());
    let mut modes = Vec::new();
    while modes.len() < most {
        let mut members = Vec::new();
        let Some(peak) = merging.next(near, |member| members.push(member)) else { break };
        let best = &candidates[peak];
        let weight = |candidate: &Candidate| ((candidate.score - best.score) / temperature).exp();
        let rotation = mean_rotation(&best.rotation, members.iter().map(|i| (candidates[*i].rotation, weight(&candidates[*i]))));
        modes.push(Mode { rotation, score: best.score, members });
    }
    modes
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::yaw;

    fn candidate(degrees: f64, score: f64) -> Candidate {
        let rotation = yaw(degrees.to_radians());
        // Half of them by the other quaternion of the same rotation.
        let rotation = if (degrees as i64) % 2 == 0 { rotation } else { Rotation::new_unchecked(-rotation.into_inner()) };
        Candidate { cell: rotation, rotation, score }
    }

    #[test]
    fn modes_are_peaks_with_what_lies_around_them() {
        let candidates = [candidate(90.0, 10.0), candidate(355.0, 9.0), candidate(5.0, 9.0), candidate(99.0, 8.0), candidate(180.0, 1.0)];
        let found = modes(&candidates, 1.0, 8);
        assert_eq!(found.iter().map(|m| m.members.clone()).collect::<Vec<_>>(), [vec![0, 3], vec![1, 2], vec![4]]);
        // Two alike: half-way. Two unlike: by weights 1 and e^−2, for small angles.
        assert!(found[1].rotation.angle() < 1e-9);
        let expected = 90.0 + 9.0 * (-2.0_f64).exp() / (1.0 + (-2.0_f64).exp());
        assert!((crate::grid::yaw_of(&found[0].rotation).to_degrees() - expected).abs() < 0.01);
        assert_eq!(modes(&candidates, 1.0, 2).len(), 2);
        assert!(modes(&[], 1.0, 2).is_empty());
    }
}
