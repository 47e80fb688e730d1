//! Values of flags that several subcommands share.

use super::failure::Failure;
use beo_core::perception::{Perceiver, PoseSearch, Projection};
use clap::ValueEnum;
use serde::Deserialize;

/// The prior knowledge of the pose.
#[derive(Clone, Copy, Debug, ValueEnum, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum PoseArgument {
    /// Objects stand as the training shapes do
    Known,
    /// Turned about the vertical axis
    Yaw,
    /// Turned in any way
    Full,
    /// In any of the poses in which its class can rest, turned about the vertical axis; of what cameras see
    Rest,
}

impl PoseArgument {
    /// The search, with angles about z in \[0, `span`) degrees.
    pub fn search(self, span: f64) -> Result<PoseSearch, Failure> {
        if !(span > 0.0 && span <= 360.0) {
            return Err(Failure::Usage(format!("--yaw-span {span}: use degrees above 0, at most 360")));
        }
        Ok(match self {
            PoseArgument::Known => PoseSearch::Known,
            PoseArgument::Yaw => PoseSearch::Yaw { span: span.to_radians() },
            PoseArgument::Rest => {
                let problem = "--pose rest: resting poses are searched for single observations only, by perceive, observe and camera";
                return Err(Failure::Usage(problem.into()));
            }
            PoseArgument::Full => PoseSearch::Full,
        })
    }
}

/// Prior over the classes.
#[derive(Clone, Copy, Debug, ValueEnum, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum PriorArgument {
    /// All classes alike
    Uniform,
    /// In proportion to the training objects
    Training,
}

/// How the paper's method projects.
#[derive(Clone, Copy, Debug, ValueEnum)]
pub enum ProjectionArgument {
    /// Lasso with λ = 1e-5 (eq. 18)
    Lasso,
    /// Ridge of 1e-3
    Ridge,
}

impl ProjectionArgument {
    /// The projection with its strength.
    pub fn projection(self) -> Projection {
        match self {
            ProjectionArgument::Lasso => Projection::default(),
            ProjectionArgument::Ridge => Projection::Ridge(1e-3),
        }
    }
}

impl PriorArgument {
    /// log P(s) for a model, up to a constant.
    pub fn log_prior(self, perceiver: &Perceiver) -> Vec<f64> {
        match self {
            PriorArgument::Uniform => Vec::new(),
            PriorArgument::Training => perceiver.model().metadata.classes.iter().map(|c| (c.shapes as f64).ln()).collect(),
        }
    }
}
