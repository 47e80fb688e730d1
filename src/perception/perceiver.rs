//! One query in, one percept out.

use super::blend::{Scores, softmax};
use super::completion::{self, Part, for_each_unknown};
use super::known::Known;
use super::paper;
use super::subspace::{ClassSubspace, Conditional};
use super::{ColumnSums, Density, Method, Percept, Query};
use crate::grid::{Dims, Observation};
use crate::linear::LinearError;
use crate::model::{Blend, Model};
use rayon::prelude::*;
use std::sync::{Arc, OnceLock};

/// Classes below this posterior take no part in a completion …
const LEAST_SHARE: f64 = 0.05;
/// … and no more than this many do.
const MOST_PARTS: usize = 3;
/// Classes whose posterior by the hull is below this share of the best one's are not worth computing their evidence, which
/// weighs little in the blend.
const HOPELESS: f64 = 1e-5;
/// Layers of constant x that one task completes.
const SLAB: usize = 4;

/// A model prepared for queries. Shared between threads; each brings its own [`Workspace`].
pub struct Perceiver {
    model: Arc<Model>,
    sums: ColumnSums,
    /// Hull densities, `[view][class]`.
    hulls: Vec<Vec<Density>>,
    subspaces: Vec<ClassSubspace>,
    /// Densities of complete objects (the paper's), made on first use.
    complete: OnceLock<Vec<Density>>,
    /// Gram matrix of W' (the paper's method), made on first use.
    gram: OnceLock<faer::Mat<f64>>,
    noise: f64,
}

/// An observation or a model cannot be used for a query.
#[derive(Debug, thiserror::Error)]
pub enum PerceiveError {
    /// The grid has another size than the model's.
    #[error(
        "the observation is a grid of {found}, the model was trained for {expected}: send grids of that size, or train with --resolution"
    )]
    Dims {
        /// Size of the observation.
        found: Dims,
        /// Size that the model answers.
        expected: Dims,
    },
    /// A matrix of the model cannot be factorised.
    #[error("the model cannot be used: {0}")]
    Model(#[from] LinearError),
}

/// Scratch memory of one thread.
pub struct Workspace {
    known: Known,
    projected: Vec<f32>,
    centred: Vec<f32>,
    scores: Scores,
    /// Classes whose evidence is computed.
    wanted: Vec<bool>,
    conditionals: Vec<Conditional>,
    slabs: Vec<completion::Scratch>,
}

impl Perceiver {
    /// Derives what queries need: prefix sums of W', Cholesky factors, class bases over voxels.
    pub fn new(model: Arc<Model>) -> Result<Self, PerceiveError> {
        let dims = model.dims();
        let hulls = (0..model.views().len())
            .map(|v| model.classes.par_iter().map(|c| Density::new(&c.hulls[v].mean, &c.hulls[v].covariance)).collect())
            .collect::<Result<_, _>>()?;
        let subspaces = model.classes.iter().map(|class| ClassSubspace::new(dims, &model.basis, class)).collect();
        let noise = model.metadata.noise_variance * model.metadata.calibration.noise_inflation;
        Ok(Self {
            sums: ColumnSums::new(dims, &model.basis),
            hulls,
            subspaces,
            complete: OnceLock::new(),
            gram: OnceLock::new(),
            noise,
            model,
        })
    }

    /// The model.
    pub fn model(&self) -> &Arc<Model> {
        &self.model
    }

    /// The mean of a class at one voxel, as learned: not clamped to \[0, 1\].
    pub fn class_mean(&self, class: usize, voxel: usize) -> f32 {
        self.subspaces[class].mean(voxel)
    }

    /// Scratch memory for queries.
    pub fn workspace(&self) -> Workspace {
        let (dims, m) = (self.model.dims(), self.model.classes.len());
        Workspace {
            known: Known::new(dims),
            projected: vec![0.0; self.model.rank()],
            centred: vec![0.0; self.model.rank()],
            scores: Scores::default(),
            wanted: vec![false; m],
            conditionals: self.subspaces.iter().map(|s| Conditional::new(s.size())).collect(),
            slabs: (0..dims.x().div_ceil(SLAB)).map(|_| completion::Scratch::default()).collect(),
        }
    }

