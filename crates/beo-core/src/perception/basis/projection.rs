//! Linear projection onto W' (eq. 5 without the mean, as W' spans the means): the sum of the rows of W' over a set of voxels.
//!
//! Voxels come in vertical runs, so prefix sums of W' along each column turn a run of any length into two rows.

use crate::grid::{Dims, for_each_run};
use crate::lanes::{Kernel, LANES, Lanes, dispatch, widen};
use crate::model::Basis;
use crate::perception::kernels::large_pages::collapse;
use bytemuck::{cast_slice, cast_slice_mut};
use fixedbitset::FixedBitSet;
use rayon::prelude::*;

/// Prefix sums of a d × a matrix along the columns of the grid, in fixed point, each component with a scale of its own. They have 24
/// bits, in two parts: searches read the upper 16 alone, and a sum of n rows is then wrong by about √n / 3 · 2⁻¹⁶ of the component's
/// largest prefix sum.
pub struct ColumnSums {
    dims: Dims,
    /// Values of a row: a, padded to whole blocks of lanes.
    width: usize,
    /// Row `v` is the sum over the voxels of v's column from its bottom up to and including v: `width` values, then as many bytes of
    /// what rounding left of them, in 256ths.
    rows: Vec<i16>,
    /// By how much each component is multiplied.
    scales: Vec<f32>,
}

impl ColumnSums {
    /// Prefix sums of W'; d × a × 3 bytes.
    pub fn new(dims: Dims, basis: &Basis) -> Self {
        let width = basis.rank();
        let column_sums = |column: usize, sums: &mut [f32]| {
            basis.widen(column * dims.z()..(column + 1) * dims.z(), sums);
            for k in 1..dims.z() {
                let (below, here) = sums.split_at_mut(k * width);
                let below = &below[(k - 1) * width..];
                here[..width].iter_mut().zip(below).for_each(|(here, below)| *here += below);
            }
        };
        let scratch = || vec![0.0_f32; dims.z() * width];
        let largest = |mut largest: Vec<f32>, sums: &[f32]| {
            for row in sums.chunks_exact(width.max(1)) {
                largest.iter_mut().zip(row).for_each(|(largest, v)| *largest = largest.max(v.abs()));
            }
            largest
        };
        let largest = (0..dims.columns())
            .into_par_iter()
            .fold(
                || (scratch(), vec![0.0; width]),
                |(mut sums, found), column| {
                    column_sums(column, &mut sums);
                    let found = largest(found, &sums);
                    (sums, found)
                },
            )
            .map(|(_, found)| found)
            .reduce(|| vec![0.0; width], |a, b| largest(a, &b));
        let scales: Vec<f32> = largest.iter().map(|v| v / f32::from(i16::MAX)).collect();
        let padded = width.next_multiple_of(LANES);
        let mut rows = vec![0_i16; dims.voxels() * stride(padded)];
        rows.par_chunks_mut((dims.z() * stride(padded)).max(1)).enumerate().for_each_init(scratch, |scratch, (column, rows)| {
            column_sums(column, scratch);
            for (row, values) in rows.chunks_exact_mut(stride(padded).max(1)).zip(scratch.chunks_exact(width.max(1))) {
                let (sums, rests) = row.split_at_mut(padded);
                for (((sum, rest), v), scale) in sums.iter_mut().zip(cast_slice_mut::<_, i8>(rests)).zip(values).zip(&scales) {
                    let v = v / scale;
                    *sum = v.round() as i16;
                    *rest = ((v - v.round()) * 256.0).round() as i8;
                }
            }
        });
        collapse(&rows);
        Self { dims, width: padded, rows, scales }
    }

    /// Bytes that [`Self::new`] keeps for a model of `rank` components.
    pub fn bytes(dims: Dims, rank: usize) -> usize {
        size_of::<i16>() * dims.voxels() * stride(rank.next_multiple_of(LANES))
    }

    /// Rows that projecting these bits reads, and the bytes of them where W' has `width` columns: of a run its uppermost row, and the one
    /// below it if it does not stand on the ground.
    pub fn read_of(dims: Dims, width: usize, bits: &FixedBitSet) -> (usize, usize) {
        let mut rows = 0;
        for_each_run(bits, dims, 0..dims.columns(), |start, _| rows += 1 + usize::from(!start.is_multiple_of(dims.z())));
        (rows, rows * width * (size_of::<i16>() + size_of::<i8>()))
    }

    /// W'ᵀx of the binary vector with these bits, into `out` (a values).
    pub fn project(&self, bits: &FixedBitSet, out: &mut [f32]) {
        dispatch(AddBits(Sum::new(self, out), bits));
    }

