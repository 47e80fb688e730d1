//! Where the aligned shapes of a class come to lie: about the origin of the unit cube, along its axes.

use super::settings::{AlignmentSettings, LONGEST};
use super::solid::{Solid, principal};
use super::transform::ShapeSimilarity;
use beo_core::grid::Rotation;
use nalgebra::{Matrix3, Vector3};

/// The similarity that takes all aligned shapes to the unit cube: the longest principal axis of the mean shape along x, the shortest along
/// z; the half turns that leaves open are chosen so that the shapes reach out farther towards +x and +y; with up kept, the longer horizontal axis along x. Then the mean of the longest
/// sides is [`LONGEST`], and the mean of the boxes' centres is the origin. All are made smaller where one would leave the cube.
pub(super) fn to_unit_cube(solids: &[Solid], placements: &[ShapeSimilarity], settings: &AlignmentSettings) -> ShapeSimilarity {
    into_cube(solids, placements, ShapeSimilarity::turning(orientation(solids, placements, settings.keep_up)))
}

/// The similarity after `turn` that brings the shapes into the cube.
pub(super) fn into_cube(solids: &[Solid], placements: &[ShapeSimilarity], turn: ShapeSimilarity) -> ShapeSimilarity {
    let count = solids.len() as f64;
    let boxes: Vec<_> = solids.iter().zip(placements).map(|(solid, placement)| solid.placed_bounds(&turn.after(placement))).collect();
    let longest = boxes.iter().map(|[low, high]| (high - low).max()).sum::<f64>() / count;
    let middle = boxes.iter().map(|[low, high]| (low.coords + high.coords) / 2.0).sum::<Vector3<f64>>() / count;
    let farthest = boxes.iter().flatten().map(|p| (p.coords - middle).amax()).fold(0.0, f64::max);
    // Not quite onto the border, which would touch the voxels beyond.
    let scale = (LONGEST / longest).min(0.5 * (1.0 - 1e-6) / farthest);
    ShapeSimilarity { rotation: Rotation::identity(), scale, translation: -middle * scale }.after(&turn)
}

fn orientation(solids: &[Solid], placements: &[ShapeSimilarity], keep_up: bool) -> Rotation {
    // Moments of all shapes together, each with the same mass.
    let count = solids.len() as f64;
    let centre = |solid: &Solid, placement: &ShapeSimilarity| placement.place(&solid.centre.into()).coords;
    let middle = solids.iter().zip(placements).map(|(s, p)| centre(s, p)).sum::<Vector3<f64>>() / count;
    let covariance = |(solid, placement): (&Solid, &ShapeSimilarity)| {
        let turn = placement.rotation.to_rotation_matrix();
        let off = centre(solid, placement) - middle;
        turn * solid.covariance * turn.transpose() * placement.scale.powi(2) + off * off.transpose()
    };
    let covariance = solids.iter().zip(placements).map(covariance).sum::<Matrix3<f64>>() / count;
    let axes = principal(&covariance, keep_up);
    let skewness =
        solids.iter().zip(placements).map(|(solid, placement)| solid.skewness(&(axes * placement.rotation))).sum::<Vector3<f64>>();
    // Half a turn about an axis changes the signs of the two others.
    let half = |axis| Rotation::from_axis_angle(&axis, std::f64::consts::PI);
    let signs = match (skewness.x < 0.0, !keep_up && skewness.y < 0.0) {
        (false, false) => Rotation::identity(),
        (true, false) if !keep_up => half(Vector3::y_axis()),
        (true, _) => half(Vector3::z_axis()),
        (false, true) => half(Vector3::x_axis()),
    };
    signs * axes
}
