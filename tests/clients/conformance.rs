//! The behaviour of every client, whatever its language: one scenario, played by the examples `camera` and `listen` of each.
//!
//! They say alike what happens to them. `camera`: "sent observation N". `listen`: a line for each percept, "#N class …" or "#N refused: why",
//! and as messages "listening", "waiting for the daemon" and "missed N percepts". A language whose tools are missing is left out with a line
//! that says so.

use crate::examples::Examples;
use crate::harness::{PATIENCE, RESOLUTION, Running, instance, model, run, serve, serve_with, text};
use crate::python;
use crate::toolchain::await_message;
use beo_core::grid::Dims;
use beo_ipc::{InstanceName, ObservationHeader, Producer, Subscriber, SubscriberOptions};
use beo_shapes::{furniture, write_binvox};
use rustix::process::Signal;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::OnceLock;
use std::time::{Duration, Instant};

/// Voxels along each side of the other daemon's grids.
const OTHER_RESOLUTION: usize = 20;
/// The beginning of the other models' class names.
const OTHER: &str = "other-";

/// How a client of some language differs from the others.
struct Client {
    examples: Examples,
    /// Whether it goes on with a daemon for grids of another size, or is to be ended before such a daemon starts.
    outlives_other_dims: bool,
}

/// A model whose classes have other names than the small one's, for grids of so many voxels a side.
fn other_model(resolution: usize) -> &'static Path {
    static MODELS: [OnceLock<(tempfile::TempDir, PathBuf)>; 2] = [const { OnceLock::new() }; 2];
    let (_, path) = MODELS[usize::from(resolution != RESOLUTION)].get_or_init(|| {
        let folder = tempfile::tempdir().unwrap();
        let shapes = folder.path().join("shapes");
        for class in &furniture::CLASSES[..2] {
            let place = shapes.join(format!("{OTHER}{class}")).join("train");
            std::fs::create_dir_all(&place).unwrap();
            for seed in 0..8 {
                let object = furniture::make(class, Dims::cube(resolution).unwrap(), seed).expect("a class of the generator");
                let mut bytes = Vec::new();
                write_binvox(&mut bytes, &object).unwrap();
                std::fs::write(place.join(format!("{seed}.binvox")), bytes).unwrap();
            }
        }
        let path = folder.path().join("other.safetensors");
        let resolution = resolution.to_string();
        let mut arguments: Vec<&std::ffi::OsStr> = ["train".as_ref(), shapes.as_os_str(), "--out".as_ref(), path.as_os_str()].into();
        arguments.extend(["--resolution", &resolution, "--least", "3"].map(std::ffi::OsStr::new));
        let output = run(arguments);
        assert!(output.status.success(), "{}", text(&output.stderr));
        (folder, path)
    });
    path
}

/// The lines of a listener up to the first that is as wanted.
fn await_line(listener: &Running, what: &str, wanted: impl Fn(&str) -> bool) -> String {
    let start = Instant::now();
    loop {
        let line = listener.line();
        if wanted(&line) {
            return line;
        }
        assert!(start.elapsed() < PATIENCE, "{what}: the last line is {line}");
    }
}

fn class(line: &str) -> &str {
    line.split(' ').nth(1).unwrap_or_default()
}

/// An answer by the small model.
fn is_furniture(line: &str) -> bool {
    furniture::CLASSES.contains(&class(line))
}

/// An answer by one of the other models.
fn is_other(line: &str) -> bool {
    class(line).starts_with(OTHER)
}

/// Asks so many times with voxels that no observation may have, which cost the daemon least, one after the other's answer.
fn ask_wrongly(name: &str, times: usize) {
    let name = InstanceName::new(name).unwrap();
    let subscriber = Subscriber::open_within(&name, &SubscriberOptions::default(), PATIENCE).unwrap();
    let producer = Producer::open_within(&name, &ObservationHeader::new([RESOLUTION as u32; 3]), PATIENCE).unwrap();
    for _ in 0..times {
        let mut loan = producer.loan().unwrap();
        loan.voxels_mut().fill(0);
        loan.voxels_mut()[77] = 9;
        let sequence = loan.send().unwrap().sequence;
        let start = Instant::now();
        let is_answer = |percept: beo_ipc::Percept| (percept.producer_id, percept.sequence) == (producer.id(), sequence);
        while !std::iter::from_fn(|| subscriber.take_percept().unwrap()).any(is_answer) {
            assert!(start.elapsed() < PATIENCE, "no answer");
            subscriber.wait(Duration::from_millis(50)).unwrap();
        }
    }
}

