//! What every implementation of a query must read and compute, whatever its skill, so that times can be held against the machine.
//!
//! Counted is what the answer depends on in the pose that is answered; what a search touches beside it is not. For class and pose: the hull
//! densities of all classes (mean and half of the whitening, single precision) and of W' two rows of column sums for each run of
//! the hull. For a completion besides: of each class that takes part one row of its basis and mean per unknown voxel, a product with the k × k
//! triangular factor for its deviation, and the two values of each voxel that are written.

use super::questions::Question;
use super::timing::Task;
use crate::grid::for_each_run;
use crate::model::Model;
use crate::perception::Percept;
use serde::Serialize;

/// Bytes and floating-point operations.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Floor {
    /// Bytes that must be read or written.
    pub bytes: f64,
    /// Additions and multiplications that must be done.
    pub flops: f64,
}

/// Posterior from which on a class takes part in completions, and how many do at most.
const PART: (f64, usize) = (0.05, 3);

impl Floor {
    /// Of one question with its answer.
    pub fn new(model: &Model, question: &Question, percept: &Percept, task: Task) -> Self {
        let (d, a, m) = (model.dims().voxels(), model.rank(), model.classes.len());
        let single = size_of::<f32>() as f64;
        let mut runs = 0;
        for_each_run(question.observation.hull().bits(), model.dims(), 0..model.dims().columns(), |_, _| runs += 1);
        let densities = m * (a + a * (a + 1) / 2);
        let rows = 2 * runs * a;
        let mut floor = Self { bytes: single * (densities + rows) as f64 + d as f64 / 4.0, flops: (2 * densities + rows) as f64 };
        if task == Task::Completion {
            let unknown = d - question.observation.known().count_ones(..);
            let mut order: Vec<usize> = (0..m).collect();
            order.sort_by(|s, t| percept.posterior[*t].total_cmp(&percept.posterior[*s]));
            let parts = order.iter().filter(|s| percept.posterior[**s] > PART.0).count().clamp(1, PART.1);
            for s in &order[..parts.min(m)] {
                let k = model.classes[*s].variances.len();
                floor.bytes += single * (unknown * (k + 1)) as f64;
                floor.flops += (unknown * (k * (k + 1) + 4 * k)) as f64;
            }
            floor.bytes += 2.0 * single * d as f64;
        }
        floor
    }

    /// The mean over questions.
    pub fn mean(floors: &[Self]) -> Self {
        let n = floors.len().max(1) as f64;
        let sum = floors.iter().fold(Self::default(), |sum, f| Self { bytes: sum.bytes + f.bytes, flops: sum.flops + f.flops });
        Self { bytes: sum.bytes / n, flops: sum.flops / n }
    }
}
