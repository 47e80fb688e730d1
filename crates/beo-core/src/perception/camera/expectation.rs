//! What is expected of an object that was answered in the frame before, against what a view shows.

use super::refinement::Parameters;
use super::scores::wrapped;
use super::{Cell, PlacementPrior, SEEN, ViewFrame};
use crate::grid::yaw_of;
use crate::perception::query::ExpectedPlacement;

/// From frame to frame an object turns by about ten degrees: radians …
const TURNS_RAD: f64 = 0.175;
/// … moves by this share of the longest side of what is seen, …
const MOVES: f64 = 0.05;
/// … and is as large as it was: the logarithm of its size is expected no more sharply than this, as errors of frames of one object are alike.
const SAME_SIZE: f64 = 0.03;
/// What is seen of the same object is as large as before, within this logarithm: else it is another, or something hides it now.
const SEEN_CHANGES: f64 = 0.2;

/// An expectation in the view's frame.
#[derive(Clone, Copy, Debug)]
pub struct Expectation {
    /// As it was answered.
    pub answered: ExpectedPlacement,
    /// Where yaw, size and place are expected.
    pub parameters: Parameters,
    /// Their standard deviations; infinite where nothing is expected.
    pub deviations: Parameters,
}

impl Expectation {
    /// What was answered, in the frame of a view of the object; `None` where so much more or less is seen than before that it cannot count.
    pub fn new(answered: &ExpectedPlacement, frame: &ViewFrame, cell_resting: &crate::grid::Rotation) -> Option<Self> {
        let side = frame.unit * SEEN;
        let is_alike = (side / answered.seen_side_voxels).ln().abs() < SEEN_CHANGES;
        let (rotation, scale, place) = frame.seen(&answered.placed);
        let moves = MOVES * SEEN;
        let placed = (answered.place_deviation_voxels / frame.unit).hypot(moves);
        is_alike.then(|| Self {
            answered: *answered,
            parameters: [yaw_of(&(rotation * cell_resting.inverse())), scale.ln(), place.x, place.y, place.z],
            deviations: [TURNS_RAD, answered.log_scale_deviation.max(SAME_SIZE), placed, placed, placed],
        })
    }

    /// Of the size alone: where an object is searched everywhere, it may have turned and moved, but has not grown.
    pub fn of_size(self) -> Self {
        let mut deviations = [f64::INFINITY; 5];
        deviations[1] = self.deviations[1];
        Self { deviations, ..self }
    }

    /// Whether a cell is of the expected class and component.
    pub fn is_of(&self, cell: &Cell) -> bool {
        (cell.class, cell.component) == (self.answered.class, self.answered.component)
    }

    /// Both expectations: a product of Gaussians. Of the size, whose errors are alike from frame to frame, it is their covariance intersection
    /// with equal weights (Julier and Uhlmann, "A non-divergent estimation algorithm in the presence of unknown correlations", 1997), which is
    /// no surer than the surer of the two.
    pub fn narrow(&self, prior: &mut PlacementPrior) {
        for axis in 0..prior.expected.len() {
            let (own, other) = (prior.deviations[axis], self.deviations[axis]);
            if own == 0.0 || other.is_infinite() {
                continue;
            }
            let share = if axis == 1 { 0.5 } else { 1.0 };
            let (a, b) = (share / own.powi(2), share / other.powi(2));
            let apart = self.parameters[axis] - prior.expected[axis];
            let apart = if axis == 0 { wrapped(apart) } else { apart };
            prior.expected[axis] += b / (a + b) * apart;
            prior.deviations[axis] = (a + b).sqrt().recip();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::{Rotation, Similarity};
    use crate::perception::camera::camera_search::tests_support::seen_chair;
    use std::f64::consts::TAU;

    fn answered(frame: &ViewFrame) -> ExpectedPlacement {
        ExpectedPlacement {
            class: 0,
            component: 0,
            placed: frame.placed(0.3, 0.9, &nalgebra::Vector3::new(1.0, -0.5, 0.2)),
            log_scale_deviation: 0.05,
            place_deviation_voxels: 0.0,
            seen_side_voxels: SEEN * frame.unit,
            log_evidence_per_voxel: 1.0,
            frames_since_search: 0,
        }
    }

    fn frame() -> ViewFrame {
        let (observation, camera) = seen_chair();
        ViewFrame::new(&observation, &camera, &mut Vec::new()).unwrap()
    }

    #[test]
    fn an_answer_is_expected_where_it_was_and_not_where_much_less_is_seen() {
        let frame = frame();
        let found = Expectation::new(&answered(&frame), &frame, &Rotation::identity()).unwrap();
        let expected = [0.3, 0.9_f64.ln(), 1.0, -0.5, 0.2];
        assert!(found.parameters.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-9), "{:?}", found.parameters);
        let larger = ExpectedPlacement { seen_side_voxels: 1.3 * SEEN * frame.unit, ..answered(&frame) };
        assert!(Expectation::new(&larger, &frame, &Rotation::identity()).is_none());
        // A thing that lies is turned about the vertical all the same.
        let lying = Rotation::from_euler_angles(std::f64::consts::FRAC_PI_2, 0.0, 0.0);
        let placed = Similarity { rotation: answered(&frame).placed.rotation * lying, ..answered(&frame).placed };
        let found = Expectation::new(&ExpectedPlacement { placed, ..answered(&frame) }, &frame, &lying).unwrap();
        assert!((found.parameters[0] - 0.3).abs() < 1e-9);
    }

    #[test]
    fn two_gaussians_become_their_product_and_of_the_size_their_covariance_intersection() {
        let frame = frame();
        let expectation = Expectation {
            answered: answered(&frame),
            parameters: [0.1, 0.2, 1.0, 0.0, 5.0],
            deviations: [0.2, 0.05, 1.0, f64::INFINITY, 1.0],
        };
        let mut prior = PlacementPrior { expected: [TAU, 0.0, 0.0, 0.0, 2.0], deviations: [0.2, 0.05, 2.0, 1.0, 0.0] };
        expectation.narrow(&mut prior);
        let near = |a: f64, b: f64| (a - b).abs() < 1e-12;
        // Across the full turn; half way, as both are as sure.
        assert!(near(prior.expected[0], TAU + 0.05) && near(prior.deviations[0], 0.2 / 2_f64.sqrt()));
        assert!(near(prior.expected[1], 0.1) && near(prior.deviations[1], 0.05), "no surer than either");
        assert!(near(prior.expected[2], 0.8) && near(prior.deviations[2], (1.0_f64 + 0.25).sqrt().recip()));
        assert_eq!((prior.expected[3], prior.deviations[3]), (0.0, 1.0), "nothing is expected");
        assert_eq!((prior.expected[4], prior.deviations[4]), (2.0, 0.0), "what is told stays");
    }
}
