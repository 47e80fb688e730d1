//! Scores of angles about z by the hull's projection, for views from above.
//!
//! The hull of a view from above turns as the object does, so its projection z = W'ᵀh can be scored by class densities at
//! every angle. That density alone is none over angles, as its data change with them: a hull that fits no class has little
//! of itself in W'. What remains outside, ‖h‖² − ‖z‖², makes it one (the second term of probabilistic PCA). For the search
//! all classes share one covariance, so that an angle costs one projection, one whitening, and one distance per class.

use crate::grid::{Dims, for_each_column_source, for_each_run};
use crate::linear::LinearError;
use crate::perception::ColumnSums;
use crate::perception::lanes::{Kernel, LANES, dispatch, multiply_add};
use crate::perception::whitening::Whitening;
use faer::Mat;
use fixedbitset::FixedBitSet;

/// Variance of a voxel of the hull outside of W'. Held-out objects do not mind its value between 0.3 and 3.
const RESIDUAL_VARIANCE: f64 = 1.0;

/// Log density of what a hull of `volume` voxels with this projection has outside of W', up to a constant.
pub fn log_residual(volume: f64, projected: &[f32]) -> f64 {
    let inside: f64 = projected.iter().map(|v| f64::from(*v).powi(2)).sum();
    -0.5 * (volume - inside) / RESIDUAL_VARIANCE
}

/// Student-t densities of all classes with one common scale matrix.
pub struct CommonDensity {
    /// L⁻¹ of the scale matrix.
    whitening: Whitening,
    /// L⁻¹ times the class means, a values per class.
    means: Vec<f32>,
    rank: usize,
    degrees_of_freedom: f64,
}

impl CommonDensity {
    /// Densities with these means (a values each) and the scale matrix `common` (a × a, lower half).
    pub fn new(means: &[&[f32]], common: &Mat<f64>, degrees_of_freedom: f64) -> Result<Self, LinearError> {
        let whitening = Whitening::new(&mut common.clone())?;
        let mut densities = Self { whitening, means: Vec::new(), rank: common.nrows(), degrees_of_freedom };
        for mean in means {
            let whitened = densities.whiten(mean);
            densities.means.extend(whitened);
        }
        Ok(densities)
    }

    fn whiten(&self, z: &[f32]) -> Vec<f32> {
        let mut out = vec![0.0; self.rank];
        self.whitening.whiten(&mut z.to_vec(), &mut out);
        out
    }

    /// The log density of `z` (a values) for each class, up to a common constant, into `scores`; −∞ for classes that are not
    /// `wanted`. Uses z and `whitened`, of as many values, as scratch.
    pub fn log_densities(&self, z: &mut [f32], wanted: &[bool], whitened: &mut [f32], scores: &mut [f64]) {
        self.whitening.whiten(z, whitened);
        let (a, nu) = (self.rank as f64, self.degrees_of_freedom);
        for ((score, mean), wanted) in scores.iter_mut().zip(self.means.chunks_exact(self.rank)).zip(wanted) {
            *score = match wanted {
                true => -0.5 * (nu + a) * (f64::from(dispatch(Distance2(mean, whitened))) / nu).ln_1p(),
                false => f64::NEG_INFINITY,
            };
        }
    }
}

/// Squared distance of two vectors.
struct Distance2<'a>(&'a [f32], &'a [f32]);

impl Kernel for Distance2<'_> {
    type Output = f32;

    #[inline(always)]
    fn run<const FUSED: bool>(self) -> f32 {
        let (a, b) = (self.0.as_chunks::<LANES>(), self.1.as_chunks::<LANES>());
        let mut sums = [0.0; LANES];
        for (a, b) in a.0.iter().zip(b.0) {
            for l in 0..LANES {
                sums[l] = multiply_add::<FUSED>(a[l] - b[l], a[l] - b[l], sums[l]);
            }
        }
        let rest: f32 = a.1.iter().zip(b.1).map(|(a, b)| (a - b) * (a - b)).sum();
        sums.iter().sum::<f32>() + rest
    }
}

