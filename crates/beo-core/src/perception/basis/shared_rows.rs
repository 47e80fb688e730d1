//! W' as a query reads it where it lies, in the model's file: for grids whose derived tables would not fit into memory.
//!
//! One pass over the rows of the hull gives what every class needs: the Gram matrix of [W', 1] over the unknown voxels, from which that
//! of any class follows (its directions are combinations of the columns of W'), and the sum over the filled ones. The sum over the
//! hull, its projection (eq. 5), comes with them. Rows outside the footprint of the training shapes are zero and are never read.

use super::columns::BlockScratch;
use super::known::Known;
use super::shared_sums::SharedSums;
use crate::grid::{Dims, Observation, Outside, Rotation, for_each_run, nearest};
use crate::lanes::{Kernel, LANES, Lanes, dispatch};
use crate::model::{Basis, Damaged, Footprint};
use crate::perception::kernels::row_gram::{AddGram, packed, packed_len, span};
use crate::perception::pool::Pool;
use fixedbitset::FixedBitSet;
use nalgebra::Vector3;
use rayon::prelude::*;
use std::ops::Range;

/// Layers of constant x that one task reads.
const SLAB: usize = 4;
/// Voxels between two runs that are not worth leaving out when pages are checked.
const GAP: usize = 1 << 10;
/// Rows that are widened at once.
const BLOCK: usize = 1024;

/// The shared basis, and where it is not zero.
pub struct SharedRows {
    dims: Dims,
    basis: Basis,
    /// Voxels whose rows may differ from zero.
    support: FixedBitSet,
    /// Gram matrix of [W', 1] over all voxels, packed lower triangle.
    gram: Vec<f64>,
    /// Memory of those who sum at the same time: sums of all slabs, and rows that are widened.
    partials: Pool<Vec<Partial>>,
    widened: Pool<Vec<f32>>,
}

/// Sums over some voxels.
#[derive(Default)]
struct Partial {
    gram: Vec<f64>,
    rows: Vec<f64>,
    filled: Vec<f64>,
}

impl SharedRows {
    /// Of a model that says where its basis is not zero.
    pub fn new(dims: Dims, basis: &Basis, footprint: &Footprint) -> Self {
        Self {
            dims,
            basis: basis.clone(),
            support: footprint.voxels.clone(),
            gram: footprint.gram.clone(),
            partials: Pool::default(),
            widened: Pool::default(),
        }
    }

    /// Of a basis whose rows outside of `support` are zero.
    ///
    /// # Errors
    /// [`Damaged`] where the rows cannot be read.
    pub fn over(dims: Dims, basis: Basis, support: FixedBitSet) -> Result<Self, Damaged> {
        let mut rows = Self { dims, basis, support, gram: Vec::new(), partials: Pool::default(), widened: Pool::default() };
        let mut sums = SharedSums { unknown_bits: rows.support.clone(), filled_bits: rows.support.clone(), ..SharedSums::default() };
        sums.filled_bits.clear();
        rows.sum_bits(dims.voxels(), 0, &mut sums)?;
        rows.gram = sums.unknown;
        Ok(rows)
    }

    /// Where rows may differ from zero, and their Gram matrix: what a model keeps of them.
    pub fn footprint(&self) -> Footprint {
        Footprint { voxels: self.support.clone(), gram: self.gram.clone() }
    }

    /// Size of the grid.
    pub fn dims(&self) -> Dims {
        self.dims
    }

    /// Number of rows of W', d.
    pub fn voxels(&self) -> usize {
        self.dims.voxels()
    }

    /// Number of columns of W', a.
    pub fn rank(&self) -> usize {
        self.basis.rank()
    }

    /// Gram matrix of [W', 1] over all voxels, packed lower triangle.
    pub fn gram(&self) -> &[f64] {
        &self.gram
    }

    /// Sums over what was observed, into `known`.
    ///
    /// # Errors
    /// [`Damaged`] if rows that no query has read yet are not those that were written.
    pub fn sum(&self, known: &mut Known) -> Result<(), Damaged> {
        let mut sums = std::mem::take(&mut known.sums);
        let SharedSums { unknown_bits, filled_bits, .. } = &mut sums;
        unknown_bits.clone_from(&known.hull);
        unknown_bits.intersect_with(&self.support);
        filled_bits.clear();
        filled_bits.grow(self.dims.voxels());
        for &voxel in known.filled.iter().filter(|voxel| self.support.contains(**voxel)) {
            unknown_bits.remove(voxel);
            filled_bits.insert(voxel);
        }
        let unknown = known.unknown.iter().map(|(start, end)| end - start).sum();
        let outcome = self.sum_bits(unknown, known.filled.len(), &mut sums);
        known.sums = sums;
        outcome
    }