    /// Classifies an observation into `percept`. Completion follows by [`Self::complete`].
    ///
    /// An observation without a filled voxel says nothing: the answer is the prior.
    pub fn classify(
        &self,
        observation: &Observation,
        query: &Query,
        work: &mut Workspace,
        percept: &mut Percept,
    ) -> Result<(), PerceiveError> {
        let (dims, m) = (self.model.dims(), self.model.classes.len());
        if observation.dims() != dims {
            return Err(PerceiveError::Dims { found: observation.dims(), expected: dims });
        }
        work.read(observation);
        percept.informed = !work.known.filled.is_empty();
        percept.scores.clear();
        percept.log_evidence.clear();
        percept.log_evidence.resize(m, 0.0);
        let calibration = &self.model.metadata.calibration;
        let prior = &query.log_prior;
        if !percept.informed {
            percept.scores.resize(m, 0.0);
            percept.posterior.clear();
            percept.posterior.resize(m, 0.0);
            percept.posterior.iter_mut().zip(prior).for_each(|(p, prior)| *p = *prior);
            softmax(&mut percept.posterior);
        } else {
            let view = query.view.or_else(|| self.model.views().iter().copied().find(|v| v.matches(observation)));
            let view = view.and_then(|view| self.model.views().iter().position(|v| *v == view));
            let (blend, raw): (&Blend, fn(&Scores) -> &Vec<f64>) = match (query.method, view) {
                (Method::Auto, Some(v)) => {
                    self.score_hull(v, work);
                    if calibration.auto.evidence != 0.0 {
                        calibration.hull.posterior(&work.scores, prior, &mut percept.posterior);
                        let least = percept.posterior.iter().copied().fold(0.0, f64::max) * HOPELESS;
                        work.wanted.iter_mut().zip(&percept.posterior).for_each(|(wanted, p)| *wanted = *p >= least);
                        self.score_evidence(work, percept)?;
                    }
                    (&calibration.auto, |s| &s.hull)
                }
                (Method::Hull, v) => {
                    self.score_hull(v.unwrap_or(0), work);
                    (&calibration.hull, |s| &s.hull)
                }
                // Hull densities belong to a view; where none fits, the evidence does not depend on it.
                (Method::Auto, None) | (Method::Evidence, _) => {
                    work.wanted.fill(true);
                    self.score_evidence(work, percept)?;
                    (&calibration.evidence, |s| &s.evidence)
                }
                (Method::Mean, _) => {
                    work.wanted.fill(true);
                    self.score_evidence(work, percept)?;
                    (&calibration.mean, |s| &s.distance)
                }
                (Method::Paper, _) => return self.classify_as_the_paper(query, work, percept),
            };
            percept.scores.extend_from_slice(raw(&work.scores));
            blend.posterior(&work.scores, prior, &mut percept.posterior);
        }
        percept.class = most_probable(&percept.posterior);
        Ok(())
    }

    /// Completes the observation that was last classified with `work`, into `percept`.
    pub fn complete(&self, query: &Query, work: &mut Workspace, percept: &mut Percept) -> Result<(), PerceiveError> {
        let dims = self.model.dims();
        for values in [&mut percept.occupancy, &mut percept.deviation] {
            values.clear();
            values.resize(dims.voxels(), 0.0);
        }
        for &voxel in &work.known.filled {
            percept.occupancy[voxel] = 1.0;
        }
        match query.method {
            Method::Paper => self.complete_as_the_paper(query, work, percept),
            Method::Mean => {
                let class = &self.subspaces[percept.class];
                complete_plainly(&work.known.unknown, percept, |voxel| class.mean(voxel));
                Ok(())
            }
            _ => self.complete_by_evidence(work, percept),
        }
    }

    fn score_hull(&self, view: usize, work: &mut Workspace) {
        self.sums.project(&work.known.hull, &mut work.projected);
        let dof = self.model.metadata.calibration.degrees_of_freedom;
        let scores = self.hulls[view].iter().map(|d| d.log_student(&work.projected, dof, &mut work.centred));
        work.scores.hull.clear();
        work.scores.hull.extend(scores);
    }

    /// Evidence of the classes that are `wanted`. The others get that of the best of these: it then says nothing about them.
    fn score_evidence(&self, work: &mut Workspace, percept: &mut Percept) -> Result<(), LinearError> {
        self.subspaces
            .par_iter()
            .zip(&mut work.conditionals)
            .zip(&work.wanted)
            .filter(|(_, wanted)| **wanted)
            .try_for_each(|((class, conditional), _)| class.condition(&work.known, self.noise, conditional))?;
        let scores = &mut work.scores;
        let computed = || work.conditionals.iter().zip(&work.wanted).filter(|(_, wanted)| **wanted).map(|(c, _)| c);
        let best = computed().map(|c| c.log_evidence).fold(f64::NEG_INFINITY, f64::max);
        for (s, conditional) in work.conditionals.iter().enumerate() {
            let wanted = work.wanted[s];
            scores.evidence.push(if wanted { conditional.log_evidence } else { best });
            scores.distance.push(-conditional.distance2);
            percept.log_evidence[s] = if wanted { conditional.log_evidence } else { 0.0 };
        }
        Ok(())
    }

