//! Observations as point clouds: the centres of the filled voxels of an observation.

use super::GridPlacement;
use beo_core::grid::Observation;
use beo_picture::Colour;

/// A point with its colour.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Point {
    /// Where it is, metres.
    pub position_m: [f64; 3],
    /// Red, green, blue.
    pub rgb: [u8; 3],
}

/// The filled voxels of an observation in the order of their indices, where the grid lies.
pub fn points_of(observation: &Observation, placement: &GridPlacement) -> Vec<Point> {
    let dims = observation.dims();
    let centre = |voxel: usize| dims.coordinates(voxel).map(|side| side as f64 + 0.5);
    let point = |voxel| Point { position_m: placement.place(dims, centre(voxel)).into(), rgb: Colour::KNOWN.rgb };
    observation.filled().ones().map(point).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use beo_core::grid::{Dims, yaw};

    #[test]
    fn points_are_the_voxels_centres_where_the_grid_lies() {
        let dims = Dims::new(8, 10, 12).unwrap();
        let mut observation = Observation::unknown(dims);
        observation.set(dims.index(7, 4, 6), true);
        observation.set(dims.index(0, 0, 0), false);
        let placement = GridPlacement { position_m: [1.0, 2.0, 3.0], orientation: yaw(std::f64::consts::FRAC_PI_2), voxel_size_m: 0.1 };
        let points = points_of(&observation, &placement);
        assert_eq!(points.len(), 1);
        // From the centre: (3.5, −0.5, 0.5) voxels; a quarter turn takes x to y and y to −x.
        let expected = [1.0 + 0.05, 2.0 + 0.35, 3.0 + 0.05];
        assert!(points[0].position_m.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-12), "{:?}", points[0]);
    }
}
