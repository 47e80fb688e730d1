//! The topics of recordings and of the live view, and where their messages go.

use foxglove::messages::{CompressedImage, FrameTransform, Log, PointCloud, PoseInFrame, SceneUpdate};
use foxglove::{Encode, Schema};

/// A topic: its messages are of one schema.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Topic {
    /// The voxels that were seen to be filled.
    Observation,
    /// The surface of the completion.
    Completion,
    /// Class, pose hypotheses and box.
    Object,
    /// The most probable pose.
    Pose,
    /// The object's frame in that of the observation.
    Transform,
    /// Each answer as a line.
    Log,
    /// Each answer in full.
    Percept,
    /// The filled voxels of the completion.
    CompletionPoints,
    /// The probabilities of the classes as bars.
    Classes,
    /// The daemon's health and latencies.
    Status,
    /// The depth image of a frame with the objects that were found in it.
    Picture,
}

/// The JSON schema of a percept, as far as it is the same in every release.
const PERCEPT_SCHEMA: &str = r#"{"title":"beo.Percept","type":"object","properties":{"sequence":{"type":"integer"},"latency_us":{"type":"number"},"class":{"type":["string","null"]},"posterior":{"type":"object","additionalProperties":{"type":"number"}},"hypotheses":{"type":"array","items":{"type":"object","properties":{"rotation":{"type":"array","items":{"type":"number"}},"class":{"type":"string"},"probability":{"type":"number"}}}},"rotation_spread_rad":{"type":"number"},"log_score":{"type":"object","additionalProperties":{"type":"number"}},"none_probability":{"type":["number","null"]},"fit":{"type":["number","null"]},"resting_pose":{"type":["integer","null"]},"filtered":{"type":"boolean"},"cut":{"type":"array","items":{"type":"string"}},"answer_number":{"type":"integer"},"refused":{"type":"string"},"completion":{"type":["object","null"]}}}"#;

/// The same of a status.
const STATUS_SCHEMA: &str = r#"{"title":"beo.Status","type":"object","properties":{"instance":{"type":"string"},"healthy":{"type":"boolean"},"complaint":{"type":["string","null"]},"state":{"type":"string"},"uptime_s":{"type":"number"},"heartbeat_age_s":{"type":"number"},"observations":{"type":"object","properties":{"received":{"type":"integer"},"answered":{"type":"integer"},"refused":{"type":"integer"},"failed":{"type":"integer"},"dropped":{"type":"integer"},"waiting":{"type":"integer"},"overflowed":{"type":"integer"}}},"latency_us":{"type":"object","properties":{"count":{"type":"integer"},"p50":{"type":"number"},"p90":{"type":"number"},"p99":{"type":"number"},"max":{"type":"number"}}}}}"#;

impl Topic {
    /// All topics; each is at the place of its number.
    pub const ALL: [Topic; 11] = [
        Topic::Observation,
        Topic::Completion,
        Topic::Object,
        Topic::Pose,
        Topic::Transform,
        Topic::Log,
        Topic::Percept,
        Topic::CompletionPoints,
        Topic::Classes,
        Topic::Status,
        Topic::Picture,
    ];

    /// Its name.
    pub const fn name(self) -> &'static str {
        match self {
            Topic::Observation => "/beo/observation",
            Topic::Completion => "/beo/completion",
            Topic::Object => "/beo/object",
            Topic::Pose => "/beo/pose",
            Topic::Transform => "/tf",
            Topic::Log => "/beo/log",
            Topic::Percept => "/beo/percept",
            Topic::CompletionPoints => "/beo/completion_points",
            Topic::Classes => "/beo/classes",
            Topic::Status => "/beo/status",
            Topic::Picture => "/beo/picture",
        }
    }

    /// How its messages are encoded.
    pub const fn encoding(self) -> &'static str {
        match self {
            Topic::Percept | Topic::Status => "json",
            _ => "protobuf",
        }
    }

    /// The schema of its messages: Foxglove's published ones, or a JSON schema.
    pub fn schema(self) -> Option<Schema> {
        let json = |name: &str, schema: &'static str| Some(Schema::new(name, "jsonschema", schema.as_bytes()));
        match self {
            Topic::Observation | Topic::CompletionPoints => PointCloud::get_schema(),
            Topic::Completion | Topic::Object | Topic::Classes => SceneUpdate::get_schema(),
            Topic::Pose => PoseInFrame::get_schema(),
            Topic::Transform => FrameTransform::get_schema(),
            Topic::Log => Log::get_schema(),
            Topic::Picture => CompressedImage::get_schema(),
            Topic::Percept => json("beo.Percept", PERCEPT_SCHEMA),
            Topic::Status => json("beo.Status", STATUS_SCHEMA),
        }
    }
}

/// When a message was taken and when what it tells of happened, nanoseconds since 1970.
#[derive(Clone, Copy, Debug)]
pub struct Times {
    /// When it was recorded.
    pub logged_ns: u64,
    /// When the sensor data was taken.
    pub captured_ns: u64,
}

/// A message that cannot be encoded.
#[derive(Debug, thiserror::Error)]
#[error("a message of {} cannot be encoded: {cause}; please report this", topic.name())]
pub struct EncodeError {
    /// Of which topic.
    pub topic: Topic,
    /// The encoder's words.
    pub cause: String,
}

/// Where messages go: into a file, or to viewers.
pub trait Sink {
    /// Why it cannot go on.
    type Error: std::error::Error + From<EncodeError>;

    /// Whether anybody gets the messages of a topic: what nobody gets is not computed.
    fn wants(&self, topic: Topic) -> bool;

    /// Takes a message, encoded as its topic says.
    ///
    /// # Errors
    /// [`Sink::Error`].
    fn write(&mut self, topic: Topic, times: Times, bytes: &[u8]) -> Result<(), Self::Error>;
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_topic_is_at_its_place_with_a_name_and_a_schema_of_its_own_encoding() {
        for (place, topic) in Topic::ALL.into_iter().enumerate() {
            assert_eq!(topic as usize, place);
            assert_eq!(Topic::ALL.iter().filter(|other| other.name() == topic.name()).count(), 1);
            let schema = topic.schema().unwrap();
            assert_eq!(schema.encoding, if topic.encoding() == "json" { "jsonschema" } else { "protobuf" });
            if topic.encoding() == "json" {
                let parsed: serde_json::Value = serde_json::from_slice(&schema.data).unwrap();
                assert_eq!(parsed["title"], schema.name);
            }
        }
    }
}
