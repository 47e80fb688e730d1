//! Gram matrices of stacks of voxels, summed once for all queries.
//!
//! Unknown voxels mostly lie in stacks: below what is seen from above, column beside column. Over a tile of columns the sum of
//! rowᵀrow from the bottom up to every few levels is therefore kept; of a query only what sticks out above the common height of
//! a tile's stacks, or lies apart, is left to be summed voxel by voxel.

use crate::grid::Dims;
use crate::lanes::Kernel;
use crate::perception::kernels::row_gram::{add_outer, packed_len};
use rayon::prelude::*;

/// Tiles along each axis, at most; it bounds the memory, whatever the resolution.
const TILES: usize = 10;

/// How a grid is cut into tiles of columns, and each tile into levels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Tiling {
    dims: Dims,
    /// Columns of a tile along x and y, and voxels of a level.
    edge: [usize; 3],
    /// Tiles along x and y, and whole levels.
    counts: [usize; 3],
}

impl Tiling {
    /// Cuts grids of one size.
    pub fn new(dims: Dims) -> Self {
        let sides = <[usize; 3]>::from(dims);
        let edge = sides.map(|side| side.div_ceil(TILES));
        // Tiles at the far sides may have fewer columns; of levels only whole ones count.
        let counts = [sides[0].div_ceil(edge[0]), sides[1].div_ceil(edge[1]), sides[2] / edge[2]];
        Self { dims, edge, counts }
    }

    /// Sums that are kept: levels of all tiles.
    pub fn cells(&self) -> usize {
        self.counts.iter().product()
    }

    fn tiles(&self) -> usize {
        self.counts[0] * self.counts[1]
    }

    /// The columns of a tile.
    fn columns(&self, tile: usize) -> impl Iterator<Item = usize> + use<> {
        let (dims, edge) = (self.dims, self.edge);
        let (x, y) = (tile / self.counts[1] * edge[0], tile % self.counts[1] * edge[1]);
        (x..(x + edge[0]).min(dims.x())).flat_map(move |i| (y..(y + edge[1]).min(dims.y())).map(move |j| i * dims.y() + j))
    }

    /// Divides voxels, given as runs inside columns, bottom up.
    pub fn divide(&self, runs: &[(usize, usize)], parts: &mut Division) {
        let z = self.dims.z();
        parts.stacks.clear();
        parts.stacks.resize(self.dims.columns(), 0);
        for &(start, end) in runs {
            if start.is_multiple_of(z) {
                parts.stacks[start / z] = end - start;
            }
        }
        parts.levels.clear();
        // From here on, of each column: how much of its stack is taken as levels.
        for tile in 0..self.tiles() {
            let common = self.columns(tile).map(|column| parts.stacks[column]).min().unwrap_or(0);
            let levels = (common / self.edge[2]).min(self.counts[2]);
            if levels > 0 {
                parts.levels.push((tile, levels));
            }
            self.columns(tile).for_each(|column| parts.stacks[column] = levels * self.edge[2]);
        }
        parts.rest.clear();
        for &(start, end) in runs {
            let taken = if start.is_multiple_of(z) { parts.stacks[start / z] } else { 0 };
            if start + taken < end {
                parts.rest.push((start + taken, end));
            }
        }
    }
}

/// Some of the voxels of a grid, divided; reused from query to query.
#[derive(Clone, Debug, Default)]
pub struct Division {
    /// Tiles of which all columns are in from the bottom, and up to which level.
    pub levels: Vec<(usize, usize)>,
    /// Runs of the other voxels.
    pub rest: Vec<(usize, usize)>,
    stacks: Vec<usize>,
}

/// Σ rowᵀrow over the stacks of tiles, for rows of one width.
pub struct TileGrams {
    tiling: Tiling,
    /// Values of one packed lower triangle.
    packed: usize,
    /// `[tile][level]`: the sum up to and including that level.
    sums: Vec<f32>,
}

