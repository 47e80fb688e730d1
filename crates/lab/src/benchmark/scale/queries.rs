//! The queries of one case, timed stage by stage.

use beo_core::grid::{Observation, Outside};
use beo_core::perception::{PerceiveError, Perceiver, Percept, PoseSearch, Query, ScaleSearch, Workspace};
use nalgebra::Vector3;
use rayon::ThreadPool;
use std::sync::Arc;
use std::time::Instant;

/// Stages of a query whose times are told apart.
pub const STAGES: [&str; 3] = ["class", "completion", "yaw"];

/// Stages of a query about what a camera sees.
pub const CAMERA_STAGES: [&str; 2] = ["class, yaw, size and place", "completion"];

/// A model that is asked.
pub struct Asked {
    perceiver: Arc<Perceiver>,
    observations: Vec<Observation>,
    work: Workspace,
    percept: Percept,
    /// A completion as messages have it.
    bytes: [Vec<u8>; 2],
    next: usize,
    /// Where the camera was, if one saw them.
    camera: Option<Vector3<f64>>,
    /// Where it computes; `None` for the threads that all share.
    threads: Option<ThreadPool>,
}

impl Asked {
    /// Asks about these observations, one after the other.
    pub fn new(perceiver: Arc<Perceiver>, observations: Vec<Observation>, threads: Option<ThreadPool>) -> Self {
        Self {
            work: perceiver.workspace(),
            perceiver,
            observations,
            percept: Percept::default(),
            bytes: Default::default(),
            next: 0,
            camera: None,
            threads,
        }
    }

    /// Asks about what a camera there saw.
    pub fn seen_from(self, camera: Vector3<f64>) -> Self {
        Self { camera: Some(camera), ..self }
    }

    /// Microseconds of each of [`CAMERA_STAGES`], for the next observation, on one thread.
    pub fn once_by_camera(&mut self) -> Result<Vec<f64>, PerceiveError> {
        let query = Query {
            camera: self.camera,
            pose: PoseSearch::YAW,
            scale: ScaleSearch::Search { side: None },
            outside: Outside::Unknown,
            ..Query::default()
        };
        self.once_with(&query).map(Vec::from)
    }

    /// Microseconds of the first two of [`STAGES`], for the next observation.
    pub fn once_known(&mut self) -> Result<[f64; 2], PerceiveError> {
        self.once_with(&Query::default())
    }

    /// Microseconds that the answer to a query about the next observation takes, and its completion as bytes.
    fn once_with(&mut self, query: &Query) -> Result<[f64; 2], PerceiveError> {
        let Self { perceiver, observations, work, percept, next, bytes, .. } = self;
        let observation = &observations[*next];
        *next = (*next + 1) % observations.len();
        let [occupancy, deviation] = bytes;
        [&mut *occupancy, &mut *deviation].into_iter().for_each(|bytes| bytes.resize(observation.dims().voxels(), 0));
        let start = Instant::now();
        let answer = perceiver.classify(observation, query, work, percept)?;
        let classified = Instant::now();
        answer.complete_into(occupancy, deviation)?;
        Ok([microseconds(start, classified), microseconds(classified, Instant::now())])
    }

    /// Microseconds of each of [`STAGES`], for the next observation: class in known pose, its completion, class and yaw.
    pub fn once(&mut self) -> Result<Vec<f64>, PerceiveError> {
        let Self { perceiver, observations, work, percept, next, threads, .. } = self;
        let observation = &observations[*next];
        *next = (*next + 1) % observations.len();
        let mut ask = || {
            let (known, yaw) = (Query::default(), Query { pose: PoseSearch::YAW, ..Query::default() });
            let start = Instant::now();
            let answer = perceiver.classify(observation, &known, work, percept)?;
            let classified = Instant::now();
            answer.complete()?;
            let completed = Instant::now();
            perceiver.classify(observation, &yaw, work, percept)?;
            let posed = Instant::now();
            Ok([(start, classified), (classified, completed), (completed, posed)].map(|(from, to)| microseconds(from, to)).into())
        };
        match threads {
            Some(threads) => threads.install(ask),
            None => ask(),
        }
    }
}

/// From one instant to another.
pub fn microseconds(from: Instant, to: Instant) -> f64 {
    (to - from).as_secs_f64() * 1e6
}
