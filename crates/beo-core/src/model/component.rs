//! Components of a class of objects that cameras see: kinds of true size, each in its resting poses.

use crate::grid::{Rotation, from_xyzw};
use nalgebra::{Cholesky, Matrix3, Vector3};
use serde::{Deserialize, Serialize};
use std::f64::consts::TAU;

/// One part of a class's mixture: objects of one kind in one resting pose. Densities of what cameras see are learned of each.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Component {
    /// Index of the class.
    pub class: usize,
    /// P(kind, resting pose | class).
    pub probability: f64,
    /// The resting pose: takes the object's canonical axes to axes in which it rests on a horizontal plane, z up. Quaternion x, y, z, w.
    pub resting_rotation: [f64; 4],
    /// True size of the kind, if units were known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub size: Option<SizeDensity>,
}

/// Normal density of the natural logarithms of an object's three lengths, metres, along its canonical axes.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct SizeDensity {
    /// Mean.
    pub mean: [f64; 3],
    /// Covariance.
    pub covariance: [[f64; 3]; 3],
}

impl Component {
    /// All objects of a class, upright.
    pub fn upright(class: usize) -> Self {
        Self { class, probability: 1.0, resting_rotation: [0.0, 0.0, 0.0, 1.0], size: None }
    }

    /// The resting pose: object axes to axes with z up.
    pub fn rotation(&self) -> Rotation {
        from_xyzw(self.resting_rotation)
    }

    /// Whether the object stands as it does canonically.
    pub fn is_upright(&self) -> bool {
        self.rotation().angle() < 1e-6
    }
}

impl SizeDensity {
    /// Log density of the logarithms of `lengths` (metres, positive), which are known with relative standard deviations `deviations`: the
    /// density convolved with that uncertainty, log N(ln lengths; mean, covariance + diag(deviations²)).
    pub fn log_density(&self, lengths: [f64; 3], deviations: [f64; 3]) -> f64 {
        let covariance = Matrix3::from_fn(|i, j| self.covariance[i][j] + if i == j { deviations[i].powi(2) } else { 0.0 });
        let apart = Vector3::from_fn(|i, _| lengths[i].max(1e-9).ln() - self.mean[i]);
        let Some(factor) = Cholesky::new(covariance) else { return f64::NEG_INFINITY };
        let log_determinant = 2.0 * (0..3).map(|i| factor.l_dirty()[(i, i)].ln()).sum::<f64>();
        -0.5 * (3.0 * TAU.ln() + log_determinant + apart.dot(&factor.solve(&apart)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Independent lengths: three one-dimensional normal densities, in closed form.
    #[test]
    fn independent_lengths_multiply_and_uncertainty_adds_to_the_variance() {
        let (mean, variance) = ([0.1_f64.ln(), 0.05_f64.ln(), 0.2_f64.ln()], [0.04, 0.01, 0.09]);
        let covariance = std::array::from_fn(|i| std::array::from_fn(|j| if i == j { variance[i] } else { 0.0 }));
        let density = SizeDensity { mean, covariance };
        let (lengths, deviations) = ([0.13, 0.04, 0.21], [0.1, 0.0, 0.2]);
        let expected: f64 = (0..3)
            .map(|i| {
                let v: f64 = variance[i] + deviations[i] * deviations[i];
                let d: f64 = f64::ln(lengths[i]) - mean[i];
                -0.5 * ((TAU * v).ln() + d * d / v)
            })
            .sum();
        assert!((density.log_density(lengths, deviations) - expected).abs() < 1e-12);
    }

    /// Lengths that grow together: along (1, 1, 1) the deviation is wide, across it narrow. By the matrix's own eigenvalues.
    #[test]
    fn correlated_lengths_are_weighed_by_the_covariance() {
        let covariance = std::array::from_fn(|i| std::array::from_fn(|j| if i == j { 0.10 } else { 0.09 }));
        let density = SizeDensity { mean: [0.0; 3], covariance };
        // Eigenvalues 0.28 along (1, 1, 1), 0.01 twice across.
        let constant = -0.5 * (3.0 * TAU.ln() + (0.28 * 0.01 * 0.01_f64).ln());
        let along = density.log_density([0.3_f64.exp(); 3], [0.0; 3]);
        assert!((along - (constant - 0.5 * 0.27 / 0.28)).abs() < 1e-9);
        let across = density.log_density([0.3_f64.exp(), (-0.3_f64).exp(), 1.0], [0.0; 3]);
        assert!((across - (constant - 0.5 * 0.18 / 0.01)).abs() < 1e-9);
    }

    #[test]
    fn sizes_without_a_length_are_impossible_not_nan() {
        let density = SizeDensity { mean: [0.0; 3], covariance: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]] };
        assert!(density.log_density([0.0, 1.0, 1.0], [0.0; 3]) < -100.0);
    }
}
