//! A class basis over voxels as a query reads it: in 16 bits, each component with a scale of its own. What a query costs is
//! memory to be read, more than arithmetic, and the basis that was learned has no more than 11 significant bits.

use crate::lanes::{Kernel, LANES, dispatch, widen};
use crate::perception::kernels::large_pages::collapse;
use rayon::prelude::*;

/// Rows of as many voxels, padded to whole blocks of lanes.
pub struct Rows {
    /// Values from row to row, a multiple of [`LANES`].
    stride: usize,
    values: Vec<i16>,
    /// By how much the values of each component are multiplied, `stride` of them.
    scales: Vec<f32>,
}

impl Rows {
    /// Rounds `rows`, `stride` values each.
    pub fn new(rows: &[f32], stride: usize) -> Self {
        assert!(stride.is_multiple_of(LANES) && rows.len().is_multiple_of(stride), "whole rows of whole blocks");
        let mut scales = vec![0.0_f32; stride];
        for row in rows.chunks_exact(stride) {
            scales.iter_mut().zip(row).for_each(|(largest, v)| *largest = largest.max(v.abs()));
        }
        // A power of two where the values are all zero or one, so that ones stay ones.
        scales.iter_mut().for_each(|scale| *scale = if *scale == 1.0 { 1.0 / 16384.0 } else { *scale / f32::from(i16::MAX) });
        let mut values = vec![0_i16; rows.len()];
        values.par_chunks_mut(stride).zip(rows.par_chunks_exact(stride)).for_each(|(values, row)| {
            for ((value, v), scale) in values.iter_mut().zip(row).zip(&scales) {
                // 0 / 0, where a component is all zeros, becomes 0.
                *value = (v / scale).round() as i16;
            }
        });
        collapse(&values);
        Self { stride, values, scales }
    }

    /// Values from row to row.
    pub fn stride(&self) -> usize {
        self.stride
    }

    /// By how much values are to be multiplied, one scale per component.
    pub fn scales(&self) -> &[f32] {
        &self.scales
    }

    /// A voxel's values, before they are multiplied by the scales.
    #[inline(always)]
    pub fn row(&self, voxel: usize) -> &[i16] {
        &self.values[voxel * self.stride..(voxel + 1) * self.stride]
    }

    /// All rows, as [`Self::row`].
    #[inline(always)]
    pub fn all(&self) -> impl Iterator<Item = &[i16]> {
        self.values.chunks_exact(self.stride)
    }

    /// One value.
    pub fn value(&self, voxel: usize, component: usize) -> f32 {
        f32::from(self.values[voxel * self.stride + component]) * self.scales[component]
    }

    /// Writes the rows of voxels, given as runs (start, end), to `out`; gives how many values.
    pub fn widen(&self, runs: &[(usize, usize)], out: &mut [f32]) -> usize {
        let count = runs.iter().map(|(start, end)| end - start).sum::<usize>() * self.stride;
        dispatch(Widen { rows: self, runs, out: &mut out[..count] });
        count
    }

    /// Adds the rows of some voxels to `out`, `stride` values.
    pub fn add(&self, voxels: &[usize], out: &mut [f64]) {
        out.fill(0.0);
        dispatch(Add { rows: self, voxels, out });
        out.iter_mut().zip(&self.scales).for_each(|(sum, scale)| *sum *= f64::from(*scale));
    }
}

struct Widen<'a> {
    rows: &'a Rows,
    runs: &'a [(usize, usize)],
    out: &'a mut [f32],
}

impl Kernel for Widen<'_> {
    type Output = ();

    #[inline(always)]
    fn run<const FUSED: bool>(self) {
        let Self { rows: Rows { stride, values, scales }, runs, out } = self;
        let scales = scales.as_chunks::<LANES>().0;
        let mut out = out.as_chunks_mut::<LANES>().0.iter_mut();
        for (start, end) in runs {
            for row in values[start * stride..end * stride].chunks_exact(*stride) {
                for ((values, scales), out) in row.as_chunks::<LANES>().0.iter().zip(scales).zip(&mut out) {
                    *out = widen(values);
                    for l in 0..LANES {
                        out[l] *= scales[l];
                    }
                }
            }
        }
    }
}

struct Add<'a> {
    rows: &'a Rows,
    voxels: &'a [usize],
    out: &'a mut [f64],
}

impl Kernel for Add<'_> {
    type Output = ();

    #[inline(always)]
    fn run<const FUSED: bool>(self) {
        for (block, out) in self.out.as_chunks_mut::<LANES>().0.iter_mut().enumerate() {
            // Whole numbers: sums of 2¹⁵ values stay exact.
            for voxels in self.voxels.chunks(1 << 15) {
                let mut sums = [0_i32; LANES];
                for voxel in voxels {
                    let values: &[i16; LANES] = self.rows.row(*voxel)[block * LANES..].first_chunk().expect("whole blocks");
                    for l in 0..LANES {
                        sums[l] += i32::from(values[l]);
                    }
                }
                for l in 0..LANES {
                    out[l] += f64::from(sums[l]);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_are_kept_in_sixteen_bits_and_ones_exactly() {
        let (stride, voxels) = (32, 50);
        let value = |i: usize| match i % stride {
            20 => 1.0,
            21.. => 0.0,
            _ => ((i * 7919 % 1009) as f32 / 1009.0 - 0.4) * (1 + i % stride) as f32,
        };
        let full: Vec<f32> = (0..voxels * stride).map(value).collect();
        let rows = Rows::new(&full, stride);
        let mut wide = vec![7.0; 4 * stride];
        assert_eq!(rows.widen(&[(3, 5), (9, 10)], &mut wide), 3 * stride);
        assert_eq!(wide[3 * stride], 7.0);
        for (at, voxel) in [3, 4, 9].into_iter().enumerate() {
            for h in 0..stride {
                let (found, expected) = (wide[at * stride + h], full[voxel * stride + h]);
                assert_eq!(found, rows.value(voxel, h));
                assert!((found - expected).abs() <= (1 + h) as f32 / 6e4, "{h}: {found} {expected}");
            }
            assert_eq!(wide[at * stride + 20], 1.0);
        }
        let mut sums = vec![f64::NAN; stride];
        rows.add(&[3, 4, 9], &mut sums);
        for (h, sum) in sums.iter().enumerate() {
            let expected: f64 = [3, 4, 9].iter().map(|v| f64::from(rows.value(*v, h))).sum();
            assert!((sum - expected).abs() < 1e-5, "{h}: {sum} {expected}");
        }
    }
}
