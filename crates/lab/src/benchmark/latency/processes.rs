//! Runs: all processes started on their cores, listened to, and ended by their id.

use super::producer::{ProducerPlan, Sent};
use super::reader::ReaderPlan;
use super::record::Record;
use super::summary::{LoadReport, Report, Run};
use super::{Grids, LatencyError, Load, Settings, Wake};
use crate::benchmark::cores::{Cores, pin, usable};
use crate::benchmark::machine::Watch;
use crate::process::{Process, this_program};
use beo_core::model::Model;
use serde::Serialize;
use serde::de::DeserializeOwned;
use std::io::Write;
use std::process::{Command, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError};
use std::time::{Duration, Instant};

/// The observations before the measurement: caches, page tables and clock rates as in the long run.
const WARM_UP_S: f64 = 0.5;
/// No step takes longer than this beyond its own length; it ends what hangs.
const PATIENCE: Duration = Duration::from_secs(120);
/// Time between two looks at whether to stop.
const LOOK: Duration = Duration::from_millis(100);

/// Measures each load `settings.repeat` times. `progress` is called after each run.
///
/// # Errors
/// [`LatencyError`]; whatever it is, all processes have been ended.
pub fn measure(
    settings: &Settings,
    loads: &[Load],
    model: &Model,
    grids: &Grids,
    stop: &AtomicBool,
    mut progress: impl FnMut(),
) -> Result<Report, LatencyError> {
    let watch = Watch::start();
    let cores = Cores::plan(&usable(), settings.subscribers);
    let mut reports = Vec::new();
    for load in loads {
        let mut runs = Vec::new();
        for _ in 0..settings.repeat {
            runs.push(run(settings, *load, model, grids, &cores, stop)?);
            progress();
        }
        reports.push(LoadReport::new(*load, &runs));
    }
    Ok(Report::new(settings, watch.end(), cores, model, reports))
}

/// One run. Processes end in the order of the fields: clients before the daemon.
fn run(settings: &Settings, load: Load, model: &Model, grids: &Grids, cores: &Cores, stop: &AtomicBool) -> Result<Run, LatencyError> {
    let instance = format!("bench-{}", std::process::id());
    let seconds = WARM_UP_S + settings.seconds;
    let patience = PATIENCE + Duration::from_secs_f64(seconds);

    let threads = rayon::current_num_threads().min(cores.daemon.len().max(1)).to_string();
    let mut serve = this_program()?;
    serve.args(["--threads", &threads, "serve", "--instance", &instance, "--model"]).arg(&settings.model);
    if settings.wake == Wake::Polling {
        serve.arg("--poll");
    }
    let mut daemon = Talking::start("beo serve", &cores.daemon, &mut serve)?;
    daemon.line(patience, stop)?;

    let plan = ReaderPlan { instance: instance.clone(), wake: settings.wake, seconds };
    let mut readers = Vec::new();
    for cores in &cores.readers {
        let mut reader =
            Talking::start("beo bench latency-reader", cores, this_program()?.args(["bench", "latency-reader"]).stdin(Stdio::piped()))?;
        reader.tell(&plan, None)?;
        // Whoever starts a producer after this line misses nothing.
        reader.line(patience, stop)?;
        readers.push(reader);
    }

    let name = "beo bench latency-producer";
    let mut producer = Talking::start(name, &cores.producer, this_program()?.args(["bench", "latency-producer"]).stdin(Stdio::piped()))?;
    producer.tell(
        &ProducerPlan {
            instance,
            load,
            camera: settings.camera,
            pose: settings.pose,
            wake: settings.wake,
            warm_up_s: WARM_UP_S,
            seconds: settings.seconds,
            dims: <[usize; 3]>::from(model.dims()).map(|side| side as u32),
            shapes: grids.shapes(),
        },
        Some(grids),
    )?;
    let sent: Sent = producer.hear(patience, stop)?;
    producer.process.finish(PATIENCE)?;
    readers.iter().for_each(|reader| reader.process.interrupt());
    let records = readers
        .iter_mut()
        .map(|reader| {
            let records: Vec<Record> = reader.hear(PATIENCE, stop)?;
            reader.process.finish(PATIENCE)?;
            Ok(records)
        })
        .collect::<Result<_, LatencyError>>()?;
    daemon.process.interrupt();
    daemon.process.finish(PATIENCE)?;
    Ok(Run { sent, readers: records })
}

/// A process and what it says.
struct Talking {
    process: Process,
    lines: Receiver<String>,
}

impl Talking {
    fn start(name: &'static str, cores: &[usize], command: &mut Command) -> Result<Self, LatencyError> {
        let mut process = pin(cores, || Process::start(name, command).map_err(LatencyError::from))?;
        let lines = process.lines()?;
        Ok(Self { process, lines })
    }

    /// Says what to do: a line, and the grids if there are any.
    fn tell(&mut self, plan: &impl Serialize, grids: Option<&Grids>) -> Result<(), LatencyError> {
        let mut input = self.process.input()?;
        let written = writeln!(input, "{}", serde_json::to_string(plan).expect("plans are plain data"));
        let written = written.and_then(|()| grids.map_or(Ok(()), |grids| grids.write(&mut input)));
        // A pipe that breaks is the end of the process at the other end, whose own message says more.
        written.map_err(|_| LatencyError::Silent(self.process.name()))
    }

    /// The next line that it says.
    fn line(&mut self, patience: Duration, stop: &AtomicBool) -> Result<String, LatencyError> {
        let name = self.process.name();
        let start = Instant::now();
        while start.elapsed() < patience {
            if stop.load(Ordering::Relaxed) {
                return Err(LatencyError::Interrupted);
            }
            match self.lines.recv_timeout(LOOK) {
                Ok(line) => return Ok(line),
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => return Err(LatencyError::Silent(name)),
            }
        }
        Err(LatencyError::Hung { name, patience })
    }

    /// The next line that it says, understood.
    fn hear<T: DeserializeOwned>(&mut self, patience: Duration, stop: &AtomicBool) -> Result<T, LatencyError> {
        let line = self.line(patience, stop)?;
        serde_json::from_str(&line).map_err(|source| LatencyError::Garbled { name: self.process.name(), source })
    }
}
