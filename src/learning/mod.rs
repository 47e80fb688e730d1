//! Learning a model from complete shapes: VBPCA per class, one shared basis, class densities, calibration.
//!
//! | file | what | source |
//! | --- | --- | --- |
//! | `gram` | inner products of binary shapes, centred | n × n instead of d × d |
//! | `vbpca` | the global analytic solution of VBPCA | eqs. 1–4; Nakajima et al. 2013 |
//! | `basis` | class bases and the shared basis W', streamed over voxels | text after eq. 9 |
//! | `shrinkage` | covariance estimators | eqs. 7, 8; Ledoit & Wolf, Schäfer & Strimmer |
//! | `densities` | Gaussian and Student-t class densities in W' | eqs. 7–10 |
//! | `calibration` | weights, temperature and class offsets on held-out objects | |
//! | `train` | the driver, with internal cross-validation | |

mod basis;
mod gram;
pub mod vbpca;
