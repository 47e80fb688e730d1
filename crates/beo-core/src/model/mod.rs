//! The trained model, in memory and on disk.
//!
//! A model is one shared orthonormal basis W' (d × a), and for each class what its objects look like in it. Quantities that
//! follow quickly from these (Cholesky factors, class means as voxels, prefix sums of W') are derived by `perception`.

mod basis;
mod camera_density;
mod component;
mod container;
mod error;
mod file;
mod first_touch;
mod footprint;
mod forest;
mod header;
mod mapping;
mod metadata;
mod opened;
#[cfg(test)]
mod test_models;
mod view_density;

pub use basis::Basis;
pub use camera_density::{CELLS as CAMERA_CELLS, CameraDensities, MEASURES as CAMERA_MEASURES, OFFSETS, YAWS};
pub use component::{Component, SizeDensity};
pub use error::ModelError;
pub use file::{Outline, VerifyReport, check_place, load, outline, save, verify};
pub use first_touch::Damaged;
pub use footprint::Footprint;
pub use forest::{Forest, LEAF};
pub use metadata::{
    Blend, Calibration, CameraCalibration, CameraSpread, ClassInfo, CompletionCalibration, FORMAT_VERSION, Metadata, NoneCalibration,
    TrainingSettings,
};
pub use view_density::{DIRECTIONS, ViewDensities};

use crate::grid::{Dims, View};
use std::sync::Arc;

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
    /// Description of the model and of its training.
    pub metadata: Metadata,
    /// The shared basis W'.
    pub basis: Basis,
    /// One entry per class, in the order of `metadata.classes`.
    pub classes: Vec<ClassModel>,
    /// With what poses, sizes and places are searched.
    pub searched: Searched,
}

/// With what poses, sizes and places are searched: the three kinds of model, in memory and on disk.
#[derive(Clone, Debug)]
pub enum Searched {
    /// On the grid of the model itself, which is small enough for tables of W'.
    Here {
        /// Densities of turned objects seen from above.
        views: Arc<ViewDensities>,
        /// Densities of what cameras see, if they were learned.
        cameras: Option<Arc<CameraDensities>>,
    },
    /// On smaller grids; W' of the large one is read in place.
    OnLevels {
        /// Where W' is not zero.
        footprint: Footprint,
        /// Models of the same shapes on the smaller grids, from the smallest on, which are searched themselves.
        levels: Vec<Model>,
    },
    /// Not at all: pose, size and place must be known.
    KnownPoseOnly {
        /// Where W' is not zero, if the grid is so large that it is read in place.
        footprint: Option<Footprint>,
    },
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

    /// Models of the same shapes on smaller grids, in which poses are searched; none where the model's own grid is searched, or none is.
    pub fn levels(&self) -> &[Model] {
        match &self.searched {
            Searched::OnLevels { levels, .. } => levels,
            Searched::Here { .. } | Searched::KnownPoseOnly { .. } => &[],
        }
    }

    /// Where W' is not zero, if it is read in place.
    pub fn footprint(&self) -> Option<&Footprint> {
        match &self.searched {
            Searched::Here { .. } => None,
            Searched::OnLevels { footprint, .. } => Some(footprint),
            Searched::KnownPoseOnly { footprint } => footprint.as_ref(),
        }
    }

    /// Densities of turned objects seen from above, of a model whose own grid is searched.
    pub fn view_densities(&self) -> Option<&ViewDensities> {
        match &self.searched {
            Searched::Here { views, .. } => Some(views),
            Searched::OnLevels { .. } | Searched::KnownPoseOnly { .. } => None,
        }
    }

    /// Whether cameras can be asked for objects that rest otherwise than upright.
    pub fn has_resting_poses(&self) -> bool {
        self.camera_densities().is_some_and(|cameras| cameras.components.iter().any(|component| !component.is_upright()))
    }

    /// Densities of what cameras see, of a model whose own grid is searched and that was learned with them.
    pub fn camera_densities(&self) -> Option<&CameraDensities> {
        match &self.searched {
            Searched::Here { cameras, .. } => cameras.as_deref(),
            Searched::OnLevels { .. } | Searched::KnownPoseOnly { .. } => None,
        }
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