    /// Sums over an observation as it looks turned into the object's frame. Of voxels outside the footprint, which no class says
    /// anything about, nothing is counted: evidence is then to be taken relative to the background of the others.
    pub fn sum_turned(&self, seen: &Observation, rotation: &Rotation, outside: Outside, sums: &mut SharedSums) -> Result<(), Damaged> {
        const WORD: usize = usize::BITS as usize;
        let sides = <[usize; 3]>::from(self.dims);
        let middle = sides.map(|side| (side as f64 - 1.0) / 2.0);
        let matrix = rotation.to_rotation_matrix();
        let (known, filled) = (seen.known(), seen.filled());
        let states = |w: usize| {
            let (mut support, mut unknown_word, mut filled_word) = (self.support.as_slice()[w], 0, 0);
            while support != 0 {
                let bit = support.trailing_zeros() as usize;
                support &= support - 1;
                let at = self.dims.coordinates(w * WORD + bit);
                let from = matrix * Vector3::from_fn(|axis, _| at[axis] as f64 - middle[axis]);
                let source: [f64; 3] = std::array::from_fn(|axis| nearest(from[axis] + middle[axis]));
                if (0..3).all(|axis| source[axis] >= 0.0 && source[axis] < sides[axis] as f64) {
                    let [i, j, k] = source.map(|v| v as usize);
                    let source = self.dims.index(i, j, k);
                    unknown_word |= usize::from(!known.contains(source)) << bit;
                    filled_word |= usize::from(filled.contains(source)) << bit;
                } else {
                    unknown_word |= usize::from(outside == Outside::Unknown) << bit;
                }
            }
            (unknown_word, filled_word)
        };
        for bits in [&mut sums.unknown_bits, &mut sums.filled_bits] {
            bits.clear();
            bits.grow(self.dims.voxels());
        }
        let words = sums.unknown_bits.as_mut_slice().par_iter_mut().zip(sums.filled_bits.as_mut_slice());
        words.enumerate().with_min_len(1 << 10).for_each(|(w, (unknown, filled))| (*unknown, *filled) = states(w));
        let counts = [&sums.unknown_bits, &sums.filled_bits].map(|bits| bits.count_ones(..));
        self.sum_bits(counts[0], counts[1], sums)
    }

    /// Whether a row may differ from zero.
    pub fn reaches(&self, voxel: usize) -> bool {
        self.support.contains(voxel)
    }

    /// Sums over the bits of `sums`, which lie in the footprint; the ones are counted.
    fn sum_bits(&self, unknown: usize, filled: usize, sums: &mut SharedSums) -> Result<(), Damaged> {
        let a = self.rank();
        self.partials.with(Vec::new, |parts| {
            self.slabs(sums, parts)?;
            sums.unknown.clear();
            sums.unknown.resize(packed_len(a + 1), 0.0);
            sums.filled.clear();
            sums.filled.resize(a + 1, 0.0);
            let (gram, rows) = sums.unknown.split_at_mut(packed_len(a));
            for part in &*parts {
                for (sums, part) in [(&mut *gram, &part.gram), (&mut *rows, &part.rows), (&mut sums.filled, &part.filled)] {
                    sums.iter_mut().zip(part).for_each(|(sum, v)| *sum += v);
                }
            }
            rows[a] = unknown as f64;
            sums.filled[a] = filled as f64;
            Ok(())
        })
    }

    /// W'ᵀh of the hull h that `known` was read from and summed over.
    pub fn hull(&self, known: &Known, out: &mut [f32]) {
        let a = self.rank();
        for (h, out) in out.iter_mut().enumerate() {
            *out = (known.sums.unknown[packed(a, h)] + known.sums.filled[h]) as f32;
        }
    }

    /// W'ᵀx of the binary vector with these bits, into `out` (a values).
    pub fn project(&self, bits: &FixedBitSet, out: &mut [f32]) {
        let mut within = bits.clone();
        within.intersect_with(&self.support);
        let mut sums = vec![0.0_f64; self.rank()];
        self.blocks(&within, 0..self.dims.columns(), |rows, count| add_rows(rows, count, &mut sums));
        out.iter_mut().zip(sums).for_each(|(out, sum)| *out = sum as f32);
    }

