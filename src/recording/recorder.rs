//! Which message goes where.

use super::Clock;
use super::file::{Channel, McapFile, RecordError, Recorded, Times};
use super::messages::{About, completed_points, completion, frame_of, object, observed_points, pose_in_frame, transform};
use super::producers::Producers;
use crate::export::{GridPlacement, surface_of};
use beo_core::grid::{Dims, Observation, from_xyzw};
use beo_ipc::{CompletionFrame, CompletionHeader, ObservationHeader, Percept, PerceptStatus};
use foxglove::messages::{FrameTransform, Log, PointCloud, PoseInFrame, SceneUpdate, log};
use std::collections::BTreeMap;
use std::path::Path;

/// The topics of a recording.
pub const TOPICS: [&str; 8] =
    ["/beo/observation", "/beo/completion", "/beo/object", "/beo/pose", "/tf", "/beo/log", "/beo/percept", "/beo/completion_points"];

/// The JSON schema of a percept, as far as it is the same in every release.
const PERCEPT_SCHEMA: &str = r#"{"title":"beo.Percept","type":"object","properties":{"sequence":{"type":"integer"},"latency_us":{"type":"number"},"class":{"type":["string","null"]},"posterior":{"type":"object","additionalProperties":{"type":"number"}},"hypotheses":{"type":"array","items":{"type":"object","properties":{"rotation":{"type":"array","items":{"type":"number"}},"class":{"type":"string"},"probability":{"type":"number"}}}},"rotation_spread_rad":{"type":"number"},"log_score":{"type":"object","additionalProperties":{"type":"number"}},"none_probability":{"type":["number","null"]},"fit":{"type":["number","null"]},"resting_pose":{"type":["integer","null"]},"filtered":{"type":"boolean"},"cut":{"type":"array","items":{"type":"string"}},"answer_number":{"type":"integer"},"refused":{"type":"string"},"completion":{"type":["object","null"]}}}"#;

/// Writes what is perceived into an MCAP file. Times are of CLOCK_MONOTONIC, nanoseconds, as in the messages; `now_ns` is when it was taken.
pub struct Recorder {
    file: McapFile,
    clock: Clock,
    channels: [Channel; 8],
    producers: Producers,
    recorded: Recorded,
}

impl Recorder {
    /// Starts a file, which takes the place of one that is there when it is finished; `notes` go into its metadata record `beo`.
    ///
    /// # Errors
    /// [`RecordError`] if it cannot be written.
    pub fn create(path: &Path, notes: BTreeMap<String, String>) -> Result<Self, RecordError> {
        let (mut file, clock) = (McapFile::create(path)?, Clock::now());
        let channels = [
            file.channel::<PointCloud>(TOPICS[0])?,
            file.channel::<SceneUpdate>(TOPICS[1])?,
            file.channel::<SceneUpdate>(TOPICS[2])?,
            file.channel::<PoseInFrame>(TOPICS[3])?,
            file.channel::<FrameTransform>(TOPICS[4])?,
            file.channel::<Log>(TOPICS[5])?,
            file.json_channel(TOPICS[6], "beo.Percept", PERCEPT_SCHEMA)?,
            file.channel::<PointCloud>(TOPICS[7])?,
        ];
        let mut notes = notes;
        notes.insert("monotonic_to_unix_ns".into(), clock.offset_ns().to_string());
        file.note("beo", notes)?;
        Ok(Self { file, clock, channels, producers: Producers::default(), recorded: Recorded::default() })
    }

    /// Where the recording is until it is finished.
    pub fn path(&self) -> &Path {
        self.file.path()
    }

    /// An observation: what was seen of it. One whose header or voxels make no sense is left out; the daemon's answer says why it refused
    /// it.
    ///
    /// # Errors
    /// [`RecordError`].
    pub fn observation(&mut self, header: &ObservationHeader, voxels: &[u8], now_ns: u64) -> Result<(), RecordError> {
        let Some(observation) = dims_of(header.dims).and_then(|dims| Observation::from_bytes(dims, voxels).ok()) else { return Ok(()) };
        let about = self.about(header.producer_id, header.object_id, &header.frame_id, header.capture_ns);
        let placement = placement(header.position_m, header.orientation, header.voxel_size_m);
        self.seen(&about, &observation, &placement, now_ns)
    }

