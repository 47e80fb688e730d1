//! Which message goes where: of observations, completions, answers and the daemon's status.

use super::Clock;
use super::messages::{About, classes, completed_points, completion, frame_of, image, object, observed_points, pose_in_frame, transform};
use super::producers::Producers;
use super::topics::{EncodeError, Sink, Times, Topic};
use crate::export::{GridPlacement, surface_of};
use beo_core::grid::{Dims, Observation, from_xyzw};
use beo_ipc::{CompletionFrame, CompletionHeader, ObservationHeader, Percept, PerceptStatus, PictureHeader};
use beo_picture::png_of;
use foxglove::Encode;
use foxglove::messages::{Log, log};
use std::time::Duration;

/// An answer in the forms in which it is told.
#[derive(Clone, Copy, Debug)]
pub struct Answer<'a> {
    /// The answer itself.
    pub percept: &'a Percept,
    /// What stands at the object.
    pub label: &'a str,
    /// Classes with their probabilities, the most probable first.
    pub ranking: &'a [(&'a str, f32)],
    /// A line for the log.
    pub line: &'a str,
    /// All of it as JSON.
    pub json: &'a str,
}

/// How much was told.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Told {
    /// Observations.
    pub observations: u64,
    /// Completions.
    pub completions: u64,
    /// Percepts.
    pub percepts: u64,
}

/// Tells a sink what is perceived. Times are of CLOCK_MONOTONIC, nanoseconds, as in the messages; `now_ns` is when it was taken.
pub struct Narrator<S> {
    pub(super) sink: S,
    clock: Clock,
    /// How long what is drawn stays if it is not drawn again; without end where there is none.
    lifetime: Option<Duration>,
    producers: Producers,
    told: Told,
}

impl<S: Sink> Narrator<S> {
    /// Tells this sink, by this clock. With `lifetime`, an object that is not perceived again disappears so long after it was seen.
    pub fn new(sink: S, clock: Clock, lifetime: Option<Duration>) -> Self {
        Self { sink, clock, lifetime, producers: Producers::default(), told: Told::default() }
    }

    /// How much was told.
    pub fn told(&self) -> Told {
        self.told
    }

    /// Where it is told to.
    pub fn into_sink(self) -> S {
        self.sink
    }

    /// An observation: what was seen of it. One whose header or voxels make no sense is left out; the daemon's answer says why it refused
    /// it.
    ///
    /// # Errors
    /// The sink's.
    pub fn observation(&mut self, header: &ObservationHeader, voxels: &[u8], now_ns: u64) -> Result<(), S::Error> {
        let Some(observation) = dims_of(header.dims).and_then(|dims| Observation::from_bytes(dims, voxels).ok()) else { return Ok(()) };
        let about = self.about(header.producer_id, header.object_id, &header.frame_id, header.capture_ns);
        let placement = placement(header.position_m, header.orientation, header.voxel_size_m);
        self.seen(&about, &observation, &placement, now_ns)
    }

    fn seen(&mut self, about: &About, seen: &Observation, placement: &GridPlacement, now_ns: u64) -> Result<(), S::Error> {
        self.told.observations += 1;
        self.write(Topic::Observation, self.times(about, now_ns), || observed_points(about, seen, placement))
    }

