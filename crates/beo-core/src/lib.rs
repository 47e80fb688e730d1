//! Bayesian Eigenobjects (Burchfiel & Konidaris, RSS 2017): class, pose and completed shape of partial voxel grids.
//!
//! ```
//! use beo_core::furniture;
//! use beo_core::grid::{Dims, View};
//! use beo_core::learning::{Shape, ShapeSet, TrainOptions, train};
//! use beo_core::perception::{Perceiver, Percept, Query};
//! use std::sync::Arc;
//!
//! // Learn two classes from made-up shapes of 16 x 16 x 16 voxels, to be answered in known pose.
//! let dims = Dims::cube(16).unwrap();
//! let classes = ["chair", "sofa"];
//! let shape = |class: usize, seed: u64| {
//!     Shape { object: furniture::make(classes[class], dims, seed).unwrap(), class, file: format!("{seed}") }
//! };
//! let shapes = ShapeSet {
//!     classes: classes.map(String::from).to_vec(),
//!     shapes: (0..2).flat_map(|class| (0..12).map(move |seed| shape(class, seed))).collect(),
//!     ..ShapeSet::default()
//! };
//! let model = train(&shapes, &TrainOptions { poses: false, folds: 2, ..TrainOptions::default() }, &|_| ()).unwrap();
//!
//! // Perceive a chair that it has not seen, from above, and complete its hidden part.
//! let perceiver = Perceiver::new(Arc::new(model)).unwrap();
//! let (mut work, mut percept) = (perceiver.workspace(), Percept::default());
//! let seen = View::Top.of(&furniture::make("chair", dims, 99).unwrap());
//! perceiver.classify(&seen, &Query::default(), &mut work, &mut percept).unwrap().complete().unwrap();
//! assert_eq!(classes[percept.class], "chair");
//! assert!(percept.posterior[0] > 0.5 && percept.occupancy.len() == dims.voxels());
//! ```
//!
//! # Glossary
//!
//! | term | meaning |
//! | --- | --- |
//! | observation | a voxel grid in which each voxel is empty, filled or unknown |
//! | visual hull | the voxels that are filled or unknown: the largest object that the observation allows |
//! | shared basis W' | orthonormal basis of the span of all class bases and class means |
//! | evidence | probability density of the known voxels under a class, its shape integrated out; here relative to a background without a class |
//! | blend | weights of scores, and an offset per class, that turn scores into a calibrated posterior; fitted on objects that were held out |
//! | hypothesis | a mode of the posterior over class and pose, with its probability |
//! | similarity | rotation, scale and translation ([`grid::Similarity`]) that take the object's canonical grid to the grid that was observed |
//! | canonical grid, object frame | the grid in which the training shapes stand, z up |
//! | support plane | the plane that an object rests on; it is not part of the object |
//! | level | a smaller grid of the same space, on which poses are searched if the model's own is too large |
//!
//! Where the paper's equations live:
//!
//! | equation | subject | where |
//! | --- | --- | --- |
//! | 1–4 | variational Bayesian PCA of each class | [`learning::vbpca`] |
//! | 5 | projection of an object | [`perception::ColumnSums`] |
//! | 6 | completion | [`perception::completion`], [`perception::ClassSubspace`] |
//! | 7, 8 | mean and shrunk covariance of each class | [`learning`] (`shrinkage`) |
//! | text after 9 | the shared basis W' | [`learning`] (`basis`), [`model::Basis`] |
//! | 9, 10 | class posterior and density | [`perception`] (`densities`), [`perception::Gaussian`] |
//! | 13–18 | projection of a partial query | [`perception`] (`paper`, `evidence`) |
//!
//! Beyond the paper: class densities of visual hulls ([`learning`], `hull_density`), the evidence of the known voxels
//! ([`perception::ClassSubspace`]), and calibration on held-out objects ([`learning`], `calibration`).
//!
//! Imports run one way: [`grid`] ← [`model`] ← [`perception`] ← [`learning`], whose calibration scores held-out objects as queries are
//! scored. [`simulation`] renders what a camera sees of a complete voxel object, [`furniture`] makes up shapes for examples and tests,
//! [`linear`] wraps the factorisations, [`lanes`] compiles arithmetic for the CPU it runs on, [`memory`] says how much memory may be taken, and [`whole_file`] writes files that appear when they are
//! whole. The crate starts no process and reads no file but the model's.

pub mod furniture;
pub mod grid;
pub mod lanes;
pub mod learning;
pub mod linear;
pub mod memory;
pub mod model;
pub mod perception;
pub mod simulation;
pub mod text;
pub mod whole_file;
