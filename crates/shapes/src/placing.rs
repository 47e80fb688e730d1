//! Where a shape comes to lie on the grid.

/// Where a shape comes to lie on the grid.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Placing {
    /// Its bounding box in the middle, so many voxels along the longest side; 24 on a grid of 30. Use this for meshes from anywhere.
    LongestSide(usize),
    /// As it lies in the unit cube about the origin, of which the grid is a picture. Use this for what has been aligned, whose sizes and places
    /// are meant.
    UnitCube,
}
