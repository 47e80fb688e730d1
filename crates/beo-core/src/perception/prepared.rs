//! A model with what queries derive from it: nothing here answers a query by itself.

use super::basis::projection::ColumnSums;
use super::basis::reading::BasisRows;
use super::camera::CameraScores;
use super::camera::camera_search::is_viewed;
use super::densities::gaussian::{CommonDensity, Gaussian};
use super::evidence::placed::EvidenceModel;
use super::paper::PaperModel;
use super::pose::view_scores::ViewScores;
use super::{PerceiveError, Perceiver, PoseSearch, Query};
use crate::grid::{Observation, Shrinking};
use crate::linear::LinearError;
use crate::model::{CameraCalibration, Model, Searched};
use rayon::prelude::*;
use std::sync::Arc;

/// Tables that all stages read.
pub(crate) struct Prepared {
    pub model: Arc<Model>,
    pub evidence: EvidenceModel,
    /// Hull densities, `[view][class]`.
    pub hulls: Vec<Vec<Gaussian>>,
    pub paper: PaperModel,
}

/// With what poses are searched.
pub(crate) enum Search {
    /// Of a model whose own grid is searched.
    Here(Box<Here>),
    /// On smaller grids, from the smallest on.
    OnLevels(Vec<Level>),
    /// They must be known.
    KnownPoseOnly,
}

/// Tables that a search on the model's own grid reads.
pub(crate) struct Here {
    /// Prefix sums of W'.
    pub sums: Arc<ColumnSums>,
    /// Hull densities with one covariance for all classes, by view: for the search over yaw.
    pub common: Vec<CommonDensity>,
    /// Densities of turned objects seen from above, for the search over SO(3).
    pub views: ViewScores,
    /// Densities of what cameras see, if the model has them, and how sure they may be.
    pub cameras: Option<(CameraScores, CameraCalibration)>,
}

/// A smaller grid.
pub(crate) struct Level {
    pub shrinking: Shrinking,
    pub perceiver: Perceiver,
}

impl Search {
    /// The smaller grids.
    pub fn levels(&self) -> &[Level] {
        match self {
            Self::OnLevels(levels) => levels,
            Self::Here(_) | Self::KnownPoseOnly => &[],
        }
    }

    /// Whether there are densities of what cameras see.
    pub fn has_cameras(&self) -> bool {
        match self {
            Self::Here(here) => here.cameras.is_some(),
            Self::OnLevels(levels) => levels.first().is_some_and(|level| level.perceiver.search.has_cameras()),
            Self::KnownPoseOnly => false,
        }
    }

    /// Fails for a query that such a model cannot answer.
    pub fn check(&self, query: &Query) -> Result<(), PerceiveError> {
        match self {
            Self::KnownPoseOnly if query.pose != PoseSearch::Known || is_viewed(query, false) => Err(PerceiveError::KnownPoseOnly),
            _ => Ok(()),
        }
    }
}

impl Prepared {
    /// Derives what queries need.
    pub fn new(model: Arc<Model>) -> Result<(Self, Search), PerceiveError> {
        let dims = model.dims();
        let hulls = (0..model.views().len())
            .map(|v| model.classes.par_iter().map(|c| Gaussian::new(&c.hulls[v].mean, &c.hulls[v].covariance)).collect())
            .collect::<Result<_, _>>()?;
        let rows = BasisRows::new(dims, &model.basis, model.footprint());
        let subspaces = model.classes.iter().map(|class| rows.class(class)).collect();
        let search = match (&model.searched, &rows) {
            (Searched::Here { views, cameras }, BasisRows::Derived { sums, .. }) => Search::Here(Box::new(Here {
                sums: sums.clone(),
                common: (0..model.views().len()).map(|v| common_density(&model, v)).collect::<Result<_, _>>()?,
                views: ViewScores::new(dims, views.clone()),
                cameras: cameras
                    .as_ref()
                    .zip(model.metadata.calibration.camera.as_ref())
                    .map(|(densities, calibration)| (CameraScores::new(densities.clone()), calibration.clone())),
            })),
            (Searched::OnLevels { levels, .. }, _) => {
                let level = |level: &Model| {
                    Ok(Level { shrinking: Shrinking::new(dims, level.dims()), perceiver: Perceiver::new(Arc::new(level.clone()))? })
                };
                Search::OnLevels(levels.iter().map(level).collect::<Result<_, PerceiveError>>()?)
            }
            (Searched::Here { .. } | Searched::KnownPoseOnly { .. }, _) => Search::KnownPoseOnly,
        };
        let noise_variance = model.metadata.noise_variance * model.metadata.calibration.noise_inflation;
        let evidence = EvidenceModel { rows, subspaces, noise_variance };
        Ok((Self { paper: PaperModel::new(model.clone()), evidence, hulls, model }, search))
    }

    /// Number of classes.
    pub fn classes(&self) -> usize {
        self.model.classes.len()
    }

    /// The place among the model's views of the one that the observation was taken from, if it is one of them.
    pub fn view_of(&self, query: &Query, seen: &Observation) -> Option<usize> {
        let view = query.view.or_else(|| self.model.views().iter().copied().find(|v| v.matches(seen)));
        view.and_then(|view| self.model.views().iter().position(|v| *v == view))
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
