//! The paper's own estimators, to be compared with.
//!
//! | file | content | source |
//! | --- | --- | --- |
//! | `projection` | lasso and ridge projection of the known voxels onto W' | eqs. 13–18 |
//! | `pose` | pose by projection of every candidate | eqs. 11, 12, 19–21 |

pub mod pose;
pub mod projection;

use super::PerceiveError;
use super::basis::known::Known;
use super::densities::gaussian::Gaussian;
use super::query::Projection;
use crate::model::{Basis, Model};
use rayon::prelude::*;
use std::sync::{Arc, OnceLock};

/// Tables that the paper's estimators read of a model, made on first use.
pub(crate) struct PaperModel {
    model: Arc<Model>,
    /// Densities of complete objects.
    densities: OnceLock<Vec<Gaussian>>,
    /// Gram matrix of W'.
    gram: OnceLock<faer::Mat<f64>>,
}

impl PaperModel {
    /// Of a model.
    pub fn new(model: Arc<Model>) -> Self {
        Self { model, densities: OnceLock::new(), gram: OnceLock::new() }
    }

    /// W'.
    pub fn basis(&self) -> &Basis {
        &self.model.basis
    }

    /// o'_q (eq. 18), into `out` (a values).
    pub fn project(&self, known: &Known, projection: Projection, out: &mut [f32]) -> Result<(), PerceiveError> {
        let (gram, b) = self.normal_equations(known);
        let solution = projection::solve(&gram, &b, projection)?;
        out.iter_mut().zip(solution).for_each(|(out, v)| *out = v as f32);
        Ok(())
    }

    /// Gram and right-hand side of eqs. 16 and 17.
    pub fn normal_equations(&self, known: &Known) -> (faer::Mat<f64>, Vec<f64>) {
        let full = self.gram.get_or_init(|| projection::full_gram(&self.model.basis));
        projection::normal_equations(&self.model.basis, full, known)
    }

    /// Densities of complete objects (eq. 10), one per class.
    pub fn densities(&self) -> Result<&[Gaussian], PerceiveError> {
        if let Some(densities) = self.densities.get() {
            return Ok(densities);
        }
        let made = self.model.classes.par_iter().map(|c| Gaussian::new(&c.mean, &c.covariance)).collect::<Result<Vec<_>, _>>()?;
        Ok(self.densities.get_or_init(|| made))
    }
}