    /// The components of the voxels of a column from `z` on, a multiple of [`LANES`], into the scratch memory; `false`: all are zero, and
    /// nothing was loaded.
    #[inline(always)]
    pub(in crate::perception) fn load(&self, column: usize, z: usize, scratch: &mut BlockScratch) -> bool {
        let first = column * self.dims.z() + z;
        let end = (first + LANES).min((column + 1) * self.dims.z());
        if !any(&self.support, first..end) {
            return false;
        }
        let a = self.rank();
        let BlockScratch { shared: block, rows, .. } = scratch;
        rows.resize(LANES * a, 0.0);
        self.basis.widen(first..end, &mut rows[..(end - first) * a]);
        rows[(end - first) * a..].fill(0.0);
        block.resize(a, [0.0; LANES]);
        for (h, block) in block.iter_mut().enumerate() {
            for l in 0..LANES {
                block[l] = rows[l * a + h];
            }
        }
        true
    }

    /// One row.
    pub fn row(&self, voxel: usize, out: &mut [f32]) {
        self.basis.widen(voxel..voxel + 1, out);
    }

    /// Sums over the bits of `sums`, slab by slab, in order: Gram matrix and sum over the unknown voxels, sum over the filled ones.
    fn slabs(&self, sums: &SharedSums, parts: &mut Vec<Partial>) -> Result<(), Damaged> {
        let (a, slab) = (self.rank(), SLAB * self.dims.y());
        parts.resize_with(self.dims.columns().div_ceil(slab), Partial::default);
        let (unknown, filled) = (&sums.unknown_bits, &sums.filled_bits);
        parts.par_iter_mut().enumerate().try_for_each(|(s, part)| {
            let columns = s * slab..((s + 1) * slab).min(self.dims.columns());
            for (values, count) in [(&mut part.gram, packed_len(a)), (&mut part.rows, a), (&mut part.filled, a)] {
                values.clear();
                values.resize(count, 0.0);
            }
            self.touch(unknown, columns.clone())?;
            self.blocks(unknown, columns.clone(), |rows, count| {
                add_rows(rows, count, &mut part.rows);
                dispatch(AddGram::of_all(rows, count, a, a, &mut part.gram));
            });
            self.touch(filled, columns.clone())?;
            self.blocks(filled, columns, |rows, count| add_rows(rows, count, &mut part.filled));
            Ok(())
        })
    }

    /// To be called before rows of unknown voxels are loaded again, after [`Self::sum`] has checked them: it keeps what stays in memory
    /// within its bound.
    pub(in crate::perception) fn touch_unknown(&self, known: &Known, columns: Range<usize>) -> Result<(), Damaged> {
        self.touch(&known.sums.unknown_bits, columns)
    }

    /// Makes sure of the rows of the set bits, and of short gaps between them.
    fn touch(&self, bits: &FixedBitSet, columns: Range<usize>) -> Result<(), Damaged> {
        let mut stretch = 0..0;
        let mut outcome = Ok(());
        for_each_run(bits, self.dims, columns, |start, end| {
            if start > stretch.end + GAP {
                outcome = outcome.and_then(|()| self.basis.touch(stretch.clone()));
                stretch.start = start;
            }
            stretch.end = end;
        });
        outcome.and_then(|()| self.basis.touch(stretch))
    }

    /// Calls `each` with the rows of the set bits, up to [`BLOCK`] at a time; room for a [`span`] lies after the last row.
    fn blocks(&self, bits: &FixedBitSet, columns: Range<usize>, mut each: impl FnMut(&[f32], usize)) {
        let a = self.rank();
        let make = || vec![0.0_f32; BLOCK * a + span(a)];
        self.widened.with(make, |rows| {
            let mut count = 0;
            for_each_run(bits, self.dims, columns, |start, end| {
                if count + (end - start) > BLOCK {
                    each(rows, count);
                    count = 0;
                }
                self.basis.widen(start..end, &mut rows[count * a..(count + end - start) * a]);
                count += end - start;
            });
            if count > 0 {
                each(rows, count);
            }
        });
    }
}

/// Whether any of these bits is set; at most [`LANES`] of them.
#[inline(always)]
fn any(bits: &FixedBitSet, voxels: Range<usize>) -> bool {
    const WORD: usize = usize::BITS as usize;
    let (word, at, length) = (voxels.start / WORD, voxels.start % WORD, voxels.len());
    let words = bits.as_slice();
    let mut found = words[word] >> at;
    if at + length > WORD {
        found |= words[word + 1] << (WORD - at);
    }
    found & ((1 << length) - 1) != 0
}

