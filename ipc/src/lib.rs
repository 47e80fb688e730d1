//! Channels of the beo daemon over shared memory (iceoryx2): message layouts, service names and limits.
//!
//! - [`messages`]: what lies in shared memory; [`codes`]: the numbers in it; [`limits`]: its fixed sizes; [`layout`]: its layout as data and as a hash;
//!   [`text`]: its text fields
//! - [`names`]: instance names and service names
//! - [`clock`]: the clock of all stamps

pub mod clock;
pub mod codes;
pub mod layout;
pub mod limits;
pub mod messages;
pub mod names;
pub mod text;

pub use codes::{CompletionFrame, Method, Outside, PerceptStatus, PoseSearch, View, tasks};
pub use messages::{ABI_VERSION, CompletionHeader, Hypothesis, NO_CLASS, ObservationHeader, Percept, Status};
pub use names::InstanceName;
