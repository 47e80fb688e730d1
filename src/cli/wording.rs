//! Answers in words, for people.

use beo_core::grid::{Rotation, yaw_of};

/// A rotation for people: its angle, its axis unless that is z, and how far the posterior spreads.
pub fn describe_pose(rotation: &Rotation, spread: f64) -> String {
    let spread = spread.to_degrees();
    let about_z = rotation.i.abs().max(rotation.j.abs()) < 1e-6;
    match rotation.axis_angle() {
        Some((axis, angle)) if !about_z => {
            let [x, y, z] = [axis.x, axis.y, axis.z];
            format!("turned by {:.0}° about ({x:.2}, {y:.2}, {z:.2}) ± {spread:.0}°", angle.to_degrees())
        }
        _ => format!("turned by {:.0}° ± {spread:.0}°", yaw_of(rotation).to_degrees()),
    }
}
