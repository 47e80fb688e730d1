//! The log evidence from a lattice of voxels instead of all of them: what searches climb on.
//!
//! The sums over voxels of which the evidence consists (eqs. 16 and 17) are estimated by those over the lattice, times the voxels that each of
//! its own stands for. As the evidence depends on these sums divided by the noise variance alone, that is a noise variance so many times
//! smaller. Neighbouring voxels say nearly the same, so that one of nine tells poses apart nearly as well as all do.

use super::conditional::{ClassGram, Conditional};
use super::lattice::{Codes, Lattice, Sampled};
use super::subspace::ClassSubspace;
use crate::grid::{Dims, Similarity};
use crate::linear::LinearError;
use crate::perception::basis::rows::Rows;
use crate::perception::kernels::lanes::dispatch;
use crate::perception::kernels::row_gram::AddGram;

/// Voxels of the coarse lattice, about, whatever the size of the grid: where a search climbs …
const COARSE_VOXELS: usize = 3000;
/// … and of the fine one, which decides between the last steps.
const FINE_VOXELS: usize = 9000;

/// Rows whose products are summed in single precision, at most.
const SUMMED: usize = 512;

/// How many voxels evidence is computed from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Detail {
    /// A few thousand.
    Coarse,
    /// Some nine thousand.
    Fine,
}

/// The classes of a model on two lattices.
pub struct ThinnedModel {
    coarse: ThinnedClasses,
    fine: ThinnedClasses,
}

/// The classes of a model on one lattice.
struct ThinnedClasses {
    lattice: Lattice,
    classes: Vec<ThinnedClass>,
}

/// A class on a lattice.
pub struct ThinnedClass {
    prior: ClassGram,
    /// [W_s, μ_s, 1] of the lattice's voxels.
    rows: Vec<f32>,
    /// Values from row to row.
    stride: usize,
}

/// Scratch memory of one thread.
pub struct ThinnedScratch {
    sampled: Sampled,
    conditional: Conditional,
}

impl Default for ThinnedScratch {
    fn default() -> Self {
        Self { sampled: Sampled::default(), conditional: Conditional::new(0) }
    }
}

impl ThinnedScratch {
    /// The posterior of the class that was scored last.
    pub fn conditional(&self) -> &Conditional {
        &self.conditional
    }
}

impl ThinnedModel {
    /// The classes on lattices of a grid; none where nothing is derived over its voxels.
    pub fn new(dims: Dims, classes: &[ClassSubspace]) -> Option<Self> {
        let of = |voxels: usize| {
            let lattice = Lattice::one_of((dims.voxels() / voxels).max(1), dims);
            let classes = classes.iter().map(|class| ThinnedClass::of(class, lattice.voxels())).collect::<Option<_>>()?;
            Some(ThinnedClasses { lattice, classes })
        };
        Some(Self { coarse: of(COARSE_VOXELS)?, fine: of(FINE_VOXELS)? })
    }

    /// Estimated log evidence of a class for an object that lies so, relative to the background, nats, in voxels of the grid that was observed;
    /// `noise` is the noise variance.
    pub fn log_evidence(
        &self,
        detail: Detail,
        seen: &Codes,
        placed: &Similarity,
        class: usize,
        noise: f64,
        scratch: &mut ThinnedScratch,
    ) -> Result<f64, LinearError> {
        let ThinnedClasses { lattice, classes } = match detail {
            Detail::Coarse => &self.coarse,
            Detail::Fine => &self.fine,
        };
        let ThinnedScratch { sampled, conditional } = scratch;
        lattice.sample(seen, placed, sampled);
        let class = &classes[class];
        let prior = &class.prior;
        conditional.make_room(prior.size);
        let Conditional { unknown, filled, .. } = conditional;
        unknown.fill(0.0);
        if sampled.known().len() < sampled.unknown().len() {
            class.add_gram(sampled.known(), unknown);
            unknown.iter_mut().zip(&prior.gram).for_each(|(sum, all)| *sum = all - *sum);
        } else {
            class.add_gram(sampled.unknown(), unknown);
        }
        class.sum(sampled.filled(), filled);
        prior.solve(noise / lattice.share(), conditional)?;
        Ok(placed.scale.powi(3) * conditional.log_evidence_ratio())
    }
}

