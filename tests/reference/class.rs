//! The model's numbers as dense matrices.

use beo_core::model::{ClassModel, Model};
use nalgebra::{Cholesky, DMatrix, DVector};
use std::f64::consts::TAU;

/// A model without any preparation but widening: d voxels, a columns of W'. Voxels are columns here, so that one is contiguous.
pub struct Reference {
    pub model: Model,
    /// W'ᵀ, a × d.
    pub basis: DMatrix<f64>,
    pub classes: Vec<Class>,
    /// σ², inflated.
    pub noise: f64,
    /// Hull densities with the covariance that all classes have in common, by which yaw is searched.
    pub common: Vec<Student>,
}

/// One class over voxels and over projected hulls.
pub struct Class {
    /// μ_s = W' ō'_s, d values.
    pub mean: DVector<f64>,
    /// B_sᵀ = D_s W'ᵀ, k × d.
    basis: DMatrix<f64>,
    /// λ, k values.
    variances: DVector<f64>,
    /// The density of its hulls seen from above.
    pub hull: Student,
}

/// A class given the known voxels.
pub struct Conditional {
    pub log_evidence: f64,
    /// Posterior mean of the coefficients, k values.
    coefficients: DVector<f64>,
    /// Their posterior covariance (Λ⁻¹ + A/σ²)⁻¹, k × k.
    covariance: DMatrix<f64>,
}

/// Student-t density up to a constant of ν and a.
pub struct Student {
    mean: DVector<f64>,
    /// L of the scale matrix L Lᵀ.
    factor: DMatrix<f64>,
    degrees_of_freedom: f64,
}

impl Reference {
    pub fn new(model: Model) -> Self {
        let (d, a) = (model.dims().voxels(), model.rank());
        let basis = DMatrix::from_iterator(a, d, model.basis.values().iter().map(|v| v.to_f64()));
        let calibration = &model.metadata.calibration;
        let nu = calibration.degrees_of_freedom;
        let mean = |s: usize| widened(a, 1, &model.classes[s].hulls[0].mean).column(0).into_owned();
        let scale = |s: usize| widened(a, a, &model.classes[s].hulls[0].covariance);
        let of_class = |(s, class): (usize, &ClassModel)| Class {
            mean: basis.tr_mul(&widened(a, 1, &class.mean)).column(0).into_owned(),
            basis: widened(a, class.variances.len(), &class.directions).transpose() * &basis,
            variances: DVector::from_column_slice(&class.variances),
            hull: Student::new(mean(s), scale(s), nu),
        };
        let classes: Vec<Class> = model.classes.iter().enumerate().map(of_class).collect();
        // S_s = (n_s C_s + n₀ C) / (n_s + n₀): weighed by n_s + n₀, their mean is C, as C is that of the C_s weighed by n_s.
        let weights: Vec<f64> = model.metadata.classes.iter().map(|c| c.shapes as f64 + calibration.prior_strength).collect();
        let common = (0..classes.len()).fold(DMatrix::zeros(a, a), |sum, s| sum + scale(s) * weights[s]) / weights.iter().sum::<f64>();
        let common = (0..classes.len()).map(|s| Student::new(mean(s), common.clone(), nu)).collect();
        let noise = model.metadata.noise_variance * calibration.noise_inflation;
        Self { basis, classes, noise, common, model }
    }
}

/// Column by column.
fn widened(rows: usize, columns: usize, values: &[f32]) -> DMatrix<f64> {
    DMatrix::from_iterator(rows, columns, values.iter().map(|v| f64::from(*v)))
}

impl Class {
    /// Conditions on `known` voxels with these values. With S = B Λ Bᵀ + σ² I over the known voxels, by the determinant lemma
    /// |S| = σ^(2d') |Λ| |Λ⁻¹ + A/σ²|, and by Woodbury's identity rᵀS⁻¹r = rᵀr/σ² − gᵀ(Λ⁻¹ + A/σ²)⁻¹g, g = Bᵀr/σ².
    pub fn condition(&self, known: &[usize], values: &DVector<f64>, noise: f64) -> Conditional {
        let basis = self.basis.select_columns(known);
        let residual = values - self.mean.select_rows(known);
        let precision = DMatrix::from_diagonal(&self.variances.map(|v| 1.0 / v)) + &basis * basis.transpose() / noise;
        let precision = Cholesky::new(precision).expect("a precision is positive definite");
        let g = basis * &residual / noise;
        let coefficients = precision.solve(&g);
        let log_determinant = known.len() as f64 * noise.ln() + self.variances.map(f64::ln).sum() + precision.ln_determinant();
        let quadratic = residual.norm_squared() / noise - g.dot(&coefficients);
        let log_evidence = -0.5 * (known.len() as f64 * TAU.ln() + log_determinant + quadratic);
        Conditional { log_evidence, coefficients, covariance: precision.inverse() }
    }

    /// Posterior mean and variance of the latent occupancy of some voxels.
    pub fn predict(&self, conditional: &Conditional, voxels: &[usize]) -> Vec<(f64, f64)> {
        let basis = self.basis.select_columns(voxels);
        let means = self.mean.select_rows(voxels) + basis.tr_mul(&conditional.coefficients);
        let spread = &conditional.covariance * &basis;
        let variances = basis.column_iter().zip(spread.column_iter()).map(|(row, spread)| row.dot(&spread));
        means.iter().copied().zip(variances).collect()
    }
}

impl Student {
    fn new(mean: DVector<f64>, scale: DMatrix<f64>, degrees_of_freedom: f64) -> Self {
        Self { mean, factor: Cholesky::new(scale).expect("a scale matrix is positive definite").unpack(), degrees_of_freedom }
    }

    /// The log density of each column of `points` (a × n).
    pub fn log_densities(&self, points: &DMatrix<f64>) -> Vec<f64> {
        let mut centred = points.clone();
        centred.column_iter_mut().for_each(|mut z| z -= &self.mean);
        assert!(self.factor.solve_lower_triangular_mut(&mut centred), "no pivot is zero");
        let (nu, a) = (self.degrees_of_freedom, self.mean.len() as f64);
        let half_log_determinant = self.factor.diagonal().map(f64::ln).sum();
        let distances2 = centred.column_iter().map(|z| z.norm_squared());
        distances2.map(|distance2| -half_log_determinant - 0.5 * (nu + a) * (1.0 + distance2 / nu).ln()).collect()
    }
}
