//! Values of a class basis, or of W', by blocks of voxels of one column: these lie side by side, component by component.

use super::rows::Rows;
use crate::grid::Dims;
use crate::lanes::{LANES, Lanes, widen};
use crate::model::MOST_COMPONENTS;
use crate::perception::kernels::large_pages::collapse;

/// A class basis and mean over voxels, column by column.
pub struct Columns {
    /// k, the number of directions.
    size: usize,
    /// Blocks of a column; the last may be filled up with zeros.
    blocks: usize,
    /// `[column][block][component][lane]`, a block being [`LANES`] voxels, in the units of the rows; the last component is the
    /// mean.
    values: Vec<[i16; LANES]>,
    /// Unit of the mean.
    mean_unit: f32,
}

/// Memory for one block at a time.
pub struct BlockScratch {
    /// Components of the block's voxels, of a class's own basis, without an allocation …
    own: [Lanes; MOST_COMPONENTS],
    /// … and of W', which may have more, with the rows as they lie in memory.
    pub shared: Vec<Lanes>,
    /// Rows of W' as they lie in memory.
    pub rows: Vec<f32>,
}

impl Default for BlockScratch {
    fn default() -> Self {
        Self { own: [[0.0; LANES]; MOST_COMPONENTS], shared: Vec::new(), rows: Vec::new() }
    }
}

impl Columns {
    /// Rearranges `rows`, of which the first components are the k directions and the mean.
    pub fn new(dims: Dims, size: usize, rows: &Rows) -> Self {
        let blocks = dims.z().div_ceil(LANES);
        let mut values = vec![[0; LANES]; dims.columns() * blocks * (size + 1)];
        for (column, values) in values.chunks_exact_mut(blocks * (size + 1)).enumerate() {
            for z in 0..dims.z() {
                let block = &mut values[z / LANES * (size + 1)..];
                let row = &rows.row(column * dims.z() + z)[..=size];
                block.iter_mut().zip(row).for_each(|(block, value)| block[z % LANES] = *value);
            }
        }
        collapse(&values);
        Self { size, blocks, values, mean_unit: rows.scales()[size] }
    }

    /// Values that are kept of a class with `size` directions, 2 bytes each.
    pub fn values(dims: Dims, size: usize) -> usize {
        dims.columns() * (size + 1) * dims.z().next_multiple_of(LANES)
    }

    /// The components of the voxels of a column from `z` on, a multiple of [`LANES`], and their class means.
    #[inline(always)]
    pub fn load<'s>(&self, column: usize, z: usize, scratch: &'s mut BlockScratch) -> (&'s [Lanes], Lanes) {
        let first = (column * self.blocks + z / LANES) * (self.size + 1);
        let values = &self.values[first..=first + self.size];
        let block = &mut scratch.own[..self.size];
        for (row, values) in block.iter_mut().zip(values) {
            *row = widen(values);
        }
        let mut class_mean = widen(&values[self.size]);
        for value in &mut class_mean {
            *value *= self.mean_unit;
        }
        (block, class_mean)
    }
}
