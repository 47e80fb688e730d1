//! Channels of the beo daemon over shared memory (iceoryx2): message layouts, service names, and the three roles.
//!
//! - [`Producer`]: the camera's end; [`Subscriber`]: the end of whoever wants to know; [`Server`]: the daemon's ends; [`ObservationReader`]:
//!   reads observations beside it, for recorders
//! - [`PictureSender`], [`PictureReader`]: pictures of frames for people, which are drawn only while somebody looks
//! - [`reconnect`]: the same two clients' ends, outliving the daemon
//! - [`relay`]: messages as bytes and stamps of another machine's clock, for relays between machines
//! - [`control`]: small calls to the daemon, each with an answer
//! - [`messages`]: what lies in shared memory; [`codes`]: the numbers in it; [`limits`]: its fixed sizes; [`layout`]: its layout as data
//!   and as a hash; [`text`]: its text fields; [`clock`]: its stamps
//! - [`validate`]: which observations are refused, and why
//! - [`names`]: instance names and service names; [`node`]: how iceoryx2 is joined; [`channel`]: limits of the services
//! - [`memory`]: is there room in shared memory; [`error`]: what can go wrong and what to do
//!
//! A process that was killed at a bad moment does not block the others: the empty segment that it may have left in /dev/shm, for which
//! iceoryx2 0.10.0 would wait for ever (private module `orphans`), is removed when a role is opened, by `maintain`, before a client connects
//! to a new peer (`peers`), and by a thread of the daemon (`sweeper`). So is what iceoryx2 forgets of the dead (`remains`, `registered`).
//!
//! All `unsafe` is in one private module, `shared`.

mod carved;
pub mod channel;
pub mod clock;
pub mod codes;
pub mod control;
pub mod error;
mod gaps;
mod identity;
mod in_use;
mod joining;
pub mod layout;
pub mod limits;
pub mod memory;
pub mod messages;
pub mod names;
pub mod node;
mod observation_reader;
mod orphans;
mod peers;
mod picture;
mod producer;
mod quaternion;
pub mod reconnect;
mod registered;
pub mod relay;
mod remains;
mod segments;
mod server;
mod shared;
mod subscriber;
mod sweeper;
pub mod text;
pub mod validate;

pub use carved::{CarvedGrid, CarvedGridError};
pub use codes::{CompletionFrame, DaemonState, Method, Outside, PerceptStatus, PoseSearch, ScaleSearch, Unit, View, cut, tasks};
pub use control::{ReloadCall, ReloadError, request_reload};
pub use error::{LoanError, OpenError, ReceiveError, ReconnectError, SendError, WaitError};
pub use gaps::Gaps;
pub use messages::{
    ABI_VERSION, CompletionHeader, Hypothesis, NO_CLASS, NO_RESTING_POSE, NOT_COMPUTED, ObservationHeader, Percept, PictureHeader, Status,
};
pub use names::{InstanceName, InstanceNameError};
pub use observation_reader::ObservationReader;
pub use picture::{Picture, PictureReader, PictureSender};
pub use producer::{Loan, Producer, Sent};
pub use reconnect::{ReconnectingProducer, ReconnectingSubscriber, Waited};
pub use server::{CompletionLoan, Observation, Server, ServerOptions};
pub use subscriber::{Completion, Subscriber, SubscriberOptions};
pub use validate::Refusal;
