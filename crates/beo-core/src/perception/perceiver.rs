//! One query in, one percept out.

use super::blend::{Scores, softmax};
use super::camera::{CameraScores, ViewWork};
use super::completing::Moved;
use super::known::Known;
use super::pose::circle::Looked;
use super::pose::posterior::{Merging, Sample};
use super::pose::view_scores::ViewScores;
use super::pose::yaw::{CommonDensity, HullColumns};
use super::subspace::{ClassSubspace, Conditional};
use super::timings::{Stopwatch, Timings};
use super::whitening::Whitening;
use super::{ColumnSums, Density, Percept, PoseSearch, Query, Reading, SharedSums};
use crate::grid::{Counts, Dims, Observation, Placed, Rotation, Shrinking, Turn};
use crate::linear::LinearError;
use crate::memory::{self, Available};
use crate::model::{Damaged, Model, ModelError, Outline, load, outline};
use rayon::prelude::*;
use std::path::{Path, PathBuf};
use std::sync::{Arc, OnceLock};

/// A model prepared for queries. Shared between threads; each brings its own [`Workspace`].
pub struct Perceiver {
    pub(super) model: Arc<Model>,
    pub(super) reading: Reading,
    /// Hull densities, `[view][class]`.
    pub(super) hulls: Vec<Vec<Density>>,
    /// Hull densities with one covariance for all classes, by view: for the search over yaw.
    pub(super) common: Vec<CommonDensity>,
    pub(super) subspaces: Vec<ClassSubspace>,
    /// Densities of turned objects seen from above, for the search over SO(3).
    pub(super) views: Option<ViewScores>,
    /// Densities of what cameras see, if the model has them.
    pub(super) cameras: Option<CameraScores>,
    /// Densities of complete objects (the paper's), made on first use.
    pub(super) complete: OnceLock<Vec<Density>>,
    /// Gram matrix of W' (the paper's method), made on first use.
    pub(super) gram: OnceLock<faer::Mat<f64>>,
    pub(super) noise: f64,
    /// The same shapes on smaller grids, in which poses are searched; from the smallest on.
    pub(super) levels: Vec<Level>,
}

