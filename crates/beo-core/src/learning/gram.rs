//! The n × n matrix of inner products of n binary shapes, exact by counting bits, and its centring.

use crate::grid::Occupancy;
use faer::Mat;
use rayon::prelude::*;

/// Number of voxels shared by each pair of shapes: XᵀX, n × n, symmetric.
pub(super) fn overlaps(shapes: &[&Occupancy]) -> Mat<f64> {
    let n = shapes.len();
    let columns: Vec<Vec<f64>> = (0..n).into_par_iter().map(|j| (j..n).map(|i| shapes[i].overlap(shapes[j]) as f64).collect()).collect();
    Mat::from_fn(n, n, |i, j| columns[i.min(j)][i.max(j) - i.min(j)])
}

/// Inner products after the mean of the shapes is subtracted, (X − μ1ᵀ)ᵀ(X − μ1ᵀ):
/// K − row means − column means + grand mean.
pub(super) fn centred(gram: &Mat<f64>) -> Mat<f64> {
    let n = gram.nrows();
    let means: Vec<f64> = (0..n).map(|j| gram.col_as_slice(j).iter().sum::<f64>() / n as f64).collect();
    let grand = means.iter().sum::<f64>() / n as f64;
    Mat::from_fn(n, n, |i, j| gram[(i, j)] - means[i] - means[j] + grand)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::Dims;

    #[test]
    fn centred_gram_is_that_of_the_dense_data() {
        let dims = Dims::cube(8).unwrap();
        let shapes: Vec<Occupancy> =
            (0..5usize).map(|s| Occupancy::from_fn(dims, |i, j, k| (i * 7 + j * 3 + k * (s + 2)) % (s + 3) == 0)).collect();
        let gram = centred(&overlaps(&shapes.iter().collect::<Vec<_>>()));
        let dense: Vec<Vec<f64>> = shapes.iter().map(|s| (0..512).map(|v| f64::from(u8::from(s.bits().contains(v)))).collect()).collect();
        let mean: Vec<f64> = (0..512).map(|v| dense.iter().map(|x| x[v]).sum::<f64>() / 5.0).collect();
        for i in 0..5 {
            for j in 0..5 {
                let expected: f64 = (0..512).map(|v| (dense[i][v] - mean[v]) * (dense[j][v] - mean[v])).sum();
                assert!((gram[(i, j)] - expected).abs() < 1e-9);
            }
        }
    }
}
