//! Scores of classes and rotations for a view from above: log N(z; mean, S) of its hull features, for each direction of the
//! object that may point up, and each turn in the plane by which the view is turned back first.

use super::viewpoint::{self, TURNS};
use crate::grid::{HeightMap, Rotation, yaw};
use crate::model::{DIRECTIONS, Model, ViewDensities};
use crate::perception::density::dot;
use crate::perception::lanes::{Kernel, dispatch, multiply_add};
use half::slice::HalfFloatSliceExt;
use nalgebra::Vector3;
use rayon::prelude::*;

use super::hull_features::HullFeatures;

/// Rotations that are scored: [`DIRECTIONS`] × [`TURNS`].
pub const CELLS: usize = DIRECTIONS * TURNS;

/// A model's densities, ready for queries.
pub struct ViewScores {
    features: HullFeatures,
    rotations: Vec<Rotation>,
}

/// The scores of one view.
pub struct Screen {
    /// `[direction][class][turn]`.
    scores: Vec<f32>,
    /// Features of the view turned back by each turn, `[turn]` p values.
    features: Vec<f32>,
    classes: usize,
}

impl Screen {
    /// Score of a class at one of the [`CELLS`] rotations; −∞ for a class that is not wanted.
    pub fn score(&self, class: usize, cell: usize) -> f64 {
        f64::from(self.scores[(cell / TURNS * self.classes + class) * TURNS + cell % TURNS])
    }
}

impl ViewScores {
    /// Prepares the densities of a model.
    pub fn new(model: &Model) -> Self {
        let densities = model.searched_views();
        Self { features: HullFeatures::new(model.dims(), densities.size, &densities.basis), rotations: viewpoint::rotations() }
    }

    /// The rotation of one of the [`CELLS`].
    pub fn rotation(&self, cell: usize) -> &Rotation {
        &self.rotations[cell]
    }

    /// Scores of all wanted classes at all rotations.
    pub fn screen(&self, model: &Model, map: &HeightMap, wanted: &[bool]) -> Screen {
        let (p, m) = (self.features.size(), wanted.len());
        let mut features = vec![0.0; TURNS * p];
        features.par_chunks_exact_mut(p).enumerate().for_each(|(turn, z)| {
            self.features.project(&map.turned(-viewpoint::angle(turn)), z);
        });
        let turned: Vec<[f32; TURNS]> = (0..p).map(|i| std::array::from_fn(|turn| features[turn * p + i])).collect();
        let mut scores = vec![f32::NEG_INFINITY; DIRECTIONS * m * TURNS];
        scores.par_chunks_exact_mut(m * TURNS).enumerate().for_each_init(
            || Scratch::new(p),
            |scratch, (direction, scores)| {
                for (class, scores) in scores.chunks_exact_mut(TURNS).enumerate().filter(|(class, _)| wanted[*class]) {
                    scratch.load(model.searched_views(), direction, class, m);
                    scores.copy_from_slice(&scratch.log_densities(&turned));
                }
            },
        );
        Screen { scores, features, classes: m }
    }

    /// Score of a class at any rotation, by the density of the nearest direction.
    pub fn score_at(&self, model: &Model, map: &HeightMap, rotation: &Rotation, class: usize) -> f64 {
        let (direction, turn) = viewpoint::nearest(rotation);
        let mut z = vec![0.0; self.features.size()];
        self.features.project(&map.turned(-turn), &mut z);
        let mut scratch = Scratch::new(z.len());
        scratch.load(model.searched_views(), direction, class, model.classes.len());
        let turned: Vec<[f32; TURNS]> = z.iter().map(|z| [*z; TURNS]).collect();
        f64::from(scratch.log_densities(&turned)[0])
    }

    /// The rotation of a cell, moved to where the features say that the object is: R_z(ψ) exp(A (z − mean)) F_d.
    pub fn regressed(&self, model: &Model, screen: &Screen, class: usize, cell: usize) -> Rotation {
        let (p, m) = (self.features.size(), model.classes.len());
        let (direction, turn) = (cell / TURNS, cell % TURNS);
        let z = &screen.features[turn * p..(turn + 1) * p];
        let mean = model.searched_views().mean(direction, class, m);
        let centred: Vec<f32> = z.iter().zip(mean).map(|(z, mean)| z - mean.to_f32()).collect();
        let mut rows = vec![0.0; 3 * p];
        model.searched_views().regression(direction, class, m).convert_to_f32_slice(&mut rows);
        let offset = Vector3::from_fn(|axis, _| f64::from(dot(&rows[axis * p..(axis + 1) * p], &centred)));
        let in_plane = yaw(viewpoint::angle(turn));
        in_plane * Rotation::from_scaled_axis(offset) * in_plane.inverse() * self.rotations[cell]
    }
}

/// One density, widened, and what is computed of it.
struct Scratch {
    mean: Vec<f32>,
    whitening: Vec<f32>,
    log_volume: f32,
    centred: Vec<[f32; TURNS]>,
}

impl Scratch {
    fn new(size: usize) -> Self {
        let whitening = vec![0.0; ViewDensities::packed(size)];
        Self { mean: vec![0.0; size], whitening, log_volume: 0.0, centred: vec![[0.0; TURNS]; size] }
    }

