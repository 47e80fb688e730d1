//! One observation in, one percept out. Knows nothing of processes and channels.
//!
//! `perceiver`, with `one_grid`, is the road that an observation takes through the stages; every stage is a type that hands a value to the next:
//!
//! | stage | folder or file | content |
//! | --- | --- | --- |
//! | read | `basis::known` | an observation taken apart: hull, unknown runs, filled voxels |
//! | score | `known_pose` | class scores in the pose in which an observation came |
//! | | `pose` | class and rotation jointly: about z, over SO(3) |
//! | | `levels` | the same of large grids: on smaller ones first |
//! | | `camera` | class, yaw, size and place of what a camera sees |
//! | | `paper` | the paper's estimators |
//! | | `cut` | what a part says of an object that is cut off |
//! | decide | `decision` | the most probable class, hypotheses, how the object lies |
//! | over time | `belief` | class and none of an object that is seen in several frames |
//! | complete | `completion` | probability and deviation of every voxel |
//!
//! They build on `densities` (Gaussians, blends of scores, sums in log space), `evidence` (a class conditioned on the known voxels), `basis` (W' by
//! tables or in place), `views` (densities of views from above), `search` (tools of all searches) and `kernels` (arithmetic). `prepared` is a model with what is derived from it.

pub(crate) mod basis;
mod belief;
pub(crate) mod camera;
pub mod completion;
mod cut;
mod decision;
pub(crate) mod densities;
mod error;
pub(crate) mod evidence;
pub mod kernels;
mod known_pose;
mod levels;
mod needs;
mod one_grid;
mod paper;
mod perceiver;
pub(crate) mod percept;
pub(crate) mod pool;
pub mod pose;
mod prepared;
pub(crate) mod query;
pub(crate) mod scored;
pub(crate) mod search;
mod settings;
pub(crate) mod timings;
pub(crate) mod views;

pub use basis::known::Known;
pub use basis::projection::ColumnSums;
pub use basis::reading::BasisRows;
pub use basis::shared_rows::SharedRows;
pub use basis::shared_sums::SharedSums;
pub use belief::{ClassBelief, NoneBelief};
pub use completion::{LEAST_SHARE, MOST_PARTS};
pub use densities::gaussian::Gaussian;
pub use error::PerceiveError;
pub use evidence::conditional::Conditional;
pub use evidence::subspace::ClassSubspace;

pub use needs::{derived_bytes, workspace_bytes};
pub use perceiver::{Classified, Perceiver, Workspace};
pub use percept::{Hypothesis, ObjectBox, Percept};
pub use query::{CompletionFrame, ExpectedPlacement, Method, PaperPose, PoseSearch, Projection, Query, RotationPrior, ScaleSearch};
pub use timings::Timings;
