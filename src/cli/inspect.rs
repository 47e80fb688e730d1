//! `beo inspect`: what a model holds.

use super::failure::Failure;
use crate::model::{load, verify};
use clap::Args;
use std::path::PathBuf;

/// Show what a model holds
#[derive(Args)]
pub struct Inspect {
    /// Model file
    model: PathBuf,
    /// Check every tensor against its checksum, however large
    #[arg(long)]
    verify: bool,
}

impl Inspect {
    /// Runs the command.
    pub fn run(self) -> Result<(), Failure> {
        let model = load(&self.model)?;
        let meta = &model.metadata;
        println!("{}: {} classes, {}, rank {}", self.model.display(), meta.classes.len(), meta.dims, model.rank());
        println!("{:<16} {:>7} {:>6} {:>10} {:>10} {:>10}", "class", "shapes", "basis", "explained", "noise", "shrinkage");
        for class in &meta.classes {
            println!(
                "{:<16} {:>7} {:>6} {:>9.1}% {:>10.5} {:>10.3}",
                class.name,
                class.shapes,
                class.basis_size,
                100.0 * class.explained,
                class.noise_variance,
                class.shrinkage
            );
        }
        println!("{:#?}", meta.calibration);
        if self.verify {
            let report = verify(&self.model)?;
            println!("{} tensors, {:.1} MB, all as written", report.tensors, report.bytes as f64 / 1e6);
        }
        Ok(())
    }
}
