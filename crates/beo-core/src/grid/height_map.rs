//! Height map of a view from above: the highest filled voxel of every column.

use super::{Dims, Observation, for_each_column_source};

/// Heights of all columns of a grid, in the order of the columns.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct HeightMap {
    dims: Dims,
    /// One more than the index of the highest filled voxel; 0 in a column without one.
    tops: Vec<u16>,
}

impl HeightMap {
    /// Heights that are all 0.
    pub fn new(dims: Dims) -> Self {
        Self { dims, tops: vec![0; dims.columns()] }
    }

    /// Heights of an observation.
    pub fn of(observation: &Observation) -> Self {
        let mut map = Self::new(observation.dims());
        map.read(observation);
        map
    }

    /// Becomes the heights of an observation of the same size.
    pub fn read(&mut self, observation: &Observation) {
        let z = self.dims.z();
        self.tops.fill(0);
        // Ascending, so that the last one of a column stays.
        for voxel in observation.filled().ones() {
            self.tops[voxel / z] = (voxel % z + 1) as u16;
        }
    }

    /// Size of the grid.
    pub fn dims(&self) -> Dims {
        self.dims
    }

    /// One value per column: one more than the index of the highest filled voxel, or 0.
    pub fn tops(&self) -> &[u16] {
        &self.tops
    }

    /// The values of [`Self::tops`], to be written.
    pub fn tops_mut(&mut self) -> &mut [u16] {
        &mut self.tops
    }

    /// Becomes another map turned about +z by `angle` radians, nearest neighbour; columns that enter are 0.
    pub fn set_turned(&mut self, map: &Self, angle: f64) {
        self.dims = map.dims;
        self.tops.clear();
        for_each_column_source(map.dims, angle, |source| self.tops.push(source.map_or(0, |column| map.tops[column])));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::{Occupancy, Outside, Turn, View, yaw};
    use proptest::prelude::*;

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(32))]
        #[test]
        fn turning_the_map_is_turning_the_view(angle in -7.0..7.0_f64, step in 2..9_usize) {
            let dims = Dims::new(9, 12, 8).unwrap();
            let object = Occupancy::from_fn(dims, |i, j, k| (i * 5 + j * 3 + k * 7) % (step + 9) < 2);
            let view = View::Top.of(&object);
            let turned = Turn::new(dims, &yaw(angle)).observation(&view, Outside::Empty);
            let expected: Vec<u16> = (0..dims.columns())
                .map(|c| (0..8).rev().find(|k| turned.filled().contains(c * 8 + k)).map_or(0, |k| k as u16 + 1))
                .collect();
            let mut found = HeightMap::new(dims);
            found.set_turned(&HeightMap::of(&view), angle);
            prop_assert_eq!(found.tops(), &expected[..]);
        }
    }
}