fn reload(name: &str, model: &Path) {
    let output = run(["reload".as_ref(), "--instance".as_ref(), name.as_ref(), "--model".as_ref(), model.as_os_str()]);
    assert!(output.status.success(), "{}", text(&output.stderr));
}

/// The scenario.
fn conforms(client: &Client) {
    let language = client.examples.language;
    let start = |program: &str, arguments: &[&str]| (client.examples.start)(program, arguments);
    let name = instance();
    let camera = |side: usize| start("camera", &[&name, "1000000", &side.to_string()]);

    // Learned first: clients wait ten seconds for a daemon.
    let [first, other, other_size] = [model(), other_model(RESOLUTION), other_model(OTHER_RESOLUTION)];

    // Who comes before the daemon waits for it.
    let mut listener = start("listen", &[&name]);
    let mut sender = camera(RESOLUTION);
    let mut daemon = serve(&name);
    await_message(&listener, "listening");
    await_line(&listener, "an answer", is_furniture);

    // A refusal says why, and harms nobody.
    ask_wrongly(&name, 1);
    let refused = await_line(&listener, "a refusal", |line| line.contains(" refused: "));
    assert!(refused.starts_with("#1 refused: ") && refused.contains("voxel 77"), "{language}: {refused}");
    await_line(&listener, "an answer after a refusal", is_furniture);

    // Of a reader that does not read, 32 percepts are kept; it knows how many it missed.
    listener.signal(Signal::STOP);
    ask_wrongly(&name, 80);
    listener.signal(Signal::CONT);
    await_message(&listener, "missed ");
    await_line(&listener, "an answer after a gap", is_furniture);

    // Another model is served from one percept to the next, and its classes have its names.
    reload(&name, other);
    await_line(&listener, "an answer by another model", is_other);
    reload(&name, first);
    await_line(&listener, "an answer by the first model", is_furniture);

    // The daemon ends in order and is started again; then it is killed.
    for signal in [Signal::TERM, Signal::KILL] {
        daemon.signal(signal);
        daemon.wait();
        await_message(&listener, "waiting for the daemon");
        listener.stdout.as_ref().unwrap().try_iter().for_each(drop);
        daemon = serve(&name);
        await_line(&listener, "an answer of the next daemon", is_furniture);
    }

    // The next daemon's grids have another size: those of the camera before are refused.
    // Not SIGINT, which shells have what they start in the background ignore.
    let ended = |running: &mut Running| {
        running.signal(Signal::TERM);
        running.wait();
    };
    if !client.outlives_other_dims {
        [&mut listener, &mut sender].into_iter().for_each(ended);
    }
    daemon.signal(Signal::TERM);
    daemon.wait();
    let _daemon = serve_with(&name, other_size, |command: &mut Command| command);
    if !client.outlives_other_dims {
        listener = start("listen", &[&name]);
        await_message(&listener, "listening");
    }
    let mut next = camera(OTHER_RESOLUTION);
    await_line(&listener, "an answer for the other size", is_other);
    if client.outlives_other_dims {
        let size = format!("{OTHER_RESOLUTION}");
        let refused = await_line(&listener, "a refusal of the size before", |line| line.contains(" refused: "));
        assert!(refused.contains(&size), "{language}: {refused}");
        assert!(!sender.has_ended(), "{language}: the camera for the size before goes on trying");
    }
    // What a signal has ended left its files in shared memory: any other client removes them.
    for running in [&mut sender, &mut next, &mut listener] {
        if !running.has_ended() {
            ended(running);
        }
    }
    Subscriber::open(&InstanceName::new(&name).unwrap(), &SubscriberOptions::default()).unwrap().maintain();
}

#[test]
fn a_client_in_rust_conforms() {
    conforms(&Client { examples: Examples::rust(), outlives_other_dims: true });
}

#[test]
fn a_client_in_c_conforms() {
    conforms(&Client { examples: Examples::c(), outlives_other_dims: true });
}

#[test]
fn a_client_in_cpp_conforms() {
    let Some(examples) = Examples::cpp() else { return };
    conforms(&Client { examples, outlives_other_dims: true });
}

#[test]
fn a_client_in_python_conforms() {
    let Some(examples) = python::examples() else { return };
    conforms(&Client { examples, outlives_other_dims: false });
}
