//! Bayesian Eigenobjects (Burchfiel & Konidaris, RSS 2017): class, pose and completed shape of partial voxel grids.

pub mod grid;
pub mod picture;
pub mod shapes;