impl ThinnedClass {
    /// A class on some of the voxels only; none where nothing is derived over voxels.
    pub fn of(class: &ClassSubspace, voxels: &[usize]) -> Option<Self> {
        class.derived().map(|(prior, rows)| Self::new(prior, rows, voxels))
    }

    /// A class with this prior and these rows.
    fn new(prior: &ClassGram, rows: &Rows, voxels: &[usize]) -> Self {
        let stride = rows.stride();
        let mut wide = vec![0.0; voxels.len() * stride];
        for (voxel, wide) in voxels.iter().zip(wide.chunks_exact_mut(stride)) {
            rows.widen(&[(*voxel, voxel + 1)], wide);
        }
        let prior = ClassGram { size: prior.size, scales: prior.scales.clone(), gram: vec![0.0; prior.gram.len()] };
        let mut class = Self { prior, rows: wide, stride };
        let (all, mut gram): (Vec<u32>, _) = ((0..voxels.len() as u32).collect(), std::mem::take(&mut class.prior.gram));
        class.add_gram(&all, &mut gram);
        class.prior.gram = gram;
        class
    }

    /// Adds Σ rowᵀrow over some places to `out`, a packed lower triangle.
    fn add_gram(&self, places: &[u32], out: &mut [f64]) {
        for places in places.chunks(SUMMED) {
            let starts = places.iter().map(|place| *place as usize * self.stride);
            dispatch(AddGram { rows: &self.rows, starts, width: self.prior.size + 2, out });
        }
    }

    /// Sums the rows of some places into `out`.
    fn sum(&self, places: &[u32], out: &mut [f64]) {
        out.fill(0.0);
        for place in places {
            let row = &self.rows[*place as usize * self.stride..][..self.stride];
            out.iter_mut().zip(row).for_each(|(sum, v)| *sum += f64::from(*v));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::{Outside, View, yaw};
    use crate::perception::evidence::placed::EvidenceScratch;
    use crate::perception::pose::small::{model, perceiver, unseen};
    use nalgebra::Vector3;

    /// On a lattice of all voxels the evidence is the evidence; on thinner ones its differences between poses are nearly those of all voxels.
    #[test]
    fn a_lattice_tells_poses_apart_as_all_voxels_do() {
        let (evidence, dims) = (perceiver().evidence(), model().dims());
        let all = ThinnedClasses { lattice: Lattice::one_of(1, dims), classes: Vec::new() };
        let of = |of: usize| {
            let lattice = Lattice::one_of(of, dims);
            let classes = evidence.subspaces.iter().map(|class| ThinnedClass::of(class, lattice.voxels()).unwrap()).collect();
            ThinnedClasses { lattice, classes }
        };
        assert_eq!(all.lattice.share(), 1.0);
        let thinned = ThinnedModel { coarse: of(5), fine: of(1) };
        let (mut scratch, mut sparse, mut seen_codes) = (EvidenceScratch::new(dims), ThinnedScratch::default(), Codes::default());
        let (mut worst, mut widest) = (0.0_f64, 0.0_f64);
        for (class, name) in model().class_names().enumerate() {
            let seen = View::Top.of(&unseen(name, 6));
            seen_codes.set(&seen, Outside::Unknown);
            let mut first = None;
            for (angle, scale, x) in [(0.0, 1.0, 0.0), (0.2, 1.0, 0.0), (0.0, 1.1, 0.5), (-0.3, 0.9, -0.7), (0.5, 1.05, 1.2)] {
                let placed = Similarity { rotation: yaw(angle), scale, translation_voxels: Vector3::new(x, 0.3 * x, 0.0) };
                let exact = evidence.of_placed(&seen, &placed, Outside::Unknown, class, &mut scratch).unwrap().log_ratio;
                let [coarse, fine] = [Detail::Coarse, Detail::Fine].map(|detail| {
                    let noise = evidence.noise_variance;
                    thinned.log_evidence(detail, &seen_codes, &placed, class, noise, &mut sparse).unwrap()
                });
                assert!((fine - exact).abs() < 1e-3 * exact.abs().max(1.0), "{fine} {exact}");
                let (exact_first, coarse_first) = *first.get_or_insert((exact, coarse));
                worst = worst.max(((coarse - coarse_first) - (exact - exact_first)).abs());
                widest = widest.max((exact - exact_first).abs());
            }
        }
        assert!(worst < 0.25 * widest, "{worst} of {widest}");
    }
}
