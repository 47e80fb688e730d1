//! An observation taken apart: what estimators read of it (V_q and w_q of eq. 13), and its visual hull.

use super::shared_sums::SharedSums;
use super::tiles::{Division, Tiling};
use crate::grid::{Dims, Observation, for_each_run};
use fixedbitset::FixedBitSet;

/// The known and the unknown part of an observation; reused from query to query.
#[derive(Clone, Debug, Default)]
pub struct Known {
    /// One bit per voxel: filled or unknown.
    pub hull: FixedBitSet,
    /// Runs of unknown voxels, bottom up.
    pub unknown: Vec<(usize, usize)>,
    /// The same voxels, as whole levels of tiles and the runs that remain.
    pub division: Division,
    /// Known filled voxels, ascending.
    pub filled: Vec<usize>,
    /// Sums over them of W', where that is read itself.
    pub sums: SharedSums,
}

impl Known {
    /// Room for observations of one size.
    pub fn new(dims: Dims) -> Self {
        Self {
            hull: FixedBitSet::with_capacity(dims.voxels()),
            unknown: Vec::with_capacity(dims.voxels() / 2),
            division: Division::default(),
            filled: Vec::with_capacity(dims.voxels()),
            sums: SharedSums::default(),
        }
    }

    /// Takes an observation apart. It has the dims that this was made for.
    pub fn read(&mut self, observation: &Observation) {
        let dims = observation.dims();
        for (hull, known) in self.hull.as_mut_slice().iter_mut().zip(observation.known().as_slice()) {
            *hull = !known;
        }
        mask_tail(&mut self.hull);
        self.unknown.clear();
        for_each_run(&self.hull, dims, 0..dims.columns(), |start, end| self.unknown.push((start, end)));
        Tiling::new(dims).divide(&self.unknown, &mut self.division);
        self.hull.union_with(observation.filled());
        self.filled.clear();
        self.filled.extend(observation.filled().ones());
    }
}

/// Clears the bits of the last word beyond the end of the set.
fn mask_tail(bits: &mut FixedBitSet) {
    let rest = bits.len() % usize::BITS as usize;
    if let (Some(last), true) = (bits.as_mut_slice().last_mut(), rest != 0) {
        *last &= (1 << rest) - 1;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::{EMPTY, FILLED, UNKNOWN};

    #[test]
    fn an_observation_is_taken_apart_completely() {
        let dims = Dims::new(8, 9, 11).unwrap();
        let codes: Vec<u8> = (0..dims.voxels()).map(|v| [EMPTY, FILLED, UNKNOWN, UNKNOWN][v * v % 4 + v % 2]).collect();
        let observation = Observation::from_bytes(dims, &codes).unwrap();
        let mut known = Known::new(dims);
        known.read(&observation);
        assert_eq!(&known.hull, observation.hull().bits());
        assert!(known.filled.iter().copied().eq((0..codes.len()).filter(|v| codes[*v] == FILLED)));
        let unknown = known.unknown.iter().flat_map(|(start, end)| *start..*end);
        assert!(unknown.eq((0..codes.len()).filter(|v| codes[*v] == UNKNOWN)));
    }
}
