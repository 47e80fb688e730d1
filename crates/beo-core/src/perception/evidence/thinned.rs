//! The log evidence from a lattice of voxels instead of all of them: what searches climb on.
//!
//! The sums over voxels of which the evidence consists (eqs. 16 and 17) are estimated by those over the lattice, times the voxels that each of
//! its own stands for. As the evidence depends on these sums divided by the noise variance alone, that is a noise variance so many times
//! smaller. Neighbouring voxels say nearly the same, so that one of nine tells poses apart nearly as well as all do.

use super::conditional::{ClassGram, Conditional};
use super::lattice::{Codes, Lattice, Sampled, count, list};
use super::subspace::ClassSubspace;
use crate::grid::{Dims, Similarity};
use crate::lanes::dispatch;
use crate::linear::LinearError;
use crate::perception::basis::rows::Rows;
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
    /// The known voxels of the pose before, of whose complement `conditional` holds the Gram matrix; empty if there was none.
    before: Vec<u64>,
    places: Vec<u32>,
    /// The Gram matrix of voxels that have become known.
    less: Vec<f64>,
    conditional: Conditional,
}

impl Default for ThinnedScratch {
    fn default() -> Self {
        let (before, places, less) = (Vec::new(), Vec::new(), Vec::new());
        Self { sampled: Sampled::default(), before, places, less, conditional: Conditional::new(0) }
    }
}

/// The evidence of one class for one observation, from one pose to the next. Of near poses most voxels agree, and only the sums over those that
/// do not are formed anew.
pub struct ThinnedEvidence<'a> {
    lattice: &'a Lattice,
    class: &'a ThinnedClass,
    seen: &'a Codes,
    noise: f64,
    scratch: &'a mut ThinnedScratch,
}

impl ThinnedModel {
    /// The classes on lattices of a grid; none where nothing is derived over its voxels.
    pub fn new(dims: Dims, classes: &[ClassSubspace]) -> Option<Self> {
        // Before there is a lattice: that of a grid which is so large that nothing is derived over it would take hours to choose.
        let derived: Vec<_> = classes.iter().map(ClassSubspace::derived).collect::<Option<_>>()?;
        let of = |voxels: usize| {
            let lattice = Lattice::one_of((dims.voxels() / voxels).max(1), dims);
            let classes = derived.iter().map(|(prior, rows)| ThinnedClass::new(prior, rows, lattice.voxels())).collect();
            ThinnedClasses { lattice, classes }
        };
        Some(Self { coarse: of(COARSE_VOXELS), fine: of(FINE_VOXELS) })
    }

    /// The evidence of a class for an observation; `noise` is the noise variance.
    pub fn of_class<'a>(
        &'a self,
        detail: Detail,
        seen: &'a Codes,
        class: usize,
        noise: f64,
        scratch: &'a mut ThinnedScratch,
    ) -> ThinnedEvidence<'a> {
        let ThinnedClasses { lattice, classes } = match detail {
            Detail::Coarse => &self.coarse,
            Detail::Fine => &self.fine,
        };
        // What was asked before must leave no trace, not even in roundings.
        scratch.before.clear();
        ThinnedEvidence { lattice, class: &classes[class], seen, noise, scratch }
    }
}

impl ThinnedEvidence<'_> {
    /// Estimated log evidence for an object that lies so, relative to the background, nats, in voxels of the grid that was observed.
    pub fn log_ratio(&mut self, placed: &Similarity) -> Result<f64, LinearError> {
        let Self { lattice, class, seen, noise, ref mut scratch } = *self;
        lattice.sample(seen, placed, &mut scratch.sampled);
        let prior = &class.prior;
        scratch.conditional.make_room(prior.size);
        class.sum_unknown(lattice.last_word(), scratch);
        let ThinnedScratch { sampled, places, conditional, .. } = &mut **scratch;
        list(sampled.filled.iter().copied(), places);
        class.sum(places, &mut conditional.filled);
        prior.solve(noise / lattice.share(), conditional)?;
        Ok(placed.scale.powi(3) * conditional.log_evidence_ratio())
    }

    /// The posterior of the class in the pose that was scored last.
    pub fn conditional(&self) -> &Conditional {
        &self.scratch.conditional
    }
}

