//! The machine: what it is, where a thread may run, and how fast it can go at most.

use super::percentiles::median;
use faer::linalg::matmul::matmul;
use faer::{Accum, Mat, Par};
use rayon::prelude::*;
use rustix::thread::{CpuSet, sched_getaffinity, sched_setaffinity};
use serde::Serialize;
use std::fs::read_to_string;
use std::hint::black_box;
use std::time::Instant;

/// What figures depend on.
#[derive(Clone, Debug, Serialize)]
pub struct Machine {
    /// The processor's name.
    pub cpu: String,
    /// Cores that this process may use.
    pub cores: usize,
    /// Bytes of the largest cache; 0 if the system does not say.
    pub cache_bytes: usize,
    /// Runnable threads, mean of the last minute.
    pub load: f64,
}

impl Machine {
    /// This machine, now.
    pub fn now() -> Self {
        let text = |path: &str| read_to_string(path).unwrap_or_default();
        let cpuinfo = text("/proc/cpuinfo");
        let field = |line: &str| line.split_once(':').map(|(_, value)| value.trim().to_owned());
        let cpu = cpuinfo.lines().find(|line| line.starts_with("model name")).and_then(field).unwrap_or_else(|| "unknown".into());
        let cache = |index: usize| {
            let size = text(&format!("/sys/devices/system/cpu/cpu0/cache/index{index}/size"));
            size.trim().strip_suffix('K').and_then(|kib| kib.parse::<usize>().ok()).map_or(0, |kib| kib << 10)
        };
        let load = text("/proc/loadavg").split_whitespace().next().and_then(|value| value.parse().ok()).unwrap_or(0.0);
        Self { cpu, cores: cores().len(), cache_bytes: (0..4).map(cache).max().unwrap_or(0), load }
    }
}

impl std::fmt::Display for Machine {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { cpu, cores, cache_bytes, load } = self;
        write!(f, "{cpu}, {cores} cores, {} MB of cache, load {load:.2} at the start", cache_bytes >> 20)?;
        if *load > 0.3 {
            write!(f, " (not idle: trust the ratios more than the times)")?;
        }
        Ok(())
    }
}

/// Most cores that are told apart.
const MOST_CORES: usize = 1024;

/// The cores that this thread may use.
fn cores() -> Vec<usize> {
    sched_getaffinity(None).map_or(Vec::new(), |set| (0..MOST_CORES).filter(|core| set.is_set(*core)).collect())
}

/// Keeps this thread on one of the cores that it may use, counted from 0. False where there are not so many.
pub fn pin(place: usize) -> bool {
    let Some(core) = cores().get(place).copied() else { return false };
    let mut set = CpuSet::new();
    set.set(core);
    sched_setaffinity(None, &set).is_ok()
}

/// What no computation on this machine exceeds.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Limits {
    /// Threads of the figures for all threads.
    pub threads: usize,
    /// Products of f32 matrices, all threads, GFLOP/s.
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
            gflops: gflops(Par::rayon(threads)),
            gflops_one: gflops(Par::Seq),
            memory_gb_s: gb_per_second(&big, threads, 1),
            memory_gb_s_one: gb_per_second(&big, 1, 1),
            cache_gb_s: gb_per_second(cached, threads, 50),
        }
    }
}

fn gflops(par: Par) -> f64 {
    let (a, b) = (Mat::<f32>::full(MATRIX, MATRIX, 0.5), Mat::<f32>::full(MATRIX, MATRIX, 0.25));
    let mut product = Mat::<f32>::zeros(MATRIX, MATRIX);
    let seconds = seconds(|| matmul(product.as_mut(), Accum::Replace, a.as_ref(), b.as_ref(), 1.0, par));
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

/// Reads all of `values`.
pub fn sum(values: &[u64]) -> u64 {
    pulp::Arch::new().dispatch(|| values.iter().copied().fold(0, u64::wrapping_add))
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
    fn a_pinned_thread_runs_on_one_core() {
        std::thread::spawn(|| {
            let before = cores();
            assert!(pin(before.len() - 1));
            assert_eq!(cores(), [before[before.len() - 1]]);
            assert!(!pin(MOST_CORES));
        })
        .join()
        .unwrap();
    }

    #[test]
    fn all_values_are_read() {
        let values: Vec<u64> = (0..1003).collect();
        assert_eq!(sum(&values), 1002 * 1003 / 2);
        assert!(Machine::now().cores > 0);
    }
}
