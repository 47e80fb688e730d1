//! A grid on fewer, larger voxels of the same space.

use super::{Dims, Observation, Occupancy, for_each_run};
use fixedbitset::FixedBitSet;

/// Takes grids of one size to a smaller one. A small voxel belongs to the large one that holds its centre.
#[derive(Clone, Debug)]
pub struct Shrinking {
    from: Dims,
    to: Dims,
    /// Along each axis, where each large voxel starts, and the end.
    starts: [Vec<usize>; 3],
}

/// Voxels of each large voxel that are filled, and that are filled or unknown; reused.
#[derive(Clone, Debug, Default)]
pub struct Counts {
    filled: Vec<u32>,
    hull: Vec<u32>,
    bits: FixedBitSet,
}

impl Shrinking {
    /// From one size to another with no longer sides.
    pub fn new(from: Dims, to: Dims) -> Self {
        let (sides, shrunk) = (<[usize; 3]>::from(from), <[usize; 3]>::from(to));
        let starts = std::array::from_fn(|axis| {
            let (n, m) = (sides[axis], shrunk[axis]);
            assert!(m <= n, "shrinking makes no voxel smaller");
            // The centre of voxel i lies in large voxel ⌊(2i + 1) m / 2n⌋.
            let mut starts: Vec<usize> = (0..m).map(|cell| (0..n).find(|i| (2 * i + 1) * m / (2 * n) >= cell).unwrap_or(n)).collect();
            starts.push(n);
            starts
        });
        Self { from, to, starts }
    }

    /// The smaller size.
    pub fn dims(&self) -> Dims {
        self.to
    }

    /// Edge of a large voxel in small ones, mean over the axes.
    pub fn factor(&self) -> f64 {
        let (from, to) = (<[usize; 3]>::from(self.from), <[usize; 3]>::from(self.to));
        (0..3).map(|axis| from[axis] as f64 / to[axis] as f64).sum::<f64>() / 3.0
    }

    /// A shape: a large voxel is filled if at least half of its voxels are.
    pub fn occupancy(&self, object: &Occupancy) -> Occupancy {
        let mut counts = Vec::new();
        self.count(object.bits(), &mut counts);
        Occupancy::from_fn(self.to, |i, j, k| 2 * counts[self.to.index(i, j, k)] >= self.volume([i, j, k]))
    }

    /// An observation, so that its hull is the shrunk hull. A large voxel of the hull is filled if any of its voxels is, and if it lies
    /// behind a large voxel outside of the hull that holds filled ones: the neighbour that holds most of the hull takes them.
    pub fn observation(&self, seen: &Observation, counts: &mut Counts, out: &mut Observation) {
        let to = self.to;
        self.count(seen.filled(), &mut counts.filled);
        let Counts { filled, hull, bits } = counts;
        bits.clone_from(seen.known());
        bits.toggle_range(..);
        bits.union_with(seen.filled());
        self.count(bits, hull);
        let inside = |at: [usize; 3]| 2 * hull[to.index(at[0], at[1], at[2])] >= self.volume(at);
        for (voxel, filled) in filled.iter().enumerate() {
            let at = to.coordinates(voxel);
            match inside(at) {
                true if *filled > 0 => out.set(voxel, true),
                true => out.set_unknown(voxel),
                false => out.set(voxel, false),
            }
        }
        for voxel in (0..to.voxels()).filter(|voxel| filled[*voxel] > 0) {
            let at = to.coordinates(voxel);
            if inside(at) {
                continue;
            }
            let neighbours = (0..6).filter_map(|n| {
                let mut next = at;
                next[n / 2] = if n % 2 == 0 { next[n / 2].checked_sub(1)? } else { next[n / 2] + 1 };
                (next[n / 2] < <[usize; 3]>::from(to)[n / 2]).then_some(next)
            });
            let index = |at: &[usize; 3]| to.index(at[0], at[1], at[2]);
            let behind = neighbours.filter(|at| inside(*at)).max_by_key(|at| (hull[index(at)], std::cmp::Reverse(index(at))));
            if let Some(at) = behind {
                out.set(index(&at), true);
            }
        }
    }

