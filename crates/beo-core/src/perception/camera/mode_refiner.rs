//! The refinement of a mode: yaw, size and place climbed by the evidence from where a cell of the view's densities expects them.

use super::expectation::Expectation;
use super::refinement::Parameters;
use super::{Cell, KnownPlacement, PlacementPrior, RefinedPlacement, ViewFrame};
use crate::grid::{Dims, Observation, Outside, Similarity};
use crate::perception::PerceiveError;
use crate::perception::evidence::conditional::Conditional;
use crate::perception::evidence::lattice::Codes;
use crate::perception::evidence::placed::{EvidenceModel, EvidenceScratch, ObjectFrame};
use crate::perception::evidence::thinned::{Detail, ThinnedEvidence, ThinnedScratch};
use nalgebra::Vector3;

/// A class as it lies best.
#[derive(Clone, Copy, Debug)]
pub struct PlacedClass {
    /// Where the search began.
    pub cell: Cell,
    /// Where it ended, in the view's frame.
    pub refined: RefinedPlacement,
    /// Log evidence there, relative to the background.
    pub log_evidence: f64,
}

/// Refines modes by the evidence: climbs on that of a coarse lattice of voxels, settles on that of a finer one, and weighs that of all.
pub struct ModeRefiner<'a> {
    /// The classes.
    pub evidence: &'a EvidenceModel,
    /// Weight of the log evidence against what the view's density expects.
    pub weight: f64,
    /// Content of the space beyond the grid.
    pub outside: Outside,
    /// The view's frame.
    pub frame: &'a ViewFrame,
    /// Knowledge of yaw, size and place.
    pub told: &'a KnownPlacement,
    /// What is expected of an object that was answered before.
    pub expectation: Option<Expectation>,
    /// The observation …
    pub seen: &'a Observation,
    /// … and the same for lattices.
    pub codes: &'a Codes,
}

/// Scratch memory of a [`ModeRefiner`].
pub struct ModeRefinerScratch {
    all: EvidenceScratch,
    thinned: ThinnedScratch,
    /// The class that was settled last, and how.
    settled: Option<(usize, Similarity)>,
    /// The frame of `all` is lent, and another in its place.
    is_lent: bool,
}

impl ModeRefinerScratch {
    /// Room for observations of one size.
    pub fn new(dims: Dims) -> Self {
        Self { all: EvidenceScratch::new(dims), thinned: ThinnedScratch::default(), settled: None, is_lent: false }
    }

    /// Nothing is settled yet.
    pub fn start(&mut self) {
        self.settled = None;
    }

    /// Hands over what was placed and conditioned last, if that was this class, and it lay so: completion does not compute it again. The frame
    /// is to be given back by [`Self::take_back`].
    pub fn lend(&mut self, class: usize, placed: &Similarity, frame: &mut ObjectFrame, conditional: &mut Conditional) -> bool {
        let is_it = !self.is_lent && self.settled.take() == Some((class, *placed));
        if is_it {
            self.all.exchange(frame);
            conditional.set(self.all.conditional());
            self.is_lent = true;
        }
        is_it
    }

    /// Takes back the frame that was lent, so that each has the memory that its own use has warmed.
    pub fn take_back(&mut self, frame: &mut ObjectFrame) {
        if std::mem::take(&mut self.is_lent) {
            self.all.exchange(frame);
        }
    }
}

/// Where the climb of a cell ended.
#[derive(Clone, Copy, Debug)]
pub struct Climbed {
    /// Where it began.
    pub cell: Cell,
    /// Where it ended.
    pub parameters: Parameters,
    /// The log density there, by the coarse lattice and what the cell expects.
    pub value: f64,
}

