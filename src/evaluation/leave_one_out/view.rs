//! From where a shape is seen that is to be completed.

use crate::grid::{Observation, Occupancy, View};
use fixedbitset::FixedBitSet;
use serde::Serialize;

/// One view, orthographic.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum OneView {
    /// Straight down along −z.
    Top,
    /// Along +x: of each row along x the first filled voxel is filled, those before it are empty, those behind it unknown; a row without a
    /// filled voxel is known to be empty.
    Side,
}

impl OneView {
    /// What is seen of an object.
    pub fn of(self, object: &Occupancy) -> Observation {
        match self {
            Self::Top => View::Top.of(object),
            Self::Side => side(object),
        }
    }

    /// Where the viewer is, for texts.
    pub fn name(self) -> &'static str {
        match self {
            Self::Top => "from above",
            Self::Side => "from the side",
        }
    }
}

fn side(object: &Occupancy) -> Observation {
    let dims = object.dims();
    let layer = dims.y() * dims.z();
    let (mut known, mut filled) = (FixedBitSet::with_capacity(dims.voxels()), FixedBitSet::with_capacity(dims.voxels()));
    // Rows in which nothing was met yet.
    let mut open = FixedBitSet::with_capacity(layer);
    open.insert_range(..);
    let mut met = Vec::new();
    for i in 0..dims.x() {
        for row in open.ones() {
            let voxel = i * layer + row;
            known.insert(voxel);
            if object.bits().contains(voxel) {
                filled.insert(voxel);
                met.push(row);
            }
        }
        met.drain(..).for_each(|row| open.remove(row));
    }
    Observation::from_parts(dims, known, filled)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::{Dims, Outside, Rotation, Turn};
    use nalgebra::Vector3;

    #[test]
    fn the_side_view_is_the_top_view_of_the_object_turned_by_a_quarter() {
        let dims = Dims::cube(11).unwrap();
        let object = Occupancy::from_fn(dims, |i, j, k| (i * 7 + j * 5 + k * 3 + i * j * k) % 13 == 0 && j != 4);
        // −x becomes up.
        let turn = |angle: f64| Turn::new(dims, &Rotation::from_axis_angle(&Vector3::y_axis(), angle));
        let quarter = std::f64::consts::FRAC_PI_2;
        let above = View::Top.of(&turn(quarter).occupancy(&object));
        assert_eq!(OneView::Side.of(&object), turn(-quarter).observation(&above, Outside::Empty));
    }

    #[test]
    fn what_lies_behind_the_first_filled_voxel_is_not_seen() {
        let dims = Dims::new(8, 9, 10).unwrap();
        let object = Occupancy::from_fn(dims, |i, j, k| (j, k) == (4, 5) && (i == 2 || i == 6));
        let seen = OneView::Side.of(&object);
        let row: Vec<u8> = (0..8).map(|i| seen.code(dims.index(i, 4, 5))).collect();
        assert_eq!(row, [0, 0, 1, 255, 255, 255, 255, 255]);
        assert_eq!(seen.known().count_ones(..), dims.voxels() - 5);
    }
}