impl ThinnedClass {
    /// A class with this prior and these rows, on some of the voxels only.
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

    /// The Gram matrix of the unknown voxels of `sampled`, from the fewest rows: of these, of the known ones, or of those that differ from the
    /// pose before. `last` are the bits of the last word of voxels.
    fn sum_unknown(&self, last: u64, scratch: &mut ThinnedScratch) {
        let ThinnedScratch { sampled: Sampled { known, .. }, before, places, less, conditional: Conditional { unknown: sum, .. } } =
            scratch;
        let words = known.len();
        let unknown = || known.iter().enumerate().map(|(i, word)| !word & if i + 1 == words { last } else { u64::MAX });
        let appeared = || before.iter().zip(known.iter()).map(|(before, now)| now & !before);
        let vanished = || before.iter().zip(known.iter()).map(|(before, now)| before & !now);
        let of_known = count(known.iter().copied());
        let of_unknown = count(unknown());
        if before.len() == words && count(appeared()) + count(vanished()) < of_known.min(of_unknown) {
            list(vanished(), places);
            self.add_gram(places, sum);
            list(appeared(), places);
            less.clear();
            less.resize(sum.len(), 0.0);
            self.add_gram(places, less);
            sum.iter_mut().zip(&*less).for_each(|(sum, less)| *sum -= less);
        } else {
            sum.fill(0.0);
            if of_known < of_unknown {
                list(known.iter().copied(), places);
                self.add_gram(places, sum);
                sum.iter_mut().zip(&self.prior.gram).for_each(|(sum, all)| *sum = all - *sum);
            } else {
                list(unknown(), places);
                self.add_gram(places, sum);
            }
        }
        before.clone_from(known);
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
    use crate::perception::basis::shared_rows::SharedRows;
    use crate::perception::evidence::placed::EvidenceScratch;
    use crate::perception::pose::small::{model, perceiver, unseen};
    use fixedbitset::FixedBitSet;
    use nalgebra::Vector3;
    use std::sync::Arc;

    /// On a lattice of all voxels the evidence is the evidence; on thinner ones its differences between poses are nearly those of all voxels.
    #[test]
    fn a_lattice_tells_poses_apart_as_all_voxels_do() {
        let (evidence, dims) = (perceiver().evidence(), model().dims());
        let all = ThinnedClasses { lattice: Lattice::one_of(1, dims), classes: Vec::new() };
        let of = |of: usize| {
            let lattice = Lattice::one_of(of, dims);
            let derived = evidence.subspaces.iter().map(|class| class.derived().unwrap());
            let classes = derived.map(|(prior, rows)| ThinnedClass::new(prior, rows, lattice.voxels())).collect();
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
                    thinned.of_class(detail, &seen_codes, class, noise, &mut sparse).log_ratio(&placed).unwrap()
                });
                assert!((fine - exact).abs() < 1e-3 * exact.abs().max(1.0), "{fine} {exact}");
                let (exact_first, coarse_first) = *first.get_or_insert((exact, coarse));
                worst = worst.max(((coarse - coarse_first) - (exact - exact_first)).abs());
                widest = widest.max((exact - exact_first).abs());
            }
        }
        assert!(worst < 0.25 * widest, "{worst} of {widest}");
    }

    /// Where W' is read in place, no lattice is looked for: of a grid of 254³ that would take hours.
    #[test]
    fn a_model_that_is_read_in_place_has_no_lattice_however_large_its_grid() {
        let support = FixedBitSet::from_iter(0..model().dims().voxels());
        let rows = Arc::new(SharedRows::over(model().dims(), model().basis.clone(), support).unwrap());
        let classes: Vec<ClassSubspace> = model().classes.iter().map(|class| ClassSubspace::shared(&rows, class)).collect();
        assert!(ThinnedModel::new(Dims::cube(254).unwrap(), &classes).is_none());
    }
}
