//! `beo reload`: another model for a running daemon.

use super::failure::Failure;
use super::observe::seconds;
use beo_ipc::{InstanceName, request_reload};
use clap::Args;
use std::path::PathBuf;

/// Have the daemon serve another model, or read its file anew, without losing an observation
///
/// The model before answers until the new one has been loaded and checked. One that is damaged, or for grids of another size, is refused:
/// then the model before goes on, and the exit code is 1. SIGHUP does the same without an answer.
#[derive(Args)]
pub struct Reload {
    /// Instance of the daemon
    #[arg(long, default_value_t = InstanceName::default(), value_name = "NAME")]
    instance: InstanceName,
    /// Model file [default: the one that is served, read anew]
    #[arg(long, value_name = "FILE")]
    model: Option<PathBuf>,
    /// Seconds to wait for the daemon's answer
    #[arg(long, default_value_t = 60.0, value_name = "SECONDS")]
    wait: f64,
}

impl Reload {
    /// Runs the command.
    pub fn run(self) -> Result<(), Failure> {
        let id = request_reload(&self.instance, self.model.as_deref(), seconds(self.wait)?)?;
        say!("`{}` serves model {id:016x}", self.instance);
        Ok(())
    }
}