impl TileGrams {
    /// Sums over `rows`: `stride` values per voxel, of which the first `width` count.
    pub fn new(tiling: Tiling, rows: &[f32], stride: usize, width: usize) -> Self {
        let packed = packed_len(width);
        let levels = tiling.counts[2];
        let mut sums = vec![0.0_f32; tiling.tiles() * levels * packed];
        sums.par_chunks_mut((levels * packed).max(1)).enumerate().for_each(|(tile, sums)| {
            let mut sum = vec![0.0_f64; packed];
            for (level, out) in sums.chunks_exact_mut(packed.max(1)).enumerate() {
                for column in tiling.columns(tile) {
                    let bottom = column * tiling.dims.z() + level * tiling.edge[2];
                    add_outer(&mut sum, rows, stride, width, bottom..bottom + tiling.edge[2]);
                }
                out.iter_mut().zip(&sum).for_each(|(out, sum)| *out = *sum as f32);
            }
        });
        Self { tiling, packed, sums }
    }

    /// Adds the sums over whole levels to `out`, a packed lower triangle.
    pub fn add<'a>(&'a self, levels: &'a [(usize, usize)], out: &'a mut [f64]) -> AddLevels<'a> {
        AddLevels { grams: self, levels, out }
    }
}

/// See [`TileGrams::add`].
pub struct AddLevels<'a> {
    grams: &'a TileGrams,
    levels: &'a [(usize, usize)],
    out: &'a mut [f64],
}

impl Kernel for AddLevels<'_> {
    type Output = ();

    #[inline(always)]
    fn run<const FUSED: bool>(self) {
        let TileGrams { tiling, packed, sums } = self.grams;
        for &(tile, count) in self.levels {
            let at = (tile * tiling.counts[2] + count - 1) * packed;
            for (out, sum) in self.out.iter_mut().zip(&sums[at..at + packed]) {
                *out += f64::from(*sum);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::Observation;
    use crate::lanes::dispatch;
    use crate::perception::Known;
    use proptest::prelude::*;

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(30))]
        /// Stacks, gaps and whole columns of any height, on a grid whose sides the tiles do not divide.
        #[test]
        fn a_divided_sum_is_the_sum_over_all_unknown_voxels(
            heights in prop::collection::vec((0..24_usize, 0..24_usize, 0..24_usize), 23 * 21),
            flat in prop::collection::vec(0..24_usize, 12 * 11)
        ) {
            let dims = Dims::new(23, 21, 24).unwrap();
            let mut codes = vec![0; dims.voxels()];
            for (column, (height, low, high)) in heights.iter().enumerate() {
                let base = flat[column / 21 / 2 * 11 + column % 21 / 2];
                let stack = if height % 3 == 0 { *height } else { base };
                for k in (0..stack).chain(*low..*high) {
                    codes[column * 24 + k] = 255;
                }
            }
            let mut known = Known::new(dims);
            known.read(&Observation::from_bytes(dims, &codes).unwrap());
            let width = 3;
            let rows: Vec<f32> = (0..dims.voxels() * width).map(|i| ((i * 37 % 101) as f32 - 50.0) / 64.0).collect();
            let grams = TileGrams::new(Tiling::new(dims), &rows, width, width);
            let mut parts = Division::default();
            Tiling::new(dims).divide(&known.unknown, &mut parts);
            let mut found = vec![0.0; 6];
            dispatch(grams.add(&parts.levels, &mut found));
            for &(start, end) in &parts.rest {
                add_outer(&mut found, &rows, width, width, start..end);
            }
            let mut expected = vec![0.0; 6];
            (0..codes.len()).filter(|v| codes[*v] == 255).for_each(|v| add_outer(&mut expected, &rows, width, width, v..v + 1));
            for (a, b) in found.iter().zip(&expected) {
                prop_assert!((a - b).abs() < 1e-3 * (1.0 + b.abs()), "{} {}", a, b);
            }
        }
    }
}
