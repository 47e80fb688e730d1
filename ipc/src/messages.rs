//! The messages, exactly as they lie in shared memory: `repr(C)`, no padding, any bit pattern valid, versioned type names.
//!
//! Frames, units and time are those of the whole project: metres; quaternions are x, y, z, w; stamps are nanoseconds of CLOCK_MONOTONIC, 0
//! where a stage did not run. The lengths of arrays are written as numbers, as rustc 1.95 crashes on closures that
//! capture a struct whose array lengths are named constants of another crate.
//!
//! A field never changes its meaning or place within one version: a change makes a new version with new type names. Reserved bytes are 0.
//! A later release may give some of them a name and a meaning, if 0 then means what it means today; the layout hash does not change by
//! it, so that both releases can talk. Readers pass over reserved bytes; the daemon refuses an observation whose reserved bytes are not 0,
//! as it asks for something that this release does not know.

use iceoryx2::prelude::ZeroCopySend;

use crate::codes::{CompletionFrame, Outside, PoseSearch, ScaleSearch, Unit, View, tasks};
use crate::layout::{Scalar, layout};
use crate::limits::{EXPLANATION_LEN, MAX_CLASSES, MAX_HYPOTHESES, NAME_LEN};
use crate::quaternion::normalised;

const _: () = assert!(MAX_CLASSES == 64 && MAX_HYPOTHESES == 8 && NAME_LEN == 32 && EXPLANATION_LEN == 128);

/// The version of these messages; every message carries it.
pub const ABI_VERSION: u32 = 2;

/// A `class_index` that says that there is none.
pub const NO_CLASS: u32 = u32::MAX;

/// A `resting_pose` that says that there is none: the rotation was not searched among resting poses.
pub const NO_RESTING_POSE: u32 = u32::MAX;

/// A `none_probability` or `fit` that says that it was not computed. What was computed is never negative and never NaN.
pub const NOT_COMPUTED: f32 = -1.0;

