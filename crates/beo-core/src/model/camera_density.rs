//! Views of a camera at some elevation of objects that are turned about the vertical: a Gaussian of hull features for each component,
//! elevation and yaw, and a regression of where the object lies on these features.

use super::{Component, Forest};
use half::f16;
use std::f64::consts::TAU;

/// Steps of yaw around the circle.
pub const YAWS: usize = 24;
/// Cells of the view's frame over which hulls are averaged: 15 along each axis.
pub const CELLS: usize = 15 * 15 * 15;
/// Numbers that a view measures for the forest.
pub const MEASURES: usize = 211;
/// Number of quantities that are regressed on the features, in the view's frame (`perception::camera::ViewFrame`): the rest of the yaw, radians; the logarithm
/// of the scale, its unit per voxel of the canonical grid; the place of the canonical grid's centre, x, y, z; the lengths of the object's
/// box along its axes.
pub const OFFSETS: usize = 8;

/// Gaussians of the features z = Bᵀ · pooled hull in the view's frame: p features, m components, `[elevation][yaw][component]`.
#[derive(Clone, Debug, PartialEq)]
pub struct CameraDensities {
    /// Elevations of the camera above the horizontal that were learned, radians, ascending.
    pub elevations: Vec<f64>,
    /// Components of the classes.
    pub components: Vec<Component>,
    /// Number of features, p.
    pub size: usize,
    /// B, one row of p values per cell.
    pub basis: Vec<f16>,
    /// Means, p values each.
    pub means: Vec<f16>,
    /// Rows of L⁻¹ of the covariances S = L Lᵀ, lower triangular and packed.
    pub whitening: Vec<f16>,
    /// Means of the [`OFFSETS`], that many values each.
    pub offsets: Vec<f32>,
    /// Regression of the offsets less their mean on z less its mean, `[offset]` p values each.
    pub regression: Vec<f16>,
    /// Standard deviations of the offsets given z, that many values each.
    pub deviations: Vec<f32>,
    /// Names classes, or none of them, from what a view measures (`perception::camera::measures`); models of version 0.1.0 have none.
    pub forest: Option<Forest>,
}

impl CameraDensities {
    /// Where an elevation, yaw and component stand among the Gaussians, of `components`.
    pub fn place(&self, elevation: usize, yaw: usize, component: usize, components: usize) -> usize {
        (elevation * YAWS + yaw) * components + component
    }

    /// The angle of a step of yaw, radians.
    pub fn yaw(step: usize) -> f64 {
        step as f64 * TAU / YAWS as f64
    }

    /// The learned elevations on both sides of one, with their weights; twice the same beyond the ends.
    pub fn beside(&self, elevation: f64) -> [(usize, f64); 2] {
        let last = self.elevations.len() - 1;
        let above = self.elevations.partition_point(|e| *e < elevation);
        if above == 0 || above > last {
            return [(above.min(last), 1.0), (above.min(last), 0.0)];
        }
        let [low, high] = [self.elevations[above - 1], self.elevations[above]];
        let share = (elevation - low) / (high - low);
        [(above - 1, 1.0 - share), (above, share)]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Densities of these elevations, and nothing in them.
    fn learned_at(elevations: Vec<f64>) -> CameraDensities {
        CameraDensities {
            elevations,
            components: vec![],
            size: 0,
            basis: vec![],
            means: vec![],
            whitening: vec![],
            offsets: vec![],
            regression: vec![],
            deviations: vec![],
            forest: None,
        }
    }

    #[test]
    fn elevations_between_two_are_shared_by_them() {
        let densities = learned_at(vec![0.2, 0.6, 1.0]);
        assert_eq!(densities.beside(0.1), [(0, 1.0), (0, 0.0)]);
        assert_eq!(densities.beside(1.5), [(2, 1.0), (2, 0.0)]);
        let [(low, a), (high, b)] = densities.beside(0.7);
        assert_eq!((low, high), (1, 2));
        assert!((a - 0.75).abs() < 1e-12 && (b - 0.25).abs() < 1e-12);
    }

    #[test]
    fn gaussians_stand_by_elevation_then_yaw_then_component() {
        let densities = learned_at(vec![0.2, 0.6]);
        let places = (0..2).flat_map(|e| (0..YAWS).flat_map(move |yaw| (0..5).map(move |component| (e, yaw, component))));
        for (place, (elevation, yaw, component)) in places.enumerate() {
            assert_eq!(densities.place(elevation, yaw, component, 5), place);
        }
        assert_eq!(densities.beside(0.2), [(0, 1.0), (0, 0.0)]);
        assert_eq!(densities.beside(0.6), [(0, 0.0), (1, 1.0)]);
        assert!((CameraDensities::yaw(6) - std::f64::consts::FRAC_PI_2).abs() < 1e-12);
    }
}
