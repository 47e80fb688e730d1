//! `beo demo`: a synthetic depth camera circles made-up household things; daemon, camera and watcher are processes of their own.

use super::failure::{Failure, cannot_write};
use super::found_models;
use crate::frames::draw_depth;
use crate::frames::synthetic::{Circle, CircleView, FrameWriter, SyntheticCamera};
use beo_camera::Intrinsics;
use beo_core::grid::{from_xyzw, yaw_of};
use beo_core::model::load;
use beo_lab::process::{Process, this_program};
use beo_shapes::{Mesh, household};
use clap::Args;
use nalgebra::Vector3;
use rayon::prelude::*;
use serde_json::Value;
use std::f64::consts::{PI, TAU};
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::Stdio;
use std::sync::mpsc::Receiver;
use std::time::{Duration, Instant};

/// Circle household things with a synthetic depth camera, and show what is perceived of each view
///
/// Daemon, camera (`beo camera`) and watcher are processes of their own. The frames stay in DIR/frames, with noise, steps and missing
/// readings as structured light has them: replay them with `beo camera DIR/frames --support-label 1`.
#[derive(Args)]
pub struct Demo {
    /// Model file, with classes of `beo generate household` [default: models/household.safetensors beside the program]
    #[arg(long)]
    model: Option<PathBuf>,
    /// Folder for the frames and the pictures: depth, query, completion of every view
    #[arg(long, default_value = "demo", value_name = "DIR")]
    png: PathBuf,
    /// Shapes to look at, one after the other
    #[arg(long, value_delimiter = ',', value_parser = household::CLASSES, default_value = "mug,box,bowl,bottle", value_name = "CLASSES")]
    objects: Vec<String>,
    /// Views of each, evenly spread around it
    #[arg(long, default_value_t = 8, value_name = "N")]
    views: usize,
    /// How far above the horizontal the camera is
    #[arg(long, default_value_t = 35.0, value_name = "DEGREES")]
    elevation: f64,
    /// Add up the views of each object before they are perceived
    #[arg(long)]
    fuse: bool,
    /// Show it live as well (`beo view`), and go on round after round until Ctrl-C
    #[cfg(feature = "view")]
    #[arg(long)]
    view: bool,
    /// Port of the live view; its page for browsers has the next one
    #[cfg(feature = "view")]
    #[arg(long, default_value_t = 8765, value_name = "PORT", requires = "view")]
    view_port: u16,
    /// Seed of the objects, their poses and the noise
    #[arg(long, default_value_t = 1)]
    seed: u64,
}

/// A process is given this long to end, and an answer this long to come.
const PATIENCE: Duration = Duration::from_secs(60);
/// The longest wait for the watcher's lines after the camera's end.
const SILENCE: Duration = Duration::from_secs(3);
/// The process that must be there before the camera sends.
const WATCHER: &str = "beo watch";
/// Label of the table in the frames; objects have the ones after it.
const TABLE: u16 = 1;
/// Time between views, nanoseconds: the stamps say which view an answer belongs to.
const PERIOD_NS: u64 = 100_000_000;
/// Most views of an object.
const MOST_VIEWS: usize = 1000;

