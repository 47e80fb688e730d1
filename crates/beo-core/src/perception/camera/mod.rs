//! Views of a camera from any elevation: class, yaw, size and place of upright objects.
//!
//! | file | content |
//! | --- | --- |
//! | `view_frame` | the frame in which views are compared |
//! | `scores` | log densities of a view for each class and step of yaw, and where the object then lies |
//! | `measures` | lengths, widths and surfaces of a view, at the grid's full resolution |
//! | `expectation` | what is expected of an object that was answered in the frame before |
//! | `refinement` | size, place and yaw refined by the evidence, coarse to fine |
//! | `mode_refiner` | the same of one mode, with the voxels of lattices |
//! | `camera_search` | class, yaw, size and place by these |

pub(crate) mod camera_search;
mod expectation;
mod measures;
pub(crate) mod mode_refiner;
mod refinement;
mod scores;
mod view_frame;

pub(crate) use measures::{MEASURES, MeasureScratch, measure};
pub(crate) use refinement::{PlacementPrior, RefinedPlacement};
pub(crate) use scores::{CameraFeatures, CameraScores, Cell, KnownPlacement, Shadow, ViewWork};
pub(crate) use view_frame::{CELLS, SEEN, ShadowImage, ViewFrame};
