//! Scores of classes and rotations for a view from above: log N(z; mean, S) of its hull features, for each direction of the
//! object that may point up, and each turn in the plane by which the view is turned back first.

use super::hull_features::HullFeatures;
use super::viewpoint::{self, TURNS};
use crate::grid::{Dims, HeightMap, Rotation, yaw};
use crate::lanes::{dot, widen_halves};
use crate::model::{DIRECTIONS, ViewDensities};
use crate::perception::densities::packed::{PackedGaussian, log_volume};
use crate::perception::pool::Pool;
use nalgebra::Vector3;
use rayon::prelude::*;
use std::sync::Arc;

/// Rotations that are scored: [`DIRECTIONS`] × [`TURNS`].
pub const CELLS: usize = DIRECTIONS * TURNS;

/// A model's densities, ready for queries.
pub struct ViewScores {
    densities: Arc<ViewDensities>,
    features: HullFeatures,
    rotations: Vec<Rotation>,
}

/// The scores of one view. Keeps its memory from view to view.
#[derive(Default)]
pub struct Screen {
    /// `[direction][class][turn]`.
    scores: Vec<f32>,
    /// Features of the view turned back by each turn, `[turn]` p values.
    features: Vec<f32>,
    /// The same feature by feature.
    by_feature: Vec<[f32; TURNS]>,
    classes: usize,
}

impl Screen {
    /// Score of a class at one of the [`CELLS`] rotations; −∞ for a class that is not wanted.
    pub fn score(&self, class: usize, cell: usize) -> f64 {
        f64::from(self.scores[(cell / TURNS * self.classes + class) * TURNS + cell % TURNS])
    }
}

/// Scratch memory of one task.
pub struct ViewScratch {
    map: HeightMap,
    gaussian: PackedGaussian,
    points: Vec<[f32; TURNS]>,
    centred_points: Vec<[f32; TURNS]>,
    features: Vec<f32>,
    regression: Vec<f32>,
}

impl ViewScratch {
    /// Room for views of one size.
    pub fn new(dims: Dims) -> Self {
        Self {
            map: HeightMap::new(dims),
            gaussian: PackedGaussian::default(),
            points: Vec::new(),
            centred_points: Vec::new(),
            features: Vec::new(),
            regression: Vec::new(),
        }
    }
}

impl ViewScores {
    /// Prepares the densities of a model for grids of this size.
    pub fn new(dims: Dims, densities: Arc<ViewDensities>) -> Self {
        Self { features: HullFeatures::new(dims, densities.size, &densities.basis), rotations: viewpoint::rotations(), densities }
    }

    /// The rotation of one of the [`CELLS`].
    pub fn rotation(&self, cell: usize) -> &Rotation {
        &self.rotations[cell]
    }

    /// Scores of all wanted classes at all rotations.
    pub fn screen(&self, map: &HeightMap, wanted: &[bool], pool: &Pool<ViewScratch>, screen: &mut Screen) {
        let (p, m) = (self.features.size(), wanted.len());
        let Screen { scores, features, by_feature, classes } = screen;
        *classes = m;
        let make = || ViewScratch::new(map.dims());
        features.resize(TURNS * p, 0.0);
        features.par_chunks_exact_mut(p).enumerate().for_each(|(turn, z)| {
            pool.with(make, |scratch| {
                scratch.map.set_turned(map, -viewpoint::angle(turn));
                self.features.project(&scratch.map, z);
            });
        });
        by_feature.clear();
        by_feature.extend((0..p).map(|i| -> [f32; TURNS] { std::array::from_fn(|turn| features[turn * p + i]) }));
        scores.clear();
        scores.resize(DIRECTIONS * m * TURNS, f32::NEG_INFINITY);
        scores.par_chunks_exact_mut(m * TURNS).enumerate().for_each(|(direction, scores)| {
            pool.with(make, |ViewScratch { gaussian, centred_points, .. }| {
                for (class, scores) in scores.chunks_exact_mut(TURNS).enumerate().filter(|(class, _)| wanted[*class]) {
                    self.load(direction, class, m, gaussian);
                    scores.copy_from_slice(&gaussian.log_densities(by_feature, centred_points));
                }
            });
        });
    }

    fn load(&self, direction: usize, class: usize, classes: usize, gaussian: &mut PackedGaussian) {
        let root = self.densities.whitening(direction, class, classes);
        gaussian.load(self.densities.mean(direction, class, classes), root, log_volume(self.features.size(), root));
    }

