//! Averages of visual hulls over cubes of voxels, for grids of any size at about the same cost.

use super::{Dims, HeightMap};

/// How grids are pooled, about 15 cells along the longest side: cubes of voxels, in which every n-th column along x
/// and y is read. Cells at the far ends may be cut.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Pooling {
    dims: Dims,
    size: usize,
    stride: usize,
}

impl Pooling {
    /// Longest side of a grid that is not pooled.
    const SMALL: usize = 22;
    /// Longest side of a grid that is pooled by 2.
    const MIDDLE: usize = 30;

    /// The pooling for grids of one size.
    pub fn new(dims: Dims) -> Self {
        let longest = dims.x().max(dims.y()).max(dims.z());
        if longest <= Self::SMALL {
            return Self { dims, size: 1, stride: 1 };
        }
        let stride = (longest + Self::MIDDLE / 2) / Self::MIDDLE;
        Self { dims, size: 2 * stride, stride }
    }

    /// Cells along each axis.
    pub fn cells(&self) -> [usize; 3] {
        <[usize; 3]>::from(self.dims).map(|side| side.div_ceil(self.size))
    }

    /// Voxels along an edge of a cell.
    pub fn size(&self) -> usize {
        self.size
    }

    /// Every how many columns one is read, along x and y.
    pub fn stride(&self) -> usize {
        self.stride
    }

    /// Number of cells.
    pub fn count(&self) -> usize {
        self.cells().iter().product()
    }

    /// The columns that are read, each with the stack of cells (index among those of the ground plane) that it belongs to.
    pub fn columns(&self) -> impl Iterator<Item = (usize, usize)> + use<> {
        let (dims, size, depth) = (self.dims, self.size, self.cells()[1]);
        let (first, stride) = (self.stride / 2, self.stride);
        (first..dims.x())
            .step_by(stride)
            .flat_map(move |i| (first..dims.y()).step_by(stride).map(move |j| (i * dims.y() + j, (i / size) * depth + j / size)))
    }

    /// Share that one voxel of a column that is read has in the average of its cell.
    pub fn share(&self) -> f32 {
        let side = self.size / self.stride;
        1.0 / (side * side * self.size) as f32
    }

    /// The pooled hull below a height map, one value per cell.
    pub fn pool(&self, map: &HeightMap, out: &mut [f32]) {
        let height = self.cells()[2];
        let share = self.share();
        out.fill(0.0);
        for (column, stack) in self.columns() {
            let mut left = usize::from(map.tops()[column]);
            for cell in &mut out[stack * height..(stack + 1) * height] {
                let filled = left.min(self.size);
                *cell += filled as f32 * share;
                left -= filled;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn grids_of_any_size_have_about_fifteen_cells() {
        for side in Dims::MIN..=Dims::MAX {
            let pooling = Pooling::new(Dims::cube(side).unwrap());
            let cells = pooling.cells()[0];
            assert!((8..=22).contains(&cells), "{side}: {cells}");
            assert!(side < 12 || cells >= 11, "{side}: {cells}");
            assert!(pooling.columns().count() <= 45 * 45);
        }
        let pooling = Pooling::new(Dims::cube(30).unwrap());
        assert_eq!((pooling.cells(), pooling.columns().count()), ([15; 3], 900));
    }
}