/// Adds the first `count` rows of as many values as `sums` has.
fn add_rows(rows: &[f32], count: usize, sums: &mut [f64]) {
    dispatch(AddRows(rows, count, sums));
}

struct AddRows<'a>(&'a [f32], usize, &'a mut [f64]);

impl Kernel for AddRows<'_> {
    type Output = ();

    #[inline(always)]
    fn run<const FUSED: bool>(self) {
        let Self(rows, count, sums) = self;
        let a = sums.len();
        for (first, sums) in (0..a).step_by(LANES).zip(sums.chunks_mut(LANES)) {
            let mut block: Lanes = [0.0; LANES];
            for at in (0..count * a).step_by(a) {
                let row: &Lanes = rows[at + first..].first_chunk().expect("room after the last row");
                for l in 0..LANES {
                    block[l] += row[l];
                }
            }
            sums.iter_mut().zip(block).for_each(|(sum, v)| *sum += f64::from(v));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::Observation;
    use half::f16;
    use proptest::prelude::*;

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(30))]
        /// Against plain sums over the voxels.
        #[test]
        fn sums_are_those_of_the_voxels(codes in prop::collection::vec(0..4_u8, 10 * 9 * 19), a in 1..22_usize, holes in 1..5_usize) {
            let dims = Dims::new(10, 9, 19).unwrap();
            let codes: Vec<u8> = codes.iter().map(|c| [0, 1, 255, 255][usize::from(*c)]).collect();
            let codes = &codes[..];
            let mut support = FixedBitSet::with_capacity(dims.voxels());
            (0..dims.voxels()).filter(|v| v / 7 % holes == 0).for_each(|v| support.insert(v));
            let value = |v: usize, h: usize| if support.contains(v) { f16::from_f32(((v * 37 + h * 11) % 101) as f32 / 64.0 - 0.8) } else { f16::ZERO };
            let basis = Basis::new(a, (0..dims.voxels()).flat_map(|v| (0..a).map(move |h| value(v, h))).collect());
            let rows = SharedRows::over(dims, basis, support.clone()).unwrap();
            let mut known = Known::new(dims);
            known.read(&Observation::from_bytes(dims, codes).unwrap());
            rows.sum(&mut known).unwrap();
            let entry = |v: usize, h: usize| if h == a { 1.0 } else { f64::from(value(v, h).to_f32()) };
            let mut hull = vec![0.0; a];
            rows.hull(&known, &mut hull);
            for (i, hull) in hull.iter().copied().chain([f32::NAN]).enumerate() {
                let of = |code: u8| (0..codes.len()).filter(move |v| code == 9 || codes[*v] == code);
                prop_assert!((known.sums.filled[i] - of(1).map(|v| entry(v, i)).sum::<f64>()).abs() < 1e-3);
                for j in 0..=i {
                    let all: f64 = of(9).map(|v| entry(v, i) * entry(v, j)).sum();
                    let unknown: f64 = of(255).map(|v| entry(v, i) * entry(v, j)).sum();
                    prop_assert!((rows.gram()[packed(i, j)] - all).abs() < 1e-2, "{} {all}", rows.gram()[packed(i, j)]);
                    prop_assert!((known.sums.unknown[packed(i, j)] - unknown).abs() < 1e-2);
                }
                if i < a {
                    let expected: f64 = (0..codes.len()).filter(|v| codes[*v] != 0).map(|v| entry(v, i)).sum();
                    prop_assert!((f64::from(hull) - expected).abs() < 1e-2);
                }
            }
            let mut projected = vec![0.0; a];
            rows.project(&known.hull, &mut projected);
            projected.iter().zip(&hull).for_each(|(a, b)| assert!((a - b).abs() < 1e-2));
            let mut scratch = BlockScratch::default();
            for column in 0..dims.columns() {
                for z in [0, 16] {
                    let loaded = rows.load(column, z, &mut scratch);
                    for l in 0..LANES.min(19 - z) {
                        for h in 0..a {
                            let expected = value(column * 19 + z + l, h).to_f32();
                            prop_assert_eq!(if loaded { scratch.shared[h][l] } else { 0.0 }, expected);
                        }
                    }
                }
            }
        }
    }
}
