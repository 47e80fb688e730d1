//! A lattice of a grid's voxels: so many that sums over it stand for sums over all.
//!
//! The voxels are those with i + a j + b k ≡ 0 (mod m), a lattice of rank one: a and b have no factor in common with m, so that of any m voxels in a
//! row along an axis exactly one belongs to it, and are chosen such that its nearest voxels lie as far apart as they can (Sloan & Joe, *Lattice
//! Methods for Multiple Integration*, 1994). Edges and faces are thus met evenly, however they lie.

use crate::grid::{Dims, Observation, Outside, Similarity};
use crate::perception::kernels::lanes::{Kernel, dispatch, multiply_add};
use std::cmp::Reverse;

/// Some of the voxels of a grid, ascending.
pub struct Lattice {
    dims: Dims,
    voxels: Vec<usize>,
    /// Their centres along each axis, in voxels from the grid's centre.
    centres: [Vec<f32>; 3],
}

/// An observation sampled at the voxels of a lattice: the places of the known, unknown and filled ones, ascending.
#[derive(Default)]
pub struct Sampled {
    known: Places,
    unknown: Places,
    filled: Places,
    sources: Vec<u32>,
}

/// Some places, and room for all.
#[derive(Default)]
struct Places {
    places: Vec<u32>,
    count: usize,
}

impl Places {
    fn clear(&mut self, room: usize) {
        self.places.resize(room, 0);
        self.count = 0;
    }

    /// Adds a place if it is one of them; without a branch, which could not be predicted.
    #[inline(always)]
    fn add(&mut self, place: usize, is_one: bool) {
        self.places[self.count] = place as u32;
        self.count += usize::from(is_one);
    }

    fn all(&self) -> &[u32] {
        &self.places[..self.count]
    }
}

impl Sampled {
    /// Known to be filled or empty.
    pub fn known(&self) -> &[u32] {
        self.known.all()
    }

    /// Not known.
    pub fn unknown(&self) -> &[u32] {
        self.unknown.all()
    }

    /// Known to be filled.
    pub fn filled(&self) -> &[u32] {
        self.filled.all()
    }
}

/// The codes of all voxels of a grid, a byte each, and the code of the space beyond.
#[derive(Default)]
pub struct Codes(Vec<u8>);

/// Bits of a code.
const KNOWN: u8 = 1;
const FILLED: u8 = 2;

impl Codes {
    /// Takes in an observation; `outside` says what lies beyond the grid.
    pub fn set(&mut self, observation: &Observation, outside: Outside) {
        let Self(codes) = self;
        codes.clear();
        codes.resize(observation.dims().voxels(), 0);
        observation.known().ones().for_each(|voxel| codes[voxel] = KNOWN);
        observation.filled().ones().for_each(|voxel| codes[voxel] |= FILLED);
        codes.push(if outside == Outside::Empty { KNOWN } else { 0 });
    }
}

impl Lattice {
    /// About one of `of` voxels.
    pub fn one_of(of: usize, dims: Dims) -> Self {
        // Odd, so that half of all numbers are no multiples of its factors; 1, 3, 5 and 7 leave little choice.
        let m = if of < 3 { 1 } else { of | 1 };
        let [a, b] = coefficients(m);
        let sides = <[usize; 3]>::from(dims);
        let belongs = |voxel: &usize| {
            let [i, j, k] = dims.coordinates(*voxel);
            (i + a * j + b * k).is_multiple_of(m)
        };
        let voxels: Vec<usize> = (0..dims.voxels()).filter(belongs).collect();
        let centres = std::array::from_fn(|axis| {
            voxels.iter().map(|voxel| dims.coordinates(*voxel)[axis] as f32 - (sides[axis] as f32 - 1.0) / 2.0).collect()
        });
        Self { dims, voxels, centres }
    }

    /// The voxels.
    pub fn voxels(&self) -> &[usize] {
        &self.voxels
    }

    /// Voxels of the grid for each of the lattice.
    pub fn share(&self) -> f64 {
        self.dims.voxels() as f64 / self.voxels.len() as f64
    }

    /// Moves an observation to the canonical grid of an object that lies so, as far as the lattice goes.
    pub fn sample(&self, Codes(codes): &Codes, placed: &Similarity, out: &mut Sampled) {
        let Sampled { known, unknown, filled, sources } = out;
        let (matrix, offset) = placed.map();
        let sides = <[usize; 3]>::from(self.dims);
        let row = |axis: usize| {
            let middle = (sides[axis] as f64 - 1.0) / 2.0;
            [matrix[(axis, 0)], matrix[(axis, 1)], matrix[(axis, 2)], offset[axis] + middle].map(|v| v as f32)
        };
        sources.resize(self.voxels.len(), 0);
        dispatch(Sources { rows: [row(0), row(1), row(2)], sides, centres: &self.centres, out: sources });
        for places in [&mut *known, unknown, filled] {
            places.clear(self.voxels.len());
        }
        for (place, source) in sources.iter().enumerate() {
            let code = codes[*source as usize];
            known.add(place, code & KNOWN != 0);
            unknown.add(place, code & KNOWN == 0);
            filled.add(place, code & FILLED != 0);
        }
    }
}

/// The coefficients (a, b) of the lattice of m voxels whose nearest ones lie farthest apart; of several the least.
fn coefficients(m: usize) -> [usize; 2] {
    let units: Vec<usize> = (1..=m.max(1)).filter(|a| gcd(*a, m) == 1 && 2 * a <= m.max(2)).collect();
    let pairs = units.iter().flat_map(|a| units.iter().map(move |b| [*a, *b]));
    pairs.min_by_key(|pair| (Reverse(nearest_squared(m, *pair)), *pair)).unwrap_or([1, 1])
}

