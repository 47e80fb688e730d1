//! Rotations, which take object axes to grid axes: about z, of the cube, uniform, and their means.

use nalgebra::{Quaternion, Unit, UnitQuaternion, Vector3, Vector4};
use std::f64::consts::{FRAC_PI_2, TAU};

/// A rotation from object axes to grid axes.
pub type Rotation = UnitQuaternion<f64>;

/// The rotation about +z by `angle` radians, counter-clockwise.
pub fn yaw(angle: f64) -> Rotation {
    Rotation::from_axis_angle(&Vector3::z_axis(), angle)
}

/// The angle about +z of a rotation about z, in \[0, 2π); of any other rotation, that of the nearest rotation about z.
pub fn yaw_of(rotation: &Rotation) -> f64 {
    (2.0 * rotation.k.atan2(rotation.w)).rem_euclid(TAU)
}

/// The 24 rotations that map a cube to itself; the identity is the first.
pub fn cube_rotations() -> Vec<Rotation> {
    let quarter = |axis: Unit<Vector3<f64>>, turns: usize| Rotation::from_axis_angle(&axis, turns as f64 * FRAC_PI_2);
    // Where the top face goes, then a turn about the vertical before it goes there.
    let (x, y) = (Vector3::x_axis(), Vector3::y_axis());
    let faces = [quarter(x, 0), quarter(x, 1), quarter(x, 2), quarter(x, 3), quarter(y, 1), quarter(y, 3)];
    faces.iter().flat_map(|face| (0..4).map(move |turns| face * quarter(Vector3::z_axis(), turns))).collect()
}

/// The rotation that three numbers in \[0, 1) stand for; uniform if these are (Shoemake, "Uniform random rotations", Graphics
/// Gems III, 1992).
pub fn uniform_rotation([u, v, w]: [f64; 3]) -> Rotation {
    let ((sin1, cos1), (sin2, cos2)) = ((TAU * v).sin_cos(), (TAU * w).sin_cos());
    let (a, b) = ((1.0 - u).sqrt(), u.sqrt());
    Rotation::from_quaternion(Quaternion::new(b * cos2, a * sin1, a * cos1, b * sin2))
}

/// The rotation of a unit quaternion x, y, z, w, as messages and JSON have them.
pub fn from_xyzw([x, y, z, w]: [f64; 4]) -> Rotation {
    Rotation::from_quaternion(Quaternion::new(w, x, y, z))
}

/// Its unit quaternion x, y, z, w.
pub fn to_xyzw(rotation: &Rotation) -> [f64; 4] {
    rotation.coords.into()
}

/// The mean of weighted rotations that lie near `middle`, by their quaternions; `middle` where nothing has weight.
pub fn mean_rotation(middle: &Rotation, weighted: impl Iterator<Item = (Rotation, f64)>) -> Rotation {
    // q and −q are the same rotation: the one on the side of the middle is added.
    let sum = weighted.fold(Vector4::zeros(), |sum, (rotation, weight)| {
        let q = rotation.coords;
        sum + q * (weight * q.dot(&middle.coords).signum())
    });
    if sum.norm() > 0.0 { Rotation::from_quaternion(Quaternion::from(sum)) } else { *middle }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn quaternions_are_x_y_z_w() {
        let rotation = Rotation::from_euler_angles(0.1, -0.4, 2.0);
        assert_eq!(to_xyzw(&rotation), [rotation.i, rotation.j, rotation.k, rotation.w]);
        assert!(from_xyzw(to_xyzw(&rotation)).angle_to(&rotation) < 1e-9);
    }

    #[test]
    fn uniform_numbers_give_uniform_rotations() {
        // Over SO(3) the angle from any rotation has density (1 − cos θ) / π: half of it below 2.31 radians or so.
        let n = 24;
        let number = |i: usize| (i as f64 + 0.5) / n as f64;
        let all = (0..n * n * n).map(|i| uniform_rotation([number(i / n / n), number(i / n % n), number(i % n)]));
        let from = yaw(1.0);
        let median = 2.309_881_460_010_057;
        let below = all.filter(|r| r.angle_to(&from) < median).count() as f64 / (n * n * n) as f64;
        // A lattice of numbers is not quite even.
        assert!((below - 0.5).abs() < 0.02, "{below}");
    }

    proptest! {
        #[test]
        fn the_yaw_of_a_rotation_about_z_is_its_angle(angle in 0.0..6.2_f64) {
            prop_assert!((yaw_of(&yaw(angle)) - angle).abs() < 1e-9);
        }
    }
}
