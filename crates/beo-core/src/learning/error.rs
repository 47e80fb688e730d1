//! Errors of the training.

use super::options::FEWEST_SHAPES;
use crate::grid::Dims;
use crate::linear::LinearError;
use crate::perception::PerceiveError;

/// Training failed.
#[derive(Debug, thiserror::Error)]
pub enum TrainError {
    /// A class has too few shapes.
    #[error("class `{class}` has {found} shapes, at least {FEWEST_SHAPES} are needed: add shapes or remove its folder")]
    TooFew {
        /// The class.
        class: String,
        /// Its shapes.
        found: usize,
    },
    /// There is no class, or no view.
    #[error("nothing to learn: no class of shapes, or no view to simulate")]
    Nothing,
    /// Shapes are on grids of different sizes.
    #[error("{file} is a grid of {found}, others are of {expected}: give all shapes one resolution")]
    Dims {
        /// The shape.
        file: String,
        /// Its size.
        found: Dims,
        /// The size of the first shape.
        expected: Dims,
    },
    /// Shapes are so thin that nothing of them is left on a smaller grid.
    #[error(
        "nothing of the shapes of class `{class}` is left on the grid of {dims} on which poses are searched: use a --resolution of at most 64, or thicker shapes"
    )]
    Vanished {
        /// The class.
        class: String,
        /// The smaller grid.
        dims: Dims,
    },
    /// A matrix could not be factorised.
    #[error(transparent)]
    Linear(#[from] LinearError),
    /// Shapes that were left out could not be perceived.
    #[error(transparent)]
    Perceive(#[from] PerceiveError),
}
