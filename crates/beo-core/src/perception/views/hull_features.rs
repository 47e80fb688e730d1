//! Few numbers that describe what a view from above shows: the visual hull below a height map, pooled and projected.
//!
//! The hull (every voxel at or below the height of its column) is averaged over cubes of voxels, then projected onto a basis:
//! z = Bᵀ · pooled hull. As every column of the hull is a stack, that is one row of a table of partial sums per column.

use crate::grid::{Dims, HeightMap, Pooling};
use crate::lanes::{Kernel, dispatch};
use half::f16;

/// The projection, as tables.
pub struct HullFeatures {
    size: usize,
    /// Columns that are read, with the start of their table.
    columns: Vec<(u32, u32)>,
    /// For each stack of cells and each height 0 to Z, `size` sums.
    table: Vec<f32>,
}

impl HullFeatures {
    /// The projection onto a basis with `size` columns, one row per cell.
    pub fn new(dims: Dims, size: usize, basis: &[f16]) -> Self {
        let pooling = Pooling::new(dims);
        let [width, depth, height] = pooling.cells();
        assert_eq!(basis.len(), width * depth * height * size, "one row per cell");
        let share = pooling.share();
        let rows = dims.z() + 1;
        let mut table = vec![0.0; width * depth * rows * size];
        for (stack, table) in table.chunks_exact_mut(rows * size).enumerate() {
            for k in 0..dims.z() {
                let cell = (stack * height + k / pooling.size()) * size;
                let (below, above) = table[k * size..(k + 2) * size].split_at_mut(size);
                for ((above, below), b) in above.iter_mut().zip(below).zip(&basis[cell..cell + size]) {
                    *above = *below + share * b.to_f32();
                }
            }
        }
        let columns = pooling.columns().map(|(column, stack)| (column as u32, (stack * rows * size) as u32)).collect();
        Self { size, columns, table }
    }

    /// Number of features.
    pub fn size(&self) -> usize {
        self.size
    }

    /// The columns of height maps that are read.
    pub fn columns(&self) -> impl Iterator<Item = usize> + '_ {
        self.columns.iter().map(|(column, _)| *column as usize)
    }

    /// Features of a height map, into `out` (`size` values).
    pub fn project(&self, map: &HeightMap, out: &mut [f32]) {
        out.fill(0.0);
        dispatch(AddColumns(self, map, &mut out[..self.size]));
    }
}

/// Adds the rows of the columns of a height map.
struct AddColumns<'a>(&'a HullFeatures, &'a HeightMap, &'a mut [f32]);

impl Kernel for AddColumns<'_> {
    type Output = ();

    #[inline(always)]
    fn run<const FUSED: bool>(self) {
        let Self(HullFeatures { columns, table, size, .. }, map, out) = self;
        for &(column, start) in columns {
            let top = usize::from(map.tops()[column as usize]);
            if top > 0 {
                let row = start as usize + top * size;
                for (sum, v) in out.iter_mut().zip(&table[row..row + size]) {
                    *sum += v;
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::furniture;
    use crate::grid::View;

    #[test]
    fn features_are_the_projection_of_the_pooled_hull() {
        for dims in [Dims::cube(30).unwrap(), Dims::cube(16).unwrap(), Dims::new(26, 19, 31).unwrap(), Dims::cube(64).unwrap()] {
            let pooling = Pooling::new(dims);
            let [width, depth, height] = pooling.cells();
            let size = 5;
            let basis: Vec<f16> =
                (0..pooling.count() * size).map(|v| f16::from_f32(((v * 7919 % 1009) as f32 / 1009.0 - 0.5) * 0.2)).collect();
            let object = furniture::make("chair", dims, 3).unwrap();
            let view = View::Top.of(&object);
            let hull = view.hull();
            // Average over the voxels of each cell that lie in columns that are read, by definition.
            let read: Vec<usize> = pooling.columns().map(|(column, _)| column).collect();
            let mut pooled = vec![0.0_f32; pooling.count()];
            for column in read {
                let (i, j) = (column / dims.y(), column % dims.y());
                for k in (0..dims.z()).filter(|k| hull.is_filled(i, j, *k)) {
                    let cell = ((i / pooling.size()) * depth + j / pooling.size()) * height + k / pooling.size();
                    pooled[cell] += (pooling.stride() as f32).powi(2) / (pooling.size() as f32).powi(3);
                }
            }
            assert!(pooled.iter().all(|v| *v <= 1.0 + 1e-5) && pooled.iter().any(|v| (*v - 1.0).abs() < 1e-5));
            let mut found = vec![0.0; width * depth * height];
            pooling.pool(&HeightMap::of(&view), &mut found);
            assert!(found.iter().zip(&pooled).all(|(a, b)| (a - b).abs() < 1e-5));

            let features = HullFeatures::new(dims, size, &basis);
            let mut z = vec![7.0; size];
            features.project(&HeightMap::of(&view), &mut z);
            for (h, z) in z.iter().enumerate() {
                let expected: f32 = pooled.iter().enumerate().map(|(cell, v)| v * basis[cell * size + h].to_f32()).sum();
                assert!((z - expected).abs() < 1e-3, "{z} {expected}");
            }
        }
    }
}
