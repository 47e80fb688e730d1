//! The evidence of an observation: how probable its known voxels are if an object of a class lies in a given way.
//!
//! | file | content | source |
//! | --- | --- | --- |
//! | `conditional` | a class conditioned on sums over the known voxels: evidence and posterior of the coefficients | eqs. 1, 6, 15–17 |
//! | `subspace` | these sums, and posterior mean and variance of voxels | eqs. 1, 16, 17 |
//! | `lattice` | some of the voxels of a grid that stand for all | |
//! | `thinned` | the evidence from a lattice's voxels, on which searches climb | |
//! | `prediction` | posterior mean and variance of blocks of voxels | |
//! | `explained` | the share of what was seen that a class's reconstruction explains | |
//! | `placed` | the evidence of a class for an object that lies in a given way | |

pub mod conditional;
pub mod explained;
pub mod lattice;
pub mod placed;
pub mod prediction;
pub mod subspace;
pub mod thinned;