    /// A completion: its surface. With `seen_too`, its certain voxels are told as the observation: for when the observation itself
    /// could not be read. `occupancy` and `deviation` are as in the message, × 255.
    ///
    /// # Errors
    /// The sink's.
    pub fn completion(
        &mut self,
        header: &CompletionHeader,
        occupancy: &[u8],
        deviation: &[u8],
        seen_too: bool,
        now_ns: u64,
    ) -> Result<(), S::Error> {
        let Some(dims) = dims_of(header.dims).filter(|d| occupancy.len() == d.voxels() && deviation.len() == d.voxels()) else {
            return Ok(());
        };
        self.told.completions += 1;
        let about = self.about(header.producer_id, header.object_id, &header.frame_id, header.capture_ns);
        let mut placement = placement(header.position_m, header.orientation, header.voxel_size_m);
        if header.frame == CompletionFrame::Object.code() {
            placement = placement.turned_by(&from_xyzw(header.rotation_object_to_grid.map(f64::from)));
        }
        if seen_too {
            self.seen(&about, &Observation::of_completion(dims, occupancy, deviation), &placement, now_ns)?;
        }
        if ![Topic::Completion, Topic::CompletionPoints].into_iter().any(|topic| self.sink.wants(topic)) {
            return Ok(());
        }
        let shares = |bytes: &[u8]| bytes.iter().map(|byte| f32::from(*byte) / 255.0).collect::<Vec<_>>();
        let (occupancy, deviation, times) = (shares(occupancy), shares(deviation), self.times(&about, now_ns));
        self.write(Topic::CompletionPoints, times, || completed_points(&about, dims, &occupancy, &deviation, &placement))?;
        self.write(Topic::Completion, times, || completion(&about, &surface_of(dims, &occupancy, &deviation, &placement)))
    }

    /// An answer.
    ///
    /// # Errors
    /// The sink's.
    pub fn percept(&mut self, answer: &Answer<'_>, now_ns: u64) -> Result<(), S::Error> {
        let percept = answer.percept;
        let about = self.about(percept.producer_id, percept.object_id, &percept.frame_id, percept.capture_ns);
        let times = self.times(&about, now_ns);
        let is_ok = percept.status == PerceptStatus::Ok.code();
        self.told.percepts += 1;
        self.json(Topic::Percept, times, answer.json)?;
        let level = if is_ok { log::Level::Info } else { log::Level::Warning };
        self.log(level, &about.object, answer.line, times)?;
        if !is_ok {
            return Ok(());
        }
        self.write(Topic::Object, times, || object(&about, percept, answer.label.into()))?;
        self.write(Topic::Classes, times, || classes(&about, percept, answer.ranking))?;
        if let (Some(pose), Some(transform)) = (pose_in_frame(&about, percept), transform(&about, percept)) {
            self.write(Topic::Pose, times, || pose)?;
            self.write(Topic::Transform, times, || transform)?;
        }
        Ok(())
    }

    /// A picture of a frame; one that has none, or not as many pixels as its header says, is left out.
    ///
    /// # Errors
    /// The sink's.
    pub fn picture(&mut self, header: &PictureHeader, pixels: &[u8], now_ns: u64) -> Result<(), S::Error> {
        if !self.wants_pictures() || pixels.len() != header.bytes() {
            return Ok(());
        }
        let Ok(png) = png_of(header.width, header.height, pixels) else { return Ok(()) };
        let about = self.about(header.producer_id, 0, &header.frame_id, header.capture_ns);
        self.write(Topic::Picture, self.times(&about, now_ns), || image(&about, png))
    }

    /// Whether anybody gets pictures.
    pub fn wants_pictures(&self) -> bool {
        self.sink.wants(Topic::Picture)
    }

    /// The daemon's status as JSON.
    ///
    /// # Errors
    /// The sink's.
    pub fn status(&mut self, json: &str, now_ns: u64) -> Result<(), S::Error> {
        self.json(Topic::Status, self.at(now_ns), json)
    }

    /// A line in the log about the daemon.
    ///
    /// # Errors
    /// The sink's.
    pub fn say(&mut self, line: &str, now_ns: u64) -> Result<(), S::Error> {
        self.log(log::Level::Info, "beo", line, self.at(now_ns))
    }

    fn log(&mut self, level: log::Level, name: &str, message: &str, times: Times) -> Result<(), S::Error> {
        let seconds = u32::try_from(times.logged_ns / 1_000_000_000).unwrap_or(u32::MAX);
        let timestamp = Some(foxglove::messages::Timestamp::new(seconds, (times.logged_ns % 1_000_000_000) as u32));
        let entry = || Log { timestamp, level: level.into(), message: message.into(), name: name.into(), ..Log::default() };
        self.write(Topic::Log, times, entry)
    }

