//! The evidence of an observation: how probable its known voxels are if an object of a class lies in a given way.
//!
//! | file | content | source |
//! | --- | --- | --- |
//! | `subspace` | a class conditioned on the known voxels: evidence, posterior mean and variance | eqs. 1, 6, 15–17 |
//! | `prediction` | posterior mean and variance of blocks of voxels | |
//! | `placed` | the evidence of a class for an object that lies in a given way | |

pub mod placed;
pub mod prediction;
pub mod subspace;