    fn classify_as_the_paper(&self, query: &Query, work: &mut Workspace, percept: &mut Percept) -> Result<(), PerceiveError> {
        self.project_as_the_paper(query, work)?;
        let densities = match self.complete.get() {
            Some(densities) => densities,
            None => {
                let made = self.model.classes.par_iter().map(|c| Density::new(&c.mean, &c.covariance)).collect::<Result<Vec<_>, _>>()?;
                self.complete.get_or_init(|| made)
            }
        };
        percept.scores.extend(densities.iter().map(|d| d.log_gaussian(&work.projected, &mut work.centred)));
        percept.posterior.clear();
        percept.posterior.extend(percept.scores.iter().enumerate().map(|(s, v)| v + query.log_prior.get(s).copied().unwrap_or(0.0)));
        softmax(&mut percept.posterior);
        percept.class = most_probable(&percept.posterior);
        Ok(())
    }

    /// o'_q (eq. 18), into `work.projected`.
    fn project_as_the_paper(&self, query: &Query, work: &mut Workspace) -> Result<(), LinearError> {
        let (gram, b) =
            paper::normal_equations(&self.model.basis, self.gram.get_or_init(|| paper::full_gram(&self.model.basis)), &work.known);
        let solution = paper::solve(&gram, &b, query.projection)?;
        work.projected.iter_mut().zip(solution).for_each(|(out, v)| *out = v as f32);
        Ok(())
    }

    fn complete_as_the_paper(&self, query: &Query, work: &mut Workspace, percept: &mut Percept) -> Result<(), PerceiveError> {
        if !percept.informed {
            self.project_as_the_paper(query, work)?;
        }
        let basis = &self.model.basis;
        let mut row = vec![0.0; basis.rank()];
        let projected = &work.projected;
        complete_plainly(&work.known.unknown, percept, |voxel| {
            basis.widen(voxel..voxel + 1, &mut row);
            super::density::dot(&row, projected)
        });
        Ok(())
    }

    fn complete_by_evidence(&self, work: &mut Workspace, percept: &mut Percept) -> Result<(), PerceiveError> {
        let mut shares: Vec<(usize, f64)> = percept.posterior.iter().copied().enumerate().collect();
        shares.sort_by(|a, b| b.1.total_cmp(&a.1));
        if percept.informed {
            let likely = shares.iter().filter(|(_, p)| *p > LEAST_SHARE).count().clamp(1, MOST_PARTS);
            shares.truncate(likely);
        }
        let total: f64 = shares.iter().map(|(_, p)| p).sum();
        let scored = !work.scores.evidence.is_empty();
        for &(s, _) in &shares {
            let (class, conditional) = (&self.subspaces[s], &mut work.conditionals[s]);
            if !scored || !work.wanted[s] {
                class.condition(&work.known, self.noise, conditional)?;
                percept.log_evidence[s] = conditional.log_evidence;
            }
            class.prepare(conditional);
        }
        let parts: Vec<Part<'_>> = shares
            .iter()
            .map(|&(s, p)| Part { weight: (p / total) as f32, class: &self.subspaces[s], conditional: &work.conditionals[s] })
            .collect();
        let weights = completion::weights(&self.model.metadata.calibration.completion);
        let dims = self.model.dims();
        // One slab of columns per task: which thread takes it does not change the result.
        let slab = dims.y() * dims.z() * SLAB;
        let runs = &work.known.unknown;
        let slabs = percept.occupancy.par_chunks_mut(slab).zip(percept.deviation.par_chunks_mut(slab)).zip(&mut work.slabs);
        slabs.enumerate().for_each(|(i, ((occupancy, deviation), scratch))| {
            let first = runs.partition_point(|run| run.0 < i * slab);
            let last = runs.partition_point(|run| run.0 < (i + 1) * slab);
            for_each_unknown(&parts, &runs[first..last], scratch, |voxel, features| {
                (occupancy[voxel - i * slab], deviation[voxel - i * slab]) = features.probability(&weights);
            });
        });
        Ok(())
    }
}

impl Workspace {
    /// Takes in the observation, and forgets the scores of the one before.
    fn read(&mut self, observation: &Observation) {
        self.known.read(observation);
        for scores in [&mut self.scores.hull, &mut self.scores.evidence, &mut self.scores.distance] {
            scores.clear();
        }
    }
}

/// Completion without a model of uncertainty: the value clamped to \[0, 1\], and the deviation of a coin with that bias.
fn complete_plainly(runs: &[(usize, usize)], percept: &mut Percept, mut value: impl FnMut(usize) -> f32) {
    for voxel in runs.iter().flat_map(|(start, end)| *start..*end) {
        let p = value(voxel).clamp(0.0, 1.0);
        percept.occupancy[voxel] = p;
        percept.deviation[voxel] = (p * (1.0 - p)).sqrt();
    }
}

fn most_probable(posterior: &[f64]) -> usize {
    (0..posterior.len()).max_by(|a, b| posterior[*a].total_cmp(&posterior[*b]).then(b.cmp(a))).unwrap_or(0)
}
