//! A lattice of a grid's voxels: so many that sums over it stand for sums over all.
//!
//! The voxels are those with i + a j + b k ≡ 0 (mod m), a lattice of rank one: a and b have no factor in common with m, so that of any m voxels in a
//! row along an axis exactly one belongs to it, and are chosen such that its nearest voxels lie as far apart as they can (Sloan & Joe, *Lattice
//! Methods for Multiple Integration*, 1994). Edges and faces are thus met evenly, however they lie.

use crate::grid::{Dims, Observation, Outside, Similarity};
use crate::lanes::{Kernel, dispatch, multiply_add};
use std::cmp::Reverse;

/// Some of the voxels of a grid, ascending.
pub struct Lattice {
    dims: Dims,
    voxels: Vec<usize>,
    /// Their centres along each axis, in voxels from the grid's centre.
    centres: [Vec<f32>; 3],
}

/// An observation sampled at the voxels of a lattice: a bit for each, from the first voxel on, in words of [`WORD`].
#[derive(Default)]
pub struct Sampled {
    /// Known to be filled or empty.
    pub known: Vec<u64>,
    /// Known to be filled.
    pub filled: Vec<u64>,
}

/// Bits of a word.
const WORD: usize = u64::BITS as usize;

/// How many bits are set.
pub fn count(words: impl Iterator<Item = u64>) -> usize {
    words.map(|word| word.count_ones() as usize).sum()
}

/// Lists the bits that are set.
pub fn list(words: impl Iterator<Item = u64>, places: &mut Vec<u32>) {
    places.clear();
    for (start, mut word) in (0..).step_by(WORD).zip(words) {
        while word != 0 {
            places.push(start + word.trailing_zeros());
            word &= word - 1;
        }
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

    /// Bits of the last word, set where there is a voxel.
    pub fn last_word(&self) -> u64 {
        match self.voxels.len() % WORD {
            0 => u64::MAX,
            count => (1 << count) - 1,
        }
    }

    /// Moves an observation to the canonical grid of an object that lies so, as far as the lattice goes.
    pub fn sample(&self, Codes(codes): &Codes, placed: &Similarity, out: &mut Sampled) {
        let (matrix, offset) = placed.map();
        let sides = <[usize; 3]>::from(self.dims);
        let row = |axis: usize| {
            let middle = (sides[axis] as f64 - 1.0) / 2.0;
            [matrix[(axis, 0)], matrix[(axis, 1)], matrix[(axis, 2)], offset[axis] + middle].map(|v| v as f32)
        };
        let words = self.voxels.len().div_ceil(WORD);
        out.known.resize(words, 0);
        out.filled.resize(words, 0);
        let rows = [row(0), row(1), row(2)];
        dispatch(Sample { rows, sides: sides.map(|side| side as u32), centres: &self.centres, codes, out });
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

/// Looks up what is known of the voxel that each voxel of a lattice comes from.
struct Sample<'a> {
    /// (x, y, z, 1) to the place along each axis, in voxels from the first.
    rows: [[f32; 4]; 3],
    sides: [u32; 3],
    centres: &'a [Vec<f32>; 3],
    codes: &'a [u8],
    out: &'a mut Sampled,
}

/// The nearest whole number to a place along an axis; one below zero, or beyond two millions, becomes larger than any grid.
#[inline(always)]
fn nearest<const FUSED: bool>(row: &[f32; 4], x: f32, y: f32, z: f32) -> u32 {
    // 1.5 · 2²³: adding it rounds to the nearest whole number, ties to even, which is left in the low bits.
    const ROUND: f32 = 12_582_912.0;
    let [a, b, c, d] = *row;
    let exact = multiply_add::<FUSED>(a, x, multiply_add::<FUSED>(b, y, multiply_add::<FUSED>(c, z, d)));
    (exact + ROUND).to_bits().wrapping_sub(ROUND.to_bits())
}

impl Kernel for Sample<'_> {
    type Output = ();

    #[inline(always)]
    fn run<const FUSED: bool>(self) {
        let Self { rows, sides: [nx, ny, nz], centres: [xs, ys, zs], codes, out } = self;
        let outside = nx * ny * nz;
        let words = out.known.iter_mut().zip(&mut out.filled);
        let chunks = xs.chunks(WORD).zip(ys.chunks(WORD)).zip(zs.chunks(WORD));
        let mut sources = [0_u32; WORD];
        let mut found = [0_u8; WORD];
        for ((known, filled), ((xs, ys), zs)) in words.zip(chunks) {
            for (((source, x), y), z) in sources.iter_mut().zip(xs).zip(ys).zip(zs) {
                let i = nearest::<FUSED>(&rows[0], *x, *y, *z);
                let j = nearest::<FUSED>(&rows[1], *x, *y, *z);
                let k = nearest::<FUSED>(&rows[2], *x, *y, *z);
                let inside = (i < nx) & (j < ny) & (k < nz);
                let index = i.wrapping_mul(ny).wrapping_add(j).wrapping_mul(nz).wrapping_add(k);
                *source = if inside { index } else { outside };
            }
            for (found, source) in found.iter_mut().zip(&sources[..xs.len()]) {
                *found = codes[*source as usize];
            }
            found[xs.len()..].fill(0);
            (*known, *filled) = (0, 0);
            for (bit, code) in found.iter().enumerate() {
                *known |= u64::from(code & KNOWN) << bit;
                *filled |= u64::from((code & FILLED) / FILLED) << bit;
            }
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
                let listed = |words: &[u64]| {
                    let mut places = Vec::new();
                    list(words.iter().copied(), &mut places);
                    assert_eq!(places.len(), count(words.iter().copied()));
                    places
                };
                assert_eq!(listed(&sampled.known), those(&|voxel| moved.known().contains(voxel)));
                assert_eq!(listed(&sampled.filled), those(&|voxel| moved.filled().contains(voxel)));
                assert!(sampled.filled.iter().any(|word| *word != 0));
                assert_eq!(sampled.known.last().unwrap() & !lattice.last_word(), 0);
            }
        }
    }
}
