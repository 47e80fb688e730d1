//! One observation in, percept and completion out.

use super::asked::ask;
use super::streams::Waiting;
use super::tracks::Tracks;
use beo_core::grid::{Observation, Rotation, from_xyzw, to_xyzw};
use beo_core::model::Model;
use beo_core::perception::{self, Frame, Method, PerceiveError, Perceiver, Query, Workspace};
use beo_ipc::clock::monotonic_ns;
use beo_ipc::tasks;
use beo_ipc::text::to_field;
use beo_ipc::validate::check_deadline;
use beo_ipc::{
    Hypothesis, LoanError, NO_RESTING_POSE, NOT_COMPUTED, ObservationHeader, Percept, PerceptStatus, PoseSearch, Refusal, Server,
};
use nalgebra::Vector3;
use std::sync::Arc;
use std::time::Duration;

/// Answers observations with one model.
pub struct Answerer {
    /// The model's name, for people.
    name: String,
    perceiver: Perceiver,
    work: Workspace,
    percept: perception::Percept,
    query: Query,
    /// The search for observations that say that their pose is known.
    pose: perception::PoseSearch,
    tracks: Tracks,
}

impl Answerer {
    /// An answerer that uses `query` for what observations do not say themselves; `name` is the model's.
    pub fn new(perceiver: Perceiver, query: Query, name: String) -> Self {
        Self {
            name,
            work: perceiver.workspace(),
            percept: perception::Percept::default(),
            perceiver,
            pose: query.pose,
            query,
            tracks: Tracks::default(),
        }
    }

    /// The model that answers.
    pub fn model(&self) -> &Arc<Model> {
        self.perceiver.model()
    }

    /// The model's name, for people.
    pub fn model_name(&self) -> &str {
        &self.name
    }

    /// Answers an observation that says nothing: a model for which this fails would fail for others, and the next is faster.
    ///
    /// # Errors
    /// Why it fails.
    pub fn rehearse(&mut self) -> Result<(), PerceiveError> {
        let nothing = Observation::unknown(self.model().dims());
        self.perceiver.classify(&nothing, &self.query, &mut self.work, &mut self.percept)?;
        let (mut occupancy, mut deviation) = (vec![0_u8; nothing.dims().voxels()], vec![0_u8; nothing.dims().voxels()]);
        self.perceiver.complete_into(&self.query, &mut self.work, &mut self.percept, &mut occupancy, &mut deviation)
    }

    /// Computes the percept of a valid observation and sends its completion if it was asked for; the percept is returned to be
    /// published after it. One whose deadline has passed, or in which nothing of an object is seen, is refused.
    pub fn answer(&mut self, server: &Server, waiting: &Waiting) -> Percept {
        let header = &waiting.header;
        if let Err(refusal) = check_deadline(header, monotonic_ns()) {
            let model_id = self.perceiver.model().id;
            return Percept { received_ns: waiting.received_ns, model_id, ..Percept::refusing(header, &refusal) };
        }
        let mut percept = Percept { received_ns: waiting.received_ns, model_id: self.perceiver.model().id, ..Percept::answering(header) };
        let started_ns = monotonic_ns();
        if let Err(error) = self.classify(waiting) {
            return internal(percept, &error.to_string());
        }
        if !self.percept.informed {
            let refusing = Percept::refusing(header, &Refusal::NothingSeen);
            return Percept { received_ns: percept.received_ns, model_id: percept.model_id, ..refusing };
        }
        let answer = &self.percept;
        let stamp = |since: Duration| started_ns + since.as_nanos() as u64;
        percept.projected_ns = stamp(answer.timings.projected);
        percept.classified_ns = stamp(answer.timings.classified);
        percept.posed_ns = stamp(answer.timings.posed);
        let classes = answer.posterior.len();
        percept.class_count = classes as u32;
        percept.class_index = answer.class as u32;
        percept.method = method_code(self.query.method).code();
        percept.tasks = tasks::CLASS | tasks::POSE;
        for s in 0..classes {
            percept.posterior[s] = answer.posterior[s] as f32;
            percept.log_score[s] = answer.scores.get(s).copied().unwrap_or(0.0) as f32;
        }
        percept.hypothesis_count = answer.hypotheses.len().min(percept.hypotheses.len()) as u32;
        for (field, h) in percept.hypotheses.iter_mut().zip(&answer.hypotheses) {
            let probability = h.probability as f32;
            *field = Hypothesis { rotation_object_to_grid: quaternion(&h.rotation), class_index: h.class as u32, probability };
        }
        percept.rotation_spread_rad = answer.spread as f32;
        place(&mut percept, answer);
        let beyond = BeyondClass::of(answer);
        (percept.none_probability, percept.fit) = (beyond.none_probability, beyond.fit);
        (percept.resting_pose, percept.filtered) = (beyond.resting_pose, u32::from(beyond.is_filtered));
        if header.tasks & tasks::COMPLETION != 0 {
            match self.complete(server, waiting) {
                Ok(()) => {
                    percept.tasks |= tasks::COMPLETION;
                    percept.completed_ns = monotonic_ns();
                }
                // The class is known all the same: the percept says that there is no completion, and why.
                Err(reason) => percept.explanation = to_field(&format!("no completion: {reason}")),
            }
        }
        percept
    }

