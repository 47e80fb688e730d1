//! Steps of the training and passes over the voxels, for progress reports.

/// A step of the training, for progress reports.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Step {
    /// Name of the step.
    pub name: &'static str,
    /// The longest side of the grid on which it is done: models of large grids have smaller ones too.
    pub side: usize,
    /// The pass over all voxels that begins within it.
    pub pass: Option<Pass>,
    /// Steps done before this one.
    pub done: usize,
    /// All steps.
    pub total: usize,
}

/// A pass over all voxels.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Pass {
    /// Inner products of the class bases: the Gram matrix of W.
    Gram,
    /// W' is formed and rounded.
    Basis,
    /// Tables that reading W' needs: prefix sums, or its Gram matrix where it is read in place.
    Reading,
    /// Shapes are projected onto W'.
    Projecting,
}