/// Squared distance of the nearest voxels of a lattice.
fn nearest_squared(m: usize, [a, b]: [usize; 2]) -> i64 {
    // No lattice of m voxels has its nearest ones farther apart than the densest packing of balls, √2 m^⅔ < (m^⅓ 1.13)².
    let reach = ((m as f64).cbrt() * 1.13).ceil() as i64;
    let (m, a, b) = (m as i64, a as i64, b as i64);
    let along = || -reach..=reach;
    let vectors = along().flat_map(|i| along().flat_map(move |j| along().map(move |k| [i, j, k])));
    let belongs = |[i, j, k]: &[i64; 3]| (i + a * j + b * k).rem_euclid(m) == 0 && [*i, *j, *k] != [0; 3];
    vectors.filter(belongs).map(|[i, j, k]| i * i + j * j + k * k).min().unwrap_or(i64::MAX)
}

fn gcd(a: usize, b: usize) -> usize {
    if b == 0 { a } else { gcd(b, a % b) }
}

/// The voxel that each voxel of a lattice comes from; one past the last for what comes from outside.
struct Sources<'a> {
    /// (x, y, z, 1) to the place along each axis, in voxels from the first.
    rows: [[f32; 4]; 3],
    sides: [usize; 3],
    centres: &'a [Vec<f32>; 3],
    out: &'a mut [u32],
}

impl Kernel for Sources<'_> {
    type Output = ();

    #[inline(always)]
    fn run<const FUSED: bool>(self) {
        // 1.5 · 2²³: adding it rounds to the nearest whole number, ties to even.
        const ROUND: f32 = 12_582_912.0;
        let Self { rows, sides, centres: [xs, ys, zs], out } = self;
        let last = sides.map(|side| side as f32 - 1.0);
        let [nx, ny, nz] = sides.map(|side| side as i32);
        for (((out, x), y), z) in out.iter_mut().zip(xs).zip(ys).zip(zs) {
            let mut at = [0.0_f32; 3];
            for axis in 0..3 {
                let [a, b, c, d] = rows[axis];
                let exact = multiply_add::<FUSED>(a, *x, multiply_add::<FUSED>(b, *y, multiply_add::<FUSED>(c, *z, d)));
                at[axis] = (exact + ROUND) - ROUND;
            }
            let inside = (at[0] >= 0.0) & (at[0] <= last[0]) & (at[1] >= 0.0) & (at[1] <= last[1]) & (at[2] >= 0.0) & (at[2] <= last[2]);
            // Whole numbers, far from the ends of their type where they are inside.
            let [i, j, k] = at.map(|v| v.clamp(0.0, 4096.0) as i32);
            let index = (i * ny + j) * nz + k;
            *out = if inside { index } else { nx * ny * nz } as u32;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::{Turn, View, yaw};
    use crate::perception::pose::small::unseen;
    use nalgebra::Vector3;

    #[test]
    fn every_row_of_m_voxels_along_an_axis_holds_one_of_the_lattice() {
        for m in [3, 9, 27] {
            let side = 4 * m;
            let dims = Dims::cube(side).unwrap();
            let lattice = Lattice::one_of(m, dims);
            assert!((lattice.share() - m as f64).abs() < 1e-12);
            let mut counts: [Vec<usize>; 3] = std::array::from_fn(|_| vec![0; side * side]);
            for voxel in lattice.voxels() {
                let [i, j, k] = dims.coordinates(*voxel);
                for (axis, [a, b]) in [[j, k], [i, k], [i, j]].into_iter().enumerate() {
                    counts[axis][a * side + b] += 1;
                }
            }
            assert!(counts.iter().flatten().all(|count| *count == 4));
        }
        assert_eq!(Lattice::one_of(1, Dims::cube(8).unwrap()).voxels().len(), 512);
    }

    /// One of nine: (2, −1, 0), (0, 2, −1) and (1, 0, 2) span it, and none is shorter.
    #[test]
    fn the_nearest_voxels_of_a_lattice_are_far_apart() {
        assert_eq!(nearest_squared(9, coefficients(9)), 5);
        assert!(nearest_squared(27, coefficients(27)) >= 9);
    }

    /// A sample at the lattice equals the observation that was moved as a whole.
    #[test]
    fn the_lattice_samples_the_moved_observation() {
        let seen: Observation = View::Top.of(&unseen("chair", 3));
        let dims = seen.dims();
        let placed = Similarity { rotation: yaw(0.37), scale: 1.13, translation_voxels: Vector3::new(0.61, -1.27, 0.83) };
        let mut turn = Turn::unset(dims);
        turn.set_to_object(&placed);
        let mut of_all = Codes::default();
        for outside in [Outside::Empty, Outside::Unknown] {
            let moved = turn.observation(&seen, outside);
            of_all.set(&seen, outside);
            for of in [1, 3, 9] {
                let (lattice, mut sampled) = (Lattice::one_of(of, dims), Sampled::default());
                lattice.sample(&of_all, &placed, &mut sampled);
                let those = |is: &dyn Fn(usize) -> bool| -> Vec<u32> {
                    (0..lattice.voxels().len()).filter(|place| is(lattice.voxels()[*place])).map(|place| place as u32).collect()
                };
                assert_eq!(sampled.known(), those(&|voxel| moved.known().contains(voxel)));
                assert_eq!(sampled.unknown(), those(&|voxel| !moved.known().contains(voxel)));
                assert_eq!(sampled.filled(), those(&|voxel| moved.filled().contains(voxel)));
                assert!(!sampled.filled().is_empty());
            }
        }
    }
}
