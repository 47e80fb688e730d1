//! `beo-ros2`: the beo perception daemon in a ROS 2 graph, as a client like any other.
//!
//! | file | what |
//! | --- | --- |
//! | `messages` | the messages of ROS, field for field |
//! | `transport` | the node in the graph, by DDS |
//! | `arguments`, `names` | the command line; names of topics and their remapping |
//! | `images`, `pairing` | images and calibrations as numbers; images of one time brought together |
//! | `perceiving` | from an image to observations |
//! | `listening`, `frames` | from percepts to whole frames |
//! | `answers`, `covariance`, `completed`, `markers` | a frame in the messages of ROS |
//! | `health` | counts and troubles, as diagnostics |
//!
//! Three threads: the graph's, which brings images; one that looks at the newest image; and the main one, which publishes what is answered.

mod answers;
mod arguments;
mod completed;
mod covariance;
mod frames;
mod health;
mod images;
mod listening;
mod markers;
mod messages;
mod names;
mod newest;
mod pairing;
mod perceiving;
mod shared;
mod transport;

use answers::{cloud, detections, label_info, transforms};
use arguments::{ArgumentError, Arguments, Masks};
use beo_ipc::clock::monotonic_ns;
use beo_ipc::{OpenError, ReconnectError};
use health::Count;
use listening::Listening;
use markers::Drawing;
use messages::{Header, Time};
use newest::Newest;
use pairing::Pairing;
use perceiving::{PerceiveError, Perceiving, Work};
use shared::Shared;
use std::process::ExitCode;
use std::sync::atomic::Ordering;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};
use transport::{Came, Transport};

/// How long answers of a frame are waited for.
const PATIENCE: Duration = Duration::from_secs(1);
/// How often a thread looks whether it is to end.
const LOOK: Duration = Duration::from_millis(50);
/// Between two diagnostics.
const DIAGNOSTICS: Duration = Duration::from_secs(1);

fn main() -> ExitCode {
    let arguments = match Arguments::parse_from_line(std::env::args_os()) {
        Ok(arguments) => arguments,
        Err(ArgumentError::Usage(error)) => {
            // Help and version are no failures.
            let code = if error.use_stderr() { 2 } else { 0 };
            let _ = error.print();
            return ExitCode::from(code);
        }
        Err(error) => {
            eprintln!("beo-ros2: {error}");
            return ExitCode::from(2);
        }
    };
    match run(&arguments) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("beo-ros2: {error}");
            ExitCode::FAILURE
        }
    }
}

fn run(arguments: &Arguments) -> Result<(), Box<dyn std::error::Error>> {
    let shared = Arc::new(Shared::default());
    let stopping = shared.clone();
    ctrlc::set_handler(move || stopping.stop.store(true, Ordering::Relaxed))?;
    let newest = Arc::new(Newest::default());
    let transport = Transport::open(arguments, intake(arguments, &shared, &newest)?)?;
    let mut perceiving = Perceiving::new(arguments.clone(), shared.clone());
    let (looking, images) = (shared.clone(), newest);
    let looker = std::thread::Builder::new().name("images".to_owned()).spawn(move || {
        while !looking.stop.load(Ordering::Relaxed) {
            let Some(work) = images.take(LOOK) else { continue };
            match perceiving.frame(&work) {
                Ok(()) => {}
                Err(PerceiveError::Image(error)) => {
                    looking.health.count(Count::Bad);
                    looking.health.trouble("image", &error);
                }
                Err(error) => looking.health.trouble("daemon", &error),
            }
        }
    })?;
    let names = arguments.names()?;
    eprintln!("beo-ros2: node {} of domain {} waits for images", names.node(), arguments.domain()?);
    publish(arguments, names.node(), &shared, &transport);
    shared.stop.store(true, Ordering::Relaxed);
    looker.join().map_err(|_| "the thread of the images ended in a panic")?;
    Ok(())
}

/// Puts what comes from the graph where it is looked at.
fn intake(
    arguments: &Arguments,
    shared: &Arc<Shared>,
    newest: &Arc<Newest<Work>>,
) -> Result<impl Fn(Came) + Send + Sync + 'static, ArgumentError> {
    let pairing = Mutex::new(Pairing::new(arguments.segmentation == Masks::Topic, arguments.tolerance()?));
    let camera = Mutex::new(None);
    let (shared, newest) = (shared.clone(), newest.clone());
    Ok(move |came| {
        let mut pairing = pairing.lock().unwrap_or_else(PoisonError::into_inner);
        let mut camera = camera.lock().unwrap_or_else(PoisonError::into_inner);
        let pair = match came {
            Came::Depth(image) => {
                shared.health.count(Count::Images);
                pairing.depth(image)
            }
            Came::Labels(image) => pairing.labels(image),
            Came::Info(info) => {
                *camera = Some(Arc::from(info));
                None
            }
            Came::Broken(error) => {
                shared.health.count(Count::Bad);
                shared.health.trouble("message", &error);
                None
            }
        };
        shared.health.set(Count::Unpaired, pairing.unpaired());
        let Some(pair) = pair else { return };
        let Some(info) = camera.clone() else {
            shared.health.count(Count::WithoutCamera);
            return shared.health.trouble("image", &"no depth/camera_info has come yet: is its topic remapped as well?");
        };
        if newest.put(Work { pair, info, arrived_ns: monotonic_ns() }) {
            shared.health.count(Count::Replaced);
        }
    })
}

/// Publishes what the daemon answers, until the node ends.
fn publish(arguments: &Arguments, node: &str, shared: &Shared, transport: &Transport) {
    let (outputs, health) = (&transport.outputs, &shared.health);
    let (mut listening, mut drawing, mut model) = (None, Drawing::default(), None);
    let mut due = Instant::now();
    while !shared.stop.load(Ordering::Relaxed) {
        match listen(arguments, &mut listening, shared) {
            Ok(()) => {}
            Err(ReconnectError::Open(error @ OpenError::NotRunning { .. })) => {
                health.trouble("daemon", &error);
                std::thread::sleep(LOOK);
            }
            Err(error) => {
                health.trouble("daemon", &error);
                listening = None;
                shared.set_status(None);
                std::thread::sleep(LOOK);
            }
        }
        let status = shared.status();
        if let Some(status) = &status
            && model != Some(status.model_id)
        {
            outputs.label_info(label_info(Header { stamp: Time::now(), frame_id: String::new() }, status), health);
            model = Some(status.model_id);
        }
        loop {
            let taken = shared.frames().take(PATIENCE);
            let Some((header, answers)) = taken else { break };
            outputs.detections(detections(&header, &answers, status.as_ref()), health);
            outputs.transforms(|| transforms(&header, &answers, status.as_ref()), health);
            outputs.markers(drawing.frame(&header, &answers, status.as_ref()), health);
            outputs.cloud(cloud(&header, &answers), health);
        }
        if Instant::now() >= due {
            outputs.diagnostics(health.diagnostics(node, status.as_ref()), health);
            due = Instant::now() + DIAGNOSTICS;
        }
    }
}

fn listen(arguments: &Arguments, listening: &mut Option<Listening>, shared: &Shared) -> Result<(), ReconnectError> {
    if listening.is_none() {
        *listening = Some(Listening::open(&arguments.instance)?);
    }
    match listening {
        Some(listening) => listening.turn(LOOK, shared),
        None => Ok(()),
    }
}
