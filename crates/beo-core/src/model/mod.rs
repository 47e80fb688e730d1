//! The trained model, in memory and on disk.
//!
//! A model is one shared orthonormal basis W' (d × a), and for each class what its objects look like in it. Quantities that
//! follow quickly from these (Cholesky factors, class means as voxels, prefix sums of W') are derived by `perception`.

mod basis;
mod camera_density;
mod component;
mod file;
mod first_touch;
mod footprint;
mod mapping;
mod metadata;
mod view_density;

pub use basis::Basis;
pub use component::{Component, SizeDensity};
pub use camera_density::{CELLS as CAMERA_CELLS, CameraDensities, OFFSETS, YAWS};
pub use file::{ModelError, Outline, VerifyReport, check_place, load, outline, save, verify};
pub use first_touch::Damaged;
pub use footprint::Footprint;
pub use metadata::{Blend, Calibration, CameraCalibration, ClassInfo, CompletionCalibration, FORMAT_VERSION, Metadata, Settings};
pub use view_density::{DIRECTIONS, ViewDensities};

use crate::grid::{Dims, View};

/// Most classes that a model, and a percept, can name.
pub const MOST_CLASSES: usize = 64;
/// Longest class name in bytes: 32 with the closing zero in the status message.
pub const LONGEST_CLASS_NAME: usize = 31;
/// Most components of a class basis.
pub const MOST_COMPONENTS: usize = 250;

/// Everything learned of one class, in coordinates of the shared basis. a is the rank of W', k_s the size of the class basis.
#[derive(Clone, Debug, PartialEq)]
pub struct ClassModel {
    /// Mean of the projected training objects ō'_s (eq. 7), a values.
    pub mean: Vec<f32>,
    /// Shrunk covariance Σ''_s of the projected training objects (eq. 8), a × a, symmetric.
    pub covariance: Vec<f32>,
    /// VBPCA's basis W_s in coordinates of W', k_s × a, one unit vector per row, by falling variance.
    pub directions: Vec<f32>,
    /// Variance of the class's objects along each direction, k_s values (VBPCA's shrunk estimate).
    pub variances: Vec<f64>,
    /// Densities of the visual hulls' projections, one per view of the model.
    pub hulls: Vec<HullDensity>,
}

/// Student-t density of the projection of a class's visual hulls seen from one view.
#[derive(Clone, Debug, PartialEq)]
pub struct HullDensity {
    /// Mean, a values.
    pub mean: Vec<f32>,
    /// Scale matrix: the posterior mean covariance of a normal-inverse-Wishart prior, a × a, symmetric.
    pub covariance: Vec<f32>,
}

/// A trained model.
#[derive(Clone, Debug)]
pub struct Model {
    /// Tells one model file from another: made of its checksums; 0 for a model that was not loaded from a file.
    pub id: u64,
    /// What the model is and how it was made.
    pub metadata: Metadata,
    /// The shared basis W'.
    pub basis: Basis,
    /// One entry per class, in the order of `metadata.classes`.
    pub classes: Vec<ClassModel>,
    /// Densities of turned objects seen from above; `None` where smaller grids are searched instead.
    pub view_densities: Option<ViewDensities>,
    /// Densities of what cameras see, if they were learned.
    pub camera_densities: Option<CameraDensities>,
    /// Where W' is not zero, if it is to be read in place.
    pub footprint: Option<Footprint>,
    /// Models of the same shapes on smaller grids, in which poses are searched; from the smallest on.
    pub levels: Vec<Model>,
}

/// Sides of the smaller grids in which poses are searched, if a grid is larger than the last of them.
pub const LEVELS: [usize; 2] = [32, 64];

/// The smaller grids of a grid of this size; none for those that are searched themselves.
pub fn levels_of(dims: Dims) -> Vec<Dims> {
    let sides = <[usize; 3]>::from(dims);
    let longest = sides.into_iter().fold(0, usize::max);
    if longest <= LEVELS[1] {
        return Vec::new();
    }
    let shrunk = |side: usize, to: usize| (side * to).div_ceil(longest).max(8);
    let of = |to: usize| Dims::new(shrunk(sides[0], to), shrunk(sides[1], to), shrunk(sides[2], to)).expect("sides from 8 to 64");
    LEVELS.map(of).to_vec()
}

impl Model {
    /// Size of the grids that the model answers.
    pub fn dims(&self) -> Dims {
        self.metadata.dims
    }

    /// Densities of turned objects of a model that is searched itself.
    pub(crate) fn searched_views(&self) -> &ViewDensities {
        self.view_densities.as_ref().expect("poses of a model with levels are searched in these")
    }

    /// Number of columns of W', a.
    pub fn rank(&self) -> usize {
        self.basis.rank()
    }

    /// Class names, sorted.
    pub fn class_names(&self) -> impl Iterator<Item = &str> {
        self.metadata.classes.iter().map(|class| class.name.as_str())
    }

    /// The views for which the model has hull densities.
    pub fn views(&self) -> &[View] {
        &self.metadata.settings.views
    }
}
