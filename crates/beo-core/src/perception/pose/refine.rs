//! A rotation refined by expectation maximisation: the object is reconstructed from what is seen in the present pose (the
//! posterior mean of its class), then turned to where it explains the observation best, in ever finer steps.
//!
//! With m the reconstruction, drawn to [0.1, 0.9], a pose is scored by what its filled and hidden voxels say against empty space:
//!
//! Q(R) = 2 Σ_filled \[logit m(Rᵀx) − logit 0.1\] + Σ_unknown \[log 0.9 − log(1 − m(Rᵀx))\].
//!
//! Known empty voxels need no sum: what is lost where the object is not hidden is lost on filled and unknown voxels.

use crate::grid::{Dims, Observation, Outside, Rotation, Similarity};
use crate::perception::PerceiveError;
use crate::perception::basis::known::Known;
use crate::perception::evidence::conditional::Conditional;
use crate::perception::evidence::lattice::Codes;
use crate::perception::evidence::placed::{Evidence, EvidenceModel, EvidenceScratch};
use crate::perception::evidence::subspace::ClassSubspace;
use crate::perception::evidence::thinned::{Detail, ThinnedScratch};
use crate::perception::pool::Pool;
use crate::perception::search::climb::{Neighbours, climb};
use nalgebra::{Unit, Vector3};
use std::convert::Infallible;

/// Least probability of a reconstructed voxel to be filled, and to be empty.
const DOUBT: f32 = 0.1;
/// Weight of a filled voxel.
const FILLED_WEIGHT: f32 = 2.0;
/// Sweeps over the six neighbours per step, at most.
const SWEEPS: usize = 8;
/// Of so many voxels one is looked at in the first step.
const EVERY: usize = 3;

/// An observation whose pose is refined.
pub struct Refiner<'a> {
    /// The classes.
    pub evidence: &'a EvidenceModel,
    /// The observation as it came.
    pub seen: &'a Observation,
    /// The same, taken apart, …
    pub known: &'a Known,
    /// … and for lattices.
    pub codes: &'a Codes,
    /// Content of the space beyond the grid.
    pub outside: Outside,
    /// Log density over rotations, relative to the uniform one, on the scale of Q.
    pub prior: &'a (dyn Fn(&Rotation) -> f64 + Sync),
    /// Scratch memory.
    pub pool: &'a Pool<RefineScratch>,
}

/// Scratch memory of one refinement.
pub struct RefineScratch {
    evidence: EvidenceScratch,
    thinned: ThinnedScratch,
    field: Field,
}

impl RefineScratch {
    /// Room for observations of one size.
    pub fn new(dims: Dims) -> Self {
        Self { evidence: EvidenceScratch::new(dims), thinned: ThinnedScratch::default(), field: Field::new(dims) }
    }
}

/// A refined rotation and what the class says of the observation there.
#[derive(Clone, Copy, Debug)]
pub struct Refined {
    /// From object axes to grid axes.
    pub rotation: Rotation,
    /// The evidence there.
    pub evidence: Evidence,
}

