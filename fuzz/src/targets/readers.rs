//! Messages of a daemon, as readers take them: percepts, completions and statuses of a daemon that may be anything, told in words and as
//! JSON, and recorded.

use super::plain::{bytes_of, message};
use beo::cli::{StatusForm, as_json, as_text, label, ranking, status_report};
use beo::recording::{Answer, Recorder};
use beo_ipc::text::to_field;
use beo_ipc::{
    ABI_VERSION, CompletionFrame, CompletionHeader, Gaps, InstanceName, ObservationHeader, Percept, PictureHeader, Status, tasks,
};
use std::collections::BTreeMap;
use std::path::Path;

/// Voxels along each side of the seeds.
const SIDE: u32 = 8;
const NOW_NS: u64 = 5_000_000_000;

/// A recorder whose file nobody keeps.
fn recorder() -> Recorder {
    Recorder::create(Path::new("/dev/null"), BTreeMap::new()).expect("a device that takes everything")
}

/// Two percepts and a status: what a reader says of them, and that the second follows the first.
pub fn percept(data: &[u8]) {
    let (first, rest) = message::<Percept>(data);
    let (second, rest) = message::<Percept>(rest);
    let (status, _) = message::<Status>(rest);
    let (mut gaps, mut recorder) = (Gaps::default(), recorder());
    for percept in [first, second, first] {
        gaps.note(&percept);
        let (line, json) = (as_text(&percept, &None, &status, NOW_NS), as_json(&percept, &None, &status, NOW_NS));
        serde_json::from_str::<serde_json::Value>(&json).expect("JSON, whatever is in it");
        let (label, ranking) = (label(&percept, &status), ranking(&percept, &status));
        let answer = Answer { percept: &percept, label: &label, ranking: &ranking, line: &line, json: &json };
        recorder.percept(&answer, NOW_NS).expect("nothing fails on a device");
    }
    recorder.finish().expect("nothing fails on a device");
}

/// A completion's header and its payload, recorded with and without what was seen; the same payload as an observation.
pub fn completion(data: &[u8]) {
    let (header, payload) = message::<CompletionHeader>(data);
    let mut recorder = recorder();
    let halves = payload.split_at(payload.len() / 2);
    // As many as the header says, where that is little.
    let count = header.dims.iter().try_fold(1_usize, |product, side| product.checked_mul(*side as usize)).filter(|count| *count <= 4096);
    let filled =
        count.map(|count| payload.iter().copied().cycle().take(if payload.is_empty() { 0 } else { 2 * count }).collect::<Vec<_>>());
    let filled = filled.as_deref().map(|payload| payload.split_at(payload.len() / 2));
    for (occupancy, deviation) in [Some(halves), filled].into_iter().flatten() {
        for seen_too in [false, true] {
            recorder.completion(&header, occupancy, deviation, seen_too, NOW_NS).expect("nothing fails on a device");
        }
        let observed = ObservationHeader {
            position_m: header.position_m,
            orientation: header.orientation,
            voxel_size_m: header.voxel_size_m,
            frame_id: header.frame_id,
            capture_ns: header.capture_ns,
            ..ObservationHeader::new(header.dims)
        };
        recorder.observation(&observed, occupancy, NOW_NS).expect("nothing fails on a device");
    }
    recorder.finish().expect("nothing fails on a device");
}

/// A picture's header and pixels, recorded; and as many pixels as the header says, where that is little.
pub fn picture(data: &[u8]) {
    let (header, payload) = message::<PictureHeader>(data);
    let mut recorder = recorder();
    recorder.picture(&header, payload, NOW_NS).expect("nothing fails on a device");
    let bytes = header.bytes();
    if bytes <= 1 << 16 && !payload.is_empty() {
        let pixels: Vec<u8> = payload.iter().copied().cycle().take(bytes).collect();
        recorder.picture(&header, &pixels, NOW_NS).expect("nothing fails on a device");
    }
    recorder.finish().expect("nothing fails on a device");
}

/// A status, told in every form.
pub fn status(data: &[u8]) {
    let (status, _) = message::<Status>(data);
    let instance = InstanceName::default();
    for form in [StatusForm::Text, StatusForm::Json, StatusForm::Prometheus] {
        let report = status_report(&instance, &status, form, NOW_NS);
        match form {
            StatusForm::Text => assert!(!report.is_empty()),
            StatusForm::Json => drop(serde_json::from_str::<serde_json::Value>(&report).expect("JSON, whatever is in it")),
            StatusForm::Prometheus => assert!(report.lines().all(|line| line.starts_with("# ") || line.starts_with("beo_")), "{report}"),
        }
    }
}

/// Three messages in words, in JSON and in the recorder's buffers.
pub fn most_bytes_of_percept(len: usize) -> usize {
    64 * len + (4 << 20)
}

