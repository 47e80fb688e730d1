//! From where a shape is seen that is to be completed.

use beo_core::grid::{Dims, Occupancy};
use serde::Serialize;

/// One view, orthographic. Models are learned for views from above: for any other, the shapes are turned so that it is one.
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
    /// Size of a grid that is turned so that the viewer is above; and the other way round.
    pub fn dims(self, dims: Dims) -> Dims {
        match self {
            Self::Top => dims,
            Self::Side => Dims::new(dims.z(), dims.y(), dims.x()).expect("the same sides"),
        }
    }

    /// Where the voxel (i, j, k) of a grid lies when it is turned so that the viewer is above: a quarter turn about y, which is exact.
    pub fn place(self, dims: Dims, [i, j, k]: [usize; 3]) -> [usize; 3] {
        match self {
            Self::Top => [i, j, k],
            Self::Side => [k, j, dims.x() - 1 - i],
        }
    }

    /// An object turned so that the viewer is above.
    pub fn turned(self, object: &Occupancy) -> Occupancy {
        let dims = object.dims();
        let mut turned = Occupancy::empty(self.dims(dims));
        for voxel in object.bits().ones() {
            let [i, j, k] = self.place(dims, dims.coordinates(voxel));
            turned.fill(i, j, k);
        }
        turned
    }

    /// Where the viewer is, for texts.
    pub fn name(self) -> &'static str {
        match self {
            Self::Top => "from above",
            Self::Side => "from the side",
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use beo_core::grid::{Rotation, Turn, View};
    use nalgebra::Vector3;

    fn object(dims: Dims) -> Occupancy {
        Occupancy::from_fn(dims, |i, j, k| (i * 7 + j * 5 + k * 3 + i * j * k).is_multiple_of(13) && j != 4)
    }

    #[test]
    fn from_the_side_all_but_what_lies_behind_the_first_filled_voxel_of_a_row_is_seen() {
        let dims = Dims::new(8, 9, 10).unwrap();
        let object = object(dims);
        let seen = View::Top.of(&OneView::Side.turned(&object));
        for j in 0..9 {
            for k in 0..10 {
                let first = (0..8).find(|i| object.is_filled(*i, j, k));
                for i in 0..8 {
                    let expected = match first {
                        Some(first) if i == first => 1,
                        Some(first) if i > first => 255,
                        _ => 0,
                    };
                    let [x, y, z] = OneView::Side.place(dims, [i, j, k]);
                    assert_eq!(seen.code(seen.dims().index(x, y, z)), expected, "{i} {j} {k}");
                }
            }
        }
    }

    #[test]
    fn the_side_is_turned_up_by_a_quarter_about_y_and_back() {
        let dims = Dims::cube(11).unwrap();
        let object = object(dims);
        let quarter = Rotation::from_axis_angle(&Vector3::y_axis(), std::f64::consts::FRAC_PI_2);
        assert_eq!(OneView::Side.turned(&object), Turn::new(dims, &quarter).occupancy(&object));
        assert_eq!(OneView::Top.turned(&object), object);
        let dims = Dims::new(8, 9, 10).unwrap();
        assert_eq!(OneView::Side.dims(OneView::Side.dims(dims)), dims);
    }
}
