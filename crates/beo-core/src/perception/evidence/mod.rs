//! The evidence of an observation: how probable its known voxels are if an object of a class lies in a given way.
//!
//! | file | content | source |
//! | --- | --- | --- |
//! | `known` | an observation taken apart: hull, unknown runs, filled voxels | V_q, w_q of eq. 13 |
//! | `subspace` | a class conditioned on the known voxels: evidence, posterior mean and variance | eqs. 1, 6, 15–17 |
//! | `placed` | the evidence of a class for an object that lies in a given way | |

pub mod known;
pub mod placed;
pub mod subspace;
