//! Bayesian Eigenobjects (Burchfiel & Konidaris, RSS 2017): class, pose and completed shape of partial voxel grids.

pub mod cli;
pub mod evaluation;
pub mod grid;
pub mod learning;
pub mod linear;
pub mod model;
pub mod perception;
pub mod picture;
pub mod service;
pub mod shapes;
