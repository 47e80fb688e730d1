//! The paper's estimator: projection of the known voxels onto W' (eqs. 13–18), Gaussian class densities (eqs. 9, 10).
//!
//! Of the readings of eq. 18, the lasso of the voxel residual is solved: ½ ‖V W' o' − w‖² + λ ‖o'‖₁, that is,
//! ½ o'ᵀA o' − bᵀo' + λ ‖o'‖₁, by coordinate descent on the Gram A. With the paper's λ = 1e-5 the penalty itself does almost
//! nothing; A is so badly conditioned that what regularises is to stop when the coefficients no longer move noticeably.

use crate::linear::{LinearError, cholesky, solve_cholesky};
use crate::model::Basis;
use crate::perception::basis::known::Known;
use crate::perception::query::Projection;
use faer::linalg::matmul::triangular::{self, BlockStructure};
use faer::{Accum, Mat, MatRef, Par};

/// Coordinate descent ends when no coefficient moves by more than this share of the largest one …
const TOLERANCE: f64 = 5e-3;
/// … or after this many sweeps.
const MOST_SWEEPS: usize = 100;
/// Voxels whose products are formed at once.
const BLOCK: usize = 1024;

/// W'ᵀW' over all voxels, lower half: the identity, but for the rounding of W' to half precision.
pub fn full_gram(basis: &Basis) -> Mat<f64> {
    let everything: Vec<(usize, usize)> =
        (0..basis.voxels()).step_by(BLOCK).map(|start| (start, (start + BLOCK).min(basis.voxels()))).collect();
    gram_over(basis, &everything)
}

/// Σ w wᵀ over runs of at most `BLOCK` voxels, lower half; single precision inside a block, double between blocks.
fn gram_over(basis: &Basis, runs: &[(usize, usize)]) -> Mat<f64> {
    let a = basis.rank();
    let (mut sum, mut part) = (Mat::<f64>::zeros(a, a), Mat::<f32>::zeros(a, a));
    let mut rows = vec![0.0_f32; BLOCK * a];
    let mut held = 0;
    let mut flush = |rows: &[f32]| {
        let rows = MatRef::from_column_major_slice(rows, a, rows.len() / a);
        let (full, lower) = (BlockStructure::Rectangular, BlockStructure::TriangularLower);
        triangular::matmul(part.as_mut(), lower, Accum::Replace, rows, full, rows.transpose(), full, 1.0, Par::Seq);
        for j in 0..a {
            (j..a).for_each(|i| sum[(i, j)] += f64::from(part[(i, j)]));
        }
    };
    for &(start, end) in runs {
        if held + (end - start) > BLOCK {
            flush(&rows[..held * a]);
            held = 0;
        }
        basis.widen(start..end, &mut rows[held * a..(held + end - start) * a]);
        held += end - start;
    }
    if held > 0 {
        flush(&rows[..held * a]);
    }
    sum
}

/// A = W'ᵀVᵀV W' (eq. 16), lower half, and b = W'ᵀVᵀw (eq. 17). `full` is [`full_gram`], from which the unknown voxels are
/// taken away: with the identity instead, the rounding of W' shows in the ill-conditioned directions of A.
pub fn normal_equations(basis: &Basis, full: &Mat<f64>, known: &Known) -> (Mat<f64>, Vec<f64>) {
    let a = basis.rank();
    let gram = full - gram_over(basis, &known.unknown);
    let mut b = vec![0.0; a];
    let mut row = vec![0.0_f32; a];
    for &voxel in &known.filled {
        basis.widen(voxel..voxel + 1, &mut row);
        b.iter_mut().zip(&row).for_each(|(sum, v)| *sum += f64::from(*v));
    }
    (gram, b)
}

/// Solves for the coefficients o' (a values); `gram` holds its lower half.
pub fn solve(gram: &Mat<f64>, b: &[f64], projection: Projection) -> Result<Vec<f64>, LinearError> {
    match projection {
        Projection::Lasso(lambda) => Ok(lasso(gram, b, lambda, TOLERANCE, MOST_SWEEPS)),
        Projection::Ridge(strength) => ridge(gram, b, strength),
    }
}

fn ridge(gram: &Mat<f64>, b: &[f64], strength: f64) -> Result<Vec<f64>, LinearError> {
    let n = b.len();
    let mut factor = gram.clone();
    (0..n).for_each(|i| factor[(i, i)] += strength);
    cholesky(&mut factor)?;
    let mut x = b.to_vec();
    solve_cholesky(&factor, &mut x);
    Ok(x)
}

