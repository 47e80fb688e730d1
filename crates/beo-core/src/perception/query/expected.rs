//! Where an object that was answered before is to be expected.

use crate::grid::{Rotation, Similarity};
use nalgebra::Vector3;

/// How an object lay before a camera when it was answered: the next query about it begins there ([`Query::expected`](super::Query::expected)),
/// and searches everywhere only where what is seen does not agree.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ExpectedPlacement {
    /// Its class.
    pub class: usize,
    /// The component of the class, a kind of size in a resting pose, among those of the model.
    pub component: usize,
    /// How it lies in the grid.
    pub placed: Similarity,
    /// Standard deviation of the logarithm of its size.
    pub log_scale_deviation: f64,
    /// Standard deviation of its place along each axis, voxels.
    pub place_deviation_voxels: f64,
    /// Longest side of what was seen of it, voxels.
    pub seen_side_voxels: f64,
    /// Log evidence of what was seen, divided by the number of known voxels: how well the object explained it.
    pub log_evidence_per_voxel: f64,
    /// Frames since it was searched everywhere.
    pub frames_since_search: u32,
}

impl ExpectedPlacement {
    /// The same for another grid, in which the one of the answer is turned by `rotation`, lies with its centre at `translation_voxels`, and
    /// has voxels of `scale` voxels of the other.
    pub fn in_grid(&self, rotation: &Rotation, scale: f64, translation_voxels: &Vector3<f64>) -> Self {
        let of_answer = Similarity { rotation: *rotation, scale, translation_voxels: *translation_voxels };
        Self {
            placed: Similarity {
                rotation: rotation * self.placed.rotation,
                scale: scale * self.placed.scale,
                translation_voxels: of_answer.place(&self.placed.translation_voxels),
            },
            place_deviation_voxels: scale * self.place_deviation_voxels,
            seen_side_voxels: scale * self.seen_side_voxels,
            ..*self
        }
    }

    /// The same for a grid of the same space with voxels `factor` times as large. Sizes are those of the canonical grid's voxels against the
    /// grid's, which grow alike.
    pub(crate) fn on_level(&self, factor: f64) -> Self {
        let placed = Similarity { translation_voxels: self.placed.translation_voxels / factor, ..self.placed };
        Self {
            placed,
            place_deviation_voxels: self.place_deviation_voxels / factor,
            seen_side_voxels: self.seen_side_voxels / factor,
            ..*self
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::yaw;

    #[test]
    fn a_point_of_the_object_lies_where_it_lay_whatever_the_grid() {
        let expected = ExpectedPlacement {
            class: 1,
            component: 2,
            placed: Similarity { rotation: yaw(0.4), scale: 1.2, translation_voxels: Vector3::new(1.0, -2.0, 0.5) },
            log_scale_deviation: 0.1,
            place_deviation_voxels: 0.7,
            seen_side_voxels: 20.0,
            log_evidence_per_voxel: 0.3,
            frames_since_search: 3,
        };
        let (rotation, scale, translation) = (yaw(-1.1), 0.8, Vector3::new(0.3, 4.0, -1.0));
        let moved = expected.in_grid(&rotation, scale, &translation);
        let point = Vector3::new(3.0, -1.0, 2.0);
        let before = rotation * expected.placed.place(&point) * scale + translation;
        assert!((moved.placed.place(&point) - before).norm() < 1e-12);
        assert!((moved.seen_side_voxels - 16.0).abs() < 1e-12 && (moved.place_deviation_voxels - 0.56).abs() < 1e-12);
        assert_eq!((moved.class, moved.component, moved.frames_since_search), (1, 2, 3));
        let on_level = expected.on_level(2.0).placed;
        assert_eq!((on_level.translation_voxels, on_level.scale), (Vector3::new(0.5, -1.0, 0.25), 1.2));
    }
}
