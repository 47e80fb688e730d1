//! The covariance of a pose from a percept, as ROS has it: x, y, z and the rotations about the fixed axes X, Y, Z of the message's frame.
//!
//! Of the place: R diag(σ²) Rᵀ, σ the deviations along the grid's axes and R the grid's rotation. Of the rotation, about hypothesis k of its
//! class: Σⱼ wⱼ vⱼ vⱼᵀ, vⱼ the rotation vector from k to hypothesis j and wⱼ its share of the class's probability; what the percept's
//! expected angle exceeds that of its hypotheses by lies about the vertical, the axis about which poses are searched densest. Nothing is
//! surer than the grid: half a voxel's uniform deviation is added to both. Place and rotation are taken to be independent.

use beo_ipc::{Hypothesis, Percept};
use nalgebra::{Matrix3, Quaternion, UnitQuaternion, Vector3};

/// The deviation of what is uniform over a voxel's edge, as a share of it: 1/√12.
const UNIFORM: f64 = 0.288_675_134_594_812_9;
/// The mean of |θ| of a normal θ, as a share of its deviation: √(2/π).
const MEAN_OF_NORMAL: f64 = 0.797_884_560_802_865_4;
/// Nothing is known of a rotation: that of the uniform distribution about each axis, π/√3.
const UNKNOWN_RAD: f64 = 1.813_799_364_234_217_8;

/// A rotation of a message, x, y, z, w; the identity where it is none.
pub fn rotation(xyzw: [f64; 4]) -> UnitQuaternion<f64> {
    let [x, y, z, w] = xyzw;
    UnitQuaternion::try_new(Quaternion::new(w, x, y, z), 1e-6).unwrap_or_default()
}

/// The hypotheses of a percept that are used.
pub fn hypotheses(percept: &Percept) -> &[Hypothesis] {
    &percept.hypotheses[..(percept.hypothesis_count as usize).min(percept.hypotheses.len())]
}

/// The rotation of a hypothesis from object axes to those of the percept's frame.
pub fn rotation_object_to_frame(percept: &Percept, hypothesis: &Hypothesis) -> UnitQuaternion<f64> {
    rotation(percept.orientation) * rotation(hypothesis.rotation_object_to_grid.map(f64::from))
}

/// The 6 × 6 covariance, row by row, of the pose of one hypothesis; of none, the rotation is unknown.
pub fn covariance(percept: &Percept, about: Option<&Hypothesis>) -> [f64; 36] {
    let (place, rotation) = (of_place(percept), about.map_or_else(unknown, |about| of_rotation(percept, about)));
    let mut covariance = [0.0; 36];
    for row in 0..3 {
        for column in 0..3 {
            covariance[6 * row + column] = place[(row, column)];
            covariance[6 * (row + 3) + column + 3] = rotation[(row, column)];
        }
    }
    covariance
}

fn unknown() -> Matrix3<f64> {
    Matrix3::identity() * UNKNOWN_RAD.powi(2)
}

fn of_place(percept: &Percept) -> Matrix3<f64> {
    let turn = rotation(percept.orientation).to_rotation_matrix();
    let deviation = Vector3::from(percept.object_position_deviation_m.map(f64::from));
    let grid = (f64::from(percept.voxel_size_m) * UNIFORM).powi(2);
    turn * Matrix3::from_diagonal(&deviation.map(|side| side * side + grid)) * turn.transpose()
}

fn of_rotation(percept: &Percept, about: &Hypothesis) -> Matrix3<f64> {
    let centre = rotation_object_to_frame(percept, about);
    let of_class: Vec<_> = hypotheses(percept).iter().filter(|other| other.class_index == about.class_index).collect();
    let all: f64 = of_class.iter().map(|other| f64::from(other.probability)).sum();
    let (mut covariance, mut angle) = (Matrix3::zeros(), 0.0);
    for other in of_class.iter().filter(|_| all > 0.0) {
        let vector = (rotation_object_to_frame(percept, other) * centre.inverse()).scaled_axis();
        let share = f64::from(other.probability) / all;
        covariance += vector * vector.transpose() * share;
        angle += vector.norm() * share;
    }
    let vertical = rotation(percept.orientation) * Vector3::z();
    let beyond = (f64::from(percept.rotation_spread_rad) - angle).max(0.0) / MEAN_OF_NORMAL;
    covariance += vertical * vertical.transpose() * beyond.min(UNKNOWN_RAD).powi(2);
    covariance + Matrix3::identity() * resolution_rad(percept).powi(2)
}

