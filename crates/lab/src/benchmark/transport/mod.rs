//! Handing grids from one process to another: by our channels, by plain iceoryx2, through a Unix-domain socket and through a pipe.
//!
//! | file | what |
//! | --- | --- |
//! | `plan` | what is handed over, how, how often, in which order; both processes follow it |
//! | `ends` | what a sending and a receiving end do, and what the reader does with a grid |
//! | `ours`, `raw`, `stream` | the ends of our channels, of plain iceoryx2, of socket and pipe |
//! | `sender`, `receiver` | the two processes |
//! | `report` | medians, ratios, text and chart |
//!
//! A hand-over begins before the sender asks for memory and ends when the reader has done its part. Both clocks are
//! CLOCK_MONOTONIC. The next one begins when the reader has said that it is done and has had time to fall asleep, so that
//! nothing ever waits in a queue.

mod ends;
mod ours;
mod plan;
mod raw;
mod receiver;
mod report;
mod sender;
mod stream;

pub use ends::TransportError;
pub use plan::{Exchange, Plan, ReaderPlan, Step, Wake, Way, Work};
pub use receiver::receive;
pub use report::{Cell, Report};
pub use sender::measure;
