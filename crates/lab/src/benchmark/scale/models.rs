//! Models learned in memory from made-up shapes.

use super::shapes;
use beo_core::grid::{Dims, Observation, View};
use beo_core::learning::{Shape, ShapeSet};
use beo_core::learning::{TrainError, TrainOptions, train};
use beo_core::model::Model;
use rayon::prelude::*;

/// The sizes that a model is made of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Recipe {
    /// Voxels along each side of the grid, 8 to 256.
    pub resolution: usize,
    /// Number of classes, at least one.
    pub classes: usize,
    /// Components of each class.
    pub basis: usize,
    /// ShapeSet of each class; `None` for as many as the components ask for.
    pub shapes: Option<usize>,
}

/// A class has this many shapes for each component, and some more: also the half that is left of them in cross-validation then
/// has more shapes than components, and so something that these do not explain, the noise.
const SHAPES: usize = 2;
const MORE_SHAPES: usize = 6;

impl std::fmt::Display for Recipe {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{} classes, {} components of each, {}", self.classes, self.basis, self.dims())
    }
}

impl Recipe {
    /// Size of the grids.
    pub fn dims(&self) -> Dims {
        Dims::cube(self.resolution).expect("sizes of the sweeps are valid")
    }

    /// Learns it; the same recipe gives the same model.
    pub fn learn(&self) -> Result<Model, TrainError> {
        self.learn_from(&self.shapes())
    }

    /// The shapes that it is learned from.
    pub fn shapes(&self) -> ShapeSet {
        let dims = self.dims();
        let count = self.shapes.unwrap_or(SHAPES * self.basis + MORE_SHAPES);
        let make = |i: usize| {
            let (class, number) = (i / count, i % count);
            Shape { object: shapes::make(dims, class, number as u64), class, file: format!("{class}/{number}") }
        };
        ShapeSet {
            classes: (0..self.classes).map(|class| format!("class-{class:02}")).collect(),
            shapes: (0..self.classes * count).into_par_iter().map(make).collect(),
            ..ShapeSet::default()
        }
    }

    /// Learns from these shapes.
    pub fn learn_from(&self, shapes: &ShapeSet) -> Result<Model, TrainError> {
        let options = TrainOptions { basis_range: [self.basis, self.basis], folds: 2, ..TrainOptions::default() };
        train(shapes, &options, &|_| ())
    }

    /// Views from above of shapes that the model has not learned from, one class after the other.
    pub fn observations(&self, count: usize) -> Vec<Observation> {
        let unseen = |i: usize| shapes::make(self.dims(), i % self.classes, 1_000_000 + i as u64);
        (0..count).into_par_iter().map(|i| View::Top.of(&unseen(i))).collect()
    }
}
