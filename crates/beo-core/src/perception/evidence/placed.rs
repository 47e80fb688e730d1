//! The log evidence of a class for an object that lies in a given way: the observation is moved to the object's canonical grid, taken apart
//! there, and the class conditioned on its known voxels.
//!
//! In the canonical grid a voxel stands for scale³ of those that were observed, so that log evidence relative to the background, times
//! scale³, speaks of the same data whatever the scale.

use super::conditional::Conditional;
use super::subspace::ClassSubspace;
use super::thinned::ThinnedModel;
use crate::grid::{Dims, Observation, Outside, Rotation, Similarity, Turn};
use crate::linear::LinearError;
use crate::model::Damaged;
use crate::perception::PerceiveError;
use crate::perception::basis::known::Known;
use crate::perception::basis::reading::BasisRows;
use rayon::prelude::*;

/// An observation in the canonical grid of an object, taken apart.
pub(crate) struct ObjectFrame {
    turn: Turn,
    observation: Observation,
    known: Known,
}

impl ObjectFrame {
    /// Room for observations of one size.
    pub fn new(dims: Dims) -> Self {
        Self { turn: Turn::unset(dims), observation: Observation::unknown(dims), known: Known::new(dims) }
    }

    /// Takes an observation apart as it came: of an object that stands in the grid as the training shapes do.
    ///
    /// # Errors
    /// [`Damaged`] if a part of the model file that is read for the first time is not what was written.
    pub fn take_as_it_came(&mut self, rows: &BasisRows, seen: &Observation) -> Result<(), Damaged> {
        rows.take_apart(seen, &mut self.known)
    }

    /// Moves an observation to the canonical grid of an object that lies so, and takes it apart; `outside` says what lies beyond the grid.
    ///
    /// # Errors
    /// [`Damaged`] if a part of the model file that is read for the first time is not what was written.
    pub fn take_moved(&mut self, rows: &BasisRows, seen: &Observation, placed: &Similarity, outside: Outside) -> Result<(), Damaged> {
        self.turn.set_to_object(placed);
        self.turn.observation_into(seen, outside, &mut self.observation);
        rows.take_apart(&self.observation, &mut self.known)
    }

    /// The known voxels in the canonical grid.
    pub fn known(&self) -> &Known {
        &self.known
    }

    /// The observation after [`Self::take_moved`].
    pub fn observation(&self) -> &Observation {
        &self.observation
    }

    /// The way from the object's canonical grid to the one that was observed.
    pub fn way_back(&mut self, placed: &Similarity) -> &Turn {
        self.turn.set_to_grid(placed);
        &self.turn
    }
}

/// Scratch memory of one thread that computes evidence of one class after the other.
pub(crate) struct EvidenceScratch {
    frame: ObjectFrame,
    conditional: Conditional,
    scale: f64,
}

impl EvidenceScratch {
    /// Room for observations of one size.
    pub fn new(dims: Dims) -> Self {
        Self { frame: ObjectFrame::new(dims), conditional: Conditional::new(0), scale: 1.0 }
    }

    /// The posterior of the class that was scored last.
    pub fn conditional(&self) -> &Conditional {
        &self.conditional
    }

    /// Exchanges the observation as it was placed last for another frame.
    pub fn exchange(&mut self, frame: &mut ObjectFrame) {
        std::mem::swap(&mut self.frame, frame);
    }

    /// The observation in the frame in which it was placed last.
    #[cfg(test)]
    pub fn frame(&self) -> &ObjectFrame {
        &self.frame
    }
}

/// Evidence of a class.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Evidence {
    /// Log evidence relative to the background, nats, in voxels of the grid that was observed.
    pub log_ratio: f64,
    /// Squared distance of the class mean to the known voxels.
    pub squared_distance: f64,
}