/// Travels with every observation, before its voxels (one byte each: 0 empty, 1 filled, 255 unknown; C order `[x][y][z]`).
///
/// `producer_id`, `sequence`, `written_ns`, `dims` and the default of `capture_ns` are filled in by [`crate::Producer`].
#[derive(Debug, Clone, Copy, PartialEq, ZeroCopySend)]
#[repr(C)]
#[type_name("beo.v2.ObservationHeader")]
pub struct ObservationHeader {
    /// [`ABI_VERSION`].
    pub abi_version: u32,
    /// The prior knowledge of the rotation: a number of [`PoseSearch`].
    pub pose_search: u32,
    /// Who wrote this; unique among the producers of a machine.
    pub producer_id: u64,
    /// The producer's own name for the object: observations of one object replace each other when the daemon is busy.
    pub object_id: u64,
    /// Counted by the producer, from 1.
    pub sequence: u64,
    /// When the sensor data was taken.
    pub capture_ns: u64,
    /// The producer's own stamp, of any clock, passed through.
    pub sensor_stamp_ns: u64,
    /// When the grid was written and sent; 0 if the producer does not say.
    pub written_ns: u64,
    /// After this time the answer is of no use: an observation whose turn comes later is refused; 0 for no deadline.
    pub deadline_ns: u64,
    /// The grid's centre in the frame `frame_id`, metres.
    pub position_m: [f64; 3],
    /// Turns grid axes into axes of the frame `frame_id`: unit quaternion x, y, z, w; refused where its norm is not 1 within 0.001.
    pub orientation: [f64; 4],
    /// Edge of a voxel in the unit that `unit` says; 1 where the scale is not known (lengths then count voxels).
    pub voxel_size_m: f32,
    /// Voxels along x, y, z.
    pub dims: [u32; 3],
    /// The tasks to compute: bits of [`tasks`].
    pub tasks: u32,
    /// In which frame the completion is wanted: a number of [`CompletionFrame`].
    pub completion_frame: u32,
    /// The assumption about voxels outside the grid: a number of [`Outside`].
    pub outside: u32,
    /// Where the sensor looked from: a number of [`View`].
    pub view: u32,
    /// Name of the sensor's or the world's frame, UTF-8, padded with NUL.
    pub frame_id: [u8; 32],
    /// The `object_id` of this producer's object whose last answer narrows the pose search; read if `continues` is 1 and there is
    /// no rotation prior.
    pub continued_object_id: u64,
    /// 1 if this observation continues the stream `continued_object_id`, 0 if not.
    pub continues: u32,
    /// How sure the producer is of `rotation_prior`: κ of the density exp(κ cos θ), θ the angle from it; 0 for not at all.
    pub rotation_prior_concentration: f32,
    /// The rotation that the producer expects: turns object axes into grid axes, unit quaternion x, y, z, w; read if
    /// `rotation_prior_concentration` is not 0.
    pub rotation_prior: [f32; 4],
    /// Where the camera is, from the grid's centre along the grid's axes, metres; read if `view` is [`View::Camera`].
    pub sensor_position_m: [f32; 3],
    /// The prior knowledge of the object's size and place: a number of [`ScaleSearch`].
    pub scale_search: u32,
    /// The object's longest side, metres, where the producer knows it and `scale_search` is [`ScaleSearch::Search`]: only the place is
    /// then found; 0 where it does not.
    pub known_side_m: f32,
    /// Standard deviation of `known_side_m`, metres; 0: exact.
    pub known_side_deviation_m: f32,
    /// The unit of `voxel_size_m` and of all other lengths: a number of [`Unit`]. True sizes count only where it is [`Unit::Metres`].
    pub unit: u32,
    /// The causes that cut the object off, so that it may go on where nothing is known: bits of [`crate::cut`].
    pub cut: u32,
    /// Share of the readings in the object's mask that were left out because they are the support's, 0 to 1. No reading counts in two
    /// shares.
    pub share_support: f32,
    /// Share that was left out because it lies at an edge in depth, between two surfaces, 0 to 1.
    pub share_edge: f32,
    /// Share that was left out because it does not hang together with the object, 0 to 1.
    pub share_far: f32,
    /// Standard deviation of the surface's position along the line of sight, after readings of the same surface were combined, metres; 0
    /// where it is not said.
    pub surface_deviation_m: f32,
    /// 0.
    pub reserved: [u8; 56],
}
layout!(ObservationHeader: 320, reserved from 264 {
    abi_version @ 0, pose_search @ 4, producer_id @ 8, object_id @ 16, sequence @ 24, capture_ns @ 32, sensor_stamp_ns @ 40, written_ns @ 48,
    deadline_ns @ 56, position_m @ 64, orientation @ 88, voxel_size_m @ 120, dims @ 124, tasks @ 136, completion_frame @ 140, outside @ 144,
    view @ 148, frame_id @ 152, continued_object_id @ 184, continues @ 192, rotation_prior_concentration @ 196, rotation_prior @ 200,
    sensor_position_m @ 216, scale_search @ 228, known_side_m @ 232, known_side_deviation_m @ 236, unit @ 240, cut @ 244, share_support @ 248,
    share_edge @ 252, share_far @ 256, surface_deviation_m @ 260, reserved @ 264,
});

