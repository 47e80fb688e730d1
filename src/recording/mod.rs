//! Recordings of observations and answers as MCAP files that Foxglove and Rerun open.
//!
//! | topic | schema | content |
//! | --- | --- | --- |
//! | `/beo/observation` | foxglove.PointCloud | the voxels that were seen to be filled |
//! | `/beo/completion` | foxglove.SceneUpdate | the surface of the completion, the more transparent the less sure |
//! | `/beo/completion_points` | foxglove.PointCloud | its filled voxels, for viewers that draw no surfaces (Rerun) |
//! | `/beo/object` | foxglove.SceneUpdate | class and probability as text, pose hypotheses as arrows, the object's box |
//! | `/beo/pose` | foxglove.PoseInFrame | the most probable pose |
//! | `/tf` | foxglove.FrameTransform | the object's frame in that of the sensor or the world |
//! | `/beo/log` | foxglove.Log | each answer as a line, refusals with their reason |
//! | `/beo/percept` | JSON | each answer as `beo watch --json` prints it |
//!
//! | file | what |
//! | --- | --- |
//! | `file` | the file: channels, messages, its end |
//! | `clock` | stamps of CLOCK_MONOTONIC as time of day |
//! | `messages` | answers as Foxglove's messages |
//! | `recorder` | which message goes where |

mod clock;
mod file;
mod messages;
mod producers;
mod recorder;

pub use clock::Clock;
pub use file::{RecordError, Recorded};
pub use recorder::{Recorder, TOPICS};
