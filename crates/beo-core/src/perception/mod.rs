//! One observation in, one percept out. Knows nothing of processes and channels.
//!
//! `perceiver` is the road that an observation takes through the stages; every stage is a type that hands a value to the next:
//!
//! | stage | folder or file | content |
//! | --- | --- | --- |
//! | read | `evidence::known` | an observation taken apart: hull, unknown runs, filled voxels |
//! | score | `known_pose` | class scores in the pose in which an observation came |
//! | | `pose` | class and rotation jointly: about z, over SO(3), on smaller grids first |
//! | | `camera` | class, yaw, size and place of what a camera sees |
//! | | `paper` | the paper's estimators |
//! | decide | `scored` | the most probable class, hypotheses, how the object lies |
//! | complete | `completion` | probability and deviation of every voxel |
//!
//! They build on `densities` (Gaussians, blends of scores, sums in log space), `evidence` (a class conditioned on the known voxels), `basis` (W' by
//! tables or in place) and `kernels` (arithmetic). `prepared` is a model with what is derived from it.

mod basis;
pub(crate) mod camera;
pub mod completion;
pub(crate) mod densities;
mod error;
pub(crate) mod evidence;
pub mod kernels;
mod known_pose;
mod method;
mod needs;
mod paper;
mod perceiver;
mod percept;
pub(crate) mod pool;
pub mod pose;
mod prepared;
pub(crate) mod scored;
mod settings;
pub(crate) mod timings;

pub use basis::projection::ColumnSums;
pub use basis::reading::BasisRows;
pub use basis::shared_rows::{SharedRows, SharedSums};
pub use completion::{LEAST_SHARE, MOST_PARTS};
pub use densities::gaussian::Gaussian;
pub use error::PerceiveError;
pub use evidence::known::Known;
pub use evidence::subspace::{ClassSubspace, Conditional};
pub use kernels::lanes;
pub use method::Method;
pub use needs::{derived_bytes, workspace_bytes};
pub use paper::pose::PaperPose;
pub use paper::projection::Projection;
pub use perceiver::{Classified, Perceiver, Workspace};
pub use percept::{Frame, ObjectBox, Percept, Query, ScaleSearch};
pub use pose::{Hypothesis, PoseSearch, RotationPrior};
pub use timings::Timings;
