//! `beo perceive`: answer files without a daemon.

use super::arguments::{PoseArgument, PriorArgument, ProjectionArgument};
use super::failure::Failure;
use super::found_models;
use super::pictures::{PictureArguments, Shown};
use super::shapes::{CameraArguments, MeshArguments, ViewArgument};
use super::wording::describe_pose;
use beo_core::grid::to_xyzw;
use beo_core::perception::{Hypothesis, Method, Perceiver, Percept, PoseSearch, Query};
use beo_ipc::Refusal;
use clap::Args;
use serde_json::json;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Answer shapes or partial grids without a daemon
#[derive(Args)]
pub struct Perceive {
    /// Shapes, or with --view none grids of bytes
    #[arg(required = true)]
    files: Vec<PathBuf>,
    /// Model file [default: models/household.safetensors beside the program]
    #[arg(long)]
    model: Option<PathBuf>,
    /// Bound the memory of a model of a large grid, which is read in place, to so many megabytes: what was read before is given back
    #[arg(long, value_name = "MB")]
    memory: Option<u64>,
    /// The view of a file
    #[arg(long, value_enum, default_value_t = ViewArgument::Top)]
    view: ViewArgument,
    /// The prior knowledge of the pose
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
    /// Turn shapes by this much about the vertical axis before they are seen
    #[arg(long, default_value_t = 0.0, value_name = "DEGREES", allow_negative_numbers = true)]
    turn: f64,
    /// Print one JSON object a line
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    pictures: PictureArguments,
    #[command(flatten)]
    camera: CameraArguments,
    #[command(flatten)]
    mesh: MeshArguments,
}

impl Perceive {
    /// Runs the command. Files that cannot be answered are named; the others are answered all the same.
    pub fn run(self) -> Result<(), Failure> {
        if !self.turn.is_finite() || self.turn != 0.0 && self.view == ViewArgument::None {
            return Err(Failure::Usage(format!("--turn {}: use a finite angle, and complete shapes (--view top or camera)", self.turn)));
        }
        self.pictures.prepare()?;
        let perceiver =
            Perceiver::open_within(&found_models::or_shipped(self.model.clone())?, self.memory.map(|mb| mb.saturating_mul(1_000_000)))?;
        let model = perceiver.model().clone();
        let rests = matches!(self.pose, PoseArgument::Rest);
        if rests && self.view != ViewArgument::Camera {
            return Err(Failure::Usage("--pose rest: it is searched in what cameras see; add --view camera".into()));
        }
        if rests && !model.has_resting_poses() {
            let problem = "--pose rest: the model has learned no resting poses; train one with --views camera --resting rest";
            return Err(Failure::Usage(problem.into()));
        }
        let read = self.mesh.read_options_of(self.view, model.dims())?;
        let names: Vec<&str> = model.class_names().collect();
        let mut query = Query {
            method: self.method,
            view: self.view.view(),
            outside: self.view.outside(),
            log_prior: self.prior.log_prior(&perceiver),
            completion: true,
            pose: if rests { PoseArgument::Yaw } else { self.pose }.search(self.yaw_span)?,
            lying: rests,
            projection: self.projection.projection(),
            ..Query::default()
        };
        let (mut work, mut percept) = (perceiver.workspace(), Percept::default());
        let mut failed = 0;
        for (place, file) in self.files.iter().enumerate() {
            let answer = self.view.source(file, &read, &self.camera).and_then(|source| {
                query.camera = source.camera();
                let observation = source.turned_by(self.turn.to_radians());
                let classified = perceiver.classify(&observation, &query, &mut work, &mut percept)?;
                if !classified.percept().informed {
                    return Ok(());
                }
                classified.complete()?;
                if self.pictures.is_wanted() {
                    let name = file.file_stem().unwrap_or_default().to_string_lossy();
                    Shown::of_file(place + 1, &name, &names, &observation, query.camera, &percept).save(&self.pictures)?;
                }
                Ok(())
            });
            if let Err(failure) = answer {
                // Errors of reading name the file themselves.
                let (name, text) = (file.display().to_string(), failure.to_string());
                if text.contains(&name) {
                    warn!("beo: {text}")
                } else {
                    warn!("beo: {name}: {text}")
                }
                failed += 1;
                continue;
            }
            if !percept.informed {
                self.say_nothing_seen(file)?;
                continue;
            }
            let filled = percept.occupancy.iter().filter(|p| **p >= 0.5).count();
            let posterior: BTreeMap<&str, f64> = names.iter().copied().zip(percept.posterior.iter().copied()).collect();
            if self.json {
                let log_score: BTreeMap<&str, f64> = names.iter().copied().zip(percept.scores.iter().copied()).collect();
                let hypothesis =
                    |h: &Hypothesis| json!({ "rotation": to_xyzw(&h.rotation), "class": names[h.class], "probability": h.probability });
                let line = json!({
                    "file": file.display().to_string(),
                    "class": names[percept.class],
                    "posterior": posterior,
                    "log_score": log_score,
                    "none_probability": percept.none_probability,
                    "fit": percept.fit,
                    "resting_pose": percept.resting_pose,
                    "filtered": false,
                    "cut": [],
                    "hypotheses": percept.hypotheses.iter().map(hypothesis).collect::<Vec<_>>(),
                    "rotation_spread_rad": percept.rotation_spread_rad,
                    "completion": { "dims": <[usize; 3]>::from(model.dims()), "filled": filled },
                });
                say!("{line}");
            } else {
                let mut ranked: Vec<(&str, f64)> = posterior.into_iter().collect();
                ranked.sort_by(|a, b| b.1.total_cmp(&a.1));
                let others: Vec<String> = ranked[1..].iter().take(2).map(|(name, p)| format!("{name} {:.1} %", 100.0 * p)).collect();
                let (name, p) = ranked[0];
                let pose = match query.pose {
                    PoseSearch::Known => String::new(),
                    _ => format!(", {}", describe_pose(&percept.rotation_object_to_grid, percept.rotation_spread_rad)),
                };
                say!("{}: {name} {:.1} % ({}){pose}, {filled} voxels filled", file.display(), 100.0 * p, others.join(", "));
            }
        }
        match failed {
            0 => Ok(()),
            _ => Err(Failure::Failed(format!("{failed} of {} files could not be answered", self.files.len()))),
        }
    }
    /// The answer to a grid without an object: no class.
    fn say_nothing_seen(&self, file: &Path) -> Result<(), Failure> {
        let reason = Refusal::NothingSeen;
        if self.json {
            let line = json!({
                "file": file.display().to_string(),
                "class": null,
                "posterior": {},
                "refused": reason.to_string(),
                "completion": null,
            });
            say!("{line}");
        } else {
            say!("{}: {reason}", file.display());
        }
        Ok(())
    }
}
