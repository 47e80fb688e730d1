//! `beo watch`: prints what the daemon perceives.

use super::failure::{Failure, cannot_write};
use super::observe::{first_status, seconds};
use super::perceive::describe_pose;
use super::stop;
use crate::grid::{Dims, Observation, Rotation, from_xyzw};
use crate::picture::{draw_completion, draw_observation, draw_poses, sheet};
use beo_ipc::clock::monotonic_ns;
use beo_ipc::text::from_field;
use beo_ipc::{Completion, Hypothesis, InstanceName, Percept, PerceptStatus, Status, Subscriber, SubscriberOptions, tasks};
use clap::Args;
use serde_json::json;
use std::collections::BTreeMap;
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

/// The completion that belongs to a percept; those of others, which came before it, are passed over.
fn completion_of(subscriber: &Subscriber, percept: &Percept) -> Result<Option<Completion>, Failure> {
    if percept.tasks & tasks::COMPLETION == 0 {
        return Ok(None);
    }
    while let Some(completion) = subscriber.take_completion()? {
        let header = completion.header();
        if (header.daemon_id, header.producer_id, header.sequence) == (percept.daemon_id, percept.producer_id, percept.sequence) {
            return Ok(Some(completion));
        }
    }
    Ok(None)
}

fn filled(completion: &Completion) -> usize {
    completion.occupancy().iter().filter(|byte| **byte >= 128).count()
}

fn class_name(status: &Status, index: u32) -> &str {
    status.class_names.get(index as usize).map_or("?", |field| from_field(field))
}

/// From the taking of the sensor data to its percept's being read here, in microseconds.
fn latency_us(percept: &Percept, read_ns: u64) -> f64 {
    read_ns.saturating_sub(percept.capture_ns) as f64 / 1e3
}

fn classes(percept: &Percept) -> usize {
    (percept.class_count as usize).min(percept.posterior.len())
}

/// A hypothesis' rotation and probability.
fn posed(h: &Hypothesis) -> (Rotation, f64) {
    (from_xyzw(h.rotation_object_to_grid.map(f64::from)), f64::from(h.probability))
}

fn hypotheses(percept: &Percept) -> &[Hypothesis] {
    &percept.hypotheses[..(percept.hypothesis_count as usize).min(percept.hypotheses.len())]
}

fn as_json(percept: &Percept, completion: &Option<Completion>, status: &Status, read_ns: u64) -> String {
    let mut line = json!({ "sequence": percept.sequence, "latency_us": latency_us(percept, read_ns) });
    if percept.status == PerceptStatus::Ok.code() {
        let posterior: BTreeMap<&str, f32> = (0..classes(percept)).map(|s| (class_name(status, s as u32), percept.posterior[s])).collect();
        line["class"] = class_name(status, percept.class_index).into();
        line["posterior"] = json!(posterior);
        let hypothesis = |h: &Hypothesis| json!({ "rotation": h.rotation_object_to_grid, "class": class_name(status, h.class_index), "probability": h.probability });
        line["hypotheses"] = hypotheses(percept).iter().map(hypothesis).collect();
        line["rotation_spread_rad"] = percept.rotation_spread_rad.into();
    } else {
        line["class"] = serde_json::Value::Null;
        line["posterior"] = json!({});
        line["refused"] = from_field(&percept.explanation).into();
    }
    line["completion"] = completion.as_ref().map_or(serde_json::Value::Null, |c| json!({ "dims": c.header().dims, "filled": filled(c) }));
    line.to_string()
}

fn as_text(percept: &Percept, completion: &Option<Completion>, status: &Status, read_ns: u64) -> String {
    let latency = latency_us(percept, read_ns) / 1e3;
    if percept.status != PerceptStatus::Ok.code() {
        return format!("#{} refused: {}", percept.sequence, from_field(&percept.explanation));
    }
    let mut ranked: Vec<(&str, f32)> = (0..classes(percept)).map(|s| (class_name(status, s as u32), percept.posterior[s])).collect();
    ranked.sort_by(|a, b| b.1.total_cmp(&a.1));
    let others: Vec<String> = ranked.iter().skip(1).take(2).map(|(name, p)| format!("{name} {:.1} %", 100.0 * p)).collect();
    let completed = completion.as_ref().map_or("no completion".into(), |c| format!("{} voxels filled", filled(c)));
    let (name, p) = ranked.first().copied().unwrap_or(("?", 0.0));
    // The pose that goes with the class: most of the time the first hypothesis.
    let pose = hypotheses(percept).iter().find(|h| h.class_index == percept.class_index).map(posed);
    let pose = match pose {
        Some((rotation, _)) if rotation != Rotation::identity() || percept.rotation_spread_rad > 0.0 => {
            format!(", {}", describe_pose(&rotation, f64::from(percept.rotation_spread_rad)))
        }
        _ => String::new(),
    };
    format!("#{} {name} {:.1} % ({}){pose}, {completed}, {latency:.2} ms", percept.sequence, 100.0 * p, others.join(", "))
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
