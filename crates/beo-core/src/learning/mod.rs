//! Learning a model from complete shapes: VBPCA per class, one shared basis, class densities, calibration.
//!
//! | file | what | source |
//! | --- | --- | --- |
//! | `gram` | inner products of binary shapes, centred | n × n instead of d × d |
//! | `vbpca` | the global analytic solution of VBPCA | eqs. 1–4; Nakajima et al. 2013 |
//! | `basis` | class bases and the shared basis W', streamed over voxels | text after eq. 9 |
//! | `shrinkage` | class covariance of complete objects | eqs. 7, 8; Ledoit & Wolf, Schäfer & Strimmer |
//! | `hull_density` | class density of the visual hulls | normal-inverse-Wishart posterior |
//! | `components` | principal components of many samples | power iteration |
//! | `regressed` | Gaussians of features with a regression on them | |
//! | `render` | height maps of turned shapes | |
//! | `view_density` | densities of turned objects seen from above, by direction | principal components, Gaussians |
//! | `sizes` | true sizes of a class's shapes | mixture of Gaussians, EM |
//! | `hull`, `resting` | in which ways shapes come to rest | Goldberg et al. 1999 |
//! | `camera_views` | shapes at rest, as cameras see them | |
//! | `camera_density` | densities of what cameras see, by elevation and yaw | principal components, Gaussians |
//! | `distractors` | things of no class | |
//! | `drawing` | one of several, by weight | |
//! | `boosting`, `camera_forest` | decision trees on what views measure | Friedman 2001; Chen & Guestrin 2016 |
//! | `camera_calibration` | how sure they may be | logistic regression |
//! | `calibration` | score weights, temperature, offsets and voxel probabilities | logistic regression |
//! | `fit` | bases and classes of some of the shapes | |
//! | `shapes` | the training set | |
//! | `options`, `error`, `progress` | options of the training, its errors, its steps | |
//! | `held_out` | objects that a fold leaves out, scored; the calibration | |
//! | `train` | the driver, with internal cross-validation, and smaller grids | |
//!
//! Calibration scores held-out objects as queries are scored, so this module also uses `perception`.

mod basis;
mod boosting;
mod calibration;
mod camera_calibration;
mod camera_density;
mod camera_forest;
mod camera_views;
mod components;
mod distractors;
mod drawing;
mod error;
mod fit;
mod gram;
mod held_out;
mod hull;
mod hull_density;
mod options;
mod progress;
mod regressed;
mod render;
mod resting;
mod shapes;
mod shrinkage;
mod sizes;
mod train;
pub mod vbpca;
mod view_density;

pub use camera_views::{AtRest, ViewSample};
pub use drawing::draw_by;
pub use error::TrainError;
pub use options::{FEWEST_SHAPES, TrainOptions};
pub use progress::{Pass, Step};
pub use resting::{Stable, stable_poses};
pub use shapes::{Shape, ShapeSet};
pub use train::train;
