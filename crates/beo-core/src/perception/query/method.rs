//! The estimators that can be asked for.

use serde::{Deserialize, Serialize};

/// How a query is classified and completed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Method {
    /// The calibrated blend of hull density and evidence; completion by evidence. Use this.
    #[default]
    Auto,
    /// Class density of the visual hull's projection alone. Use it to see what the silhouette says, and only for views that the
    /// model was trained for: it takes any other observation for the model's first view.
    Hull,
    /// Marginal likelihood of the known voxels in each class's own basis. Use it for views the model was not trained for.
    Evidence,
    /// The paper's: lasso projection onto W' (eq. 18), Gaussian class densities (eqs. 9, 10), completion from W' whatever the
    /// class (eq. 6). Use it to compare with the paper.
    Paper,
    /// The paper's baseline: nearest class mean on the known voxels.
    Mean,
}

impl Method {
    /// All methods, the default first.
    pub const ALL: [Method; 5] = [Method::Auto, Method::Hull, Method::Evidence, Method::Paper, Method::Mean];

    /// The name on the command line and in results.
    pub fn name(self) -> &'static str {
        match self {
            Method::Auto => "auto",
            Method::Hull => "hull",
            Method::Evidence => "evidence",
            Method::Paper => "paper",
            Method::Mean => "mean",
        }
    }
}

impl std::str::FromStr for Method {
    type Err = String;
    fn from_str(text: &str) -> Result<Self, String> {
        Self::ALL
            .into_iter()
            .find(|m| m.name() == text)
            .ok_or_else(|| format!("unknown method `{text}`: use auto, hull, evidence, paper or mean"))
    }
}

impl std::fmt::Display for Method {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(self.name())
    }
}
