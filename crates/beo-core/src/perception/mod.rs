//! One observation in, one percept out. Knows nothing of processes and channels.
//!
//! | file | what | source |
//! | --- | --- | --- |
//! | `known` | an observation taken apart: hull, unknown runs, filled voxels | V_q, w_q of eq. 13 |
//! | `projection` | linear projection onto W' by runs of voxels | eq. 5 |
//! | `density` | Gaussian and Student-t class densities | eqs. 9, 10 |
//! | `tiles` | Gram matrices of stacks of voxels, summed once | eq. 16 |
//! | `shared_rows` | W' read where it lies, for grids too large for tables | eqs. 5, 16, 17 |
//! | `reading` | W' with tables or in place | |
//! | `subspace` | a class conditioned on the known voxels: evidence, posterior mean and variance | eqs. 1, 6, 15–17 |
//! | `paper` | lasso and ridge projection onto W' | eqs. 13–18 |
//! | `blend` | from scores to a posterior | eq. 9 |
//! | `completion` | probability and deviation per voxel | eq. 6 |
//! | `pose` | rotations: priors, search, posterior | eqs. 11, 12, 19–21 |
//! | `camera` | what a camera sees: densities and the search for size and place | |
//! | `perceiver` | a model prepared for queries; what is asked is handed on to: | |
//! | `scoring` | class scores in the pose in which an observation stands | |
//! | `posing` | class and pose jointly | |
//! | `pyramid` | pose on smaller grids first, refined on the larger ones | |
//! | `viewing` | class, yaw, size and place of what a camera sees | |
//! | `paper_pose` | pose by the paper's estimators | eqs. 11, 12, 19–21 |
//! | `completing` | the completion, in the frame that was asked for | |
//! | `timings` | when each stage of a query was done | |

pub mod blend;
pub(crate) mod camera;
mod completing;
pub mod completion;
mod density;
mod known;
pub mod lanes;
mod large_pages;
mod method;
mod paper;
mod paper_pose;
mod perceiver;
mod percept;
pub mod pose;
mod posing;
mod prediction;
mod projection;
mod pyramid;
mod reading;
mod row_gram;
mod rows;
mod scoring;
mod shared_rows;
mod subspace;
mod tiles;
mod timings;
mod viewing;
mod whitening;

pub use completing::{LEAST_SHARE, MOST_PARTS};
pub use density::Density;
pub use known::Known;
pub use method::Method;
pub use paper::Projection;
pub use paper_pose::PaperPose;
pub use perceiver::{PerceiveError, Perceiver, Workspace};
pub use percept::{Frame, Lay, Percept, Query, ScaleSearch};
pub use pose::{Hypothesis, PoseSearch, RotationPrior};
pub use projection::ColumnSums;
pub use reading::Reading;
pub use shared_rows::{SharedRows, SharedSums};
pub use subspace::{ClassSubspace, Conditional};
pub use timings::Timings;
pub(crate) use viewing::PlacedEvidence;