/// A hull as runs of voxels, column by column: it turns about z by moving columns.
#[derive(Default)]
pub struct HullColumns {
    /// Runs (bottom, end) within a column.
    runs: Vec<(u32, u32)>,
    /// Where the runs of each column begin; one more than there are columns.
    starts: Vec<u32>,
    /// Runs of voxels of the hull turned.
    turned: Vec<(u32, u32)>,
}

impl HullColumns {
    /// Takes in a hull, one bit per voxel.
    pub fn read(&mut self, dims: Dims, hull: &FixedBitSet) {
        self.runs.clear();
        self.starts.clear();
        for column in 0..dims.columns() {
            self.starts.push(self.runs.len() as u32);
            let bottom = column * dims.z();
            for_each_run(hull, dims, column..column + 1, |start, end| self.runs.push(((start - bottom) as u32, (end - bottom) as u32)));
        }
        self.starts.push(self.runs.len() as u32);
    }

    /// W'ᵀh of the hull turned by `angle`, into `out` (a values); gives the voxels of that hull. What enters is empty.
    pub fn project(&mut self, dims: Dims, sums: &ColumnSums, angle: f64, out: &mut [f32]) -> f64 {
        let Self { runs, starts, turned } = self;
        turned.clear();
        let (mut bottom, mut voxels) = (0, 0);
        for_each_column_source(dims, angle, |source| {
            if let Some(source) = source {
                for (start, end) in &runs[starts[source] as usize..starts[source + 1] as usize] {
                    turned.push((bottom + start, bottom + end));
                    voxels += end - start;
                }
            }
            bottom += dims.z() as u32;
        });
        sums.project_runs(turned, out);
        f64::from(voxels)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::furniture;
    use crate::grid::{Outside, Turn, View, yaw};
    use crate::model::Basis;
    use crate::perception::Density;
    use half::f16;
    use proptest::prelude::*;

    #[test]
    fn with_one_class_it_is_the_density_of_that_class() {
        let scale = [2.0_f32, 0.5, 0.5, 1.0];
        let common = Mat::from_fn(2, 2, |i, j| f64::from(scale[i * 2 + j]));
        let (one, two): (&[f32], &[f32]) = (&[1.0, -0.5], &[0.0, 2.0]);
        let densities = CommonDensity::new(&[one, two], &common, 7.0).unwrap();
        let z = [0.3, 0.4];
        for (s, mean) in [one, two].into_iter().enumerate() {
            let density = Density::new(mean, &scale).unwrap();
            let expected = density.log_student(&z, 7.0, &mut [0.0; 2]) - density.log_volume();
            let mut found = [0.0; 2];
            densities.log_densities(&mut z.clone(), &[true; 2], &mut [0.0; 2], &mut found);
            assert!((found[s] - expected).abs() < 1e-5);
        }
        let mut found = [0.0; 2];
        densities.log_densities(&mut z.clone(), &[false, true], &mut [0.0; 2], &mut found);
        assert!(found[0] == f64::NEG_INFINITY && found[1].is_finite());
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(20))]
        #[test]
        fn projecting_turned_columns_is_projecting_the_turned_hull(angle in -7.0..7.0_f64, seed in 0..1000_u64) {
            let dims = Dims::cube(16).unwrap();
            let observation = View::Top.of(&furniture::make("chair", dims, seed).unwrap());
            let rows = (0..dims.voxels() * 3).map(|i| f16::from_f32(((i * 37 % 101) as f32 - 50.0) / 64.0)).collect();
            let sums = ColumnSums::new(dims, &Basis::new(3, rows));
            let mut columns = HullColumns::default();
            columns.read(dims, observation.hull().bits());
            let turned = Turn::new(dims, &yaw(angle)).observation(&observation, Outside::Empty).hull();
            let (mut expected, mut found) = ([0.0; 3], [0.0; 3]);
            sums.project(turned.bits(), &mut expected);
            let volume = columns.project(dims, &sums, angle, &mut found);
            prop_assert_eq!(volume, turned.count() as f64);
            for (a, b) in expected.iter().zip(found) {
                prop_assert!((a - b).abs() < 1e-2, "{} {}", a, b);
            }
        }
    }
}
