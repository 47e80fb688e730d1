//! `beo perceive`: answer files without a daemon.

use super::eval::{PoseArgument, PriorArgument, ProjectionArgument};
use super::failure::Failure;
use super::shapes::{MeshArguments, ViewArgument};
use crate::model::load;
use crate::perception::{Method, Perceiver, Percept, Query};
use clap::Args;
use serde_json::json;
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::Arc;

/// Answer shapes or partial grids without a daemon
#[derive(Args)]
pub struct Perceive {
    /// Shapes, or with --view none grids of bytes
    #[arg(required = true)]
    files: Vec<PathBuf>,
    /// Model file
    #[arg(long)]
    model: PathBuf,
    /// What is seen of a file
    #[arg(long, value_enum, default_value_t = ViewArgument::Top)]
    view: ViewArgument,
    /// What is known of the pose
    #[arg(long, value_enum, default_value_t = PoseArgument::Known)]
    pose: PoseArgument,
    /// With --pose yaw, search angles in [0, DEGREES)
    #[arg(long, default_value_t = 360.0, value_name = "DEGREES")]
    yaw_span: f64,
    /// Method: auto, hull, evidence, paper or mean
    #[arg(long, default_value = "auto")]
    method: Method,
    /// How the paper's method projects
    #[arg(long, value_enum, default_value_t = ProjectionArgument::Lasso)]
    projection: ProjectionArgument,
    /// Prior over the classes
    #[arg(long, value_enum, default_value_t = PriorArgument::Uniform)]
    prior: PriorArgument,
    /// Print one JSON object a line
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    mesh: MeshArguments,
}

impl Perceive {
    /// Runs the command. Files that cannot be answered are named; the others are answered all the same.
    pub fn run(self) -> Result<(), Failure> {
        let model = Arc::new(load(&self.model)?);
        let read = self.mesh.read_options(model.dims())?;
        let perceiver = Perceiver::new(model.clone())?;
        let names: Vec<&str> = model.class_names().collect();
        let query = Query {
            method: self.method,
            view: self.view.view(),
            log_prior: self.prior.log_prior(&perceiver),
            completion: true,
            pose: self.pose.search(self.yaw_span)?,
            projection: self.projection.projection(),
            ..Query::default()
        };
        let (mut work, mut percept) = (perceiver.workspace(), Percept::default());
        let mut failed = 0;
        for file in &self.files {
            let answer = self.view.observe(file, &read).and_then(|observation| {
                perceiver.classify(&observation, &query, &mut work, &mut percept)?;
                perceiver.complete(&query, &mut work, &mut percept)?;
                Ok(())
            });
            if let Err(failure) = answer {
                eprintln!("beo: {}: {failure}", file.display());
                failed += 1;
                continue;
            }
            let filled = percept.occupancy.iter().filter(|p| **p >= 0.5).count();
            let posterior: BTreeMap<&str, f64> = names.iter().copied().zip(percept.posterior.iter().copied()).collect();
            if self.json {
                let scores: BTreeMap<&str, f64> = names.iter().copied().zip(percept.scores.iter().copied()).collect();
                let line = json!({
                    "file": file.display().to_string(),
                    "class": names[percept.class],
                    "posterior": posterior,
                    "scores": scores,
                    "completion": { "dims": <[usize; 3]>::from(model.dims()), "filled": filled },
                });
                say!("{line}");
            } else {
                let mut ranked: Vec<(&str, f64)> = posterior.into_iter().collect();
                ranked.sort_by(|a, b| b.1.total_cmp(&a.1));
                let others: Vec<String> = ranked[1..].iter().take(2).map(|(name, p)| format!("{name} {:.1} %", 100.0 * p)).collect();
                say!("{}: {} {:.1} % ({}), {filled} voxels filled", file.display(), ranked[0].0, 100.0 * ranked[0].1, others.join(", "));
            }
        }
        match failed {
            0 => Ok(()),
            _ => Err(Failure::Failed(format!("{failed} of {} files could not be answered", self.files.len()))),
        }
    }
}
