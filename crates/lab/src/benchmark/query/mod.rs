//! The compute of queries alone, without processes and channels, beside peers that do the same work.
//!
//! | file | what |
//! | --- | --- |
//! | `questions` | what is asked: observations of turned objects, and what is known of their pose |
//! | `timing` | how long answers take: warm, with cold caches, and at 30 a second |
//! | `floor` | what an answer reads and computes at least |
//! | `peers` | NumPy doing the same, and whether it answers the same |
//! | `icp` | alignment with the mean of the true class, from several starts |
//! | `report` | medians, ratios and text |

mod floor;
mod icp;
mod peers;
mod questions;
mod report;
mod timing;

pub use floor::Floor;
pub use icp::time_icp;
pub use peers::{Agreement, OwnAnswer, Peer, PeerError, PeerRun, Peers, own_answers};
pub use questions::{Object, Question, Search, furniture, questions};
pub use report::{PeerRow, Report, Row};
pub use timing::{Condition, Evictor, Task, time_answers};
