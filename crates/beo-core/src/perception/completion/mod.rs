//! Completion: a probability and its deviation for every voxel (eq. 6 and the evidence's posterior mean).
//!
//! | file | content |
//! | --- | --- |
//! | `completing` | the completion of what was classified, in the frame that was asked for |
//! | `voxels` | from the posteriors of the likely classes to one probability and one deviation per voxel |

pub(crate) mod completing;
pub mod voxels;

pub use completing::{LEAST_SHARE, MOST_PARTS, OutputValue};