    /// Small voxels of a large one.
    fn volume(&self, at: [usize; 3]) -> u32 {
        (0..3).map(|axis| (self.starts[axis][at[axis] + 1] - self.starts[axis][at[axis]]) as u32).product()
    }

    /// Set bits of each large voxel.
    fn count(&self, bits: &FixedBitSet, counts: &mut Vec<u32>) {
        let (from, to) = (self.from, self.to);
        counts.clear();
        counts.resize(to.voxels(), 0);
        let heights = &self.starts[2];
        for i in 0..to.x() {
            for j in 0..to.y() {
                let counts = &mut counts[to.index(i, j, 0)..][..to.z()];
                for x in self.starts[0][i]..self.starts[0][i + 1] {
                    let columns = x * from.y() + self.starts[1][j]..x * from.y() + self.starts[1][j + 1];
                    for_each_run(bits, from, columns, |start, end| {
                        let (low, high) = (start % from.z(), start % from.z() + (end - start));
                        let mut k = heights.partition_point(|h| *h <= low) - 1;
                        while k < to.z() && heights[k] < high {
                            counts[k] += (high.min(heights[k + 1]) - low.max(heights[k])) as u32;
                            k += 1;
                        }
                    });
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::View;
    use proptest::prelude::*;

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(20))]
        /// Against counting voxel by voxel.
        #[test]
        fn a_large_voxel_is_what_most_of_its_voxels_are(seed in 0..1000_usize, x in 16..30_usize, z in 17..33_usize) {
            let (from, to) = (Dims::new(x, 23, z).unwrap(), Dims::new(9, 8, 16).unwrap());
            let object = Occupancy::from_fn(from, |i, j, k| !((i / 3 * 7 + j / 2 * 5 + k / 3 * 3 + seed) % 7).is_multiple_of(3));
            let shrinking = Shrinking::new(from, to);
            let mut counts = vec![(0, 0); to.voxels()];
            for voxel in 0..from.voxels() {
                let at = from.coordinates(voxel);
                let cell: Vec<usize> = (0..3).map(|a| ((at[a] as f64 + 0.5) * <[usize; 3]>::from(to)[a] as f64 / <[usize; 3]>::from(from)[a] as f64) as usize).collect();
                let count = &mut counts[to.index(cell[0], cell[1], cell[2])];
                count.0 += u32::from(object.bits().contains(voxel));
                count.1 += 1;
            }
            let found = shrinking.occupancy(&object);
            for (voxel, (filled, all)) in counts.iter().enumerate() {
                prop_assert_eq!(found.bits().contains(voxel), 2 * filled >= *all);
            }
            // The hull of what is seen shrinks as a shape does.
            let seen = View::Top.of(&object);
            let mut small = Observation::unknown(to);
            shrinking.observation(&seen, &mut Counts::default(), &mut small);
            prop_assert_eq!(small.hull(), shrinking.occupancy(&seen.hull()));
        }
    }

    #[test]
    fn a_surface_between_large_voxels_stays_on_top() {
        let (from, to) = (Dims::cube(32).unwrap(), Dims::cube(8).unwrap());
        // Slabs that end at each height within a large voxel.
        for top in 8..16 {
            let object = Occupancy::from_fn(from, |i, j, k| (8..24).contains(&i) && (8..24).contains(&j) && (4..top).contains(&k));
            let shrinking = Shrinking::new(from, to);
            let mut small = Observation::unknown(to);
            shrinking.observation(&View::Top.of(&object), &mut Counts::default(), &mut small);
            assert_eq!(small, View::Top.of(&shrinking.occupancy(&object)), "{top}");
        }
    }
}