/// Points, a surface and their encodings: some hundred bytes a voxel.
pub fn most_bytes_of_completion(len: usize) -> usize {
    512 * len.max(2 * 4096) + (4 << 20)
}

/// Pixels, their PNG, and the recorder's buffers.
pub fn most_bytes_of_picture(len: usize) -> usize {
    64 * len.max(1 << 16) + (4 << 20)
}

/// A small multiple of the message.
pub fn most_bytes_of_status(len: usize) -> usize {
    64 * len + (1 << 20)
}

/// Seeds.
pub fn percept_seeds() -> Vec<Vec<u8>> {
    let answered = |answer_number| {
        let mut percept = Percept {
            daemon_id: 7,
            model_id: 3,
            producer_id: 1,
            sequence: answer_number,
            answer_number,
            tasks: tasks::CLASS | tasks::POSE | tasks::COMPLETION,
            class_count: 2,
            class_index: 1,
            hypothesis_count: 2,
            none_probability: 0.25,
            fit: 0.5,
            voxel_size_m: 0.01,
            dims: [SIDE; 3],
            object_extent_m: [0.1, 0.2, 0.3],
            frame_id: to_field("camera"),
            ..Percept::EMPTY
        };
        percept.posterior[..2].copy_from_slice(&[0.25, 0.75]);
        percept.log_score[..2].copy_from_slice(&[-2.0, -1.0]);
        for (hypothesis, probability) in percept.hypotheses.iter_mut().zip([0.7, 0.2]) {
            (hypothesis.rotation_object_to_grid, hypothesis.class_index, hypothesis.probability) = ([0.0, 0.0, 0.6, 0.8], 1, probability);
        }
        percept
    };
    let refused = |status, explanation: &str| Percept { status, explanation: to_field(explanation), ..answered(3) };
    let pairs = [
        [answered(1), answered(2)],
        [answered(u64::MAX), refused(3, "voxel 77 is 9: \u{1b}[2J")],
        [refused(10, "nothing seen"), answered(9)],
    ];
    pairs.iter().map(|pair| [bytes_of(&pair[0]), bytes_of(&pair[1]), bytes_of(&serving())].concat()).collect()
}

/// Seeds.
pub fn completion_seeds() -> Vec<Vec<u8>> {
    let count = SIDE.pow(3) as usize;
    [CompletionFrame::Grid, CompletionFrame::Object]
        .iter()
        .map(|frame| {
            let header = CompletionHeader {
                frame: frame.code(),
                voxel_size_m: 0.01,
                position_m: [0.1, -0.2, 0.3],
                rotation_object_to_grid: [0.0, 0.0, 0.6, 0.8],
                frame_id: to_field("camera"),
                ..CompletionHeader::answering(&ObservationHeader::new([SIDE; 3]))
            };
            let mut bytes = bytes_of(&header);
            bytes.extend((0..count).map(|voxel| if voxel / 64 % 8 < 4 { 255 } else { (voxel % 64) as u8 }));
            bytes.extend((0..count).map(|voxel| if voxel % 3 == 0 { 0 } else { (voxel % 128) as u8 }));
            bytes
        })
        .collect()
}

/// Seeds.
pub fn picture_seeds() -> Vec<Vec<u8>> {
    let of_size = |(width, height): (u32, u32)| {
        let header = PictureHeader { width, height, frame_id: to_field("camera"), capture_ns: 7, ..PictureHeader::default() };
        let mut bytes = bytes_of(&header);
        bytes.extend((0..header.bytes()).map(|byte| (byte % 251) as u8));
        bytes
    };
    [(1, 1), (8, 5), (64, 48)].map(of_size).into()
}

fn serving() -> Status {
    let mut status = Status {
        abi_version: ABI_VERSION,
        pid: 42,
        daemon_id: 7,
        model_id: 3,
        heartbeat_ns: 4_900_000_000,
        heartbeat_interval_ns: 250_000_000,
        received: 110,
        answered: 100,
        refused: 5,
        failed: 1,
        nothing_seen: 2,
        answered_none: 7,
        latency_count: 60,
        latency_p50_ns: 1_500_000,
        dims: [SIDE; 3],
        class_count: 2,
        reloads: 2,
        reloads_refused: 1,
        model_name: to_field("fur\"ni\\ture\n"),
        ..Status::EMPTY
    };
    (status.class_names[0], status.class_names[1]) = (to_field("bed"), to_field("ch\"air"));
    status
}

/// Seeds.
pub fn status_seeds() -> Vec<Vec<u8>> {
    vec![bytes_of(&serving()), bytes_of(&Status { state: 3, heartbeat_ns: 1, ..serving() }), bytes_of(&Status::EMPTY)]
}
