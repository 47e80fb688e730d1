//! How long answers take: warm, with cold caches, and at 30 a second.

use super::questions::Question;
use crate::benchmark::limits::sum;
use crate::benchmark::machine::Machine;
use crate::benchmark::percentiles::Percentiles;
use beo_core::perception::{PerceiveError, Perceiver, Percept, Workspace};
use serde::{Deserialize, Serialize};
use std::hint::black_box;
use std::time::{Duration, Instant};

/// The tasks of a query.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Task {
    /// Class and pose.
    Class,
    /// Class, pose and completion with its deviation.
    Completion,
}

/// The activity before a query.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Condition {
    /// Another query.
    Warm,
    /// Something that took all caches.
    Cold,
    /// A sleep of 33 ms: a camera of 30 Hz.
    Paced,
}

/// Time between two frames of a camera.
const FRAME: Duration = Duration::from_millis(33);
/// Unmeasured queries before the others.
const WARM_UP: usize = 5;

impl Condition {
    /// All.
    pub const ALL: [Self; 3] = [Self::Warm, Self::Cold, Self::Paced];

    /// Its name.
    pub fn name(self) -> &'static str {
        match self {
            Self::Warm => "warm",
            Self::Cold => "cold cache",
            Self::Paced => "every 33 ms",
        }
    }
}

/// Something that takes all caches.
pub struct Evictor(Vec<u64>);

impl Evictor {
    /// Larger than the machine's largest cache.
    pub fn new(machine: &Machine) -> Self {
        Self(vec![1; (2 * machine.cache_bytes).max(32 << 20) / size_of::<u64>()])
    }

    fn evict(&self) {
        // On every thread, since each core has a cache of its own.
        rayon::broadcast(|_| black_box(sum(black_box(&self.0))));
    }
}

/// Answers the questions one after the other; reading and preparing them is not timed.
pub fn time_answers(
    perceiver: &Perceiver,
    work: &mut Workspace,
    questions: &[Question],
    task: Task,
    condition: Condition,
    evictor: &Evictor,
) -> Result<Percentiles, PerceiveError> {
    let mut percept = Percept::default();
    let mut times_ns = Vec::with_capacity(questions.len());
    for (i, question) in questions.iter().take(WARM_UP).chain(questions).enumerate() {
        match condition {
            Condition::Warm => {}
            Condition::Cold => evictor.evict(),
            Condition::Paced => std::thread::sleep(FRAME),
        }
        let start = Instant::now();
        let classified = perceiver.classify(&question.observation, &question.query, work, &mut percept)?;
        if task == Task::Completion {
            classified.complete()?;
        }
        let elapsed = start.elapsed();
        black_box(&percept);
        if i >= questions.len().min(WARM_UP) {
            times_ns.push(elapsed.as_nanos() as u64);
        }
    }
    Ok(Percentiles::of_times(times_ns))
}
