//! Choices of the paper's estimators.

use serde::{Deserialize, Serialize};

/// The paper's estimators of pose.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum PaperPose {
    /// Coarse by the error of distance transforms (eq. 20), then fine by density (eq. 21). With one class only, by its density
    /// alone (eq. 12), as in section IV-B.
    #[default]
    Edt,
    /// Density alone (eqs. 12, 21): the paper finds it unreliable where class and pose are both unknown.
    Density,
    /// Least distance between query and back-projection on the known voxels (eq. 11).
    Distance,
    /// The same relative to the query's length (eq. 19).
    Reprojection,
}

/// How A o' = b (eq. 15) is solved.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Projection {
    /// The lasso of eq. 18 with this λ, by coordinate descent from zero.
    Lasso(f64),
    /// (A + ρ I) o' = b with this ρ.
    Ridge(f64),
}

impl Default for Projection {
    /// The paper's λ.
    fn default() -> Self {
        Projection::Lasso(1e-5)
    }
}
