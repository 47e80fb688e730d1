//! Views: what a camera at a given place knows of a complete object.

use super::{Observation, Occupancy, for_each_run};
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
    /// The observation of `object` from this side.
    pub fn of(self, object: &Occupancy) -> Observation {
        match self {
            View::Top => top(object),
        }
    }

    /// Whether `observation` could come from this view: at least 95 % of the columns that hold a filled or unknown voxel are
    /// as this view leaves them (from a camera, single columns are not).
    pub fn matches(self, observation: &Observation) -> bool {
        match self {
            View::Top => {
                let (z, columns) = (observation.dims().z(), observation.dims().columns());
                let (known, filled) = (observation.known(), observation.filled());
                let (mut seen, mut fitting) = (0, 0);
                for column in 0..columns {
                    let (bottom, end) = (column * z, (column + 1) * z);
                    let (knows, fills) = (known.count_ones(bottom..end), filled.count_ones(bottom..end));
                    if knows == z && fills == 0 {
                        continue;
                    }
                    seen += 1;
                    // One filled voxel, all above it known, nothing below.
                    let top = end - knows;
                    fitting += usize::from(fills == 1 && known.count_ones(top..end) == knows && filled.contains(top));
                }
                fitting * 100 >= seen * 95
            }
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
        let (bottom, end) = (column * dims.z(), (column + 1) * dims.z());
        let mut top = None;
        for_each_run(object.bits(), dims, column..column + 1, |_, end| top = Some(end - 1));
        observation.set_empty(top.map_or(bottom, |top| top + 1)..end);
        if let Some(top) = top {
            observation.set(top, true);
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

    #[test]
    fn a_complete_object_is_no_top_view_but_its_view_is() {
        let dims = Dims::cube(8).unwrap();
        let object = Occupancy::from_fn(dims, |i, j, k| i < 6 && j < 6 && k < 4);
        assert!(View::Top.matches(&View::Top.of(&object)));
        assert!(!View::Top.matches(&Observation::complete(&object)));
        assert!(!View::Top.matches(&Observation::unknown(dims)));
    }
}
