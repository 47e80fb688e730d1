//! `beo watch`: prints what the daemon perceives.

use super::answers::{as_json, as_text, class_name, completion_of, hypotheses, label, posed};
use super::failure::{Failure, cannot_write};
use super::observe::{first_status, seconds};
use super::stop;
use crate::export::{GridPlacement, ply_of_points, ply_of_surface, points_of, save, surface_of};
use crate::grid::{Dims, Observation, Rotation, from_xyzw};
use crate::picture::{draw_completion, draw_observation, draw_poses, sheet};
use beo_ipc::clock::monotonic_ns;
use beo_ipc::{Completion, CompletionFrame, InstanceName, Percept, Status, Subscriber, SubscriberOptions};
use clap::Args;
use std::path::{Path, PathBuf};
use std::sync::atomic::Ordering;
use std::sync::mpsc::channel;
use std::time::{Duration, Instant};

/// Print what the daemon perceives
#[derive(Args)]
pub struct Watch {
    /// Instance of the daemon
    #[arg(long, default_value_t = InstanceName::default(), value_name = "NAME")]
    instance: InstanceName,
    /// Print one JSON object a line
    #[arg(long)]
    json: bool,
    /// End after this many percepts
    #[arg(long, value_name = "N")]
    count: Option<u64>,
    /// Draw query and completion of every percept into this folder
    #[arg(long, value_name = "DIR")]
    png: Option<PathBuf>,
    /// Seconds to wait for a daemon
    #[arg(long, default_value_t = 10.0, value_name = "SECONDS")]
    wait: f64,
}

impl Watch {
    /// Runs the command.
    pub fn run(self) -> Result<(), Failure> {
        let wait = seconds(self.wait)?;
        if let Some(folder) = &self.png {
            std::fs::create_dir_all(folder).map_err(cannot_write(folder))?;
        }
        let stop = stop::on_signal()?;
        let deadline = Instant::now() + wait;
        let subscriber = Subscriber::open_within(&self.instance, &SubscriberOptions { completion: true }, wait)?;
        let mut status = first_status(&subscriber, deadline)?;
        // Whoever starts a producer after this line misses nothing.
        eprintln!("watching `{}`", self.instance);
        let (drawings, drawn) = channel::<Drawing>();
        let artist = std::thread::spawn(move || drawn.iter().try_for_each(Drawing::draw));
        let mut shown = 0;
        let mut housekeeping = Instant::now();
        while self.count.is_none_or(|count| shown < count) && !stop.load(Ordering::Relaxed) {
            subscriber.wait(Duration::from_millis(50))?;
            while self.count.is_none_or(|count| shown < count) {
                let Some(percept) = subscriber.take_percept()? else { break };
                let read_ns = monotonic_ns();
                let completion = completion_of(&subscriber, &percept)?;
                if percept.model_id != status.model_id {
                    status = subscriber.status()?.unwrap_or(status);
                }
                let line = if self.json {
                    as_json(&percept, &completion, &status, read_ns)
                } else {
                    as_text(&percept, &completion, &status, read_ns)
                };
                say!("{line}");
                if let (Some(folder), Some(completion)) = (&self.png, &completion) {
                    let drawing = Drawing::of(folder, shown + 1, &percept, completion, &status)?;
                    if drawings.send(drawing).is_err() {
                        break; // a picture could not be written: the thread's own error is reported below
                    }
                }
                shown += 1;
            }
            if housekeeping.elapsed() > Duration::from_secs(1) {
                subscriber.maintain();
                housekeeping = Instant::now();
            }
            if artist.is_finished() {
                break;
            }
        }
        drop(drawings);
        artist.join().unwrap_or_else(|_| Err(Failure::Failed("drawing failed".into())))
    }
}

/// A picture to be drawn: drawing takes longer than a percept, so it is done in another thread.
struct Drawing {
    path: PathBuf,
    title: String,
    dims: Dims,
    occupancy: Vec<u8>,
    deviation: Vec<u8>,
    /// Hypotheses, where the pose was searched.
    poses: Vec<(Rotation, f64)>,
}

impl Drawing {
    fn of(folder: &Path, number: u64, percept: &Percept, completion: &Completion, status: &Status) -> Result<Self, Failure> {
        let [x, y, z] = completion.header().dims.map(|side| side as usize);
        let name = class_name(status, percept.class_index);
        let p = percept.posterior.get(percept.class_index as usize).copied().unwrap_or(0.0);
        Ok(Self {
            path: folder.join(format!("{number:04}-{}.png", name.replace(['/', '\\'], "_"))),
            title: format!("#{} {name} {:.1} %", percept.sequence, 100.0 * p),
            dims: Dims::new(x, y, z)?,
            occupancy: completion.occupancy().to_vec(),
            deviation: completion.deviation().to_vec(),
            poses: if percept.rotation_spread_rad > 0.0 { hypotheses(percept).iter().map(posed).collect() } else { Vec::new() },
        })
    }

    fn draw(self) -> Result<(), Failure> {
        // Observed voxels are those that are certain: 0 or 1 without deviation.
        let mut observation = Observation::unknown(self.dims);
        for (index, (occupancy, deviation)) in self.occupancy.iter().zip(&self.deviation).enumerate() {
            if *deviation == 0 && (*occupancy == 0 || *occupancy == 255) {
                observation.set(index, *occupancy == 255);
            }
        }
        let occupancy: Vec<f32> = self.occupancy.iter().map(|byte| f32::from(*byte) / 255.0).collect();
        let row = vec![
            match self.poses.is_empty() {
                true => (draw_observation(&observation, 360), "query: seen and hidden".to_string()),
                false => (draw_poses(&observation, self.poses, 360), "query, and where its front may be".to_string()),
            },
            (draw_completion(&observation, &occupancy, 360), "completion".to_string()),
        ];
        sheet(&[row], &self.title).save(&self.path).map_err(|error| Failure::Failed(error.to_string()))
    }
}