/// Cyclic coordinate descent on ½ xᵀG x − bᵀx + λ‖x‖₁ from zero.
fn lasso(gram: &Mat<f64>, b: &[f64], lambda: f64, tolerance: f64, most_sweeps: usize) -> Vec<f64> {
    let n = b.len();
    let full = Mat::from_fn(n, n, |i, j| gram[(i.max(j), i.min(j))]);
    let mut x = vec![0.0; n];
    let mut gradient = b.to_vec(); // b − G x
    for _ in 0..most_sweeps {
        let (mut largest_step, mut largest) = (0.0_f64, 0.0_f64);
        for j in 0..n {
            let curvature = full[(j, j)];
            if curvature <= 1e-9 {
                continue; // a direction that the known voxels do not see
            }
            let target = gradient[j] + curvature * x[j];
            let next = target.signum() * (target.abs() - lambda).max(0.0) / curvature;
            let step = next - x[j];
            if step != 0.0 {
                gradient.iter_mut().zip(full.col_as_slice(j)).for_each(|(g, column)| *g -= step * column);
                x[j] = next;
            }
            largest_step = largest_step.max(step.abs());
            largest = largest.max(next.abs());
        }
        if largest_step <= tolerance * largest {
            break;
        }
    }
    x
}

#[cfg(test)]
mod tests {
    use super::*;
    use half::f16;

    fn problem() -> (Mat<f64>, Vec<f64>) {
        let rows = [[1.0, 0.3, -0.2], [0.3, 0.8, 0.1], [-0.2, 0.1, 0.5]];
        (Mat::from_fn(3, 3, |i, j| if i >= j { rows[i][j] } else { 0.0 }), vec![0.9, -0.4, 0.05])
    }

    #[test]
    fn the_lasso_satisfies_its_optimality_conditions() {
        let (gram, b) = problem();
        for lambda in [1e-5, 0.05, 0.3, 2.0] {
            let x = lasso(&gram, &b, lambda, 1e-12, 10_000);
            for i in 0..3 {
                let slope: f64 = b[i] - (0..3).map(|j| gram[(i.max(j), i.min(j))] * x[j]).sum::<f64>();
                if x[i] == 0.0 {
                    assert!(slope.abs() <= lambda + 1e-9);
                } else {
                    assert!((slope - lambda * x[i].signum()).abs() < 1e-9);
                }
            }
        }
        assert_eq!(lasso(&gram, &b, 2.0, 1e-12, 100), [0.0; 3]);
    }

    #[test]
    fn ridge_is_that_of_numpy() {
        let (gram, b) = problem();
        // numpy.linalg.solve(A + 0.1 * numpy.eye(3), b)
        for (value, expected) in ridge(&gram, &b, 0.1).unwrap().iter().zip([1.179833679834, -0.907484407484, 0.627858627859]) {
            assert!((value - expected).abs() < 1e-9, "{value}");
        }
    }

    #[test]
    fn normal_equations_are_those_of_the_known_rows() {
        let (a, d) = (4, 512);
        // Orthonormal columns: four disjoint indicator vectors of 128 voxels each.
        let rows = (0..d * a).map(|i| f16::from_f32(if (i / a) % a == i % a { 1.0 / 128_f32.sqrt() } else { 0.0 })).collect();
        let basis = Basis::new(a, rows);
        let unknown: Vec<(usize, usize)> = (0..64).map(|c| (c * 8, c * 8 + c % 9)).filter(|(s, e)| s < e).collect();
        let is_unknown = |v: usize| unknown.iter().any(|&(s, e)| (s..e).contains(&v));
        let filled: Vec<usize> = (0..d).filter(|&v| !is_unknown(v) && v % 3 == 0).collect();
        let known = Known { unknown: unknown.clone(), filled: filled.clone(), ..Known::default() };
        let (gram, b) = normal_equations(&basis, &full_gram(&basis), &known);
        for i in 0..a {
            for j in 0..=i {
                let expected = if i == j { (0..d).filter(|v| v % a == i && !is_unknown(*v)).count() as f64 / 128.0 } else { 0.0 };
                assert!((gram[(i, j)] - expected).abs() < 1e-3, "{} {expected}", gram[(i, j)]);
            }
            let expected = filled.iter().filter(|v| **v % a == i).count() as f64 / 128_f64.sqrt();
            assert!((b[i] - expected).abs() < 1e-2);
        }
    }
}