/// A smaller grid.
pub(super) struct Level {
    pub shrinking: Shrinking,
    pub perceiver: Perceiver,
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
    /// Pose, size or place are asked for, and the model was learned without what they are searched with.
    #[error("the model was learned for known poses alone: ask with pose, size and place known, or train with poses")]
    KnownPoseOnly,
    /// A matrix of the model cannot be factorised.
    #[error("the model cannot be used: {0}")]
    Model(#[from] LinearError),
    /// The model file cannot be used.
    #[error(transparent)]
    File(#[from] ModelError),
    /// A part of the model file that was read for the first time is damaged.
    #[error(transparent)]
    Damaged(#[from] Damaged),
    /// There is too little memory for the model.
    #[error(
        "{}: the model needs about {} MB of memory, {limit} has {} MB left: end other processes, or train with a lower --resolution or --most",
        path.display(), needed.div_ceil(MB), available / MB
    )]
    Memory {
        /// The file.
        path: PathBuf,
        /// Bytes that loading and preparing it take.
        needed: u64,
        /// Bytes that may be taken.
        available: u64,
        /// Who allows no more.
        limit: &'static str,
    },
    /// More memory is needed than was allowed.
    #[error("{}: the model needs about {} MB of memory, {} MB are allowed: allow more, or train with a lower --resolution", path.display(), needed.div_ceil(MB), most / MB)]
    Bound {
        /// The file.
        path: PathBuf,
        /// Bytes that loading and preparing it take.
        needed: u64,
        /// Bytes that were allowed.
        most: u64,
    },
}

const MB: u64 = 1_000_000;

fn require(path: &Path, needed: u64, available: Option<Available>) -> Result<(), PerceiveError> {
    match available {
        Some(Available { bytes, limit }) if bytes < needed => {
            Err(PerceiveError::Memory { path: path.to_owned(), needed, available: bytes, limit })
        }
        _ => Ok(()),
    }
}

/// Scratch memory of one thread.
pub struct Workspace {
    /// The observation as it came.
    pub(super) seen: Observation,
    /// The observation as the estimators read it: in the object frame once the pose is chosen.
    pub(super) known: Known,
    pub(super) projected: Vec<f32>,
    pub(super) centred: Vec<f32>,
    pub(super) scores: Scores,
    /// Classes whose evidence is computed.
    pub(super) wanted: Vec<bool>,
    pub(super) conditionals: Vec<Conditional>,
    /// Classes that take part in the completion, and their shares.
    pub(super) shares: Vec<(usize, f64)>,
    pub(super) columns: HullColumns,
    /// What a camera sees.
    pub(super) view: ViewWork,
    /// What a search about z looked at, the angles that it was told of, and those at which classes are scored.
    pub(super) looked: Looked,
    pub(super) hints: Vec<f64>,
    pub(super) finals: Vec<f64>,
    pub(super) samples: Vec<Sample>,
    pub(super) merging: Merging,
    /// The turn between the grid's frame and the object's, the observation turned by it, and completions that are being turned.
    pub(super) turn: Turn,
    pub(super) turned: Observation,
    pub(super) moved: Moved,
    /// Of each smaller grid: scratch memory, the observation on it, and counts for that.
    pub(super) levels: Vec<LevelWork>,
    /// Sums over a turned observation.
    pub(super) sums: SharedSums,
    /// Runs since the query began.
    pub(super) stopwatch: Stopwatch,
}

/// Scratch memory of a smaller grid.
pub(super) struct LevelWork {
    pub work: Workspace,
    pub seen: Observation,
    pub counts: Counts,
}

impl Perceiver {
    /// Derives what queries need: prefix sums of W', Cholesky factors, class bases over voxels. A model with smaller grids is read where
    /// it lies instead, and they are searched.
    pub fn new(model: Arc<Model>) -> Result<Self, PerceiveError> {
        let dims = model.dims();
        let hulls = (0..model.views().len())
            .map(|v| model.classes.par_iter().map(|c| Density::new(&c.hulls[v].mean, &c.hulls[v].covariance)).collect())
            .collect::<Result<_, _>>()?;
        let common = (0..model.views().len()).map(|v| common_density(&model, v)).collect::<Result<_, _>>()?;
        let reading = Reading::new(dims, &model.basis, model.footprint.as_ref());
        let subspaces = model.classes.iter().map(|class| reading.class(class)).collect();
        let level =
            |level: &Model| Ok(Level { shrinking: Shrinking::new(dims, level.dims()), perceiver: Self::new(Arc::new(level.clone()))? });
        Ok(Self {
            reading,
            hulls,
            common,
            subspaces,
            views: model.view_densities.as_ref().map(|_| ViewScores::new(&model)),
            cameras: model.camera_densities.as_ref().map(CameraScores::new),
            complete: OnceLock::new(),
            gram: OnceLock::new(),
            noise: model.metadata.noise_variance * model.metadata.calibration.noise_inflation,
            levels: model.levels.iter().map(level).collect::<Result<_, PerceiveError>>()?,
            model,
        })
    }

    /// Bytes that [`Self::new`] derives from a model: prefix sums of W', class bases over voxels with their Gram matrices, factors
    /// of the hull densities; of one with smaller grids, those of the grids.
    pub fn derived_bytes(outline: &Outline) -> usize {
        let Outline { metadata, rank, levels, .. } = outline;
        let (dims, views, m) = (metadata.dims, metadata.settings.views.len(), metadata.classes.len());
        let densities = views * (m + 1) * Whitening::bytes(*rank);
        if !levels.is_empty() {
            return densities + levels.iter().map(Self::derived_bytes).sum::<usize>();
        }
        let classes: usize = metadata.classes.iter().map(|c| ClassSubspace::bytes(dims, c.basis_size)).sum();
        // At most as many features as the training learns.
        let cameras = if metadata.settings.camera_elevations_deg.is_empty() { 0 } else { CameraScores::bytes(64) };
        classes + ColumnSums::bytes(dims, *rank) + densities + cameras
    }

