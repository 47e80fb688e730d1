//! Views: what a camera at a given place knows of a complete object.

use super::{Observation, Occupancy};
use serde::{Deserialize, Serialize};

/// From where a complete object is looked at.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum View {
    /// Straight down along −z, orthographic. In each column the first filled voxel from above is filled, those above it are
    /// empty, those below it unknown; a column without a filled voxel is known to be empty.
    Top,
}

impl View {
    /// What this view knows of `object`.
    pub fn of(self, object: &Occupancy) -> Observation {
        match self {
            View::Top => top(object),
        }
    }

    /// The name used on the command line and in model files.
    pub fn name(self) -> &'static str {
        match self {
            View::Top => "top",
        }
    }
}

fn top(object: &Occupancy) -> Observation {
    let dims = object.dims();
    let mut observation = Observation::unknown(dims);
    for column in 0..dims.columns() {
        for index in (column * dims.z()..(column + 1) * dims.z()).rev() {
            let filled = object.bits().contains(index);
            observation.set(index, filled);
            if filled {
                break;
            }
        }
    }
    observation
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::{Dims, EMPTY, FILLED, UNKNOWN};

    #[test]
    fn top_view_knows_what_is_not_below_a_filled_voxel() {
        let dims = Dims::cube(8).unwrap();
        // One column with filled voxels at z = 2 and 5; all others are empty.
        let object = Occupancy::from_fn(dims, |i, j, k| (i, j) == (3, 4) && (k == 2 || k == 5));
        let view = View::Top.of(&object);
        let column: Vec<u8> = (0..8).map(|k| view.code(dims.index(3, 4, k))).collect();
        assert_eq!(column, [UNKNOWN, UNKNOWN, UNKNOWN, UNKNOWN, UNKNOWN, FILLED, EMPTY, EMPTY]);
        assert_eq!(view.known().count_ones(..), dims.voxels() - 5);
        assert_eq!(view.hull().count(), 6);
    }
}
