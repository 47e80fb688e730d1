//! Queries of large grids, stage by stage, beside a plain read of all of the basis: the machine's limit for what must read all of it.
//!
//! In each round every observation is answered, and the basis is read once from end to end by all threads, so that other work on the
//! machine slows all of it alike.

use super::limits::sum;
use super::machine::process_memory;
use super::percentiles::Percentiles;
use beo_core::grid::Observation;
use beo_core::model::Model;
use beo_core::perception::{PerceiveError, Perceiver, Percept, PoseSearch, Query};
use rayon::prelude::*;
use serde::Serialize;
use std::hint::black_box;
use std::time::Instant;

/// The timed steps. The first three make up a query in known pose.
pub const STAGES: [&str; 6] = [
    "read and check the bytes",
    "class, known pose",
    "completion, as bytes",
    "query in known pose: all three",
    "class and yaw",
    "class and pose in SO(3)",
];
/// The stage that is all of a query in known pose.
const WHOLE: usize = 3;
/// Rotations are searched for this many observations of a round: they take longer.
pub const POSES: usize = 2;

/// The measured values.
#[derive(Clone, Debug, Serialize)]
pub struct Large {
    /// Stages with their times in microseconds.
    pub stages: Vec<(&'static str, Percentiles)>,
    /// Reading all of W', microseconds.
    pub read_basis: Percentiles,
    /// Bytes of W'.
    pub basis_bytes: usize,
    /// Median of a query in known pose over that of reading the basis.
    pub ratio: f64,
    /// Memory of this process before the basis was read as a whole, bytes: all, and pages of files.
    pub resident: Option<[usize; 2]>,
}

/// Answers observations, given as one byte per voxel, `rounds` times; of the first `poses` the rotation is searched too.
///
/// # Errors
/// As the queries.
pub fn measure(
    perceiver: &Perceiver,
    grids: &[Vec<u8>],
    rounds: usize,
    poses: usize,
    mut answered: impl FnMut(),
) -> Result<Large, PerceiveError> {
    let model = perceiver.model();
    let dims = model.dims();
    let mut work = perceiver.workspace();
    let mut percept = Percept::default();
    let mut seen = Observation::unknown(dims);
    let (mut occupancy, mut deviation) = (vec![1_u8; dims.voxels()], vec![1_u8; dims.voxels()]);
    let mut times: [Vec<u64>; STAGES.len()] = Default::default();
    let mut reads = Vec::new();
    let mut resident = None;
    // The first answers find pages that are not in memory yet.
    for round in 0..=rounds {
        for (n, grid) in grids.iter().enumerate() {
            let known = Query { completion: true, ..Query::default() };
            let start = Instant::now();
            seen.read(grid).expect("written by an observation");
            let read = Instant::now();
            let answer = perceiver.classify(&seen, &known, &mut work, &mut percept)?;
            let classified = Instant::now();
            answer.complete_into(&mut occupancy, &mut deviation)?;
            let completed = Instant::now();
            let mut took = vec![read - start, classified - read, completed - classified, completed - start];
            if n < poses {
                for pose in [PoseSearch::YAW, PoseSearch::Full] {
                    let start = Instant::now();
                    let query = Query { pose, ..Query::default() };
                    perceiver.classify(&seen, &query, &mut work, &mut percept)?;
                    took.push(start.elapsed());
                }
            }
            if round > 0 {
                times.iter_mut().zip(took).for_each(|(times, took)| times.push(took.as_nanos() as u64));
            }
            answered();
        }
        if resident.is_none() {
            resident = process_memory("VmRSS:").zip(process_memory("RssFile:")).map(<[usize; 2]>::from);
        }
        let start = Instant::now();
        read_basis(model);
        if round > 0 {
            reads.push(start.elapsed().as_nanos() as u64);
        }
    }
    let stages: Vec<_> = STAGES.iter().copied().zip(times.map(Percentiles::of_times)).filter(|(_, times)| times.count > 0).collect();
    let read_basis = Percentiles::of_times(reads);
    let ratio = stages[WHOLE].1.p50 / read_basis.p50.max(f64::MIN_POSITIVE);
    Ok(Large { stages, read_basis, basis_bytes: size_of_val(model.basis.values()), ratio, resident })
}

/// Reads all of W' with all threads, once.
fn read_basis(model: &Model) {
    let values: &[u8] = bytemuck::cast_slice(model.basis.values());
    let whole = values.len() / size_of::<u64>() * size_of::<u64>();
    let total: u64 = values[..whole]
        .par_chunks(1 << 20)
        .map(|bytes| {
            // Words, where the tensor begins at one: safetensors aligns all that it writes.
            bytemuck::try_cast_slice::<u8, u64>(bytes).map_or_else(|_| sum(bytes), sum)
        })
        .reduce(|| 0, u64::wrapping_add);
    black_box(total);
}

impl std::fmt::Display for Large {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { stages, read_basis, basis_bytes, ratio, resident } = self;
        writeln!(f, "{:<34}{:>10}{:>10}{:>10}  ms", "", "p50", "p90", "max")?;
        let mut row =
            |name: &str, p: &Percentiles| writeln!(f, "{name:<34}{:>10.2}{:>10.2}{:>10.2}", p.p50 / 1e3, p.p90 / 1e3, p.max / 1e3);
        stages.iter().try_for_each(|(name, times)| row(name, times))?;
        row("a plain read of the whole basis", read_basis)?;
        let megabytes = *basis_bytes as f64 / 1e6;
        writeln!(f, "the basis has {megabytes:.1} MB: read at {:.1} GB/s", megabytes / 1e3 / (read_basis.p50 / 1e6))?;
        write!(f, "a query in known pose takes {ratio:.2} times as long as reading the basis")?;
        if let Some([all, files]) = resident {
            write!(
                f,
                "\nresident after the first answers: {:.0} MB, of which {:.0} MB are pages of files",
                *all as f64 / 1e6,
                *files as f64 / 1e6
            )?;
        }
        Ok(())
    }
}