impl Refiner<'_> {
    /// Refines `start` for a class by `steps`, in radians, falling.
    pub fn refine(&self, class: usize, start: &Rotation, steps: &[f64]) -> Result<Refined, PerceiveError> {
        self.pool.with(
            || RefineScratch::new(self.evidence.dims()),
            |RefineScratch { evidence: scratch, thinned, field }| {
                let mut rotation = *start;
                for (n, step) in steps.iter().enumerate() {
                    let subspace = &self.evidence.subspaces[class];
                    // Where the object lies so far is only known about: a lattice says enough of what it looks like.
                    match &self.evidence.thinned {
                        Some(model) => {
                            let (placed, noise) = (Similarity::turned(rotation), self.evidence.noise_variance);
                            let mut evidence = model.of_class(Detail::Fine, self.codes, class, noise, thinned);
                            evidence.log_ratio(&placed)?;
                            field.reconstruct(subspace, evidence.conditional());
                        }
                        None => {
                            self.evidence_at(&rotation, class, scratch)?;
                            field.reconstruct(subspace, scratch.conditional());
                        }
                    }
                    let every = if n == 0 { EVERY } else { 1 };
                    rotation = self.climb(field, &rotation, *step, every);
                }
                Ok(Refined { rotation, evidence: self.evidence_at(&rotation, class, scratch)? })
            },
        )
    }

    fn evidence_at(&self, rotation: &Rotation, class: usize, scratch: &mut EvidenceScratch) -> Result<Evidence, PerceiveError> {
        self.evidence.of_placed(self.seen, &Similarity::turned(*rotation), self.outside, class, scratch)
    }

    /// Moves by `step` about the grid's axes while that improves; one of `every` voxels is looked at.
    fn climb(&self, field: &Field, start: &Rotation, step: f64, every: usize) -> Rotation {
        let value = |rotation: &Rotation| f64::from(field.score(self.known, rotation, every)) + (self.prior)(rotation);
        let neighbours: [[Rotation; 2]; 3] = std::array::from_fn(|axis| {
            let about = Unit::new_unchecked(Vector3::ith(axis, 1.0));
            [step, -step].map(|angle| Rotation::from_axis_angle(&about, angle))
        });
        let look = |at: &Rotation, axis: usize, side: f64| {
            let next = neighbours[axis][usize::from(side < 0.0)] * at;
            Ok::<_, Infallible>(Some((next, value(&next))))
        };
        match climb((*start, value(start)), &[0, 1, 2], SWEEPS, Neighbours::First, look) {
            Ok((rotation, _)) => rotation,
        }
    }
}

/// The gain of a voxel of the reconstruction in Q, (filled, unknown), one pair per voxel.
struct Field {
    dims: Dims,
    gains: Vec<[f32; 2]>,
    /// The gain at each of [`LEVELS`] probabilities, from 0 to 1.
    of_level: Vec<[f32; 2]>,
}

/// Probabilities in whose gains the reconstruction is rounded, less one.
const LEVELS: usize = 1000;

impl Field {
    fn new(dims: Dims) -> Self {
        let empty = (1.0 - DOUBT).ln();
        let of_level = (0..=LEVELS).map(|level| {
            let m = level as f32 / LEVELS as f32 * (1.0 - 2.0 * DOUBT) + DOUBT;
            let (filled, hidden) = (m.ln(), empty - (1.0 - m).ln());
            [FILLED_WEIGHT * (filled - DOUBT.ln() + hidden), hidden]
        });
        Self { dims, gains: Vec::with_capacity(dims.voxels()), of_level: of_level.collect() }
    }

    fn reconstruct(&mut self, class: &ClassSubspace, conditional: &Conditional) {
        let Self { gains, of_level, .. } = self;
        gains.clear();
        class.reconstruct(conditional, |mean| gains.push(of_level[(mean.clamp(0.0, 1.0) * LEVELS as f32 + 0.5) as usize]));
    }