impl ModeRefiner<'_> {
    /// Climbs from where a cell expects yaw, size and place.
    pub fn climb(&self, cell: &Cell, scratch: &mut ModeRefinerScratch) -> Result<Climbed, PerceiveError> {
        let start = self.start(cell);
        if start.is_known() {
            return Ok(Climbed { cell: *cell, parameters: start.expected, value: 0.0 });
        }
        let mut evidence = self.evidence(Detail::Coarse, cell, scratch);
        let (parameters, value) = start.climb(|at| evidence.log_likelihood(at))?;
        Ok(Climbed { cell: *cell, parameters, value })
    }

    /// Ends a climb.
    pub fn settle(&self, climbed: &Climbed, scratch: &mut ModeRefinerScratch) -> Result<PlacedClass, PerceiveError> {
        let Climbed { cell, parameters, .. } = climbed;
        let start = self.start(cell);
        let mut refined = match start.is_known() {
            true => RefinedPlacement { parameters: *parameters, deviations: [0.0; 5], value: 0.0 },
            false => {
                let mut evidence = self.evidence(Detail::Fine, cell, scratch);
                start.settle(parameters, |at| evidence.log_likelihood(at))?
            }
        };
        let log_evidence = self.of_all(cell, &refined.parameters, &mut scratch.all)?;
        scratch.settled = Some((cell.class, self.placed(cell, &refined.parameters)));
        refined.value = self.weight * log_evidence + start.log_density(&refined.parameters);
        Ok(PlacedClass { cell: *cell, refined, log_evidence })
    }

    /// Both.
    pub fn refine(&self, cell: &Cell, scratch: &mut ModeRefinerScratch) -> Result<PlacedClass, PerceiveError> {
        let climbed = self.climb(cell, scratch)?;
        self.settle(&climbed, scratch)
    }

    /// Where the search of a cell begins: what is told has no deviation.
    fn start(&self, cell: &Cell) -> PlacementPrior {
        let mut start = start(cell, self.told);
        if let Some(expectation) = self.expectation.as_ref().filter(|expectation| expectation.is_of(cell)) {
            expectation.narrow(&mut start);
        }
        start
    }

    fn placed(&self, cell: &Cell, at: &Parameters) -> Similarity {
        cell.placed(self.frame, at[0], at[1].exp(), &Vector3::new(at[2], at[3], at[4]))
    }

    fn of_all(&self, cell: &Cell, at: &Parameters, scratch: &mut EvidenceScratch) -> Result<f64, PerceiveError> {
        Ok(self.evidence.of_placed(self.seen, &self.placed(cell, at), self.outside, cell.class, scratch)?.log_ratio)
    }

    fn evidence<'b>(&'b self, detail: Detail, cell: &'b Cell, scratch: &'b mut ModeRefinerScratch) -> CellEvidence<'b> {
        let EvidenceModel { thinned, noise_variance, .. } = self.evidence;
        let from = match thinned {
            Some(model) => Voxels::Lattice(model.of_class(detail, self.codes, cell.class, *noise_variance, &mut scratch.thinned)),
            None => Voxels::All(&mut scratch.all),
        };
        CellEvidence { refiner: self, cell, from }
    }
}

/// The evidence on which a cell is refined.
struct CellEvidence<'a> {
    refiner: &'a ModeRefiner<'a>,
    cell: &'a Cell,
    from: Voxels<'a>,
}

/// Voxels that evidence is computed from.
enum Voxels<'a> {
    Lattice(ThinnedEvidence<'a>),
    All(&'a mut EvidenceScratch),
}

impl CellEvidence<'_> {
    fn log_likelihood(&mut self, at: &Parameters) -> Result<f64, PerceiveError> {
        let Self { refiner, cell, from } = self;
        let log_evidence = match from {
            Voxels::Lattice(evidence) => evidence.log_ratio(&refiner.placed(cell, at))?,
            Voxels::All(scratch) => refiner.of_all(cell, at, scratch)?,
        };
        Ok(refiner.weight * log_evidence)
    }
}

/// Where a cell expects yaw, size and place; what is told has no deviation.
fn start(cell: &Cell, told: &KnownPlacement) -> PlacementPrior {
    let (place, scale) = (cell.place(), cell.scale());
    let mut start = PlacementPrior {
        expected: [cell.yaw(), scale.ln(), place.x, place.y, place.z],
        deviations: std::array::from_fn(|axis| cell.deviations[axis]),
    };
    let told = [told.yaw, told.scale.map(f64::ln), told.place.map(|p| p.x), told.place.map(|p| p.y), told.place.map(|p| p.z)];
    for (axis, value) in told.into_iter().enumerate() {
        if let Some(value) = value {
            (start.expected[axis], start.deviations[axis]) = (value, 0.0);
        }
    }
    start
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::Rotation;
    use crate::model::{CameraDensities, OFFSETS};

    #[test]
    fn what_is_told_is_not_searched() {
        let cell = Cell {
            class: 0,
            component: 0,
            resting: Rotation::identity(),
            log_prior: 0.0,
            step: 6,
            score: 0.0,
            offsets: [0.1, -0.2, 1.0, 2.0, 3.0, 9.0, 9.0, 9.0],
            deviations: [0.5; OFFSETS],
        };
        let free = start(&cell, &KnownPlacement::default());
        assert!((free.expected[0] - (CameraDensities::yaw(6) + 0.1)).abs() < 1e-12);
        let same = |a: &[f64], b: &[f64]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-12);
        assert!(same(&free.expected[1..], &[-0.2, 1.0, 2.0, 3.0]) && free.deviations == [0.5; 5]);
        let told = KnownPlacement { yaw: Some(1.0), scale: Some(1.0), ..KnownPlacement::default() };
        let some = start(&cell, &told);
        assert_eq!((some.expected, some.deviations), ([1.0, 0.0, 1.0, 2.0, 3.0], [0.0, 0.0, 0.5, 0.5, 0.5]));
    }
}
