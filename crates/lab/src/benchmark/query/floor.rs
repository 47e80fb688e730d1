//! The least that the answer to a query reads and computes, so that times can be held against the machine.
//!
//! Counted is what the answer depends on in the pose that is answered, as it is kept in memory; what a search touches beside it is not. For
//! class and pose: the hull densities of all classes (mean, and half of the whitening in 16 bits), of the prefix sums of W' in 24
//! bits two rows for each run of the hull, and of each class whose evidence is asked: its Gram matrices over stacks of unknown voxels and
//! its rows of the other unknown and of the filled ones, in 16 bits. For a completion besides: of each class that takes part, the
//! blocks of its columns that hold unknown voxels, a product with its triangular k × k factor for the deviation of each of them, and the two
//! values of each voxel that are written.

use super::peers::OwnAnswer;
use super::questions::{Question, Search};
use super::timing::Task;
use beo_core::grid::Turn;
use beo_core::model::Model;
use beo_core::perception::{ClassSubspace, ColumnSums, Gaussian, Known, LEAST_SHARE, MOST_PARTS};
use serde::Serialize;

/// Bytes and floating-point operations.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Floor {
    /// Bytes that must be read or written.
    pub bytes: f64,
    /// Additions and multiplications that must be done.
    pub flops: f64,
}

impl Floor {
    /// Of one question with its answer.
    pub fn new(model: &Model, search: Search, question: &Question, answer: &OwnAnswer, task: Task) -> Self {
        let (dims, a, m) = (model.dims(), model.rank(), model.classes.len());
        let (seen, percept) = (&question.observation, &answer.percept);
        let mut known = Known::new(dims);
        match search {
            Search::Known => known.read(seen),
            _ => known.read(&Turn::new(dims, &percept.rotation_object_to_grid.inverse()).observation(seen, question.query.outside)),
        }
        let (rows, sums) = ColumnSums::read_of(dims, a, &known.hull);
        // The observation is two bits per voxel.
        let mut bytes = sums + m * Gaussian::bytes(a) + dims.voxels() / 4;
        let mut flops = rows * a + m * a * (a + 1);
        let mut scored = answer.scored.clone();
        if task == Task::Completion {
            let mut order: Vec<usize> = (0..m).collect();
            order.sort_by(|s, t| percept.posterior[*t].total_cmp(&percept.posterior[*s]));
            if percept.informed {
                order.truncate(percept.posterior.iter().filter(|p| **p > LEAST_SHARE).count().clamp(1, MOST_PARTS));
            }
            for s in order {
                let k = model.classes[s].variances.len();
                scored[s] = true;
                bytes += ClassSubspace::read_to_complete(dims, k, &known).1;
                flops += known.unknown.iter().map(|(start, end)| end - start).sum::<usize>() * (k * (k + 1) + 4 * k);
            }
            bytes += 2 * size_of::<f32>() * dims.voxels();
        }
        let rest: usize = known.division.rest.iter().map(|(start, end)| end - start).sum();
        for (class, _) in model.classes.iter().zip(scored).filter(|(_, scored)| *scored) {
            let k = class.variances.len();
            let gram = (k + 2) * (k + 3);
            bytes += ClassSubspace::bytes_to_condition(k, &known);
            flops += rest * gram + known.division.levels.len() * gram / 2 + known.filled.len() * (k + 2) + k * k * k / 3;
        }
        Self { bytes: bytes as f64, flops: flops as f64 }
    }

    /// The mean over questions.
    pub fn mean(floors: &[Self]) -> Self {
        let n = floors.len().max(1) as f64;
        let sum = floors.iter().fold(Self::default(), |sum, f| Self { bytes: sum.bytes + f.bytes, flops: sum.flops + f.flops });
        Self { bytes: sum.bytes / n, flops: sum.flops / n }
    }
}
