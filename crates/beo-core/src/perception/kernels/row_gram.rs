//! Gram matrices of rows of a few dozen values: Σ rowᵀrow, lower triangle, packed row after row.

use crate::lanes::{Kernel, LANES, load, multiply_add};
use std::iter::StepBy;
use std::ops::Range;

/// Rows of the triangle that are summed together.
const GROUP: usize = 4;

/// Where entry (i, j), j ≤ i, of a packed lower triangle lies.
#[inline(always)]
pub fn packed(i: usize, j: usize) -> usize {
    i * (i + 1) / 2 + j
}

/// Values of a packed lower triangle with `width` rows.
pub fn packed_len(width: usize) -> usize {
    width * (width + 1) / 2
}

/// Values that are read of a row of this width: whole blocks of lanes.
pub fn span(width: usize) -> usize {
    width.next_multiple_of(LANES)
}

/// Adds Σ rowᵀrow to `out`; products are summed in single precision, so give it no more than a few hundred rows at a time.
pub struct AddGram<'a, P> {
    /// Rows of which the first `width` values count. After the last, as many more values as [`span`] is longer than a row.
    pub rows: &'a [f32],
    /// Where the rows begin that are summed.
    pub starts: P,
    /// Values of a row that count.
    pub width: usize,
    /// A packed lower triangle.
    pub out: &'a mut [f64],
}

impl<'a> AddGram<'a, StepBy<Range<usize>>> {
    /// Of `count` rows one after the other, `stride` values from row to row.
    pub fn of_all(rows: &'a [f32], count: usize, stride: usize, width: usize, out: &'a mut [f64]) -> Self {
        Self { rows, starts: (0..count * stride).step_by(stride), width, out }
    }
}

impl<P: Iterator<Item = usize> + Clone> Kernel for AddGram<'_, P> {
    type Output = ();

    #[inline(always)]
    fn run<const FUSED: bool>(self) {
        let Self { rows, starts, width, out } = self;
        let span = span(width);
        for first in (0..width).step_by(GROUP) {
            let group = first..(first + GROUP).min(width);
            for from in (0..group.end).step_by(LANES) {
                let mut sums = [[0.0_f32; LANES]; GROUP];
                for at in starts.clone() {
                    let row = &rows[at..at + span];
                    let b = load(&row[from..]);
                    let a: &[f32; GROUP] = row[first..].first_chunk().expect("spans are whole groups");
                    for g in 0..GROUP {
                        for l in 0..LANES {
                            sums[g][l] = multiply_add::<FUSED>(a[g], b[l], sums[g][l]);
                        }
                    }
                }
                for (i, sums) in group.clone().zip(&sums) {
                    let to = packed(i, from)..packed(i, (from + LANES - 1).min(i)) + 1;
                    for (out, sum) in out[to].iter_mut().zip(sums) {
                        *out += f64::from(*sum);
                    }
                }
            }
        }
    }
}

/// Adds rowᵀrow of some voxels to a packed lower triangle, in double precision.
pub fn add_outer(sum: &mut [f64], rows: &[f32], stride: usize, width: usize, voxels: Range<usize>) {
    for row in rows[voxels.start * stride..voxels.end * stride].chunks_exact(stride.max(1)) {
        for i in 0..width {
            let factor = f64::from(row[i]);
            sum[packed(i, 0)..=packed(i, i)].iter_mut().zip(row).for_each(|(sum, v)| *sum += factor * f64::from(*v));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lanes::dispatch;

    #[test]
    fn the_kernel_sums_as_the_plain_loops_do() {
        for (width, stride) in [1, 3, 4, 15, 16, 17, 32, 41].into_iter().flat_map(|width| [(width, width), (width, span(width))]) {
            let rows: Vec<f32> = (0..56 * stride + span(width)).map(|i| ((i * 7919 % 1009) as f32 / 1009.0) - 0.4).collect();
            let (mut found, mut expected) = (vec![1.0; packed_len(width)], vec![1.0; packed_len(width)]);
            dispatch(AddGram::of_all(&rows, 57, stride, width, &mut found));
            let padded: Vec<f32> = rows.iter().copied().chain(std::iter::repeat_n(0.0, stride)).collect();
            add_outer(&mut expected, &padded, stride, width, 0..57);
            for (a, b) in found.iter().zip(&expected) {
                assert!((a - b).abs() < 1e-4, "{width}: {a} {b}");
            }
        }
    }
}
