//! Gaussians, the posterior over classes, and sums of probabilities in log space.
//!
//! A Gaussian is kept by its square-root information L⁻¹ (Σ = L Lᵀ): it whitens, L⁻¹ (z − μ); the squared norm of that is the squared
//! Mahalanobis distance, and −Σ log diag(L⁻¹) half of the log determinant. Two machines store it: `whitening` for a few large ones, `packed` for
//! many small ones that are read from the model file.
//!
//! | file | content | source |
//! | --- | --- | --- |
//! | `gaussian` | Gaussian and Student-t density of a class, and of classes with a common covariance | eqs. 9, 10 |
//! | `whitening` | square-root information in 16 bits, by blocks of rows | |
//! | `packed` | square-root information as a packed lower triangle | |
//! | `blend` | weights × scores + offset + log prior, normalised | eq. 9 |
//! | `log_sum` | log Σ exp | |

pub mod blend;
pub mod gaussian;
pub mod log_sum;
pub mod packed;
pub mod whitening;
