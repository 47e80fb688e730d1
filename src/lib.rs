//! Bayesian Eigenobjects (Burchfiel & Konidaris, RSS 2017): class, pose and completed shape of partial voxel grids.
//!
//! Where the paper's equations live:
//!
//! | equation | what | where |
//! | --- | --- | --- |
//! | 1–4 | variational Bayesian PCA of each class | [`learning::vbpca`] |
//! | 5 | projection of an object | [`perception::ColumnSums`] |
//! | 6 | completion | [`perception::completion`], [`perception::ClassSubspace`] |
//! | 7, 8 | mean and shrunk covariance of each class | [`learning`] (`shrinkage`) |
//! | text after 9 | the shared basis W' | [`learning`] (`basis`), [`model::Basis`] |
//! | 9, 10 | class posterior and density | [`perception::blend`], [`perception::Density`] |
//! | 13–18 | projection of a partial query | [`perception`] (`paper`, `subspace`) |
//! | section IV | protocol, tables and figures | [`evaluation`] |
//!
//! Beyond the paper: class densities of visual hulls ([`learning`], `hull_density`), the evidence of the known voxels
//! ([`perception::ClassSubspace`]), and calibration on held-out objects ([`learning`], `calibration`).
//!
//! Before learning, [`alignment`] brings shapes of one kind to one pose (congealing, Learned-Miller 2006); it builds on [`grid`] and [`shapes`].
//!
//! Imports run one way: [`grid`] ← [`shapes`], [`model`] ← [`perception`] ← [`learning`] (whose calibration scores held-out
//! objects as queries are scored), [`evaluation`], [`service`] ← [`benchmark`] ← [`cli`]. [`picture`] draws what the last ones show,
//! [`export`] writes it for other programs' viewers, and [`recording`] what a daemon answers; [`linear`] wraps the factorisations, [`memory`]
//! says how much may be taken, and [`process`] starts other processes. Only [`service`], [`benchmark`], [`recording`] and the subcommands
//! know of the messages in shared memory (the crate `beo_ipc`).

pub mod alignment;
pub mod benchmark;
pub mod camera;
pub mod cli;
pub mod evaluation;
pub mod export;
pub mod grid;
pub mod learning;
pub mod linear;
pub mod memory;
pub mod model;
pub mod perception;
pub mod picture;
pub mod process;
pub mod recording;
pub mod service;
pub mod shapes;
