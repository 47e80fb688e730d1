//! `beo serve`: the daemon.

use super::arguments::{PoseArgument, PriorArgument, ProjectionArgument};
use super::failure::Failure;
use super::found_models;
use super::stop;
use crate::service::{Daemon, Recipe, ServeOptions, outlive_bus_errors};
use beo_core::perception::{Method, Query};
use beo_ipc::InstanceName;
use clap::Args;
use serde::Deserialize;
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Answer observations from shared memory until SIGINT or SIGTERM
///
/// SIGHUP, or `beo reload`, reads the model's file anew: the model before answers until the new one has been checked. Replace the file by
/// renaming another over it, as `mv` and `beo train --out` do: one that is being rewritten is refused, and one of a grid beyond 64 voxels,
/// which is read in place, is no longer answered from when it is rewritten. On SIGTERM what
/// waits is answered for most of a second, and the rest refused. Under systemd the daemon tells how it goes (sd_notify, watchdog).
#[derive(Args)]
pub struct Serve {
    /// Model file [default: models/household.safetensors beside the program]
    #[arg(long)]
    model: Option<PathBuf>,
    /// Instance: daemon and clients of one name find each other [default: default]
    #[arg(long, value_name = "NAME")]
    instance: Option<InstanceName>,
    /// TOML file with the same settings: model, instance, method, pose, prior, memory; flags override it
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// Method: auto, hull, evidence, paper or mean [default: auto]
    #[arg(long)]
    method: Option<Method>,
    /// Search for observations that say that their pose is known, as producers do by default [default: known]
    #[arg(long, value_enum)]
    pose: Option<PoseArgument>,
    /// Prior over the classes [default: uniform]
    #[arg(long, value_enum)]
    prior: Option<PriorArgument>,
    /// Bound the memory of a model of a large grid, which is read in place, to so many megabytes: what was read before is given back
    #[arg(long, value_name = "MB")]
    memory: Option<u64>,
    /// Look for observations again and again instead of sleeping until one comes: some tens of microseconds faster, and a core busy
    #[arg(long)]
    poll: bool,
}

/// Largest configuration file that is read; a full one has some hundred bytes.
const LARGEST_CONFIGURATION: u64 = 64 * 1024;

/// The configuration file of `beo serve`.
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Configuration {
    model: Option<PathBuf>,
    instance: Option<String>,
    method: Option<Method>,
    pose: Option<PoseArgument>,
    prior: Option<PriorArgument>,
    memory: Option<u64>,
}

impl Configuration {
    /// Reads the file's text; an error is one line.
    pub fn parse(text: &str) -> Result<Self, String> {
        toml::from_str(text).map_err(|e| {
            // The message shows the line that is wrong: what a terminal would obey is left out.
            let text = e.to_string().replace(|c: char| c.is_control(), " ");
            let line = text.split_whitespace().collect::<Vec<_>>().join(" ");
            format!("{line}; known settings: model, instance, method, pose, prior, memory")
        })
    }

    fn read(path: &Path) -> Result<Self, Failure> {
        let cannot_read = |e: std::io::Error| Failure::Failed(format!("cannot read {}: {e}", path.display()));
        // What is no regular file may have no end, or nobody who writes it.
        if !std::fs::metadata(path).map_err(cannot_read)?.is_file() {
            return Err(Failure::Failed(format!("{} is not a regular file", path.display())));
        }
        let mut text = String::new();
        let limit = LARGEST_CONFIGURATION;
        File::open(path).and_then(|file| file.take(limit + 1).read_to_string(&mut text)).map_err(cannot_read)?;
        if text.len() as u64 > limit {
            return Err(Failure::Failed(format!("{} has more than {limit} bytes: is it a configuration file?", path.display())));
        }
        Self::parse(&text).map_err(|line| Failure::Failed(format!("{}: {line}", path.display())))
    }
}

impl Serve {
    /// Runs the command.
    pub fn run(self) -> Result<(), Failure> {
        let configuration = match &self.config {
            Some(path) => Configuration::read(path)?,
            None => Configuration::default(),
        };
        let instance = match (self.instance, &configuration.instance) {
            (Some(instance), _) => instance,
            (None, Some(name)) => InstanceName::new(name).map_err(|e| {
                let file = self.config.unwrap_or_default();
                Failure::Failed(format!("{}: {e}", file.display()))
            })?,
            (None, None) => InstanceName::default(),
        };
        let path = found_models::or_shipped(self.model.or(configuration.model))?;
        let loading = Arc::new(AtomicBool::new(true));
        let signals = stop::of_daemon(loading.clone())?;
        let prior = self.prior.or(configuration.prior).unwrap_or(PriorArgument::Uniform);
        let query = Query {
            method: self.method.or(configuration.method).unwrap_or_default(),
            completion: true,
            pose: self.pose.or(configuration.pose).unwrap_or(PoseArgument::Known).search(360.0)?,
            projection: ProjectionArgument::Lasso.projection(),
            ..Query::default()
        };
        let most = self.memory.or(configuration.memory).map(|mb| mb.saturating_mul(1_000_000));
        let recipe = Recipe { query, most, prior: Arc::new(move |perceiver| prior.log_prior(perceiver)) };
        // Absolute, so that what `beo status` and `beo reload` say and do does not depend on where the daemon was started.
        let model = std::path::absolute(&path)?;
        outlive_bus_errors().map_err(|error| Failure::Failed(format!("cannot listen for bus errors: {error}")))?;
        let answerer = recipe.prepare(&model)?;
        loading.store(false, Ordering::Relaxed);
        let mut daemon = Daemon::open(ServeOptions { instance: instance.clone(), model, recipe, poll: self.poll }, answerer)?;
        // Scripts wait for this line.
        let model = daemon.model();
        say!("serving `{instance}` with {}: {} classes, {}", path.display(), model.classes.len(), model.dims());
        tracing::info!(daemon = daemon.id(), model = daemon.model().id, "ready");
        daemon.run(&signals)?;
        let status = daemon.status();
        tracing::info!(
            received = status.received,
            answered = status.answered,
            dropped = status.dropped,
            refused = status.refused,
            overflowed = status.overflowed,
            p50_us = status.latency_p50_ns / 1000,
            p90_us = status.latency_p90_ns / 1000,
            p99_us = status.latency_p99_ns / 1000,
            "stopped"
        );
        Ok(())
    }
}