impl ObservationHeader {
    /// A header for a grid of `dims`: known pose, class and completion, centred at the origin, scale not known.
    pub const fn new(dims: [u32; 3]) -> Self {
        Self {
            abi_version: ABI_VERSION,
            pose_search: PoseSearch::Known.code(),
            producer_id: 0,
            object_id: 0,
            sequence: 0,
            capture_ns: 0,
            sensor_stamp_ns: 0,
            written_ns: 0,
            deadline_ns: 0,
            position_m: [0.0; 3],
            orientation: [0.0, 0.0, 0.0, 1.0],
            voxel_size_m: 1.0,
            dims,
            tasks: tasks::CLASS | tasks::COMPLETION,
            completion_frame: CompletionFrame::Grid.code(),
            outside: Outside::Empty.code(),
            view: View::Unspecified.code(),
            frame_id: [0; NAME_LEN],
            continued_object_id: 0,
            continues: 0,
            rotation_prior_concentration: 0.0,
            rotation_prior: [0.0, 0.0, 0.0, 1.0],
            sensor_position_m: [0.0; 3],
            scale_search: ScaleSearch::Known.code(),
            known_side_m: 0.0,
            known_side_deviation_m: 0.0,
            unit: Unit::Unknown.code(),
            cut: 0,
            share_support: 0.0,
            share_edge: 0.0,
            share_far: 0.0,
            surface_deviation_m: 0.0,
            reserved: [0; 56],
        }
    }
}

impl Default for ObservationHeader {
    /// [`ObservationHeader::new`] without dims: to be filled in.
    fn default() -> Self {
        Self::new([0; 3])
    }
}

/// How the object may be turned.
#[derive(Debug, Clone, Copy, PartialEq, ZeroCopySend)]
#[repr(C)]
#[type_name("beo.v2.Hypothesis")]
pub struct Hypothesis {
    /// Turns object axes into grid axes: unit quaternion x, y, z, w.
    pub rotation_object_to_grid: [f32; 4],
    /// The class that this pose belongs to.
    pub class_index: u32,
    /// Posterior probability of this class and pose.
    pub probability: f32,
}
layout!(Hypothesis: 24, reserved from 24 { rotation_object_to_grid @ 0, class_index @ 16, probability @ 20 });

impl Hypothesis {
    /// All zero: the unused entries of a percept.
    pub const ZERO: Self = Self { rotation_object_to_grid: [0.0; 4], class_index: 0, probability: 0.0 };
}

impl Scalar for Hypothesis {
    const NAME: &'static str = "Hypothesis";
}

