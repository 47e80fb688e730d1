//! How fast the machine can go at most: products of matrices, reading from memory and from the shared cache.

use super::machine::Machine;
use super::percentiles::median;
use beo_core::lanes::{Kernel, dispatch};
use faer::linalg::matmul::matmul;
use faer::{Accum, Mat, Par};
use rayon::prelude::*;
use serde::Serialize;
use std::hint::black_box;
use std::time::Instant;

/// The limits that no computation on this machine exceeds.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Limits {
    /// Threads of the figures for all threads.
    pub threads: usize,
    /// Products of f32 matrices, each thread its own, GFLOP/s.
    pub gflops: f64,
    /// The same with one thread.
    pub gflops_one: f64,
    /// Reading from memory, all threads, GB/s.
    pub memory_gb_s: f64,
    /// The same with one thread.
    pub memory_gb_s_one: f64,
    /// Reading what lies in the shared cache, all threads, GB/s.
    pub cache_gb_s: f64,
}

/// Rows and columns of the matrices that are multiplied.
const MATRIX: usize = 1024;
/// Bytes that lie in the cache that the cores share, and not in their own.
const CACHED: usize = 4 << 20;
/// Times that each is measured; the median counts.
const TIMES: usize = 7;

impl Limits {
    /// Measures them on rayon's threads; a second or so.
    pub fn measure(machine: &Machine) -> Self {
        let threads = rayon::current_num_threads();
        let big = vec![1_u64; (4 * machine.cache_bytes).max(256 << 20) / size_of::<u64>()];
        let cached = &big[..CACHED / size_of::<u64>()];
        Self {
            threads,
            gflops: (0..threads).into_par_iter().map(|_| gflops()).sum(),
            gflops_one: gflops(),
            memory_gb_s: gb_per_second(&big, threads, 1),
            memory_gb_s_one: gb_per_second(&big, 1, 1),
            cache_gb_s: gb_per_second(cached, threads, 50),
        }
    }
}

/// Products of matrices on this thread.
fn gflops() -> f64 {
    let (a, b) = (Mat::<f32>::full(MATRIX, MATRIX, 0.5), Mat::<f32>::full(MATRIX, MATRIX, 0.25));
    let mut product = Mat::<f32>::zeros(MATRIX, MATRIX);
    let seconds = seconds(|| matmul(product.as_mut(), Accum::Replace, a.as_ref(), b.as_ref(), 1.0, Par::Seq));
    2.0 * (MATRIX as f64).powi(3) / seconds / 1e9
}

/// Reading `values` by `threads` threads, over and over.
fn gb_per_second(values: &[u64], threads: usize, rounds: usize) -> f64 {
    let share = values.len().div_ceil(threads);
    let seconds = seconds(|| {
        let total: u64 =
            values.par_chunks(share).map(|values| (0..rounds).map(|_| sum(black_box(values))).fold(0, u64::wrapping_add)).sum();
        black_box(total);
    });
    (size_of_val(values) * rounds) as f64 / seconds / 1e9
}

/// Reads all of `values`: their sum, modulo 2^64.
pub fn sum<T: Copy + Into<u64>>(values: &[T]) -> u64 {
    dispatch(Sum(values))
}

struct Sum<'a, T>(&'a [T]);

impl<T: Copy + Into<u64>> Kernel for Sum<'_, T> {
    type Output = u64;

    #[inline(always)]
    fn run<const FUSED: bool>(self) -> u64 {
        let mut sum = 0_u64;
        for value in self.0 {
            sum = sum.wrapping_add((*value).into());
        }
        sum
    }
}

fn seconds(mut once: impl FnMut()) -> f64 {
    once();
    let time = |_| {
        let start = Instant::now();
        once();
        start.elapsed().as_secs_f64()
    };
    median((0..TIMES).map(time))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_values_are_read() {
        let values: Vec<u64> = (0..1003).collect();
        assert_eq!(sum(&values), 1002 * 1003 / 2);
        assert_eq!(sum(&[255_u8; 1003]), 255 * 1003);
        assert_eq!(sum(&[u64::MAX, 3]), 2);
    }
}
