//! Answers of a daemon, read from shared memory and put into words and JSON.

use super::failure::Failure;
use super::wording::describe_pose;
use beo_core::grid::{Rotation, from_xyzw};
use beo_ipc::text::from_field;
use beo_ipc::{Completion, Hypothesis, NO_RESTING_POSE, NOT_COMPUTED, Percept, PerceptStatus, Status, Subscriber, cut, tasks};
use serde_json::json;
use std::collections::BTreeMap;

/// The completion that belongs to a percept; those of others, which came before it, are passed over.
pub fn completion_of(subscriber: &Subscriber, percept: &Percept) -> Result<Option<Completion>, Failure> {
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

/// Voxels that count as filled.
pub fn filled(completion: &Completion) -> usize {
    completion.occupancy().iter().filter(|byte| **byte >= 128).count()
}

/// The name of a class, `?` if there is none of this number.
pub fn class_name(status: &Status, index: u32) -> &str {
    status.class_names.get(index as usize).map_or("?", |field| from_field(field))
}

/// From the taking of the sensor data to its percept's being read here, in microseconds.
fn latency_us(percept: &Percept, read_ns: u64) -> f64 {
    read_ns.saturating_sub(percept.capture_ns) as f64 / 1e3
}

/// How many classes there are.
pub fn classes(percept: &Percept) -> usize {
    (percept.class_count as usize).min(percept.posterior.len())
}

/// A hypothesis' rotation and probability.
pub fn posed(h: &Hypothesis) -> (Rotation, f64) {
    (from_xyzw(h.rotation_object_to_grid.map(f64::from)), f64::from(h.probability))
}

/// The hypotheses that are used.
pub fn hypotheses(percept: &Percept) -> &[Hypothesis] {
    &percept.hypotheses[..(percept.hypothesis_count as usize).min(percept.hypotheses.len())]
}

/// One JSON object, in one line.
pub fn as_json(percept: &Percept, completion: &Option<Completion>, status: &Status, read_ns: u64) -> String {
    as_value(percept, completion, status, read_ns).to_string()
}

/// A JSON object.
pub fn as_value(percept: &Percept, completion: &Option<Completion>, status: &Status, read_ns: u64) -> serde_json::Value {
    let mut line = json!({
        "sequence": percept.sequence,
        "producer_id": percept.producer_id,
        "object_id": percept.object_id,
        "answer_number": percept.answer_number,
        "cut": cut::words(percept.cut).collect::<Vec<_>>(),
        "sensor_stamp_ns": percept.sensor_stamp_ns,
        "latency_us": latency_us(percept, read_ns),
    });
    if percept.status == PerceptStatus::Ok.code() {
        let posterior: BTreeMap<&str, f32> = (0..classes(percept)).map(|s| (class_name(status, s as u32), percept.posterior[s])).collect();
        line["class"] = class_name(status, percept.class_index).into();
        line["posterior"] = json!(posterior);
        let log_score: BTreeMap<&str, f32> = (0..classes(percept)).map(|s| (class_name(status, s as u32), percept.log_score[s])).collect();
        line["log_score"] = json!(log_score);
        line["none_probability"] = computed(percept.none_probability);
        line["fit"] = computed(percept.fit);
        line["resting_pose"] = (percept.resting_pose != NO_RESTING_POSE).then_some(percept.resting_pose).into();
        line["filtered"] = (percept.filtered != 0).into();
        let hypothesis = |h: &Hypothesis| json!({ "rotation": h.rotation_object_to_grid, "class": class_name(status, h.class_index), "probability": h.probability });
        line["hypotheses"] = hypotheses(percept).iter().map(hypothesis).collect();
        line["rotation_spread_rad"] = percept.rotation_spread_rad.into();
        line["object"] = json!({
            "frame_id": from_field(&percept.frame_id),
            "position_m": percept.object_position_m,
            "position_deviation_m": percept.object_position_deviation_m,
            "extent_m": percept.object_extent_m,
            "extent_deviation_m": percept.object_extent_deviation_m,
        });
    } else {
        line["class"] = serde_json::Value::Null;
        line["posterior"] = json!({});
        line["refused"] = from_field(&percept.explanation).into();
    }
    line["completion"] = completion.as_ref().map_or(serde_json::Value::Null, |c| json!({ "dims": c.header().dims, "filled": filled(c) }));
    line
}

/// A value that was computed, or null.
fn computed(value: f32) -> serde_json::Value {
    if value == NOT_COMPUTED { serde_json::Value::Null } else { value.into() }
}

/// The classes with their probabilities, the most probable first.
pub fn ranking<'a>(percept: &Percept, status: &'a Status) -> Vec<(&'a str, f32)> {
    let mut ranked: Vec<(&str, f32)> = (0..classes(percept)).map(|s| (class_name(status, s as u32), percept.posterior[s])).collect();
    ranked.sort_by(|a, b| b.1.total_cmp(&a.1));
    ranked
}

/// A line for people.
pub fn as_text(percept: &Percept, completion: &Option<Completion>, status: &Status, read_ns: u64) -> String {
    let latency = latency_us(percept, read_ns) / 1e3;
    if percept.status == PerceptStatus::NothingSeen.code() {
        return format!("#{} {}, {latency:.2} ms", percept.sequence, from_field(&percept.explanation));
    }
    if percept.status != PerceptStatus::Ok.code() {
        return format!("#{} refused: {}", percept.sequence, from_field(&percept.explanation));
    }
    let ranked = ranking(percept, status);
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
    let none =
        if percept.none_probability >= 0.0 { format!(", none of these {:.1} %", 100.0 * percept.none_probability) } else { String::new() };
    let cut: Vec<&str> = cut::words(percept.cut).collect();
    let cut = if cut.is_empty() { String::new() } else { format!(", cut by {}", cut.join(" and ")) };
    let others = others.join(", ");
    format!("#{} {name} {:.1} % ({others}{none}){cut}{pose}, {completed}, {latency:.2} ms", percept.sequence, 100.0 * p)
}

/// Class and probability, for where there is little room.
#[cfg(feature = "record")]
pub fn label(percept: &Percept, status: &Status) -> String {
    let p = percept.posterior.get(percept.class_index as usize).copied().unwrap_or(0.0);
    format!("{} {:.0} %", class_name(status, percept.class_index), 100.0 * p)
}