/// The answer to one observation: class posterior, pose hypotheses, place and size, timings, status.
#[derive(Debug, Clone, Copy, PartialEq, ZeroCopySend)]
#[repr(C)]
#[type_name("beo.v2.Percept")]
pub struct Percept {
    /// [`ABI_VERSION`].
    pub abi_version: u32,
    /// A number of [`crate::PerceptStatus`]; unless it is 0 (ok), class, posterior and hypotheses are empty and
    /// `object_extent_m` is 0.
    pub status: u32,
    /// The run of the daemon that answered; changes when the daemon restarts.
    pub daemon_id: u64,
    /// The model that answered.
    pub model_id: u64,
    /// Who wrote the observation.
    pub producer_id: u64,
    /// The producer's own name for the object.
    pub object_id: u64,
    /// The observation's number, counted by its producer.
    pub sequence: u64,
    /// The daemon's number for this percept: it counts all that it sends in this run, to whomever they are of use, from 1. A reader that
    /// finds a gap has missed as many percepts.
    pub answer_number: u64,
    /// More about `status`: see [`crate::PerceptStatus`].
    pub detail: u64,
    /// When the sensor data was taken.
    pub capture_ns: u64,
    /// The producer's own stamp, passed through.
    pub sensor_stamp_ns: u64,
    /// When the producer sent the observation; 0 if it does not say.
    pub written_ns: u64,
    /// When the daemon took the observation.
    pub received_ns: u64,
    /// When the known voxels were projected; in a search, when every rotation's score was there.
    pub projected_ns: u64,
    /// When the class posterior was ready.
    pub classified_ns: u64,
    /// When the pose hypotheses were ready.
    pub posed_ns: u64,
    /// When the completion was ready.
    pub completed_ns: u64,
    /// When this percept was sent.
    pub published_ns: u64,
    /// The grid's centre in the frame `frame_id`, metres, as the observation had it.
    pub position_m: [f64; 3],
    /// Turns grid axes into axes of the frame `frame_id`: unit quaternion x, y, z, w, as the observation had it, at length 1.
    pub orientation: [f64; 4],
    /// Edge of a voxel in the unit that `unit` says, as the observation had it.
    pub voxel_size_m: f32,
    /// Voxels along x, y, z.
    pub dims: [u32; 3],
    /// Name of the sensor's or the world's frame, UTF-8, padded with NUL.
    pub frame_id: [u8; 32],
    /// How it was computed: a number of [`crate::Method`].
    pub method: u32,
    /// How many entries of `posterior` and `log_score` are used.
    pub class_count: u32,
    /// The most probable class, an index into the status' class names; [`NO_CLASS`] if there is none.
    pub class_index: u32,
    /// How many entries of `hypotheses` are used, most probable first.
    pub hypothesis_count: u32,
    /// Spread of the rotation's posterior: expected angle to the first hypothesis, radians.
    pub rotation_spread_rad: f32,
    /// The tasks that were computed: bits of [`tasks`].
    pub tasks: u32,
    /// Probability that the object is of none of the model's classes, 0 to 1; [`NOT_COMPUTED`] where the model cannot say. `posterior` is
    /// that of the classes given that it is of one of them.
    pub none_probability: f32,
    /// How well the object fits its class: the share of the seen surface, 0 to 1, that lies within a voxel of what the class makes of it. It is
    /// small for most things of no class. [`NOT_COMPUTED`] where it was not computed.
    pub fit: f32,
    /// Which of the resting poses of `class_index` the first hypothesis has, a number of the model's list; [`NO_RESTING_POSE`] if they
    /// were not searched.
    pub resting_pose: u32,
    /// 1 if earlier observations of the object count in this answer, 0 if it is this observation's alone.
    pub filtered: u32,
    /// The causes that cut the object off, as the observation had them: bits of [`crate::cut`].
    pub cut: u32,
    /// The unit of all lengths, as the observation had it: a number of [`Unit`].
    pub unit: u32,
    /// Probability of each class; unused entries are 0.
    pub posterior: [f32; 64],
    /// Log score of each class by the method, before priors and calibration, natural logarithm: only differences between the classes of
    /// one percept have a meaning. Unused entries are 0.
    pub log_score: [f32; 64],
    /// Pose hypotheses, most probable first; unused entries are 0.
    pub hypotheses: [Hypothesis; 8],
    /// Why the observation was refused, for people: UTF-8, padded with NUL.
    pub explanation: [u8; 128],
    /// The centre of the object's box (along the object's axes), in the frame `frame_id`, metres; where neither size nor place was
    /// searched, the grid's centre.
    pub object_position_m: [f64; 3],
    /// Its standard deviation along the grid's axes, metres; 0 where it was not searched.
    pub object_position_deviation_m: [f32; 3],
    /// Lengths of the object's box along the object's axes, metres; 0 where they were not estimated.
    pub object_extent_m: [f32; 3],
    /// Their standard deviation, metres.
    pub object_extent_deviation_m: [f32; 3],
    /// 0.
    pub reserved: [u8; 100],
}
layout!(Percept: 1280, reserved from 1180 {
    abi_version @ 0, status @ 4, daemon_id @ 8, model_id @ 16, producer_id @ 24, object_id @ 32, sequence @ 40, answer_number @ 48, detail @ 56,
    capture_ns @ 64, sensor_stamp_ns @ 72, written_ns @ 80, received_ns @ 88, projected_ns @ 96, classified_ns @ 104, posed_ns @ 112,
    completed_ns @ 120, published_ns @ 128, position_m @ 136, orientation @ 160, voxel_size_m @ 192, dims @ 196, frame_id @ 208, method @ 240,
    class_count @ 244, class_index @ 248, hypothesis_count @ 252, rotation_spread_rad @ 256, tasks @ 260, none_probability @ 264, fit @ 268,
    resting_pose @ 272, filtered @ 276, cut @ 280, unit @ 284, posterior @ 288, log_score @ 544, hypotheses @ 800, explanation @ 992,
    object_position_m @ 1120, object_position_deviation_m @ 1144, object_extent_m @ 1156, object_extent_deviation_m @ 1168, reserved @ 1180,
});