/// The angle by which the object's rim moves by a voxel's deviation.
fn resolution_rad(percept: &Percept) -> f64 {
    let longest = percept.object_extent_m.into_iter().fold(0.0_f32, f32::max);
    let across = percept.dims.into_iter().max().unwrap_or(1).max(1) as f32;
    let voxels = if longest > 0.0 && percept.voxel_size_m > 0.0 { longest / percept.voxel_size_m } else { across };
    (2.0 * UNIFORM / f64::from(voxels)).min(UNKNOWN_RAD)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::PI;

    fn percept() -> Percept {
        Percept {
            orientation: [0.0, 0.0, 0.0, 1.0],
            voxel_size_m: 0.01,
            dims: [30; 3],
            object_extent_m: [0.1, 0.2, 0.1],
            object_position_deviation_m: [0.01, 0.02, 0.03],
            ..Percept::EMPTY
        }
    }

    fn about_z(angle: f64, probability: f32) -> Hypothesis {
        let half = 0.5 * angle;
        Hypothesis { rotation_object_to_grid: [0.0, 0.0, half.sin() as f32, half.cos() as f32], class_index: 2, probability }
    }

    #[test]
    fn the_place_is_as_sure_as_the_posterior_and_no_surer_than_a_voxel() {
        let uniform = 0.01_f64.powi(2) / 12.0;
        let straight = covariance(&percept(), None);
        for (at, deviation) in [(0, 0.01_f64), (7, 0.02), (14, 0.03)] {
            assert!((straight[at] - deviation.powi(2) - uniform).abs() < 1e-8, "{at}: {}", straight[at]);
        }
        // A quarter turn about x swaps y and z.
        let half = std::f64::consts::FRAC_1_SQRT_2;
        let turned = covariance(&Percept { orientation: [half, 0.0, 0.0, half], ..percept() }, None);
        assert!((turned[7] - straight[14]).abs() < 1e-8 && (turned[14] - straight[7]).abs() < 1e-8);
        let unsearched = covariance(&Percept { object_position_deviation_m: [0.0; 3], ..percept() }, None);
        assert!((unsearched[0] - uniform).abs() < 1e-12);
        // Uniform over a circle: π²/3.
        assert!((straight[35] - PI * PI / 3.0).abs() < 1e-9);
    }

    #[test]
    fn two_hypotheses_a_quarter_turn_apart_spread_about_their_axis_alone() {
        let mut percept = percept();
        (percept.hypotheses[0], percept.hypotheses[1]) = (about_z(0.2, 0.6), about_z(0.2 + PI / 2.0, 0.2));
        // Of another class: it counts for neither.
        percept.hypotheses[2] = Hypothesis { class_index: 1, ..about_z(3.0, 0.2) };
        (percept.hypothesis_count, percept.rotation_spread_rad) = (3, 0.1);
        let floor = (0.01 / (2.0 * 3.0_f64.sqrt()) / 0.1).powi(2);
        let found = covariance(&percept, Some(&percept.hypotheses[0]));
        assert!((found[35] - 0.25 * (PI / 2.0).powi(2) - floor).abs() < 1e-6, "{}", found[35]);
        assert!((found[21] - floor).abs() < 1e-6 && (found[28] - floor).abs() < 1e-6);
        let other = covariance(&percept, Some(&percept.hypotheses[1]));
        assert!((other[35] - 0.75 * (PI / 2.0).powi(2) - floor).abs() < 1e-6);
    }

    #[test]
    fn whatever_a_percept_says_the_covariance_is_finite_symmetric_and_positive() {
        let mut odd = percept();
        odd.hypothesis_count = u32::MAX;
        odd.orientation = [0.0; 4];
        odd.object_extent_m = [0.0; 3];
        odd.rotation_spread_rad = 3.0;
        let mut turned = percept();
        turned.orientation = [0.1, 0.7, -0.1, 0.7];
        turned.rotation_spread_rad = 0.4;
        (turned.hypotheses[0], turned.hypothesis_count) = (about_z(1.0, 1.0), 1);
        for percept in [odd, turned] {
            let found = nalgebra::SMatrix::<f64, 6, 6>::from_row_slice(&covariance(&percept, Some(&percept.hypotheses[0])));
            assert!(found.iter().all(|value| value.is_finite()));
            assert!((found - found.transpose()).amax() < 1e-15);
            assert!(found.symmetric_eigenvalues().min() > 0.0, "{found}");
        }
    }
}