    /// Q of a pose, by one of `every` voxels, each of which then stands for so many.
    fn score(&self, known: &Known, rotation: &Rotation, every: usize) -> f32 {
        let back = rotation.inverse().to_rotation_matrix();
        let back = back.matrix().map(|v| v as f32);
        let sides = <[usize; 3]>::from(self.dims);
        let middle = sides.map(|side| (side as f32 - 1.0) / 2.0);
        let place = |voxel: usize| {
            let [i, j, k] = self.dims.coordinates(voxel);
            let at = Vector3::new(i as f32 - middle[0], j as f32 - middle[1], k as f32 - middle[2]);
            // Half a voxel to round, and one so that truncation rounds down.
            back * at + Vector3::new(middle[0] + 1.5, middle[1] + 1.5, middle[2] + 1.5)
        };
        let gain = |at: Vector3<f32>, what: usize| {
            let [i, j, k] = [at.x as usize, at.y as usize, at.z as usize];
            // What is negative becomes 0, and then huge.
            let [i, j, k] = [i.wrapping_sub(1), j.wrapping_sub(1), k.wrapping_sub(1)];
            if i < sides[0] && j < sides[1] && k < sides[2] { self.gains[(i * sides[1] + j) * sides[2] + k][what] } else { 0.0 }
        };
        let filled: f32 = known.filled.iter().step_by(every).map(|voxel| gain(place(*voxel), 0)).sum();
        let up = back.column(2).into_owned();
        let mut hidden = 0.0;
        for &(start, end) in &known.unknown {
            let bottom = place(start);
            // Not the same levels of all columns.
            let column = start / self.dims.z();
            let first = (column + column / self.dims.y() + start) % every;
            hidden += (first..end - start).step_by(every).map(|k| gain(bottom + up * k as f32, 1)).sum::<f32>();
        }
        every as f32 * (filled + hidden)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::{Turn, View, yaw};
    use crate::perception::pose::small::{perceiver, unseen};

    fn with_refiner<T>(object: &crate::grid::Occupancy, truth: &Rotation, act: impl FnOnce(&Refiner<'_>) -> T) -> T {
        let seen = View::Top.of(&Turn::new(object.dims(), truth).occupancy(object));
        let mut known = Known::new(object.dims());
        known.read(&seen);
        let (evidence, pool) = (perceiver().evidence(), Pool::default());
        let mut codes = Codes::default();
        codes.set(&seen, Outside::Empty);
        act(&Refiner { evidence, seen: &seen, known: &known, codes: &codes, outside: Outside::Empty, prior: &|_| 0.0, pool: &pool })
    }

    /// Q by definition, voxel by voxel of the observation, with the object's grid looked up by the turn of grids.
    #[test]
    fn a_pose_is_scored_by_what_filled_and_unknown_voxels_say() {
        let (object, rotation) = (unseen("chair", 3), Rotation::from_euler_angles(0.4, -0.7, 2.0));
        let dims = object.dims();
        let means: Vec<f32> = (0..dims.voxels()).map(|v| perceiver().class_mean(0, v)).collect();
        let clamped: Vec<f32> = means.iter().map(|m| m.clamp(0.0, 1.0) * 0.8 + 0.1).collect();
        let filled: Vec<f32> = clamped.iter().map(|m| 2.0 * ((m / (1.0 - m)).ln() - (0.1_f32 / 0.9).ln())).collect();
        let hidden: Vec<f32> = clamped.iter().map(|m| 0.9_f32.ln() - (1.0 - m).ln()).collect();
        let (mut turned_filled, mut turned_hidden) = (vec![0.0; filled.len()], vec![0.0; hidden.len()]);
        let turn = Turn::new(dims, &rotation);
        turn.values(&filled, 0.0, &mut turned_filled);
        turn.values(&hidden, 0.0, &mut turned_hidden);
        with_refiner(&object, &yaw(0.3), |refiner| {
            let mut expected = 0.0;
            for voxel in 0..dims.voxels() {
                match (refiner.seen.known().contains(voxel), refiner.seen.filled().contains(voxel)) {
                    (_, true) => expected += turned_filled[voxel],
                    (false, _) => expected += turned_hidden[voxel],
                    _ => {}
                }
            }
            // A class conditioned on nothing is its mean.
            let class = &perceiver().evidence().subspaces[0];
            let mut conditional = Conditional::new(class.size());
            let mut nothing = Known::new(dims);
            nothing.read(&Observation::unknown(dims));
            class.condition(&nothing, 1.0, &mut conditional).unwrap();
            let mut field = Field::new(dims);
            field.reconstruct(class, &conditional);
            let found = field.score(refiner.known, &rotation, 1);
            assert!((found - expected).abs() < 0.02 * expected.abs().max(1.0), "{found} {expected}");
            let some = field.score(refiner.known, &rotation, EVERY);
            assert!((some - expected).abs() < 0.1 * expected.abs().max(1.0), "{some} {expected}");
        });
    }

    #[test]
    fn refinement_comes_closer() {
        let (mut before, mut after) = (0.0, 0.0);
        for seed in 0..8 {
            let angle = seed as f64;
            let truth = Rotation::from_euler_angles(0.3 * angle, 0.2 - 0.1 * angle, angle);
            let off = Rotation::from_scaled_axis(Vector3::new(0.08, -0.09, 0.07));
            with_refiner(&unseen("chair", seed), &truth, |refiner| {
                let refined = refiner.refine(0, &(off * truth), &[0.1, 0.05, 0.025]).unwrap();
                assert!(refined.evidence.log_ratio.is_finite());
                before += off.angle();
                after += refined.rotation.angle_to(&truth);
            });
        }
        assert!(after < 0.6 * before, "{after} {before}");
    }
}
