//! Bayesian Eigenobjects (Burchfiel & Konidaris, RSS 2017): class, pose and completed shape of partial voxel grids.
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
//! [`linear`] wraps the factorisations, and [`memory`] says how much memory may be taken. The crate starts no process and reads no file
//! but the model's.

pub mod furniture;
pub mod grid;
pub mod learning;
pub mod linear;
pub mod memory;
pub mod model;
pub mod perception;
pub mod simulation;
pub mod text;