    /// Encodes what the sink wants, and hands it over.
    fn write<T: Encode>(&mut self, topic: Topic, times: Times, message: impl FnOnce() -> T) -> Result<(), S::Error> {
        if !self.sink.wants(topic) {
            return Ok(());
        }
        let message = message();
        let mut bytes = Vec::with_capacity(message.encoded_len().unwrap_or(0));
        message.encode(&mut bytes).map_err(|error| EncodeError { topic, cause: error.to_string() })?;
        self.sink.write(topic, times, &bytes)
    }

    fn json(&mut self, topic: Topic, times: Times, json: &str) -> Result<(), S::Error> {
        if self.sink.wants(topic) { self.sink.write(topic, times, json.as_bytes()) } else { Ok(()) }
    }

    fn times(&self, about: &About, now_ns: u64) -> Times {
        Times { logged_ns: self.clock.day_ns(now_ns), captured_ns: self.clock.day_ns(about.capture_ns) }
    }

    fn at(&self, now_ns: u64) -> Times {
        let now = self.clock.day_ns(now_ns);
        Times { logged_ns: now, captured_ns: now }
    }

    fn about(&mut self, producer_id: u64, object_id: u64, frame_id: &[u8; 32], capture_ns: u64) -> About {
        let producer = self.producers.number(producer_id);
        About {
            object: format!("camera{producer}/object{object_id}"),
            frame: frame_of(frame_id),
            capture_ns,
            clock: self.clock,
            lifetime: self.lifetime,
        }
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
    use beo_ipc::Hypothesis;
    use foxglove::Decode;
    use foxglove::messages::{CompressedImage, PointCloud, SceneUpdate};

    /// Keeps the messages of the topics that it wants.
    struct Kept {
        wanted: Vec<Topic>,
        messages: Vec<(Topic, Vec<u8>)>,
    }

    impl Kept {
        fn narrator(wanted: &[Topic], lifetime: Option<Duration>) -> Narrator<Self> {
            Narrator::new(Self { wanted: wanted.to_vec(), messages: Vec::new() }, Clock::now(), lifetime)
        }
    }

    impl Sink for Kept {
        type Error = EncodeError;

        fn wants(&self, topic: Topic) -> bool {
            self.wanted.contains(&topic)
        }

        fn write(&mut self, topic: Topic, _: Times, bytes: &[u8]) -> Result<(), EncodeError> {
            self.messages.push((topic, bytes.to_vec()));
            Ok(())
        }
    }

    fn percept() -> Percept {
        let mut percept = Percept {
            status: PerceptStatus::Ok.code(),
            class_count: 2,
            hypothesis_count: 1,
            object_extent_m: [0.1, 0.2, 0.3],
            ..Percept::answering(&ObservationHeader::new([8; 3]))
        };
        percept.hypotheses[0] = Hypothesis { rotation_object_to_grid: [0.0, 0.0, 0.0, 1.0], probability: 1.0, class_index: 0 };
        percept
    }

    #[test]
    fn what_nobody_wants_is_not_told() {
        let percept = percept();
        let answer = Answer { percept: &percept, label: "mug", ranking: &[("mug", 1.0)], line: "a mug", json: "{}" };
        let header = CompletionHeader::answering(&ObservationHeader::new([8; 3]));
        for wanted in Topic::ALL {
            let mut narrator = Kept::narrator(&[wanted], None);
            narrator.percept(&answer, 5).unwrap();
            narrator.completion(&header, &[255; 512], &[0; 512], true, 5).unwrap();
            narrator.status("{}", 5).unwrap();
            let picture = PictureHeader { width: 2, height: 1, ..PictureHeader::default() };
            assert_eq!(narrator.wants_pictures(), wanted == Topic::Picture);
            narrator.picture(&picture, &[0, 1, 2, 253, 254, 255], 5).unwrap();
            assert_eq!(narrator.told(), Told { observations: 1, completions: 1, percepts: 1 });
            let messages = narrator.into_sink().messages;
            assert_eq!(messages.iter().map(|(topic, _)| *topic).collect::<Vec<_>>(), [wanted]);
        }
    }

    #[test]
    fn bars_are_as_long_as_classes_are_probable_and_drawings_live_as_long_as_told() {
        let percept = percept();
        let ranking = [("mug", 0.75), ("can", 0.25), ("cup", 0.001)];
        let answer = Answer { percept: &percept, label: "mug", ranking: &ranking, line: "a mug", json: "{}" };
        let mut narrator = Kept::narrator(&[Topic::Classes], Some(Duration::from_millis(2500)));
        narrator.percept(&answer, 5).unwrap();
        let update = SceneUpdate::decode(&narrator.into_sink().messages[0].1[..]).unwrap();
        let entity = &update.entities[0];
        let lifetime = entity.lifetime.unwrap();
        assert_eq!((lifetime.sec(), lifetime.nsec()), (2, 500_000_000));
        let lengths: Vec<f64> = entity.cubes.iter().map(|cube| cube.size.unwrap().y).collect();
        assert_eq!(lengths.len(), 2, "what is not probable has no bar");
        assert!((lengths[0] / lengths[1] - 3.0).abs() < 1e-6, "{lengths:?}");
        assert_eq!(entity.texts.iter().map(|text| &*text.text).collect::<Vec<_>>(), ["mug 75 %", "can 25 %"]);
        let heights: Vec<f64> = entity.cubes.iter().map(|cube| cube.pose.unwrap().position.unwrap().z).collect();
        assert!(heights[0] > heights[1], "the most probable is at the top");
    }

    #[test]
    fn a_picture_is_told_as_png_with_the_time_of_its_capture_and_what_is_none_is_left_out() {
        let mut narrator = Kept::narrator(&[Topic::Picture], None);
        let pixels = [0, 1, 2, 253, 254, 255];
        let frame_id = beo_ipc::text::to_field("wrist");
        let header = PictureHeader { width: 2, height: 1, frame_id, capture_ns: 5_000_000_000, ..PictureHeader::default() };
        narrator.picture(&header, &pixels, 6_000_000_000).unwrap();
        for (width, height) in [(0, 0), (1, 1), (3, 1), (u32::MAX, u32::MAX)] {
            narrator.picture(&PictureHeader { width, height, ..header }, &pixels, 6).unwrap();
        }
        let expected_ns = narrator.clock.day_ns(header.capture_ns);
        let messages = narrator.into_sink().messages;
        let [(Topic::Picture, bytes)] = &messages[..] else { panic!("one picture") };
        let image = CompressedImage::decode(&bytes[..]).unwrap();
        let stamp = image.timestamp.unwrap();
        assert_eq!(u64::from(stamp.sec()) * 1_000_000_000 + u64::from(stamp.nsec()), expected_ns);
        assert_eq!((&*image.frame_id, &*image.format), ("wrist", "png"));
        let mut reader = png::Decoder::new(std::io::Cursor::new(&image.data[..])).read_info().unwrap();
        let mut decoded = [0; 6];
        reader.next_frame(&mut decoded).unwrap();
        assert_eq!((reader.info().size(), decoded), ((2, 1), pixels));
    }

    #[test]
    fn a_completion_in_the_objects_frame_lies_as_the_object_does() {
        let mut narrator = Kept::narrator(&[Topic::CompletionPoints], None);
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
            narrator.completion(&header, &occupancy, &deviation, false, 5).unwrap();
        }
        let clouds = narrator.into_sink().messages;
        let turned: Vec<f64> =
            clouds.iter().map(|(_, bytes)| PointCloud::decode(&bytes[..]).unwrap().pose.unwrap().orientation.unwrap().z).collect();
        assert_eq!(turned.len(), 2);
        assert!(turned[0].abs() < 1e-6 && (turned[1] - f64::from(half)).abs() < 1e-6, "{turned:?}");
    }
}