impl Percept {
    /// No class, nothing computed, everything else 0.
    pub const EMPTY: Self = Self {
        abi_version: ABI_VERSION,
        status: 0,
        daemon_id: 0,
        model_id: 0,
        producer_id: 0,
        object_id: 0,
        sequence: 0,
        answer_number: 0,
        detail: 0,
        capture_ns: 0,
        sensor_stamp_ns: 0,
        written_ns: 0,
        received_ns: 0,
        projected_ns: 0,
        classified_ns: 0,
        posed_ns: 0,
        completed_ns: 0,
        published_ns: 0,
        position_m: [0.0; 3],
        orientation: [0.0; 4],
        voxel_size_m: 0.0,
        dims: [0; 3],
        frame_id: [0; NAME_LEN],
        method: 0,
        class_count: 0,
        class_index: NO_CLASS,
        hypothesis_count: 0,
        rotation_spread_rad: 0.0,
        tasks: 0,
        none_probability: NOT_COMPUTED,
        fit: NOT_COMPUTED,
        resting_pose: NO_RESTING_POSE,
        filtered: 0,
        cut: 0,
        unit: Unit::Unknown.code(),
        posterior: [0.0; MAX_CLASSES],
        log_score: [0.0; MAX_CLASSES],
        hypotheses: [Hypothesis::ZERO; MAX_HYPOTHESES],
        explanation: [0; EXPLANATION_LEN],
        object_position_m: [0.0; 3],
        object_position_deviation_m: [0.0; 3],
        object_extent_m: [0.0; 3],
        object_extent_deviation_m: [0.0; 3],
        reserved: [0; 100],
    };

    /// A percept that repeats the identifiers, stamps and placement of the observation it answers; no class yet.
    pub fn answering(observation: &ObservationHeader) -> Self {
        Self {
            producer_id: observation.producer_id,
            object_id: observation.object_id,
            sequence: observation.sequence,
            capture_ns: observation.capture_ns,
            sensor_stamp_ns: observation.sensor_stamp_ns,
            written_ns: observation.written_ns,
            position_m: observation.position_m,
            orientation: normalised(observation.orientation),
            voxel_size_m: observation.voxel_size_m,
            dims: observation.dims,
            frame_id: observation.frame_id,
            cut: observation.cut,
            unit: observation.unit,
            object_position_m: observation.position_m,
            ..Self::EMPTY
        }
    }
}

