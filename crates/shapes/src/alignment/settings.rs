//! Settings of the alignment.

/// Mean of the shapes' longest sides, as a share of the cube's: the 24 voxels of 30 that other shapes take.
pub const LONGEST: f64 = 0.8;

/// How shapes are aligned.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct AlignmentSettings {
    /// Cells along the unit cube in which the entropy is measured.
    pub resolution: usize,
    /// Shapes are turned about z only. Use this for things that stand.
    pub keep_up: bool,
    /// Seed of the choice of the shapes that tell which way round the others are meant, where there are many.
    pub seed: u64,
}

impl Default for AlignmentSettings {
    fn default() -> Self {
        Self { resolution: 40, keep_up: false, seed: 0 }
    }
}