    /// The same of the binary vector made of these runs (start, end), each inside one column; of the upper 16 bits.
    pub fn project_runs(&self, runs: &[(u32, u32)], out: &mut [f32]) {
        dispatch(AddRuns(Sum::new(self, out), runs));
    }

    /// A row: the upper 16 bits, and the lower 8.
    #[inline(always)]
    fn row(&self, voxel: usize) -> (&[[i16; LANES]], &[[i8; LANES]]) {
        let (sums, rests) = self.rows[voxel * stride(self.width)..][..stride(self.width)].split_at(self.width);
        (sums.as_chunks().0, cast_slice(rests).as_chunks().0)
    }
}

/// 16-bit values from row to row of `width` components.
fn stride(width: usize) -> usize {
    width + width / 2
}

/// A sum of rows, in whole numbers until it is complete; `FINE`: of all 24 bits.
struct Sum<'a, const FINE: bool> {
    sums: &'a ColumnSums,
    whole: &'a mut [Lanes],
    /// The components after the last whole block, and where they go.
    rest: Lanes,
    last: &'a mut [f32],
}

impl<'a, const FINE: bool> Sum<'a, FINE> {
    fn new(sums: &'a ColumnSums, out: &'a mut [f32]) -> Self {
        out.fill(0.0);
        let (whole, last) = out.as_chunks_mut();
        Self { sums, whole, rest: [0.0; LANES], last }
    }

    #[inline(always)]
    fn add(&mut self, start: usize, end: usize) {
        self.add_row(end - 1, 1.0);
        if !start.is_multiple_of(self.sums.dims.z()) {
            self.add_row(start - 1, -1.0);
        }
    }

    #[inline(always)]
    fn add_row(&mut self, voxel: usize, sign: f32) {
        let (upper, lower) = self.sums.row(voxel);
        for ((sum, upper), lower) in self.whole.iter_mut().chain([&mut self.rest]).zip(upper).zip(lower) {
            add(sum, &widen(upper), sign);
            if FINE {
                add(sum, &widen(lower), sign / 256.0);
            }
        }
    }

    #[inline(always)]
    fn finish(self) {
        self.last.iter_mut().zip(self.rest).for_each(|(last, sum)| *last = sum);
        let out = self.whole.as_flattened_mut().iter_mut().chain(self.last);
        out.zip(&self.sums.scales).for_each(|(out, scale)| *out *= scale);
    }
}

#[inline(always)]
fn add(sum: &mut Lanes, row: &Lanes, factor: f32) {
    for l in 0..LANES {
        sum[l] += factor * row[l];
    }
}

/// Adds the sums over the set bits.
struct AddBits<'a>(Sum<'a, true>, &'a FixedBitSet);

impl Kernel for AddBits<'_> {
    type Output = ();

    #[inline(always)]
    fn run<const FUSED: bool>(self) {
        let Self(mut sum, bits) = self;
        let dims = sum.sums.dims;
        for_each_run(bits, dims, 0..dims.columns(), |start, end| sum.add(start, end));
        sum.finish();
    }
}

/// Adds the sums over runs.
struct AddRuns<'a>(Sum<'a, false>, &'a [(u32, u32)]);

impl Kernel for AddRuns<'_> {
    type Output = ();

    #[inline(always)]
    fn run<const FUSED: bool>(self) {
        let Self(mut sum, runs) = self;
        for (start, end) in runs {
            sum.add(*start as usize, *end as usize);
        }
        sum.finish();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use half::f16;

    #[test]
    fn projection_is_the_sum_of_the_rows() {
        let dims = Dims::new(8, 9, 11).unwrap();
        let rows = (0..dims.voxels() * 3).map(|i| f16::from_f32(((i * 37 % 101) as f32 - 50.0) / 64.0)).collect();
        let basis = Basis::new(3, rows);
        let mut bits = FixedBitSet::with_capacity(dims.voxels());
        (0..dims.voxels()).filter(|v| v * v % 7 < 4).for_each(|v| bits.insert(v));
        let runs = (0..dims.columns()).map(|c| (c * 11..c * 11 + 11).map(|v| bits.contains(v)).collect::<Vec<_>>());
        let rows: usize = runs.map(|column| column.windows(2).filter(|w| w[0] != w[1]).count() + usize::from(column[10])).sum();
        assert_eq!(ColumnSums::read_of(dims, 3, &bits), (rows, rows * 9));
        let mut out = [f32::NAN; 3];
        ColumnSums::new(dims, &basis).project(&bits, &mut out);
        for (h, value) in out.iter().enumerate() {
            let expected: f64 = bits.ones().map(|v| f64::from(basis.row(v)[h].to_f32())).sum();
            assert!((f64::from(*value) - expected).abs() < 1e-5, "{value} {expected}");
        }
    }
}
