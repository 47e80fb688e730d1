//! The queries once more, as plainly as the equations read: every matrix dense and in double precision, every voxel one row,
//! nothing shared with `beo_core::perception` but the model. What is rewritten for speed has to agree with it.
//!
//! | file | content |
//! | --- | --- |
//! | `class` | the model's numbers as dense matrices: densities, and each class conditioned on known voxels |
//! | `known_pose` | class posterior and completion of an observation that stands as the training shapes do |
//! | `every_degree` | class and yaw by the hull's density at every whole degree |
//! | `camera_view` | the frame of a camera's view, and the shadow of what is seen in it |
//! | `camera` | class by the densities of that view and by the evidence; size, place and yaw by a climb on all voxels |
//! | `camera_forest` | the forest's shares by the measures of a view |
//! | `observations` | what is asked: furniture from above and from other sides, voxels at random, real shapes |
//! | `agreement`, `camera_agreement` | the tests: the fast answers beside these |
//!
//! Formulas are those of `models/README.md`.

mod agreement;
mod camera;
mod camera_agreement;
mod camera_forest;
mod camera_view;
mod class;
mod every_degree;
mod known_pose;
mod observations;
