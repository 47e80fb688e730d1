//! What a camera sees, from any elevation: class, yaw, size and place of upright objects.
//!
//! | file | what |
//! | --- | --- |
//! | `view_frame` | the frame in which views are compared |
//! | `scores` | log densities of a view for each class and step of yaw, and where the object then lies |
//! | `search` | size, place and yaw refined by the evidence, coarse to fine |

mod scores;
mod search;
mod view_frame;

pub(crate) use scores::{CameraScores, Cell, Shadow, Told, ViewWork};
pub(crate) use search::{Refined, refine, start};
pub(crate) use view_frame::{CELLS, SEEN, ShadowImage, ViewFrame};
