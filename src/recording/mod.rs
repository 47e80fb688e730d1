//! What is perceived as messages that Foxglove, Lichtblick and Rerun draw: into an MCAP file, or live to whoever looks.
//!
//! | topic | schema | content |
//! | --- | --- | --- |
//! | `/beo/observation` | foxglove.PointCloud | the voxels that were seen to be filled |
//! | `/beo/completion` | foxglove.SceneUpdate | the surface of the completion, the more transparent the less sure |
//! | `/beo/completion_points` | foxglove.PointCloud | its filled voxels, for viewers that draw no surfaces (Rerun) |
//! | `/beo/object` | foxglove.SceneUpdate | class and probability as text, pose hypotheses as arrows, the object's box |
//! | `/beo/classes` | foxglove.SceneUpdate | the probabilities of the classes as bars above the object |
//! | `/beo/pose` | foxglove.PoseInFrame | the most probable pose |
//! | `/tf` | foxglove.FrameTransform | the object's frame in that of the sensor or the world |
//! | `/beo/log` | foxglove.Log | each answer as a line, refusals with their reason |
//! | `/beo/percept` | JSON | each answer as `beo watch --json` prints it |
//! | `/beo/status` | JSON | once a second, the daemon's health as `beo status --json` prints it |
//!
//! | file | what |
//! | --- | --- |
//! | `topics` | the topics with their schemas, and where messages go |
//! | `clock` | stamps of CLOCK_MONOTONIC as time of day |
//! | `messages` | answers as Foxglove's messages |
//! | `producers` | the numbers of producers |
//! | `narrator` | which message goes where |
//! | `file` | an MCAP file: channels, messages, its end |
//! | `recorder` | messages into that file |
//! | `live` | messages to viewers, over WebSockets |

mod clock;
mod file;
#[cfg(feature = "view")]
mod live;
mod messages;
mod narrator;
mod producers;
mod recorder;
mod topics;

pub use clock::Clock;
pub use file::RecordError;
#[cfg(feature = "view")]
pub use live::{Live, LiveError};
pub use narrator::{Answer, Narrator, Told};
pub use recorder::{Recorded, Recorder, Recording};
pub use topics::{EncodeError, Sink, Times, Topic};