/// Travels with every completion. Its payload is `2 × voxels` bytes: first the occupancy probability of every voxel, then its standard
/// deviation, each value × 255.
#[derive(Debug, Clone, Copy, PartialEq, ZeroCopySend)]
#[repr(C)]
#[type_name("beo.v2.CompletionHeader")]
pub struct CompletionHeader {
    /// [`ABI_VERSION`].
    pub abi_version: u32,
    /// The frame of the payload: a number of [`CompletionFrame`].
    pub frame: u32,
    /// The run of the daemon that answered.
    pub daemon_id: u64,
    /// The model that answered.
    pub model_id: u64,
    /// Who wrote the observation.
    pub producer_id: u64,
    /// The producer's own name for the object.
    pub object_id: u64,
    /// The observation's number, counted by its producer.
    pub sequence: u64,
    /// When the sensor data was taken.
    pub capture_ns: u64,
    /// The producer's own stamp, passed through.
    pub sensor_stamp_ns: u64,
    /// When this completion was sent.
    pub published_ns: u64,
    /// The grid's centre in the frame `frame_id`, metres, as the observation had it.
    pub position_m: [f64; 3],
    /// Turns grid axes into axes of the frame `frame_id`: unit quaternion x, y, z, w, as the observation had it, at length 1.
    pub orientation: [f64; 4],
    /// Edge of a voxel, metres.
    pub voxel_size_m: f32,
    /// Voxels of the payload along x, y, z.
    pub dims: [u32; 3],
    /// Name of the sensor's or the world's frame, UTF-8, padded with NUL.
    pub frame_id: [u8; 32],
    /// The pose that was completed: turns object axes into grid axes, unit quaternion x, y, z, w.
    pub rotation_object_to_grid: [f32; 4],
    /// The most probable class.
    pub class_index: u32,
    /// How it was computed: a number of [`crate::Method`].
    pub method: u32,
    /// Probability that the object is of none of the model's classes, as its percept says: what is predicted is then of little use.
    /// [`NOT_COMPUTED`] where the model cannot say.
    pub none_probability: f32,
    /// The causes that cut the object off, as the observation had them: bits of [`crate::cut`]. The part beyond is predicted.
    pub cut: u32,
    /// The unit of all lengths, as the observation had it: a number of [`Unit`].
    pub unit: u32,
    /// 0.
    pub reserved: [u8; 76],
}
layout!(CompletionHeader: 288, reserved from 212 {
    abi_version @ 0, frame @ 4, daemon_id @ 8, model_id @ 16, producer_id @ 24, object_id @ 32, sequence @ 40, capture_ns @ 48,
    sensor_stamp_ns @ 56, published_ns @ 64, position_m @ 72, orientation @ 96, voxel_size_m @ 128, dims @ 132, frame_id @ 144,
    rotation_object_to_grid @ 176, class_index @ 192, method @ 196, none_probability @ 200, cut @ 204, unit @ 208, reserved @ 212,
});

impl CompletionHeader {
    /// A header that repeats the identifiers, stamps, dims and placement of the observation it completes, in the grid's frame.
    pub fn answering(observation: &ObservationHeader) -> Self {
        Self {
            abi_version: ABI_VERSION,
            frame: CompletionFrame::Grid.code(),
            daemon_id: 0,
            model_id: 0,
            producer_id: observation.producer_id,
            object_id: observation.object_id,
            sequence: observation.sequence,
            capture_ns: observation.capture_ns,
            sensor_stamp_ns: observation.sensor_stamp_ns,
            published_ns: 0,
            position_m: observation.position_m,
            orientation: normalised(observation.orientation),
            voxel_size_m: observation.voxel_size_m,
            dims: observation.dims,
            frame_id: observation.frame_id,
            rotation_object_to_grid: [0.0, 0.0, 0.0, 1.0],
            class_index: NO_CLASS,
            method: 0,
            none_probability: NOT_COMPUTED,
            cut: observation.cut,
            unit: observation.unit,
            reserved: [0; 76],
        }
    }
}

impl Default for CompletionHeader {
    /// The completion of the default observation: to be filled in.
    fn default() -> Self {
        Self::answering(&ObservationHeader::default())
    }
}

/// Travels with a picture of a frame, drawn for people, before its pixels: three bytes each (red, green, blue), row by row from the top left.
#[derive(Debug, Clone, Copy, PartialEq, ZeroCopySend)]
#[repr(C)]
#[type_name("beo.v2.PictureHeader")]
pub struct PictureHeader {
    /// [`ABI_VERSION`].
    pub abi_version: u32,
    /// Pixels of a row.
    pub width: u32,
    /// Who drew it; that of the observations of the same frame.
    pub producer_id: u64,
    /// When the sensor data was taken; that of the observations of the same frame.
    pub capture_ns: u64,
    /// The producer's own stamp, passed through.
    pub sensor_stamp_ns: u64,
    /// Name of the camera's frame, UTF-8, padded with NUL.
    pub frame_id: [u8; 32],
    /// Rows.
    pub height: u32,
    /// 0.
    pub reserved: [u8; 60],
}
layout!(PictureHeader: 128, reserved from 68 {
    abi_version @ 0, width @ 4, producer_id @ 8, capture_ns @ 16, sensor_stamp_ns @ 24, frame_id @ 32, height @ 64, reserved @ 68,
});