/// The classes of a model as Gaussians over voxels, and the variance of the noise about them.
pub(crate) struct EvidenceModel {
    /// W' as it is read.
    pub rows: BasisRows,
    /// One per class.
    pub subspaces: Vec<ClassSubspace>,
    /// σ², inflated.
    pub noise_variance: f64,
    /// The same on lattices, for searches; none where W' is read in place.
    pub thinned: Option<ThinnedModel>,
}

impl EvidenceModel {
    /// Classes as Gaussians about which the noise has this variance.
    pub fn new(rows: BasisRows, subspaces: Vec<ClassSubspace>, noise_variance: f64) -> Self {
        let thinned = ThinnedModel::new(rows.dims(), &subspaces);
        Self { rows, subspaces, noise_variance, thinned }
    }

    /// Size of the canonical grid.
    pub fn dims(&self) -> Dims {
        self.rows.dims()
    }

    /// Moves an observation to the canonical grid of an object that lies so.
    pub fn place(&self, seen: &Observation, placed: &Similarity, outside: Outside, scratch: &mut EvidenceScratch) -> Result<(), Damaged> {
        scratch.scale = placed.scale;
        scratch.frame.take_moved(&self.rows, seen, placed, outside)
    }

    /// Evidence of a class for the observation that was placed last; its posterior is left in the scratch memory.
    pub fn of_class(&self, class: usize, scratch: &mut EvidenceScratch) -> Result<Evidence, LinearError> {
        let EvidenceScratch { frame, conditional, scale } = scratch;
        self.subspaces[class].condition(&frame.known, self.noise_variance, conditional)?;
        Ok(Evidence { log_ratio: scale.powi(3) * conditional.log_evidence_ratio(), squared_distance: conditional.distance2 })
    }

    /// Evidence of a class for an object that is turned so, like [`Self::of_placed`]. Where W' is read in place, only voxels inside its footprint
    /// are counted: relative to the background no other says anything.
    pub fn of_turned(
        &self,
        seen: &Observation,
        rotation: &Rotation,
        outside: Outside,
        class: usize,
        scratch: &mut EvidenceScratch,
    ) -> Result<Evidence, PerceiveError> {
        match &self.rows {
            BasisRows::InPlace(rows) => {
                scratch.scale = 1.0;
                rows.sum_turned(seen, rotation, outside, &mut scratch.frame.known.sums)?;
            }
            BasisRows::Derived { .. } => self.place(seen, &Similarity::turned(*rotation), outside, scratch)?,
        }
        Ok(self.of_class(class, scratch)?)
    }

    /// Both at once.
    pub fn of_placed(
        &self,
        seen: &Observation,
        placed: &Similarity,
        outside: Outside,
        class: usize,
        scratch: &mut EvidenceScratch,
    ) -> Result<Evidence, PerceiveError> {
        self.place(seen, placed, outside, scratch)?;
        Ok(self.of_class(class, scratch)?)
    }

