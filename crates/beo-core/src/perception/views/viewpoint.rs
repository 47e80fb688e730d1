//! Rotations seen from above: which direction of the object points up, and how it is turned in the image plane.
//!
//! Any rotation is R = R_z(ψ) E F_d: F_d takes the direction d of the object to +z, E is small, ψ is the turn in the plane. An
//! observation from above, turned by −ψ, looks like the object turned by E F_d. So one set of densities per direction serves
//! all turns.

use crate::grid::{Rotation, yaw};
use crate::model::DIRECTIONS;
use nalgebra::{Matrix3, Rotation3, Vector3};
use std::f64::consts::{PI, TAU};

/// Turns in the plane.
pub const TURNS: usize = 24;

/// The directions: a Fibonacci spiral over the sphere, so that each stands for about the same area, 4π / `DIRECTIONS`.
pub fn direction(index: usize) -> Vector3<f64> {
    let at = index as f64 + 0.5;
    let z = 1.0 - 2.0 * at / DIRECTIONS as f64;
    let (sin, cos) = (PI * (1.0 + 5.0_f64.sqrt()) * at).sin_cos();
    let radius = (1.0 - z * z).sqrt();
    Vector3::new(radius * cos, radius * sin, z)
}

/// F_d of a direction: takes it to +z.
pub fn frame(index: usize) -> Rotation {
    let up = direction(index);
    let aside = if up.z.abs() < 0.9 { Vector3::z() } else { Vector3::x() };
    let x = aside.cross(&up).normalize();
    let y = up.cross(&x);
    let rows = Matrix3::from_rows(&[x.transpose(), y.transpose(), up.transpose()]);
    Rotation::from_rotation_matrix(&Rotation3::from_matrix_unchecked(rows))
}

/// The angle of a turn in the plane, radians.
pub fn angle(turn: usize) -> f64 {
    turn as f64 * TAU / TURNS as f64
}

/// All rotations R_z(ψ) F_d, `[direction][turn]`.
pub fn rotations() -> Vec<Rotation> {
    (0..DIRECTIONS).flat_map(|d| (0..TURNS).map(move |turn| yaw(angle(turn)) * frame(d))).collect()
}

/// The direction nearest to that which `rotation` takes to +z, and the turn ψ for which E = R_z(−ψ) R F_d⁻¹ has no part about z.
pub fn nearest(rotation: &Rotation) -> (usize, f64) {
    let up = rotation.inverse() * Vector3::z();
    let closeness = |d: usize| direction(d).dot(&up);
    let best = (0..DIRECTIONS).fold(0, |best, d| if closeness(d) > closeness(best) { d } else { best });
    (best, crate::grid::yaw_of(&(rotation * frame(best).inverse())))
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Quaternion;
    use proptest::prelude::*;

    #[test]
    fn frames_take_their_direction_up() {
        for d in 0..DIRECTIONS {
            assert!((frame(d) * direction(d) - Vector3::z()).norm() < 1e-12);
        }
    }

    proptest! {
        #[test]
        fn any_rotation_is_a_turn_after_a_tilt_after_a_frame(q in prop::array::uniform4(-1.0..1.0_f64)) {
            prop_assume!(q.iter().map(|v| v * v).sum::<f64>() > 0.01);
            let rotation = Rotation::from_quaternion(Quaternion::new(q[0], q[1], q[2], q[3]));
            let (d, turn) = nearest(&rotation);
            let tilt = (yaw(-turn) * rotation * frame(d).inverse()).scaled_axis();
            prop_assert!(tilt.z.abs() < 1e-9, "{}", tilt);
            // Radius of a disc of that area is 8.3 degrees; the farthest corner is not much farther.
            prop_assert!(tilt.norm() < 0.2, "{}", tilt.norm());
            let one = rotations().into_iter().map(|r| r.angle_to(&rotation)).fold(f64::INFINITY, f64::min);
            prop_assert!(one < 0.24, "{}", one);
        }
    }
}