impl PictureHeader {
    /// The bytes of its pixels; `usize::MAX` where there would be more than can be counted.
    pub fn bytes(&self) -> usize {
        3_usize.saturating_mul(self.width as usize).saturating_mul(self.height as usize)
    }
}

impl Default for PictureHeader {
    /// A picture without pixels, of nobody.
    fn default() -> Self {
        Self {
            abi_version: ABI_VERSION,
            width: 0,
            producer_id: 0,
            capture_ns: 0,
            sensor_stamp_ns: 0,
            frame_id: [0; NAME_LEN],
            height: 0,
            reserved: [0; 60],
        }
    }
}

/// The daemon's heartbeat: who it is, what model it serves, how it does.
#[derive(Debug, Clone, Copy, PartialEq, ZeroCopySend)]
#[repr(C)]
#[type_name("beo.v2.Status")]
pub struct Status {
    /// [`ABI_VERSION`].
    pub abi_version: u32,
    /// The daemon's process id.
    pub pid: u32,
    /// The run of the daemon; changes when it restarts.
    pub daemon_id: u64,
    /// The model that is served.
    pub model_id: u64,
    /// When the daemon started.
    pub started_ns: u64,
    /// When this was sent.
    pub heartbeat_ns: u64,
    /// When to expect the next: this long after `heartbeat_ns`.
    pub heartbeat_interval_ns: u64,
    /// [`Percept::answer_number`] of the last percept that the daemon sent; 0 before the first.
    pub answer_number: u64,
    /// Observations that the daemon took; the sum of the next three and of those that still wait ([`Status::waiting`]).
    pub received: u64,
    /// Observations that were answered with status ok.
    pub answered: u64,
    /// Observations that a newer one of the same stream replaced, or for which there was no room.
    pub dropped: u64,
    /// Observations that were answered with another status.
    pub refused: u64,
    /// Of the refused, those that were the daemon's own failure ([`crate::PerceptStatus::Internal`]).
    pub failed: u64,
    /// Of the refused, those in which nothing of an object was seen ([`crate::PerceptStatus::NothingSeen`]).
    pub nothing_seen: u64,
    /// Of the answered, those whose object is more probably of none of the model's classes than of one
    /// ([`Percept::none_probability`] above one half).
    pub answered_none: u64,
    /// Observations that were lost before the daemon took them, because their producer's queue was full: gaps in the numbers of the
    /// observations that it took. Not part of `received`. Those before the first and after the last that it took are not known.
    pub overflowed: u64,
    /// Percepts sent in the last minute; the latencies are theirs. Those refused on arrival do not count.
    pub latency_count: u64,
    /// Median time from taking an observation to sending its percept, in the last minute, to within 1 %; 0 if there was none.
    pub latency_p50_ns: u64,
    /// 90th percentile of the same.
    pub latency_p90_ns: u64,
    /// 99th percentile of the same.
    pub latency_p99_ns: u64,
    /// 99.9th percentile of the same.
    pub latency_p999_ns: u64,
    /// Longest of the same.
    pub latency_max_ns: u64,
    /// The model's dims.
    pub dims: [u32; 3],
    /// How many entries of `class_names` are used.
    pub class_count: u32,
    /// The state of the daemon: a number of [`crate::DaemonState`].
    pub state: u32,
    /// How often another model took the place of the one before.
    pub reloads: u32,
    /// How often that was asked for and refused: the model before goes on.
    pub reloads_refused: u32,
    /// The names of the classes: UTF-8, padded with NUL.
    pub class_names: [[u8; 32]; 64],
    /// The model's name, for people: UTF-8, padded with NUL.
    pub model_name: [u8; 64],
    /// 0.
    pub reserved: [u8; 60],
}
layout!(Status: 2368, reserved from 2308 {
    abi_version @ 0, pid @ 4, daemon_id @ 8, model_id @ 16, started_ns @ 24, heartbeat_ns @ 32, heartbeat_interval_ns @ 40,
    answer_number @ 48, received @ 56, answered @ 64, dropped @ 72, refused @ 80, failed @ 88, nothing_seen @ 96, answered_none @ 104,
    overflowed @ 112, latency_count @ 120, latency_p50_ns @ 128, latency_p90_ns @ 136, latency_p99_ns @ 144, latency_p999_ns @ 152,
    latency_max_ns @ 160, dims @ 168, class_count @ 180, state @ 184, reloads @ 188, reloads_refused @ 192, class_names @ 196,
    model_name @ 2244, reserved @ 2308,
});

