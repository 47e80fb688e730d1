//! Scores of angles about z by the hull's projection, for views from above.
//!
//! The hull of a view from above turns as the object does, so its projection z = W'ᵀh can be scored by class densities at
//! every angle. That density alone is none over angles, as its data change with them: a hull that fits no class has little
//! of itself in W'. What remains outside, ‖h‖² − ‖z‖², makes it one (the second term of probabilistic PCA). For the search
//! all classes share one covariance, so that an angle costs one projection, one whitening, and one distance per class.

use crate::grid::{Dims, for_each_column_source, for_each_run};
use crate::perception::ColumnSums;
use fixedbitset::FixedBitSet;

/// Variance of a voxel of the hull outside of W'. Held-out objects do not mind its value between 0.3 and 3.
const RESIDUAL_VARIANCE: f64 = 1.0;

/// Log density of what a hull of `volume` voxels with this projection has outside of W', up to a constant.
pub fn log_residual(volume: f64, projected: &[f32]) -> f64 {
    let inside: f64 = projected.iter().map(|v| f64::from(*v).powi(2)).sum();
    -0.5 * (volume - inside) / RESIDUAL_VARIANCE
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
    use half::f16;
    use proptest::prelude::*;

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