    fn seen(&mut self, about: &About, seen: &Observation, placement: &GridPlacement, now_ns: u64) -> Result<(), RecordError> {
        self.recorded.observations += 1;
        self.file.write(self.channels[0], self.times(about, now_ns), &observed_points(about, seen, placement))
    }

    /// A completion: its surface. With `seen_too`, its certain voxels are recorded as the observation: for when the observation itself
    /// could not be read. `occupancy` and `deviation` are as in the message, × 255.
    ///
    /// # Errors
    /// [`RecordError`].
    pub fn completion(
        &mut self,
        header: &CompletionHeader,
        occupancy: &[u8],
        deviation: &[u8],
        seen_too: bool,
        now_ns: u64,
    ) -> Result<(), RecordError> {
        let Some(dims) = dims_of(header.dims).filter(|d| occupancy.len() == d.voxels() && deviation.len() == d.voxels()) else {
            return Ok(());
        };
        let about = self.about(header.producer_id, header.object_id, &header.frame_id, header.capture_ns);
        let mut placement = placement(header.position_m, header.orientation, header.voxel_size_m);
        if header.frame == CompletionFrame::Object.code() {
            placement = placement.turned_by(&from_xyzw(header.rotation_object_to_grid.map(f64::from)));
        }
        if seen_too {
            self.seen(&about, &Observation::of_completion(dims, occupancy, deviation), &placement, now_ns)?;
        }
        let shares = |bytes: &[u8]| bytes.iter().map(|byte| f32::from(*byte) / 255.0).collect::<Vec<_>>();
        let (occupancy, deviation) = (shares(occupancy), shares(deviation));
        let (surface, times) = (surface_of(dims, &occupancy, &deviation, &placement), self.times(&about, now_ns));
        self.recorded.completions += 1;
        self.file.write(self.channels[7], times, &completed_points(&about, dims, &occupancy, &deviation, &placement))?;
        self.file.write(self.channels[1], times, &completion(&about, &surface))
    }

    /// An answer; `label` stands at the object, `line` in the log, `json` is the answer in full.
    ///
    /// # Errors
    /// [`RecordError`].
    pub fn percept(&mut self, percept: &Percept, label: String, line: String, json: &str, now_ns: u64) -> Result<(), RecordError> {
        let about = self.about(percept.producer_id, percept.object_id, &percept.frame_id, percept.capture_ns);
        let times = self.times(&about, now_ns);
        let is_ok = percept.status == PerceptStatus::Ok.code();
        self.recorded.percepts += 1;
        self.file.write_bytes(self.channels[6], times, json.as_bytes())?;
        let level = if is_ok { log::Level::Info } else { log::Level::Warning };
        self.log(level, &about.object, line, times)?;
        if !is_ok {
            return Ok(());
        }
        self.file.write(self.channels[2], times, &object(&about, percept, label))?;
        if let (Some(pose), Some(transform)) = (pose_in_frame(&about, percept), transform(&about, percept)) {
            self.file.write(self.channels[3], times, &pose)?;
            self.file.write(self.channels[4], times, &transform)?;
        }
        Ok(())
    }

    /// A line in the log about the daemon.
    ///
    /// # Errors
    /// [`RecordError`].
    pub fn say(&mut self, line: String, now_ns: u64) -> Result<(), RecordError> {
        let now = self.clock.day_ns(now_ns);
        self.log(log::Level::Info, "beo", line, Times { logged_ns: now, captured_ns: now })
    }

    fn log(&mut self, level: log::Level, name: &str, message: String, times: Times) -> Result<(), RecordError> {
        let seconds = u32::try_from(times.logged_ns / 1_000_000_000).unwrap_or(u32::MAX);
        let timestamp = Some(foxglove::messages::Timestamp::new(seconds, (times.logged_ns % 1_000_000_000) as u32));
        let entry = Log { timestamp, level: level.into(), message, name: name.into(), ..Log::default() };
        self.file.write(self.channels[5], times, &entry)
    }

