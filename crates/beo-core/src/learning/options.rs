//! Options of the training.

use crate::grid::View;
use crate::simulation::Sensing;

/// Fewest shapes of a class.
pub const FEWEST_SHAPES: usize = 4;

/// How to train.
#[derive(Clone, Debug)]
pub struct TrainOptions {
    /// Views to simulate.
    pub views: Vec<View>,
    /// Elevations of the cameras to be met, degrees above the horizontal, ascending: densities of what they see are learned; none for none.
    pub camera_elevations_deg: Vec<f64>,
    /// What sensors and masks get wrong in the cameras' views.
    pub sensing: Sensing,
    /// Whether the resting poses of the shapes are learned for cameras; else all stand upright.
    pub lying: bool,
    /// Share of the variance that sizes a class basis.
    pub variance_share: f64,
    /// Least and most components of a class basis.
    pub basis_range: [usize; 2],
    /// Seed of the folds.
    pub seed: u64,
    /// Number of folds, at least two.
    pub folds: usize,
    /// Whether to learn what poses are searched with: smaller grids, and views from all sides. A model without them answers queries in
    /// known pose alone, the same as with them.
    pub poses: bool,
    /// Splits that the shapes come from, for the record.
    pub splits: Vec<String>,
    /// Longest side of a mesh in voxels, for the record.
    pub longest_side: usize,
    /// Terms of the data, for the record.
    pub licence: String,
}

impl Default for TrainOptions {
    /// The paper's basis sizes, top views, three folds.
    fn default() -> Self {
        Self {
            views: vec![View::Top],
            camera_elevations_deg: Vec::new(),
            sensing: Sensing::Mild,
            lying: false,
            variance_share: 0.6,
            basis_range: [30, 70],
            seed: 0,
            folds: 3,
            poses: true,
            splits: vec!["train".into()],
            longest_side: 24,
            licence: String::new(),
        }
    }
}
