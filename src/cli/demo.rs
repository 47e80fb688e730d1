//! `beo demo`: daemon, producer and watcher as separate processes on made-up furniture.

use super::eval::PoseArgument;
use super::failure::{Failure, cannot_write};
use crate::evaluation::protocol::draw_rotation;
use crate::grid::{Dims, Turn};
use crate::model::load;
use crate::perception::PoseSearch;
use crate::process::{Process, this_program};
use crate::shapes::{furniture, write_binvox};
use clap::Args;
use std::io::{BufRead, BufReader, Write};
use std::path::{Path, PathBuf};
use std::process::Stdio;
use std::time::Duration;

/// Start daemon, producer and watcher on made-up furniture, and show what is perceived
#[derive(Args)]
pub struct Demo {
    /// Model file
    #[arg(long, default_value = "models/modelnet10.safetensors")]
    model: PathBuf,
    /// Folder for the pictures of query and completion
    #[arg(long, default_value = "demo", value_name = "DIR")]
    png: PathBuf,
    /// Turn the furniture, about the vertical axis or in any way, and have its pose found
    #[arg(long, value_enum, default_value_t = PoseArgument::Known)]
    pose: PoseArgument,
    /// Seed of the furniture
    #[arg(long, default_value_t = 1)]
    seed: u64,
}

/// A process is given this long to end.
const PATIENCE: Duration = Duration::from_secs(60);

/// The process that must be there before the camera sends.
const WATCHER: &str = "beo watch";

impl Demo {
    /// Runs the command.
    pub fn run(self) -> Result<(), Failure> {
        let model = load(&self.model)?;
        let dims = model.dims();
        drop(model);
        std::fs::create_dir_all(&self.png).map_err(cannot_write(&self.png))?;
        let instance = format!("demo-{}", std::process::id());
        let pose = self.pose.search(360.0)?;
        let files = make_furniture(&self.png, dims, self.seed, pose)?;
        let count = files.len().to_string();

        say!("1. the daemon: beo serve --model {} --instance {instance}", self.model.display());
        let mut daemon = start("beo serve", &["serve", "--instance", &instance, "--model"], &[&self.model])?;
        let mut ready = String::new();
        BufReader::new(daemon.output()?).read_line(&mut ready)?;
        if ready.is_empty() {
            return Err(Failure::Failed("the daemon did not start; its own message stands above".into()));
        }
        say!("2. a robot's process: beo watch --instance {instance} --json --png {}", self.png.display());
        let mut watcher = start(WATCHER, &["watch", "--instance", &instance, "--count", &count, "--json", "--png"], &[&self.png])?;
        wait_until_watching(&mut watcher)?;
        say!("3. the camera: beo observe {} pieces of made-up furniture, seen from above\n", files.len());
        let arguments = ["observe", "--instance", &instance, "--rate", "10", "--pose", pose.name()];
        let mut camera = start("beo observe", &arguments, &files.iter().map(PathBuf::as_path).collect::<Vec<_>>())?;

        let mut right = 0;
        let mut seen = 0;
        let lines = watcher.lines()?;
        while let Ok(line) = lines.recv_timeout(PATIENCE) {
            let line: serde_json::Value = serde_json::from_str(&line)?;
            seen += 1;
            let made = furniture::CLASSES[(line["sequence"].as_u64().unwrap_or(1) as usize - 1) % files.len()];
            let class = line["class"].as_str().unwrap_or("refused");
            right += usize::from(class == made);
            let spread = line["rotation_spread_rad"].as_f64().unwrap_or(0.0).to_degrees();
            let known = pose == PoseSearch::Known;
            say!(
                "   made-up {made:<12} → {class:<12} {:>5.1} %   {}{:>5} voxels after completion   {:>6.2} ms",
                100.0 * line["posterior"][class].as_f64().unwrap_or(0.0),
                if known { String::new() } else { format!("pose ± {spread:>3.0}°   ") },
                line["completion"]["filled"],
                line["latency_us"].as_f64().unwrap_or(0.0) / 1e3
            );
        }
        camera.finish(PATIENCE)?;
        watcher.finish(PATIENCE)?;
        daemon.interrupt();
        daemon.finish(PATIENCE)?;
        if seen < files.len() {
            return Err(Failure::Failed(format!("only {seen} of {} observations were answered", files.len())));
        }
        say!("\n{right} of {seen} named as they were made; pictures of query and completion are in {}/", self.png.display());
        Ok(())
    }
}

/// One piece of each class, as files that the producer reads; turned, where the pose is to be found.
fn make_furniture(folder: &Path, dims: Dims, seed: u64, pose: PoseSearch) -> Result<Vec<PathBuf>, Failure> {
    let folder = folder.join("furniture");
    std::fs::create_dir_all(&folder).map_err(cannot_write(&folder))?;
    furniture::CLASSES
        .iter()
        .enumerate()
        .map(|(place, class)| {
            let path = folder.join(format!("{class}.binvox"));
            let upright = furniture::make(class, dims, seed).expect("its own class");
            let shape = Turn::new(dims, &draw_rotation(pose, seed, place)).occupancy(&upright);
            let mut bytes = Vec::new();
            write_binvox(&mut bytes, &shape)?;
            std::fs::File::create(&path).and_then(|mut file| file.write_all(&bytes)).map_err(cannot_write(&path))?;
            Ok(path)
        })
        .collect()
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
    std::thread::spawn(move || messages.lines().map_while(Result::ok).for_each(|line| eprintln!("{line}")));
    Ok(())
}
