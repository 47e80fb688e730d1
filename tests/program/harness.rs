//! Starting the program, a small model to serve, and ending every process by its id.

#[path = "watchdog.rs"]
pub mod watchdog;

use beo_core::grid::{Dims, Observation, Occupancy, Rotation, Turn, View};
use beo_core::perception::{Perceiver, Percept, Query};
use beo_shapes::{furniture, write_binvox};
use std::io::{BufRead, BufReader, Read};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc::{Receiver, channel};
use std::sync::{Arc, OnceLock};
use std::time::{Duration, Instant};

/// No step of a test takes longer than this on the slowest machine; it ends what hangs, it measures nothing.
pub const PATIENCE: Duration = Duration::from_secs(300);
/// Resolution of the small model.
pub const RESOLUTION: usize = 16;
/// Made-up shapes of each class that the small model learns from.
const SHAPES: u64 = 12;

/// The program with these arguments, not yet started.
pub fn beo<S: AsRef<std::ffi::OsStr>>(arguments: impl IntoIterator<Item = S>) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_beo"));
    command.args(arguments).stdin(Stdio::null());
    command
}

/// Runs the program to its end.
pub fn run<S: AsRef<std::ffi::OsStr>>(arguments: impl IntoIterator<Item = S>) -> Output {
    finish(beo(arguments))
}

/// Runs a command to its end.
fn finish(command: Command) -> Output {
    let mut running = Running::start(command);
    let status = running.wait();
    let take =
        |stream: Option<Receiver<String>>| stream.map_or(Vec::new(), |lines| lines.iter().collect::<Vec<_>>().join("\n").into_bytes());
    Output { status, stdout: take(running.stdout.take()), stderr: take(running.stderr.take()) }
}

/// Text of a finished program's output.
pub fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// A running program, killed by its id when dropped.
pub struct Running {
    child: Child,
    /// Lines of its output.
    pub stdout: Option<Receiver<String>>,
    /// Lines of its messages.
    pub stderr: Option<Receiver<String>>,
}

impl Running {
    /// Starts it.
    pub fn start(mut command: Command) -> Self {
        let mut child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().expect("the program starts");
        watchdog::started(child.id());
        let (stdout, stderr) = (child.stdout.take().map(lines), child.stderr.take().map(lines));
        Self { child, stdout, stderr }
    }

    /// Its process id.
    pub fn id(&self) -> u32 {
        self.child.id()
    }

    /// The next line of its output.
    pub fn line(&self) -> String {
        self.stdout.as_ref().unwrap().recv_timeout(PATIENCE).expect("a line before the program ends")
    }

    /// The next line of its messages.
    pub fn message(&self) -> String {
        self.stderr.as_ref().unwrap().recv_timeout(PATIENCE).expect("a message before the program ends")
    }

    /// Sends a signal.
    pub fn signal(&self, signal: rustix::process::Signal) {
        let pid = rustix::process::Pid::from_raw(self.id() as i32).unwrap();
        rustix::process::kill_process(pid, signal).unwrap();
    }

    /// Whether it has ended.
    pub fn has_ended(&mut self) -> bool {
        self.child.try_wait().unwrap().is_some()
    }

    /// Waits for its end.
    pub fn wait(&mut self) -> std::process::ExitStatus {
        let start = Instant::now();
        loop {
            if let Some(status) = self.child.try_wait().unwrap() {
                return status;
            }
            if start.elapsed() > PATIENCE {
                let said: Vec<String> = [&self.stdout, &self.stderr].into_iter().flatten().flat_map(Receiver::try_iter).collect();
                panic!("process {} did not end; it said last:\n{}", self.id(), said.join("\n"));
            }
            std::thread::sleep(Duration::from_millis(5));
        }
    }
}

impl Drop for Running {
    /// Ends it as Ctrl-C would, so that it leaves nothing in shared memory; what does not end is killed.
    fn drop(&mut self) {
        let ended = |child: &mut Child| !matches!(child.try_wait(), Ok(None));
        if !ended(&mut self.child) {
            self.signal(rustix::process::Signal::INT);
        }
        let start = Instant::now();
        while !ended(&mut self.child) && start.elapsed() < Duration::from_secs(20) {
            std::thread::sleep(Duration::from_millis(5));
        }
        let _ = self.child.kill();
        let _ = self.child.wait();
        watchdog::ended(self.child.id());
    }
}