impl Demo {
    /// Runs the command.
    pub fn run(self) -> Result<(), Failure> {
        if !(1..=MOST_VIEWS).contains(&self.views) {
            return Err(Failure::Usage(format!("--views {}: use 1 to {MOST_VIEWS}", self.views)));
        }
        if !(5.0..=85.0).contains(&self.elevation) {
            return Err(Failure::Usage(format!("--elevation {}: use 5 to 85 degrees", self.elevation)));
        }
        let file = found_models::or_shipped(self.model.clone())?;
        let model = load(&file)?;
        if let Some(class) = self.objects.iter().find(|object| !model.class_names().any(|class| class == object.as_str())) {
            let path = file.display();
            return Err(Failure::Failed(format!("{path} has no class `{class}`: train it on what `beo generate household` writes")));
        }
        drop(model);
        std::fs::create_dir_all(&self.png).map_err(cannot_write(&self.png))?;
        let instance = format!("demo-{}", std::process::id());
        say!("1. the daemon: beo serve --model {} --instance {instance}", file.display());
        let mut daemon = start("beo serve", &["serve", "--instance", &instance, "--model"], &[&file])?;
        let frames = self.png.join("frames");
        say!("2. {} views of each of {}, written to {}", self.views, self.objects.join(", "), frames.display());
        let (views, trajectory) = self.render(&frames)?;

        let mut ready = String::new();
        BufReader::new(daemon.output()?).read_line(&mut ready)?;
        if ready.is_empty() {
            return Err(Failure::Failed("the daemon did not start; its own message stands above".into()));
        }
        #[cfg(feature = "view")]
        let viewed = if self.view { Some(self.start_view(&instance)?) } else { None };
        say!("3. a robot's process: beo watch --instance {instance} --json --png {}", self.png.display());
        let count = views.len().to_string();
        let mut watcher = start(WATCHER, &["watch", "--instance", &instance, "--count", &count, "--json", "--png"], &[&self.png])?;
        wait_until_watching(&mut watcher)?;
        let fuse: &[&str] = if self.fuse { &["--fuse"] } else { &[] };
        say!("4. the camera: beo camera {} --instance {instance} {}\n", frames.display(), fuse.join(" "));
        let table = TABLE.to_string();
        let start_camera = |more: &[&str]| {
            // The camera leaps by an eighth of a turn from view to view, so that nothing is to be expected of one from the view before.
            let camera: &[&str] = &["camera", "--instance", &instance, "--support-label", &table, "--pose", "yaw", "--track=none"];
            start("beo camera", &[camera, fuse, more, &["--trajectory"]].concat(), &[&trajectory, &frames])
        };
        let mut camera = start_camera(&[])?;
        let told = camera.lines()?;
        let tally = show(&views, &watcher.lines()?, &mut camera)?;
        camera.finish(PATIENCE)?;
        // What the camera could not make a grid of.
        told.try_iter().filter(|line| line.contains("no grid")).try_for_each(|line| Ok::<(), Failure>(say!("   {line}")))?;
        if tally.answers < views.len() {
            watcher.interrupt();
        }
        watcher.finish(PATIENCE)?;
        if tally.answers == 0 {
            return Err(Failure::Failed(format!("none of {} views was answered", views.len())));
        }
        say!("\n{}; pictures of every view are in {}/", tally.summary(views.len()), self.png.display());
        #[cfg(feature = "view")]
        if let Some(view) = viewed {
            say!("the camera goes round for the live view; Ctrl-C ends it");
            go_round(start_camera(&["--loop", "--rate", "2"])?, view)?;
        }
        daemon.interrupt();
        daemon.finish(PATIENCE)?;
        Ok(())
    }

    /// Starts the live view, and passes on where it is seen.
    #[cfg(feature = "view")]
    fn start_view(&self, instance: &str) -> Result<Process, Failure> {
        // Any free port is any free port for both.
        let page_port = if self.view_port == 0 { 0 } else { self.view_port.saturating_add(1) };
        let (port, page_port) = (self.view_port.to_string(), page_port.to_string());
        // The objects are looked at one after the other, all at the same place.
        let arguments = ["view", "--instance", instance, "--port", &port, "--web", &page_port, "--keep", "1"];
        let mut view = start("beo view", &arguments, &[])?;
        let mut lines = BufReader::new(view.output()?).lines();
        let first = lines.next().transpose()?;
        let Some(first) = first else {
            return Err(Failure::Failed("the live view did not start; its own message stands above".into()));
        };
        say!("   {first}");
        std::thread::spawn(move || lines.map_while(Result::ok).try_for_each(|line| Ok::<(), Failure>(say!("   {line}"))));
        Ok(view)
    }

