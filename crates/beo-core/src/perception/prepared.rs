//! A model with what queries derive from it: nothing here answers a query by itself.

use super::basis::projection::ColumnSums;
use super::basis::reading::BasisRows;
use super::camera::CameraScores;
use super::densities::gaussian::{CommonDensity, Gaussian};
use super::error::PerceiveError;
use super::evidence::placed::EvidenceModel;
use super::evidence::subspace::ClassSubspace;
use super::paper::PaperModel;
use super::query::Query;
use super::views::view_scores::ViewScores;
use crate::grid::Observation;
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

impl Prepared {
    /// Derives what queries need; the second only of a model that is searched on its own grid.
    pub fn new(model: Arc<Model>) -> Result<(Self, Option<Here>), PerceiveError> {
        let dims = model.dims();
        let hulls = (0..model.views().len())
            .map(|v| model.classes.par_iter().map(|c| Gaussian::new(&c.hulls[v].mean, &c.hulls[v].covariance)).collect())
            .collect::<Result<_, _>>()?;
        let rows = BasisRows::new(dims, &model.basis, model.footprint());
        let subspaces = model.classes.iter().map(|class| ClassSubspace::of(&rows, class)).collect();
        let here = match (&model.searched, &rows) {
            (Searched::Here { views, cameras }, BasisRows::Derived { sums, .. }) => Some(Here {
                sums: sums.clone(),
                common: (0..model.views().len()).map(|v| common_density(&model, v)).collect::<Result<_, _>>()?,
                views: ViewScores::new(dims, views.clone()),
                cameras: cameras
                    .as_ref()
                    .zip(model.metadata.calibration.camera.as_ref())
                    .map(|(densities, calibration)| (CameraScores::new(densities.clone()), calibration.clone())),
            }),
            (Searched::Here { .. } | Searched::OnLevels { .. } | Searched::KnownPoseOnly { .. }, _) => None,
        };
        let noise_variance = model.metadata.noise_variance * model.metadata.calibration.noise_inflation;
        let evidence = EvidenceModel::new(rows, subspaces, noise_variance);
        Ok((Self { paper: PaperModel::new(model.clone()), evidence, hulls, model }, here))
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