impl Status {
    /// No class, everything 0.
    pub const EMPTY: Self = Self {
        abi_version: ABI_VERSION,
        pid: 0,
        daemon_id: 0,
        model_id: 0,
        started_ns: 0,
        heartbeat_ns: 0,
        heartbeat_interval_ns: 0,
        answer_number: 0,
        received: 0,
        answered: 0,
        dropped: 0,
        refused: 0,
        failed: 0,
        nothing_seen: 0,
        answered_none: 0,
        overflowed: 0,
        latency_count: 0,
        latency_p50_ns: 0,
        latency_p90_ns: 0,
        latency_p99_ns: 0,
        latency_p999_ns: 0,
        latency_max_ns: 0,
        dims: [0; 3],
        class_count: 0,
        state: 0,
        reloads: 0,
        reloads_refused: 0,
        class_names: [[0; NAME_LEN]; MAX_CLASSES],
        model_name: [0; 64],
        reserved: [0; 60],
    };

    /// Observations that were taken and not yet answered, refused or dropped.
    pub fn waiting(&self) -> u64 {
        [self.answered, self.refused, self.dropped].into_iter().fold(self.received, u64::saturating_sub)
    }

    /// The names of the classes that are used, in the order of [`Percept::posterior`].
    pub fn class_names(&self) -> impl Iterator<Item = &str> {
        self.class_names.iter().take((self.class_count as usize).min(MAX_CLASSES)).map(|name| crate::text::from_field(name))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::layout::Layout;

    #[test]
    fn the_published_layouts_have_these_hashes() {
        // A change here breaks every running peer: make a new version instead.
        let hashes = [
            ObservationHeader::LAYOUT_HASH,
            Hypothesis::LAYOUT_HASH,
            Percept::LAYOUT_HASH,
            CompletionHeader::LAYOUT_HASH,
            Status::LAYOUT_HASH,
            PictureHeader::LAYOUT_HASH,
        ];
        assert_eq!(
            hashes.map(|hash| format!("{hash:016x}")),
            ["74fdf0008c04dc9d", "fec395a92f4fab4f", "4ba7458eb99f2dd2", "67df1109af4ea55e", "fa9d4a7a2012470a", "cd197c7adeb14c58"]
        );
    }

    #[test]
    fn what_is_not_yet_accounted_for_waits() {
        let status = Status { received: 10, answered: 4, refused: 2, dropped: 1, overflowed: 99, ..Status::EMPTY };
        assert_eq!(status.waiting(), 3);
        assert_eq!(Status { answered: u64::MAX, ..status }.waiting(), 0);
    }

    #[test]
    fn a_status_with_a_lying_class_count_gives_no_more_names_than_there_are() {
        let mut status = Status::EMPTY;
        status.class_count = u32::MAX;
        status.class_names[1] = crate::text::to_field("chair");
        assert_eq!(status.class_names().count(), MAX_CLASSES);
        assert_eq!(status.class_names().nth(1), Some("chair"));
    }
}
