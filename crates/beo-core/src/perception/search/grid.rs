//! Rotations spread evenly over SO(3): super-Fibonacci spirals (Alexa, "Super-Fibonacci spirals: fast, low-discrepancy
//! sampling of SO(3)", CVPR 2022).

use crate::grid::Rotation;
use nalgebra::Quaternion;
use std::f64::consts::{PI, SQRT_2, TAU};

/// ψ⁴ = ψ + 4.
const PSI: f64 = 1.533_751_168_755_204_3;

/// `count` rotations, in a fixed order.
pub fn rotations(count: usize) -> impl ExactSizeIterator<Item = Rotation> {
    (0..count).map(move |i| {
        let s = i as f64 + 0.5;
        let t = s / count as f64;
        let (inner, outer) = (t.sqrt(), (1.0 - t).sqrt());
        let (a, b) = (TAU * s / SQRT_2, TAU * s / PSI);
        Rotation::from_quaternion(Quaternion::new(outer * b.cos(), inner * a.sin(), inner * a.cos(), outer * b.sin()))
    })
}

/// How many rotations have cells as large as a cube with edges of `step` radians: the volume of SO(3) is 8π².
pub fn count_for(step: f64) -> usize {
    (8.0 * PI * PI / step.powi(3)).ceil() as usize
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]
        /// A cube with edge s has its corners at s √3 / 2 from its centre.
        #[test]
        fn every_rotation_has_one_of_the_grid_nearby(q in prop::array::uniform4(-1.0..1.0_f64)) {
            prop_assume!(q.iter().map(|v| v * v).sum::<f64>() > 0.01);
            let q = Rotation::from_quaternion(Quaternion::new(q[0], q[1], q[2], q[3]));
            let step = 20_f64.to_radians();
            let nearest = rotations(count_for(step)).map(|r| r.angle_to(&q)).fold(f64::INFINITY, f64::min);
            prop_assert!(nearest < step, "{}", nearest.to_degrees());
        }
    }

    #[test]
    fn cells_are_alike() {
        // Each of the 24 rotations of the cube has about as many of the grid within 30 degrees as any other.
        let grid: Vec<Rotation> = rotations(count_for(10_f64.to_radians())).collect();
        let expected = grid.len() as f64 * (PI / 6.0 - (PI / 6.0).sin()) / PI;
        for q in grid.iter().step_by(997) {
            let near = grid.iter().filter(|r| r.angle_to(q) < PI / 6.0).count() as f64;
            assert!((near / expected - 1.0).abs() < 0.1, "{near} {expected}");
        }
    }
}