    fn classify(&mut self, waiting: &Waiting) -> Result<(), PerceiveError> {
        let header = &waiting.header;
        let query = &mut self.query;
        ask(query, header, self.pose);
        if header.rotation_prior_concentration == 0.0
            && header.continues != 0
            && let Some(expected) = self.tracks.expectation(header.producer_id, header.continued_object_id)
        {
            query.rotation_prior = expected.clone();
        }
        self.perceiver.classify(&waiting.observation, query, &mut self.work, &mut self.percept)?;
        // What says nothing of the object does not change what is expected of it.
        if query.pose != perception::PoseSearch::Known && self.percept.informed {
            self.tracks.remember(header.producer_id, header.object_id, &self.percept);
        }
        Ok(())
    }

    /// Writes the completion in place into shared memory.
    fn complete(&mut self, server: &Server, waiting: &Waiting) -> Result<(), String> {
        let mut loan = server.loan_completion(&waiting.header).map_err(|error: LoanError| error.to_string())?;
        let header = loan.header_mut();
        header.model_id = self.perceiver.model().id;
        header.class_index = self.percept.class as u32;
        header.method = method_code(self.query.method).code();
        header.rotation_object_to_grid = quaternion(&self.percept.rotation);
        header.none_probability = BeyondClass::of(&self.percept).none_probability;
        header.frame = waiting.header.completion_frame;
        if self.query.frame == Frame::Object {
            // The canonical grid lies elsewhere and has other voxels where size and place were searched.
            header.position_m = object_position(&waiting.header, &self.percept);
            header.voxel_size_m *= self.percept.placed.scale as f32;
        }
        let (occupancy, deviation) = loan.occupancy_and_deviation_mut();
        let completed = self.perceiver.complete_into(&self.query, &mut self.work, &mut self.percept, occupancy, deviation);
        completed.map_err(|error| error.to_string())?;
        loan.send().map_err(|error| error.to_string())
    }
}

/// What an answer says besides class, pose, size and place.
struct BeyondClass {
    none_probability: f32,
    fit: f32,
    resting_pose: u32,
    is_filtered: bool,
}

impl BeyondClass {
    /// Perception does not compute these yet, and the messages say so. The one place where they are taken from its answer.
    fn of(_answer: &perception::Percept) -> Self {
        Self { none_probability: NOT_COMPUTED, fit: NOT_COMPUTED, resting_pose: NO_RESTING_POSE, is_filtered: false }
    }
}

/// Writes where the object is and how big.
fn place(percept: &mut Percept, answer: &perception::Percept) {
    let voxel = f64::from(percept.voxel_size_m);
    let metres = |lengths: [f64; 3]| lengths.map(|v| (v * voxel) as f32);
    percept.object_position_m = position(percept.position_m, percept.orientation, &(answer.placed.shift * voxel));
    if let Some(lay) = &answer.lay {
        percept.object_extent_m = metres(lay.extent);
        percept.object_extent_deviation_m = metres(lay.extent_deviation);
        percept.object_position_deviation_m = metres(lay.position_deviation);
    }
}

/// The object's centre in the frame in which the grid's placement is given, metres.
fn object_position(header: &ObservationHeader, answer: &perception::Percept) -> [f64; 3] {
    position(header.position_m, header.orientation, &(answer.placed.shift * f64::from(header.voxel_size_m)))
}

/// A point of the grid (metres from its centre) in the frame in which the grid lies so.
fn position(centre: [f64; 3], orientation: [f64; 4], point: &Vector3<f64>) -> [f64; 3] {
    (Vector3::from(centre) + from_xyzw(orientation) * point).into()
}

/// Why a valid header cannot be answered by this daemon, if so.
pub fn unsupported(header: &beo_ipc::ObservationHeader, model: [u32; 3], method: Method) -> Option<Refusal> {
    if header.dims != model {
        return Some(Refusal::DimsNotOfModel { dims: header.dims, model });
    }
    // This model has learned no resting poses.
    if header.pose_search == PoseSearch::Rest.code() {
        return Some(Refusal::PoseSearchNotSupported(PoseSearch::Rest));
    }
    // The paper's method projects the observation once for each of two thousand rotations: half a minute, all others waiting.
    let too_slow = header.pose_search == PoseSearch::Full.code() && method == Method::Paper;
    too_slow.then_some(Refusal::PoseSearchNotSupported(PoseSearch::Full))
}

fn quaternion(rotation: &Rotation) -> [f32; 4] {
    to_xyzw(rotation).map(|v| v as f32)
}

/// The same percept, saying that the daemon failed.
fn internal(percept: Percept, reason: &str) -> Percept {
    Percept { status: PerceptStatus::Internal.code(), explanation: to_field(reason), ..percept }
}

fn method_code(method: Method) -> beo_ipc::Method {
    match method {
        Method::Auto => beo_ipc::Method::Auto,
        Method::Hull => beo_ipc::Method::Hull,
        Method::Evidence => beo_ipc::Method::Evidence,
        Method::Paper => beo_ipc::Method::Paper,
        Method::Mean => beo_ipc::Method::Mean,
    }
}