    /// Renders all views and writes them as frames and as pictures.
    fn render(&self, folder: &Path) -> Result<(Vec<View>, PathBuf), Failure> {
        remove_frames(folder)?;
        let intrinsics = Intrinsics::new(640, 480, [525.0; 2], [319.5, 239.5], [0.04, -0.08, 0.0005, -0.0005, 0.0])?;
        let camera = SyntheticCamera::new(intrinsics);
        let circle = Circle { views: self.views, elevation_rad: self.elevation.to_radians(), table_label: TABLE, ..Circle::default() };
        let mut writer = FrameWriter::new(folder, &intrinsics)?;
        let mut views = Vec::new();
        for (n, class) in self.objects.iter().enumerate() {
            let seed = self.seed.wrapping_add(n as u64);
            let mesh = household::mesh(class, seed).expect("its own class");
            // Turned by the golden ratio's share of a full turn, so that no view shows an object straight on.
            let yaw = TAU * (0.618_034 * (seed as f64 + 1.0)).fract();
            let label = TABLE + 1 + n as u16;
            let circled = circle.views_of(&camera, &mesh, yaw, label, seed);
            circled.par_iter().enumerate().try_for_each(|(view, circled)| {
                let picture = draw_depth(&circled.image.frame(), &[(label, class.clone())], Some(TABLE));
                picture.save(&self.png.join(format!("{:04}-depth.png", n * self.views + view + 1)))
            })?;
            for circled in circled {
                let stamp_ns = (views.len() as u64 + 1) * PERIOD_NS;
                writer.write(&format!("{:04}-{class}", views.len() + 1), stamp_ns, &circled.camera_to_world, &circled.image)?;
                views.push(View::new(class, &mesh, yaw, &circled));
            }
        }
        Ok((views, writer.finish()?))
    }
}

/// Lets camera and view run until an interrupt.
#[cfg(feature = "view")]
fn go_round(mut camera: Process, mut view: Process) -> Result<(), Failure> {
    let stop = super::stop::on_signal()?;
    let said = camera.lines()?;
    while !stop.load(std::sync::atomic::Ordering::Relaxed) && camera.is_running() && view.is_running() {
        std::thread::sleep(Duration::from_millis(20));
        said.try_iter().for_each(drop);
    }
    for process in [&mut camera, &mut view] {
        process.interrupt();
        process.finish(PATIENCE)?;
    }
    Ok(())
}

/// Frames of an earlier run would be replayed as well; nothing else in the folder is touched.
fn remove_frames(folder: &Path) -> Result<(), Failure> {
    let Ok(entries) = std::fs::read_dir(folder) else { return Ok(()) };
    for path in entries.filter_map(|entry| Some(entry.ok()?.path())) {
        let name = path.file_name().map(|name| name.to_string_lossy()).unwrap_or_default();
        if name.ends_with("_depth.png") || name.ends_with("_label.png") {
            let failed = |error| Failure::Failed(format!("cannot remove {}, a frame of an earlier run: {error}", path.display()));
            std::fs::remove_file(&path).map_err(failed)?;
        }
    }
    Ok(())
}

/// The ground truth of a view, known because it was made up.
struct View {
    class: String,
    /// Turn of the object in the world, radians.
    yaw: f64,
    /// Radians of a full turn after which the object looks the same; 0 for round ones.
    period: f64,
    azimuth: f64,
    size_mm: Vector3<f64>,
}

impl View {
    fn new(class: &str, mesh: &Mesh, yaw: f64, circled: &CircleView) -> Self {
        let [low, high] = mesh.bounds();
        let size_mm = 1e3 * (high - low);
        let is_round = (size_mm.x - size_mm.y).abs() < 1.0;
        let period = match class {
            "mug" | "cutlery_box" => TAU,
            _ if is_round => 0.0,
            _ => PI,
        };
        Self { class: class.to_owned(), yaw, period, azimuth: circled.azimuth_rad, size_mm }
    }

    /// One line about an answer, and whether class and turn are right.
    fn line(&self, answer: &Value) -> (String, [bool; 2]) {
        let class = answer["class"].as_str().unwrap_or("refused");
        let p = answer["posterior"][class].as_f64().unwrap_or(0.0);
        let (turn, is_right) = self.turn(answer);
        let size = answer["object"]["extent_m"].as_array().map_or(String::new(), |extent| {
            let mm: Vec<String> = extent.iter().map(|side| format!("{:.0}", 1e3 * side.as_f64().unwrap_or(0.0))).collect();
            let made = self.size_mm;
            format!("{:>13} mm ({:.0}×{:.0}×{:.0})", mm.join("×"), made.x, made.y, made.z)
        });
        let line = format!(
            "   {:<12}from {:>3.0}° → {class:<12}{:>5.1} %   {turn:<24}{size}   {:>6.1} ms",
            self.class,
            self.azimuth.to_degrees(),
            100.0 * p,
            answer["latency_us"].as_f64().unwrap_or(0.0) / 1e3
        );
        (line, [class == self.class, is_right])
    }