    /// Bytes that one [`Workspace`] and its answers take at most: observations, the voxels of them, and completions.
    pub fn workspace_bytes(outline: &Outline) -> usize {
        let voxels = outline.metadata.dims.voxels();
        // Of a voxel: where it comes from in a turned grid (4 bytes), a completion that is being turned (2), and bits of observations.
        voxels * 7 + outline.levels.iter().map(Self::workspace_bytes).sum::<usize>()
    }

    /// Loads a model file and prepares it for queries, after asking whether there is memory for both: without it, the system would
    /// end some process, perhaps this one, in the middle.
    ///
    /// # Errors
    /// [`PerceiveError::File`], [`PerceiveError::Memory`], and as [`Self::new`].
    pub fn open(path: &Path) -> Result<Self, PerceiveError> {
        Self::open_within(path, None)
    }

    /// The same within `most` bytes of memory: of a file that is read in place, pages beyond that are given back to the system.
    ///
    /// # Errors
    /// [`PerceiveError::File`], [`PerceiveError::Memory`], [`PerceiveError::Bound`], and as [`Self::new`].
    pub fn open_within(path: &Path, most: Option<u64>) -> Result<Self, PerceiveError> {
        let outline = outline(path)?;
        let derived = (Self::derived_bytes(&outline) + Self::workspace_bytes(&outline)) as u64;
        // Pages of a file that is read in place can be given back at any time.
        let in_place = if outline.levels.is_empty() { 0 } else { outline.basis_bytes };
        let needed = outline.bytes().saturating_sub(in_place).saturating_add(derived);
        require(path, needed, memory::available())?;
        if let Some(most) = most
            && most < needed
        {
            return Err(PerceiveError::Bound { path: path.to_owned(), needed, most });
        }
        let model = load(path)?;
        if let Some(most) = most {
            model.basis.bound((most - needed) as usize);
        }
        Self::new(Arc::new(model))
    }

    /// The model.
    pub fn model(&self) -> &Arc<Model> {
        &self.model
    }

    /// The mean of a class at one voxel, as learned: not clamped to \[0, 1\].
    pub fn class_mean(&self, class: usize, voxel: usize) -> f32 {
        self.subspaces[class].mean(voxel)
    }

    /// Prefix sums of a model that is searched itself.
    pub(super) fn column_sums(&self) -> &ColumnSums {
        match &self.reading {
            Reading::Derived { sums, .. } => sums,
            Reading::InPlace(_) => unreachable!("poses of a model that is read in place are searched on smaller grids"),
        }
    }

    /// Densities of turned objects of a model that is searched itself.
    pub(super) fn view_scores(&self) -> &ViewScores {
        self.views.as_ref().expect("poses of a model with smaller grids are searched on these")
    }

    /// Scratch memory for queries.
    pub fn workspace(&self) -> Workspace {
        let (dims, m) = (self.model.dims(), self.model.classes.len());
        Workspace {
            seen: Observation::unknown(dims),
            known: Known::new(dims),
            projected: vec![0.0; self.model.rank()],
            centred: vec![0.0; self.model.rank()],
            scores: Scores::default(),
            wanted: vec![false; m],
            conditionals: self.subspaces.iter().map(|s| Conditional::new(s.size())).collect(),
            shares: Vec::with_capacity(m),
            columns: HullColumns::default(),
            view: ViewWork::default(),
            looked: Looked::default(),
            hints: Vec::new(),
            finals: Vec::new(),
            samples: Vec::new(),
            merging: Merging::default(),
            turn: Turn::unset(dims),
            turned: Observation::unknown(dims),
            moved: Moved::default(),
            levels: self.levels.iter().map(Level::workspace).collect(),
            sums: SharedSums::default(),
            stopwatch: Stopwatch::start(),
        }
    }

