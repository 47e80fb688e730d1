//! The few factorisations that the method needs, on faer, always on the calling thread: results do not depend on the number
//! of threads. Matrices are column-major.

use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::{cholesky, evd};
use faer::{Mat, MatRef, Par};

/// A matrix could not be factorised.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum LinearError {
    /// The eigenvalue iteration did not converge, which happens when an entry is not finite.
    #[error("the eigenvalues of a {0}×{0} matrix did not converge: does it hold infinite or missing values?")]
    NoConvergence(usize),
    /// The matrix is not positive definite.
    #[error("a {size}×{size} covariance is not positive definite (pivot {pivot})")]
    NotPositiveDefinite {
        /// Rows of the matrix.
        size: usize,
        /// First pivot that is not positive.
        pivot: usize,
    },
}

/// Eigenvalues in descending order, and the eigenvectors as columns in that order.
pub struct Eigen {
    /// n eigenvalues, descending.
    pub values: Vec<f64>,
    /// n × n, column h belongs to `values[h]`.
    pub vectors: Mat<f64>,
}

/// Eigendecomposition of a symmetric n × n matrix (its lower half is read).
///
/// The sign of each eigenvector is fixed by making its entry of largest magnitude positive.
pub fn symmetric_eigen(matrix: MatRef<'_, f64>) -> Result<Eigen, LinearError> {
    let n = matrix.nrows();
    let mut values = faer::diag::Diag::<f64>::zeros(n);
    let mut vectors = Mat::zeros(n, n);
    let scratch = evd::self_adjoint_evd_scratch::<f64>(n, evd::ComputeEigenvectors::Yes, Par::Seq, Default::default());
    let mut buffer = MemBuffer::new(scratch);
    evd::self_adjoint_evd(matrix, values.as_mut(), Some(vectors.as_mut()), Par::Seq, MemStack::new(&mut buffer), Default::default())
        .map_err(|_| LinearError::NoConvergence(n))?;
    let ascending: Vec<f64> = values.column_vector().iter().copied().collect();
    if ascending.iter().any(|v| !v.is_finite()) {
        return Err(LinearError::NoConvergence(n));
    }
    let descending = Mat::from_fn(n, n, |i, h| {
        let column = vectors.col(n - 1 - h);
        column[i]
    });
    let mut eigen = Eigen { values: ascending.into_iter().rev().collect(), vectors: descending };
    for h in 0..n {
        let column = eigen.vectors.col_as_slice_mut(h);
        let largest = column.iter().copied().fold(0.0, |best: f64, v| if v.abs() > best.abs() { v } else { best });
        if largest < 0.0 {
            column.iter_mut().for_each(|v| *v = -*v);
        }
    }
    Ok(eigen)
}

/// Replaces the lower half of a symmetric positive definite matrix by its Cholesky factor L, and clears the upper half.
pub fn cholesky(matrix: &mut Mat<f64>) -> Result<(), LinearError> {
    let n = matrix.nrows();
    let scratch = cholesky::llt::factor::cholesky_in_place_scratch::<f64>(n, Par::Seq, Default::default());
    let mut buffer = MemBuffer::new(scratch);
    cholesky::llt::factor::cholesky_in_place(matrix.as_mut(), Default::default(), Par::Seq, MemStack::new(&mut buffer), Default::default())
        .map_err(|cholesky::llt::factor::LltError::NonPositivePivot { index }| LinearError::NotPositiveDefinite {
            size: n,
            pivot: index,
        })?;
    for j in 1..n {
        matrix.col_as_slice_mut(j)[..j].fill(0.0);
    }
    Ok(())
}

/// The Cholesky factor L of a small symmetric positive definite matrix: n × n row-major, of which only the lower half is read
/// and replaced. Unlike `cholesky` it allocates nothing.
pub fn cholesky_rows(matrix: &mut [f64], n: usize) -> Result<(), LinearError> {
    for i in 0..n {
        let (above, row) = matrix.split_at_mut(i * n);
        for j in 0..i {
            row[j] = (row[j] - dot64(&above[j * n..j * n + j], &row[..j])) / above[j * n + j];
        }
        let pivot = row[i] - dot64(&row[..i], &row[..i]);
        if pivot.is_nan() || pivot <= 0.0 {
            return Err(LinearError::NotPositiveDefinite { size: n, pivot: i });
        }
        row[i] = pivot.sqrt();
    }
    Ok(())
}

/// Inner product over the shorter length, in four partial sums.
pub fn dot64(a: &[f64], b: &[f64]) -> f64 {
    let n = a.len().min(b.len());
    let ((a, a_rest), (b, b_rest)) = (a[..n].as_chunks::<4>(), b[..n].as_chunks::<4>());
    let mut sums = [0.0; 4];
    for (a, b) in a.iter().zip(b) {
        (0..4).for_each(|i| sums[i] += a[i] * b[i]);
    }
    sums.iter().sum::<f64>() + a_rest.iter().zip(b_rest).map(|(a, b)| a * b).sum::<f64>()
}

