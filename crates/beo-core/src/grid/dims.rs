//! The size of a voxel grid and its index order.

use serde::{Deserialize, Serialize};

/// Number of voxels along each axis. Index order is `[x][y][z]`, z fastest.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(try_from = "[usize; 3]", into = "[usize; 3]")]
pub struct Dims {
    x: usize,
    y: usize,
    z: usize,
}

/// A side of a grid is out of range.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("a grid of {0:?} voxels is not supported: every side must be from {min} to {max}", min = Dims::MIN, max = Dims::MAX)]
pub struct DimsError(pub [usize; 3]);

impl Dims {
    /// Fewest voxels along one axis.
    pub const MIN: usize = 8;
    /// Most voxels along one axis.
    pub const MAX: usize = 256;

    /// Dims of `x` × `y` × `z` voxels; an error when a side is outside `MIN..=MAX`.
    pub fn new(x: usize, y: usize, z: usize) -> Result<Self, DimsError> {
        let valid = |n: usize| (Self::MIN..=Self::MAX).contains(&n);
        if valid(x) && valid(y) && valid(z) { Ok(Self { x, y, z }) } else { Err(DimsError([x, y, z])) }
    }

    /// Dims of a cube with `n` voxels along each side.
    pub fn cube(n: usize) -> Result<Self, DimsError> {
        Self::new(n, n, n)
    }

    /// Voxels along x.
    pub fn x(self) -> usize {
        self.x
    }

    /// Voxels along y.
    pub fn y(self) -> usize {
        self.y
    }

    /// Voxels along z (up).
    pub fn z(self) -> usize {
        self.z
    }

    /// Number of voxels, d in the paper.
    pub fn voxels(self) -> usize {
        self.x * self.y * self.z
    }

    /// Number of vertical columns; column `c` holds the voxels `c * z .. (c + 1) * z`.
    pub fn columns(self) -> usize {
        self.x * self.y
    }

    /// Index of voxel (i, j, k). The caller keeps i, j, k inside the grid.
    pub fn index(self, i: usize, j: usize, k: usize) -> usize {
        debug_assert!(i < self.x && j < self.y && k < self.z);
        (i * self.y + j) * self.z + k
    }

    /// The voxel (i, j, k) of an index.
    pub fn coordinates(self, index: usize) -> [usize; 3] {
        [index / (self.y * self.z), index / self.z % self.y, index % self.z]
    }
}

impl TryFrom<[usize; 3]> for Dims {
    type Error = DimsError;
    fn try_from([x, y, z]: [usize; 3]) -> Result<Self, DimsError> {
        Self::new(x, y, z)
    }
}

impl From<Dims> for [usize; 3] {
    fn from(dims: Dims) -> Self {
        [dims.x, dims.y, dims.z]
    }
}

impl std::fmt::Display for Dims {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}×{}×{}", self.x, self.y, self.z)
    }
}

/// Voxels that the longest side of a shape takes on a grid: four fifths of the smallest side, as in 3DShapeNets (24 of 30), rounded
/// to an odd number where that side is odd and to an even one otherwise, so that the shape's ends fall on borders of voxels.
pub fn longest_side(dims: Dims) -> usize {
    let smallest = dims.x().min(dims.y()).min(dims.z());
    let odd = smallest % 2;
    (4 * smallest + 5 - 5 * odd) / 10 * 2 + odd
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn index_is_c_order_with_z_fastest() {
        let dims = Dims::new(8, 9, 10).unwrap();
        // numpy.ravel_multi_index((2, 3, 4), (8, 9, 10))
        assert_eq!(dims.index(2, 3, 4), 214);
        for index in 0..dims.voxels() {
            let [i, j, k] = dims.coordinates(index);
            assert_eq!(dims.index(i, j, k), index);
        }
    }

    #[test]
    fn sides_out_of_range_are_named() {
        assert!(Dims::new(8, 256, 30).is_ok());
        let message = Dims::new(7, 30, 30).unwrap_err().to_string();
        assert!(message.contains("[7, 30, 30]") && message.contains("8 to 256"), "{message}");
        assert!(Dims::cube(257).is_err());
    }

    #[test]
    fn the_default_leaves_a_tenth_on_either_side() {
        let side = |n| longest_side(Dims::cube(n).unwrap());
        assert_eq!([8, 9, 30, 31, 32, 64, 254].map(side), [6, 7, 24, 25, 26, 52, 204]);
        assert_eq!(longest_side(Dims::new(100, 30, 50).unwrap()), 24);
    }
}