    fn load(&mut self, densities: &ViewDensities, direction: usize, class: usize, classes: usize) {
        densities.mean(direction, class, classes).convert_to_f32_slice(&mut self.mean);
        densities.whitening(direction, class, classes).convert_to_f32_slice(&mut self.whitening);
        self.log_volume = (0..self.mean.len()).map(|i| self.whitening[ViewDensities::packed(i + 1) - 1].ln()).sum();
    }

    /// log N(z; mean, S) without the constant of the number of features, for one z per turn; `turned` has a row per feature.
    fn log_densities(&mut self, turned: &[[f32; TURNS]]) -> [f32; TURNS] {
        dispatch(LogDensities(self, turned))
    }
}

/// See [`Scratch::log_densities`].
struct LogDensities<'a>(&'a mut Scratch, &'a [[f32; TURNS]]);

impl Kernel for LogDensities<'_> {
    type Output = [f32; TURNS];

    #[inline(always)]
    fn run<const FUSED: bool>(self) -> [f32; TURNS] {
        let Self(Scratch { mean, whitening, log_volume, centred }, turned) = self;
        for ((centred, z), mean) in centred.iter_mut().zip(turned).zip(&*mean) {
            for (out, z) in centred.iter_mut().zip(z) {
                *out = z - mean;
            }
        }
        let mut sums = [0.0_f32; TURNS];
        let mut rest = &whitening[..];
        for i in 0..centred.len() {
            let (row, tail) = rest.split_at(i + 1);
            rest = tail;
            let mut whitened = [0.0_f32; TURNS];
            for (factor, centred) in row.iter().zip(&*centred) {
                for (sum, v) in whitened.iter_mut().zip(centred) {
                    *sum = multiply_add::<FUSED>(*factor, *v, *sum);
                }
            }
            for (sum, v) in sums.iter_mut().zip(whitened) {
                *sum = multiply_add::<FUSED>(v, v, *sum);
            }
        }
        sums.map(|sum| *log_volume - 0.5 * sum)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::{Turn, View};
    use crate::perception::pose::small::{model, unseen};
    use half::f16;

    /// log N by the textbook, for z = (0.3, −1): S = L Lᵀ with L = [[2, 0], [1, 1]], so L⁻¹ = [[0.5, 0], [−0.5, 1]].
    #[test]
    fn scores_are_log_densities_of_the_dense_gaussian() {
        let half = |values: &[f32]| -> Vec<f16> { values.iter().map(|v| f16::from_f32(*v)).collect() };
        let mean = [1.0_f32, -0.5];
        let densities = ViewDensities {
            size: 2,
            basis: vec![],
            means: half(&[&[9.0, 9.0], &mean[..]].concat()),
            whitening: half(&[1.0, 0.0, 1.0, 0.5, -0.5, 1.0]),
            regression: vec![],
        };
        let mut scratch = Scratch::new(2);
        scratch.load(&densities, 0, 1, 2);
        let mut turned = vec![[0.0; TURNS]; 2];
        (turned[0][5], turned[1][5]) = (0.3, -1.0);
        // S = [[4, 2], [2, 2]], |S| = 4, S⁻¹ = [[0.5, −0.5], [−0.5, 1]], centred (−0.7, −0.5)
        let expected = -0.5 * (4.0_f64.ln() + 0.5 * 0.49 - 0.35 + 0.25);
        assert!((f64::from(scratch.log_densities(&turned)[5]) - expected).abs() < 1e-6);
    }

    #[test]
    fn a_cell_scores_as_its_rotation_does() {
        let (model, views) = (model(), ViewScores::new(model()));
        let map = HeightMap::of(&View::Top.of(&unseen("chair", 0)));
        let screen = views.screen(model, &map, &[true, false, true]);
        for cell in (0..CELLS).step_by(37) {
            let alone = views.score_at(model, &map, views.rotation(cell), 2);
            assert!((screen.score(2, cell) - alone).abs() < 1e-3 * alone.abs().max(1.0), "{} {alone}", screen.score(2, cell));
            assert_eq!(screen.score(1, cell), f64::NEG_INFINITY);
        }
    }

    /// The rotation of the query is R = R_z(ψ) E F_d; with the wrong sign of the offset E it would be found farther away than the
    /// cell, with the inverse rotation nowhere near.
    #[test]
    fn the_regression_moves_cells_towards_the_truth() {
        let (model, views) = (model(), ViewScores::new(model()));
        let (mut before, mut after, mut count) = (0.0, 0.0, 0);
        for seed in 0..6 {
            let object = unseen("chair", seed);
            for cell in (0..CELLS).step_by(331) {
                let tilt = Rotation::from_scaled_axis(Vector3::new(0.08, -0.06, 0.05) * if seed % 2 == 0 { 1.0 } else { -1.0 });
                let truth = tilt * views.rotation(cell);
                let map = HeightMap::of(&View::Top.of(&Turn::new(model.dims(), &truth).occupancy(&object)));
                let screen = views.screen(model, &map, &[true; 3]);
                before += views.rotation(cell).angle_to(&truth);
                after += views.regressed(model, &screen, 0, cell).angle_to(&truth);
                count += 1;
            }
        }
        assert!(after < 0.85 * before, "{} {}", after / f64::from(count), before / f64::from(count));
    }
}