    /// The turn in the world, found and made: the grid's x axis points away from the camera.
    fn turn(&self, answer: &Value) -> (String, bool) {
        let hypotheses = answer["hypotheses"].as_array();
        let of_class = hypotheses.and_then(|all| all.iter().find(|h| h["class"] == answer["class"]));
        let rotation: Option<[f64; 4]> = of_class.and_then(|h| serde_json::from_value(h["rotation"].clone()).ok());
        let Some(rotation) = rotation.filter(|_| self.period > 0.0) else { return ("round".into(), self.period == 0.0) };
        let found = (yaw_of(&from_xyzw(rotation)) + self.azimuth + PI).rem_euclid(self.period);
        let made = self.yaw.rem_euclid(self.period);
        let error = (found - made + self.period / 2.0).rem_euclid(self.period) - self.period / 2.0;
        // Where half a turn makes no difference, the spread is that of both halves and says nothing.
        let spread = answer["rotation_spread_rad"].as_f64().filter(|_| self.period == TAU);
        let spread = spread.map_or(String::new(), |spread| format!(" ± {:.0}°", spread.to_degrees()));
        (format!("turned {:>3.0}° ({:.0}°){spread}", found.to_degrees(), made.to_degrees()), error.abs() <= RIGHT_TURN)
    }
}

/// A turn this near is right, radians.
const RIGHT_TURN: f64 = 15.0 / 180.0 * PI;

/// The outcome of all views.
#[derive(Default)]
struct Tally {
    answers: usize,
    right_class: usize,
    /// Of objects that are not round: those named right, and those turned right as well.
    turned: [usize; 2],
}

impl Tally {
    fn summary(&self, views: usize) -> String {
        let [named, turned] = self.turned;
        format!(
            "{} of {views} views named as they were made, {turned} of {named} of these turned within 15° (round ones apart)",
            self.right_class
        )
    }
}

/// Prints the watcher's answers as they come, until all have come or the camera has ended and no more come.
fn show(views: &[View], lines: &Receiver<String>, camera: &mut Process) -> Result<Tally, Failure> {
    let mut tally = Tally::default();
    let mut last = Instant::now();
    while tally.answers < views.len() {
        let Ok(line) = lines.recv_timeout(Duration::from_millis(100)) else {
            let patience = if camera.is_running() { PATIENCE } else { SILENCE };
            if last.elapsed() > patience {
                break;
            }
            continue;
        };
        last = Instant::now();
        let answer: Value = serde_json::from_str(&line)?;
        let number = answer["sensor_stamp_ns"].as_u64().unwrap_or(0) / PERIOD_NS;
        let Some(view) = number.checked_sub(1).and_then(|n| views.get(n as usize)) else { continue };
        let (line, [right_class, right_turn]) = view.line(&answer);
        say!("{line}");
        tally.answers += 1;
        tally.right_class += usize::from(right_class);
        if view.period > 0.0 && right_class {
            tally.turned = [tally.turned[0] + 1, tally.turned[1] + usize::from(right_turn)];
        }
    }
    Ok(tally)
}

/// Starts this program once more; the watcher's messages are listened to, those of others go where ours go.
fn start(name: &'static str, arguments: &[&str], paths: &[&Path]) -> Result<Process, Failure> {
    let mut command = this_program()?;
    if name == WATCHER {
        command.stderr(Stdio::piped());
    }
    Ok(Process::start(name, command.args(arguments).args(paths))?)
}

/// Waits until the watcher says that it has subscribed; what else it says goes where ours goes.
fn wait_until_watching(watcher: &mut Process) -> Result<(), Failure> {
    let mut messages = BufReader::new(watcher.messages()?);
    let mut line = String::new();
    messages.read_line(&mut line)?;
    if !line.starts_with("watching") {
        return Err(Failure::Failed(format!("{} did not start: {}", watcher.name(), line.trim())));
    }
    std::thread::spawn(move || messages.lines().map_while(Result::ok).for_each(|line| warn!("{line}")));
    Ok(())
}