    /// Conditions the classes that are `wanted` on what is known, each into its own memory: on one thread, or on all.
    pub fn condition(&self, known: &Known, wanted: &[bool], conditionals: &mut [Conditional], alone: bool) -> Result<(), LinearError> {
        let condition = |((class, conditional), wanted): ((&ClassSubspace, &mut Conditional), &bool)| match wanted {
            true => class.condition(known, self.noise_variance, conditional),
            false => Ok(()),
        };
        if alone {
            self.subspaces.iter().zip(conditionals).zip(wanted).try_for_each(condition)
        } else {
            self.subspaces.par_iter().zip(conditionals).zip(wanted).try_for_each(condition)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::{View, yaw};
    use crate::perception::pose::small::{model, perceiver, unseen};

    /// Border columns, where no training shape is: whether they are known to be empty must not tell poses apart. Against the plain
    /// density of the known voxels each of them would count with log(2πσ²) / 2.
    #[test]
    fn what_is_known_to_be_empty_far_from_the_object_says_nothing() {
        let seen = View::Top.of(&unseen("chair", 4));
        let dims = model().dims();
        let mut less = Observation::unknown(dims);
        let mut hidden = 0;
        for voxel in seen.known().ones() {
            let [i, j, _] = dims.coordinates(voxel);
            if [i, j].iter().any(|c| *c == 0 || *c == dims.x() - 1) {
                hidden += 1;
            } else {
                less.set(voxel, seen.filled().contains(voxel));
            }
        }
        let evidence = perceiver().evidence();
        let mut scratch = EvidenceScratch::new(dims);
        let plain = 0.5 * f64::from(hidden) * (std::f64::consts::TAU * evidence.noise_variance).ln().abs();
        for class in 0..model().classes.len() {
            let [a, b] = [&seen, &less].map(|observation| {
                let found = evidence.of_placed(observation, &Similarity::default(), Outside::Empty, class, &mut scratch);
                found.unwrap().log_ratio
            });
            assert!((a - b).abs() < 0.05 * plain, "{a} {b}, plain {plain}");
        }
    }

    /// Independent of how the class is conditioned: log N(w; V μ, V W Λ WᵀVᵀ + σ² I) less log N(w; 0, σ² I) with the dense covariance over the
    /// known voxels of a small observation.
    #[test]
    fn the_evidence_is_that_of_the_dense_gaussian_relative_to_noise() {
        let (object, dims) = (unseen("chair", 2), model().dims());
        let seen = View::Top.of(&object);
        let mut few = Observation::unknown(dims);
        seen.known().ones().filter(|voxel| voxel % 11 == 3).for_each(|voxel| few.set(voxel, seen.filled().contains(voxel)));
        let placed = Similarity { rotation: yaw(0.4), scale: 0.9, translation_voxels: nalgebra::Vector3::new(0.6, -0.3, 0.2) };
        let (evidence, mut scratch) = (perceiver().evidence(), EvidenceScratch::new(dims));
        let found = evidence.of_placed(&few, &placed, Outside::Unknown, 0, &mut scratch).unwrap();
        let moved = scratch.frame().observation().clone();
        let known: Vec<usize> = moved.known().ones().collect();
        let n = known.len();
        assert!(n > 50);
        let (class, basis, noise) = (&model().classes[0], &model().basis, evidence.noise_variance);
        let a = model().rank();
        let row = |voxel: usize| -> Vec<f64> { basis.row(voxel).iter().map(|v| f64::from(v.to_f32())).collect() };
        let rows: Vec<Vec<f64>> = known.iter().map(|voxel| row(*voxel)).collect();
        let product = |x: &[f64], y: &[f32]| x.iter().zip(y).map(|(x, y)| x * f64::from(*y)).sum::<f64>();
        let own: Vec<Vec<f64>> =
            rows.iter().map(|row| class.directions.chunks_exact(a).map(|direction| product(row, direction)).collect()).collect();
        let mut covariance = faer::Mat::<f64>::from_fn(n, n, |i, j| {
            let shared: f64 = (0..class.variances.len()).map(|h| own[i][h] * class.variances[h] * own[j][h]).sum();
            shared + if i == j { noise } else { 0.0 }
        });
        crate::linear::cholesky(&mut covariance).unwrap();
        let residual: Vec<f64> =
            known.iter().zip(&rows).map(|(v, row)| f64::from(u8::from(moved.filled().contains(*v))) - product(row, &class.mean)).collect();
        let mut solved = residual.clone();
        crate::linear::solve_cholesky(&covariance, &mut solved);
        let quadratic: f64 = residual.iter().zip(&solved).map(|(r, s)| r * s).sum();
        let filled = moved.filled().count_ones(..) as f64;
        let expected = -0.5 * (quadratic + crate::linear::log_determinant(covariance.as_ref()) - n as f64 * noise.ln() - filled / noise);
        let expected = placed.scale.powi(3) * expected;
        // Rows of a class are kept in 16 bits.
        assert!((found.log_ratio - expected).abs() < 2e-3 * expected.abs().max(1.0), "{} {expected}", found.log_ratio);
    }
}
