//! Where the camera stands and what it looks at.

use nalgebra::{Isometry3, Matrix3, Point3, Rotation3, Translation3, UnitQuaternion, Vector3};

/// Takes the optical frame (x right, y down, z ahead) of a camera at `eye` that looks at `target` to the frame in which these are given;
/// `up` points up in the image. Where `up` says nothing (parallel to the line of sight, or zero), another axis takes its place; where
/// `eye` and `target` coincide, the camera looks along +x.
pub fn look_at(eye: &Point3<f64>, target: &Point3<f64>, up: &Vector3<f64>) -> Isometry3<f64> {
    let z = (target - eye).try_normalize(1e-12).unwrap_or_else(Vector3::x);
    let ups = [up.try_normalize(1e-12).unwrap_or_else(Vector3::z), Vector3::y(), Vector3::x()];
    let right = ups.iter().find_map(|up| z.cross(up).try_normalize(1e-6));
    let x = right.expect("of two different axes one is not parallel to the line of sight");
    let axes = Matrix3::from_columns(&[x, z.cross(&x), z]);
    let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(axes));
    Isometry3::from_parts(Translation3::from(eye.coords), rotation)
}

/// A camera `distance_m` metres from `target`, `elevation_rad` above its horizontal plane and at `azimuth_rad` counter-clockwise from +x
/// about z; it looks at `target`, z up in the image.
pub fn orbit(target: &Point3<f64>, distance_m: f64, azimuth_rad: f64, elevation_rad: f64) -> Isometry3<f64> {
    let ((sin_a, cos_a), (sin_e, cos_e)) = (azimuth_rad.sin_cos(), elevation_rad.sin_cos());
    let eye = target + distance_m * Vector3::new(cos_e * cos_a, cos_e * sin_a, sin_e);
    look_at(&eye, target, &Vector3::z())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_target_lies_on_the_optical_axis_and_up_is_up_in_the_image() {
        let (eye, target) = (Point3::new(1.0, -2.0, 0.7), Point3::new(0.3, 0.4, 0.1));
        let camera = look_at(&eye, &target, &Vector3::z());
        let seen = camera.inverse_transform_point(&target);
        assert!((seen - Point3::new(0.0, 0.0, (target - eye).norm())).norm() < 1e-12);
        let above = camera.inverse_transform_point(&(target + Vector3::z()));
        assert!(above.x.abs() < 1e-12 && above.y < -0.1, "y points down");
        // To the right of someone who looks along +y is +x.
        let right = look_at(&Point3::origin(), &Point3::new(0.0, 1.0, 0.0), &Vector3::z()).inverse_transform_vector(&Vector3::x());
        assert!((right - Vector3::x()).norm() < 1e-12);
    }

    #[test]
    fn a_circling_camera_is_where_its_angles_say() {
        let target = Point3::new(0.1, 0.2, 0.3);
        let camera = orbit(&target, 2.0, 30_f64.to_radians(), 45_f64.to_radians());
        let eye = camera.translation.vector - target.coords;
        assert!((eye.norm() - 2.0).abs() < 1e-12 && (eye.z - 2_f64.sqrt()).abs() < 1e-12);
        assert!((eye.y.atan2(eye.x).to_degrees() - 30.0).abs() < 1e-9);
    }

    #[test]
    fn a_view_from_straight_above_has_a_rotation() {
        for eye in [[0.0, 0.0, 1.0], [0.0, 0.0, -1.0], [0.0, 0.0, 0.0]] {
            let camera = look_at(&Point3::from(eye), &Point3::origin(), &Vector3::z());
            assert!((camera.rotation.norm() - 1.0).abs() < 1e-12 && camera.to_homogeneous().iter().all(|v| v.is_finite()));
        }
        let above = look_at(&Point3::new(0.0, 0.0, 1.0), &Point3::origin(), &Vector3::z());
        assert!((above.inverse_transform_vector(&Vector3::y()) - Vector3::new(0.0, -1.0, 0.0)).norm() < 1e-12);
    }
}