fn lines(stream: impl Read + Send + 'static) -> Receiver<String> {
    let (sender, receiver) = channel();
    std::thread::spawn(move || BufReader::new(stream).lines().map_while(Result::ok).try_for_each(|line| sender.send(line)));
    receiver
}

/// An instance name that no other test uses.
pub fn instance() -> String {
    static COUNT: AtomicUsize = AtomicUsize::new(0);
    format!("test-{}-{}", std::process::id(), COUNT.fetch_add(1, Ordering::Relaxed))
}

/// A file of one made-up shape.
pub fn shape(folder: &Path, class: &str, seed: u64) -> PathBuf {
    let path = folder.join(format!("{class}-{seed}.binvox"));
    let mut bytes = Vec::new();
    let object = furniture::make(class, Dims::cube(RESOLUTION).unwrap(), seed).expect("a class of the generator");
    write_binvox(&mut bytes, &object).unwrap();
    std::fs::write(&path, bytes).unwrap();
    path
}

/// A folder of made-up shapes, DIR/<class>/train/*.
pub fn library(root: &Path) {
    shapes_of(root, &furniture::CLASSES, SHAPES);
}

/// As [`library`], of three classes with few shapes each: for trainings of which not the model matters but what becomes of it.
pub fn small_library(root: &Path) {
    shapes_of(root, &furniture::CLASSES[..3], 6);
}

fn shapes_of(root: &Path, classes: &[&str], count: u64) {
    for class in classes {
        let folder = root.join(class).join("train");
        std::fs::create_dir_all(&folder).unwrap();
        (0..count).for_each(|seed| drop(shape(&folder, class, seed)));
    }
}

/// A model of made-up shapes, trained once by the program itself.
pub fn model() -> &'static Path {
    static MODEL: OnceLock<(tempfile::TempDir, PathBuf)> = OnceLock::new();
    let (_, path) = MODEL.get_or_init(|| {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("small.safetensors");
        train(&path, 5);
        (folder, path)
    });
    path
}

/// Trains a model of made-up shapes with at least so many components for each class.
pub fn train(path: &Path, least: usize) {
    let shapes = path.with_extension("shapes");
    library(&shapes);
    let (resolution, least) = (RESOLUTION.to_string(), least.to_string());
    let mut command = beo(["train".as_ref(), shapes.as_os_str(), "--out".as_ref(), path.as_os_str()]);
    command.args(["--resolution", &resolution, "--least", &least]);
    let output = finish(command);
    assert!(output.status.success(), "{}", text(&output.stderr));
}

/// Size of the small model's grids.
pub fn dims() -> Dims {
    Dims::cube(RESOLUTION).unwrap()
}

/// The small model's answer, without a daemon.
pub fn answer(observation: &Observation, query: &Query) -> Percept {
    static PERCEIVER: OnceLock<Perceiver> = OnceLock::new();
    let perceiver = PERCEIVER.get_or_init(|| Perceiver::new(Arc::new(beo_core::model::load(model()).unwrap())).unwrap());
    let (mut work, mut percept) = (perceiver.workspace(), Percept::default());
    perceiver.classify(observation, query, &mut work, &mut percept).unwrap().complete().unwrap();
    percept
}

/// The view from above of an object turned by `rotation`.
pub fn seen(object: &Occupancy, rotation: &Rotation) -> Observation {
    View::Top.of(&Turn::new(object.dims(), rotation).occupancy(object))
}

/// A daemon with the small model, ready to answer.
pub fn serve(instance: &str) -> Running {
    serve_with(instance, model(), |command| command)
}

/// A daemon with this model and whatever else `change` asks for, ready to answer.
pub fn serve_with(instance: &str, model: &Path, change: impl FnOnce(&mut Command) -> &mut Command) -> Running {
    let mut command = beo(["serve".as_ref(), "--instance".as_ref(), instance.as_ref(), "--model".as_ref(), model.as_os_str()]);
    change(&mut command);
    let daemon = Running::start(command);
    let line = daemon.line();
    assert!(line.starts_with("serving"), "{line}");
    daemon
}

/// Files of shared memory that a process has mapped.
pub fn segments(pid: u32) -> Vec<PathBuf> {
    let maps = std::fs::read_to_string(format!("/proc/{pid}/maps")).unwrap();
    let mut files: Vec<PathBuf> = maps
        .lines()
        .filter_map(|line| line.split_whitespace().last())
        .filter(|path| path.starts_with("/dev/shm/") && !path.ends_with(".global_mgmt"))
        .map(PathBuf::from)
        .collect();
    files.sort();
    files.dedup();
    files
}