/// log |M| of M = L Lᵀ from its Cholesky factor.
pub fn log_determinant(factor: MatRef<'_, f64>) -> f64 {
    (0..factor.nrows()).map(|i| 2.0 * factor[(i, i)].ln()).sum()
}

/// Solves M x = b for M = L Lᵀ in place: `x` holds b, then the solution.
pub fn solve_cholesky(factor: &Mat<f64>, x: &mut [f64]) {
    let n = x.len();
    for i in 0..n {
        let sum: f64 = (0..i).map(|j| factor[(i, j)] * x[j]).sum();
        x[i] = (x[i] - sum) / factor[(i, i)];
    }
    for i in (0..n).rev() {
        let sum: f64 = factor.col_as_slice(i)[i + 1..].iter().zip(&x[i + 1..]).map(|(l, x)| l * x).sum();
        x[i] = (x[i] - sum) / factor[(i, i)];
    }
}

/// L⁻¹ of a lower triangular factor.
pub fn invert_lower(factor: MatRef<'_, f64>) -> Mat<f64> {
    let n = factor.nrows();
    let mut inverse = Mat::<f64>::identity(n, n);
    faer::linalg::triangular_solve::solve_lower_triangular_in_place(factor, inverse.as_mut(), Par::Seq);
    inverse
}

#[cfg(test)]
mod tests {
    use super::*;

    fn example() -> Mat<f64> {
        let rows = [[4.0, 1.0, 0.5], [1.0, 3.0, -0.25], [0.5, -0.25, 2.0]];
        Mat::from_fn(3, 3, |i, j| rows[i][j])
    }

    #[test]
    fn eigenvalues_are_those_of_numpy() {
        let eigen = symmetric_eigen(example().as_ref()).unwrap();
        // numpy.linalg.eigvalsh
        for (value, expected) in eigen.values.iter().zip([4.651_875_76, 2.689_794_47, 1.658_329_77]) {
            assert!((value - expected).abs() < 1e-7, "{value} {expected}");
        }
        let product = &example() * &eigen.vectors;
        for h in 0..3 {
            for i in 0..3 {
                assert!((product[(i, h)] - eigen.values[h] * eigen.vectors[(i, h)]).abs() < 1e-12);
            }
        }
    }

    #[test]
    fn cholesky_factor_and_its_inverse() {
        let mut factor = example();
        cholesky(&mut factor).unwrap();
        let product = &factor * factor.transpose();
        let identity = &invert_lower(factor.as_ref()) * &factor;
        for i in 0..3 {
            for j in 0..3 {
                assert!((product[(i, j)] - example()[(i, j)]).abs() < 1e-12);
                assert!((identity[(i, j)] - f64::from(u8::from(i == j))).abs() < 1e-12);
            }
        }
        // numpy.linalg.solve(A, [1, -2, 0.5])
        let mut x = [1.0, -2.0, 0.5];
        solve_cholesky(&factor, &mut x);
        for (value, expected) in x.iter().zip([0.448795180723, -0.813253012048, 0.036144578313]) {
            assert!((value - expected).abs() < 1e-9, "{x:?}");
        }
        assert!((log_determinant(factor.as_ref()) - 20.75_f64.ln()).abs() < 1e-12);
    }

    #[test]
    fn the_small_factor_is_that_of_faer() {
        for n in [0, 1, 3, 4, 9, 30] {
            let entry = |i: usize, j: usize| ((i * 7 + j * 7 + i * j) % 11) as f64 / 11.0 + if i == j { n as f64 } else { 0.0 };
            let mut expected = Mat::from_fn(n, n, entry);
            cholesky(&mut expected).unwrap();
            let mut found: Vec<f64> = (0..n * n).map(|at| if at % n <= at / n { entry(at / n, at % n) } else { f64::NAN }).collect();
            cholesky_rows(&mut found, n).unwrap();
            for i in 0..n {
                (0..=i).for_each(|j| assert!((found[i * n + j] - expected[(i, j)]).abs() < 1e-12, "{n}: ({i}, {j})"));
            }
        }
        let indefinite = LinearError::NotPositiveDefinite { size: 2, pivot: 1 };
        assert_eq!(cholesky_rows(&mut [1.0, 0.0, 2.0, 4.0], 2), Err(indefinite.clone()));
        assert_eq!(cholesky_rows(&mut [1.0, 0.0, 0.0, f64::NAN], 2), Err(indefinite));
    }

    #[test]
    fn an_indefinite_matrix_is_refused() {
        let mut matrix = example();
        matrix[(2, 2)] = -1.0;
        assert!(matches!(cholesky(&mut matrix), Err(LinearError::NotPositiveDefinite { size: 3, pivot: 2 })));
        let mut matrix = example();
        matrix[(0, 0)] = f64::NAN;
        assert!(symmetric_eigen(matrix.as_ref()).is_err());
    }
}
