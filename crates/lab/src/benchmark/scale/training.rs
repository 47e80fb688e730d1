//! Learning models of growing size: how long it takes, how much memory it takes at a time, and what the model then is.

use super::error::ScaleError;
use super::models::Recipe;
use super::queries::Asked;
use crate::benchmark::machine::process_memory;
use crate::benchmark::percentiles::median;
use beo_core::perception::Perceiver;
use std::fs::write;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// The measured quantities of a model, with units; memory is that of the whole process.
pub const MEASURES: [(&str, &str); 5] =
    [("learning", "s"), ("learning", "MB"), ("basis W'", "MB"), ("answering", "MB"), ("query in known pose", "µs")];

/// Short trainings are repeated for about this long.
const LEAST: Duration = Duration::from_millis(500);
/// Queries whose median is taken, and different observations.
const QUERIES: usize = 25;
const OBSERVATIONS: usize = 5;

/// Learns a model and asks it: a value for each of [`MEASURES`]; 0 where the system does not tell.
pub fn measure(recipe: Recipe) -> Result<Vec<f64>, ScaleError> {
    let shapes = recipe.shapes();
    let observations = recipe.observations(OBSERVATIONS);
    let (begin, mut times) = (Instant::now(), Vec::new());
    forget_peak();
    let model = loop {
        let start = Instant::now();
        let model = recipe.learn_from(&shapes)?;
        times.push(start.elapsed().as_secs_f64());
        if begin.elapsed() > LEAST {
            break model;
        }
    };
    let peak = memory("VmHWM:");
    let basis = size_of_val(model.basis.values()) as f64 / 1e6;
    drop(shapes);
    let mut asked = Asked::new(Arc::new(Perceiver::new(Arc::new(model))?), observations, None);
    let mut queries = Vec::new();
    for _ in 0..QUERIES {
        let stages = asked.once_known()?;
        queries.push(stages.iter().sum::<f64>());
    }
    let held = memory("VmRSS:");
    Ok(vec![median(times.into_iter()), peak, basis, held, median(queries.into_iter())])
}

/// A line of /proc/self/status, in MB; 0 where the system does not tell.
fn memory(name: &str) -> f64 {
    process_memory(name).unwrap_or(0) as f64 / 1e6
}

/// Lets the peak of this process's memory begin anew; where the kernel does not, the peak is that of all that went before.
fn forget_peak() {
    let _ = write("/proc/self/clear_refs", "5");
}