    /// Score of a class at any rotation, by the density of the nearest direction.
    pub fn score_at(&self, map: &HeightMap, rotation: &Rotation, class: usize, scratch: &mut ViewScratch) -> f64 {
        let (direction, turn) = viewpoint::nearest(rotation);
        let ViewScratch { map: turned, gaussian, points, centred_points, features, .. } = scratch;
        features.resize(self.features.size(), 0.0);
        turned.set_turned(map, -turn);
        self.features.project(turned, features);
        let m = self.densities.classes();
        self.load(direction, class, m, gaussian);
        points.clear();
        points.extend(features.iter().map(|z| [*z; TURNS]));
        f64::from(gaussian.log_densities(points, centred_points)[0])
    }

    /// The rotation of a cell, moved to where the features say that the object is: R_z(ψ) exp(A (z − mean)) F_d.
    pub fn regressed(&self, screen: &Screen, class: usize, cell: usize, scratch: &mut ViewScratch) -> Rotation {
        let (p, m) = (self.features.size(), self.densities.classes());
        let (direction, turn) = (cell / TURNS, cell % TURNS);
        let z = &screen.features[turn * p..(turn + 1) * p];
        let mean = self.densities.mean(direction, class, m);
        let ViewScratch { features: centred, regression: rows, .. } = scratch;
        centred.clear();
        centred.extend(z.iter().zip(mean).map(|(z, mean)| z - mean.to_f32()));
        rows.resize(3 * p, 0.0);
        widen_halves(self.densities.regression(direction, class, m), rows);
        let offset = Vector3::from_fn(|axis, _| f64::from(dot(&rows[axis * p..(axis + 1) * p], centred)));
        let in_plane = yaw(viewpoint::angle(turn));
        in_plane * Rotation::from_scaled_axis(offset) * in_plane.inverse() * self.rotations[cell]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::{Turn, View};
    use crate::model::Searched;
    use crate::perception::pose::small::{model, unseen};

    fn views() -> ViewScores {
        let Searched::Here { views, .. } = &model().searched else { panic!("a model that is searched itself") };
        ViewScores::new(model().dims(), views.clone())
    }

    fn screen(views: &ViewScores, map: &HeightMap, wanted: &[bool]) -> Screen {
        let mut screen = Screen::default();
        views.screen(map, wanted, &Pool::default(), &mut screen);
        screen
    }

    #[test]
    fn a_cell_scores_as_its_rotation_does() {
        let views = views();
        let map = HeightMap::of(&View::Top.of(&unseen("chair", 0)));
        let screen = screen(&views, &map, &[true, false, true]);
        let mut scratch = ViewScratch::new(map.dims());
        for cell in (0..CELLS).step_by(37) {
            let alone = views.score_at(&map, views.rotation(cell), 2, &mut scratch);
            assert!((screen.score(2, cell) - alone).abs() < 1e-3 * alone.abs().max(1.0), "{} {alone}", screen.score(2, cell));
            assert_eq!(screen.score(1, cell), f64::NEG_INFINITY);
        }
    }

    /// The rotation of the query is R = R_z(ψ) E F_d; with the wrong sign of the offset E it would be found farther away than the
    /// cell, with the inverse rotation nowhere near.
    #[test]
    fn the_regression_moves_cells_towards_the_truth() {
        let views = views();
        let (mut before, mut after, mut count) = (0.0, 0.0, 0);
        for seed in 0..6 {
            let object = unseen("chair", seed);
            for cell in (0..CELLS).step_by(331) {
                let tilt = Rotation::from_scaled_axis(Vector3::new(0.08, -0.06, 0.05) * if seed % 2 == 0 { 1.0 } else { -1.0 });
                let truth = tilt * views.rotation(cell);
                let map = HeightMap::of(&View::Top.of(&Turn::new(model().dims(), &truth).occupancy(&object)));
                let screen = screen(&views, &map, &[true; 3]);
                before += views.rotation(cell).angle_to(&truth);
                after += views.regressed(&screen, 0, cell, &mut ViewScratch::new(map.dims())).angle_to(&truth);
                count += 1;
            }
        }
        assert!(after < 0.85 * before, "{} {}", after / f64::from(count), before / f64::from(count));
    }
}
