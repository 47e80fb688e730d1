//! Models learned in memory from made-up shapes.

use super::shapes;
use beo_core::grid::{Dims, Observation, Turn, View, yaw};
use beo_core::learning::{Shape, ShapeSet};
use beo_core::learning::{TrainError, TrainOptions, train};
use beo_core::model::Model;
use beo_core::simulation::{self, Eye};
use nalgebra::Vector3;
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

    /// Learns it with densities of what cameras see.
    pub fn learn_cameras(&self) -> Result<Model, TrainError> {
        let options = TrainOptions {
            basis_range: [self.basis, self.basis],
            folds: 2,
            camera_elevations_deg: vec![20.0, 45.0],
            ..TrainOptions::default()
        };
        train(&self.shapes(), &options, &|_| ())
    }

    /// What a camera at thirty degrees sees of shapes that the model has not learned from, turned about the vertical, and where it is in voxels
    /// from the grid's centre.
    pub fn camera_observations(&self, count: usize) -> (Vec<Observation>, Vector3<f64>) {
        let eye = Eye { azimuth: 0.0, elevation: std::f64::consts::PI / 6.0, distance: 4.0 * self.resolution as f64 };
        let seen = |i: usize| {
            let object = shapes::make(self.dims(), i % self.classes, 1_000_000 + i as u64);
            simulation::observe(&Turn::new(self.dims(), &yaw(0.7 * i as f64)).occupancy(&object), &eye)
        };
        ((0..count).into_par_iter().map(seen).collect(), eye.position())
    }

    /// Views from above of shapes that the model has not learned from, one class after the other.
    pub fn observations(&self, count: usize) -> Vec<Observation> {
        let unseen = |i: usize| shapes::make(self.dims(), i % self.classes, 1_000_000 + i as u64);
        (0..count).into_par_iter().map(|i| View::Top.of(&unseen(i))).collect()
    }
}