    /// Hands everything to the operating system.
    ///
    /// # Errors
    /// [`RecordError`].
    pub fn flush(&mut self) -> Result<(), RecordError> {
        self.file.flush()
    }

    /// Ends the file.
    ///
    /// # Errors
    /// [`RecordError`].
    pub fn finish(mut self) -> Result<Recorded, RecordError> {
        (self.recorded.messages, self.recorded.bytes) = self.file.finish()?;
        Ok(self.recorded)
    }

    fn times(&self, about: &About, now_ns: u64) -> Times {
        Times { logged_ns: self.clock.day_ns(now_ns), captured_ns: self.clock.day_ns(about.capture_ns) }
    }

    fn about(&mut self, producer_id: u64, object_id: u64, frame_id: &[u8; 32], capture_ns: u64) -> About {
        let producer = self.producers.number(producer_id);
        About { object: format!("camera{producer}/object{object_id}"), frame: frame_of(frame_id), capture_ns, clock: self.clock }
    }
}

fn dims_of(dims: [u32; 3]) -> Option<Dims> {
    let [x, y, z] = dims.map(|side| side as usize);
    Dims::new(x, y, z).ok()
}

fn placement(position_m: [f64; 3], orientation: [f64; 4], voxel_size_m: f32) -> GridPlacement {
    GridPlacement { position_m, orientation: from_xyzw(orientation), voxel_size_m: f64::from(voxel_size_m) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use foxglove::Decode;

    /// The clouds of completions in a finished file.
    fn clouds(path: &Path) -> Vec<PointCloud> {
        let bytes = std::fs::read(path).unwrap();
        let messages = mcap::MessageStream::new(&bytes).unwrap().map(Result::unwrap);
        let of_topic = messages.filter(|message| message.channel.topic == "/beo/completion_points");
        of_topic.map(|message| PointCloud::decode(&message.data[..]).unwrap()).collect()
    }

    #[test]
    fn a_pipe_takes_a_whole_recording_and_a_device_loses_one_without_complaint() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("pipe");
        let mode = rustix::fs::Mode::RUSR | rustix::fs::Mode::WUSR;
        rustix::fs::mknodat(rustix::fs::CWD, &path, rustix::fs::FileType::Fifo, mode, 0).unwrap();
        let record = |path: &Path| {
            let mut recorder = Recorder::create(path, BTreeMap::new()).unwrap();
            for line in ["one", "two"] {
                recorder.say(line.into(), 5).unwrap();
                recorder.flush().unwrap();
            }
            recorder.finish().unwrap()
        };
        let other_end = std::thread::spawn({
            let path = path.clone();
            move || std::fs::read(path)
        });
        let recorded = record(&path);
        let bytes = other_end.join().unwrap().unwrap();
        assert_eq!((recorded.messages, recorded.bytes), (2, bytes.len() as u64));
        assert_eq!(mcap::MessageStream::new(&bytes).unwrap().map(Result::unwrap).count(), 2);
        assert!(mcap::Summary::read(&bytes).unwrap().is_some());
        assert_eq!(record(Path::new("/dev/null")), recorded);
    }

    #[test]
    fn a_completion_in_the_objects_frame_lies_as_the_object_does() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.mcap");
        let mut recorder = Recorder::create(&path, BTreeMap::new()).unwrap();
        let (mut occupancy, deviation) = (vec![0; 512], vec![0; 512]);
        occupancy[300] = 255;
        let half = std::f32::consts::FRAC_1_SQRT_2;
        for frame in [CompletionFrame::Grid, CompletionFrame::Object] {
            let header = CompletionHeader {
                frame: frame.code(),
                voxel_size_m: 0.01,
                rotation_object_to_grid: [0.0, 0.0, half, half],
                ..CompletionHeader::answering(&ObservationHeader::new([8; 3]))
            };
            recorder.completion(&header, &occupancy, &deviation, false, 5).unwrap();
        }
        recorder.finish().unwrap();
        let turned: Vec<f64> = clouds(&path).iter().map(|cloud| cloud.pose.unwrap().orientation.unwrap().z).collect();
        assert_eq!(turned.len(), 2);
        assert!(turned[0].abs() < 1e-6 && (turned[1] - f64::from(half)).abs() < 1e-6, "{turned:?}");
    }
}