    /// Classifies an observation into `percept`, and finds its pose if that is asked for. Completion follows by
    /// [`Self::complete`].
    ///
    /// An observation without a filled voxel says nothing: the answer is the prior.
    pub fn classify(
        &self,
        observation: &Observation,
        query: &Query,
        work: &mut Workspace,
        percept: &mut Percept,
    ) -> Result<(), PerceiveError> {
        work.stopwatch = Stopwatch::start();
        percept.timings = Timings::default();
        let dims = self.model.dims();
        if observation.dims() != dims {
            return Err(PerceiveError::Dims { found: observation.dims(), expected: dims });
        }
        if self.views.is_none() && self.levels.is_empty() && (query.pose != PoseSearch::Known || self.is_viewed(query)) {
            return Err(PerceiveError::KnownPoseOnly);
        }
        work.read(observation);
        if self.searches_levels(query) {
            return self.search_levels(query, work, percept);
        }
        self.reading.take_apart(&work.seen, &mut work.known)?;
        let m = self.model.classes.len();
        percept.informed = !work.known.filled.is_empty();
        percept.rotation = Rotation::identity();
        (percept.placed, percept.lay, percept.resting_pose) = (Placed::default(), None, None);
        for scores in [&mut percept.scores, &mut percept.posterior, &mut percept.log_evidence] {
            scores.clear();
        }
        percept.log_evidence.resize(m, 0.0);
        if percept.informed && self.is_viewed(query) {
            self.view(query, work, percept)?;
            if percept.informed {
                return Ok(());
            }
        }
        if !percept.informed {
            percept.scores.resize(m, 0.0);
            percept.posterior.extend((0..m).map(|s| query.log_prior(s)));
            softmax(&mut percept.posterior);
        } else if query.pose == PoseSearch::Known {
            self.classify_here(query, work, percept)?;
            percept.timings.classified = work.stopwatch.elapsed();
        }
        if !percept.informed {
            let elapsed = work.stopwatch.elapsed();
            (percept.timings.projected, percept.timings.classified) = (elapsed, elapsed);
        }
        match query.pose {
            PoseSearch::Known => {
                percept.class = most_probable(&percept.posterior);
                percept.rotation = Rotation::identity();
                percept.spread = 0.0;
                let probability = percept.posterior[percept.class];
                percept.hypotheses.clear();
                percept.hypotheses.push(super::Hypothesis { rotation: percept.rotation, class: percept.class, probability });
                percept.timings.posed = work.stopwatch.elapsed();
                Ok(())
            }
            _ => self.find_pose(query, work, percept),
        }
    }
}

impl Level {
    fn workspace(&self) -> LevelWork {
        LevelWork { work: self.perceiver.workspace(), seen: Observation::unknown(self.shrinking.dims()), counts: Counts::default() }
    }
}

/// The densities of one view with the covariance that all classes have in common, recovered from those of the classes: each
/// was pulled towards it with the same strength.
fn common_density(model: &Model, view: usize) -> Result<CommonDensity, LinearError> {
    let a = model.rank();
    let calibration = &model.metadata.calibration;
    let weights: Vec<f64> = model.metadata.classes.iter().map(|c| c.shapes as f64 + calibration.prior_strength).collect();
    let total: f64 = weights.iter().sum();
    let mut common = faer::Mat::<f64>::zeros(a, a);
    for (class, weight) in model.classes.iter().zip(&weights) {
        for j in 0..a {
            for i in j..a {
                common[(i, j)] += weight / total * f64::from(class.hulls[view].covariance[i * a + j]);
            }
        }
    }
    let means: Vec<&[f32]> = model.classes.iter().map(|c| &c.hulls[view].mean[..]).collect();
    CommonDensity::new(&means, &common, calibration.degrees_of_freedom)
}

impl Workspace {
    /// Takes in the observation, and forgets the scores of the one before.
    fn read(&mut self, observation: &Observation) {
        self.seen.clone_from(observation);
        self.forget();
    }

    /// Forgets the scores.
    pub(super) fn forget(&mut self) {
        for scores in [&mut self.scores.hull, &mut self.scores.evidence, &mut self.scores.distance] {
            scores.clear();
        }
    }
}

pub(super) fn most_probable(posterior: &[f64]) -> usize {
    (0..posterior.len()).max_by(|a, b| posterior[*a].total_cmp(&posterior[*b]).then(b.cmp(a))).unwrap_or(0)
}
