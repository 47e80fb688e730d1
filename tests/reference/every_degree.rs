//! Class and yaw by exhaustive search: the hull's density at every whole degree.
//!
//! log t(z) − ½ (‖h‖² − ‖z‖²): the density of the projection z of the hull h turned back by the angle, and what h has outside of
//! W' with unit variance. Angles are compared with one covariance for all classes, classes each with its own at the angles that
//! are the best of some class.

use crate::class::Reference;
use crate::known_pose::{hull, softmax};
use beo_core::grid::{Observation, Outside, Turn, yaw};
use nalgebra::DMatrix;

const DEGREES: usize = 360;

/// Class posterior, and the most probable degree of each class.
pub struct EveryDegree {
    pub posterior: Vec<f64>,
    pub best: Vec<usize>,
}

impl Reference {
    /// Searches the whole circle.
    pub fn every_degree(&self, observation: &Observation) -> EveryDegree {
        let dims = observation.dims();
        let back = |degree: usize| {
            let rotation = yaw(-(degree as f64).to_radians());
            hull(&Turn::new(dims, &rotation).observation(observation, Outside::Empty))
        };
        let hulls = DMatrix::from_columns(&(0..DEGREES).map(back).collect::<Vec<_>>());
        let projected = &self.basis * &hulls;
        let inside = projected.column_iter().zip(hulls.column_iter());
        let outside: Vec<f64> = inside.map(|(z, hull)| -0.5 * (hull.norm_squared() - z.norm_squared())).collect();
        let best = |density: &crate::class::Student| {
            let scores: Vec<f64> =
                density.log_densities(&projected).iter().zip(&outside).map(|(inside, outside)| inside + outside).collect();
            (0..DEGREES).max_by(|a, b| scores[*a].total_cmp(&scores[*b])).unwrap()
        };
        let best: Vec<usize> = self.common.iter().map(best).collect();
        let blend = &self.model.metadata.calibration.hull;
        let score = |s: usize| {
            let densities = self.classes[s].hull.log_densities(&projected.select_columns(&best));
            let scores = densities.iter().zip(&best).map(|(inside, degree)| inside + outside[*degree]);
            blend.hull * scores.fold(f64::NEG_INFINITY, f64::max) + blend.offsets[s]
        };
        EveryDegree { posterior: softmax((0..self.classes.len()).map(score)), best }
    }
}
