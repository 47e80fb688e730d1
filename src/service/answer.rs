//! One observation in, percept and completion out.

use super::asked::ask;
use super::streams::Waiting;
use super::tracks::{Answered, Tracks};
use beo_core::grid::{Observation, Rotation, from_xyzw, to_xyzw};
use beo_core::model::Model;
use beo_core::perception::{
    self, ClassBelief, Classified, CompletionFrame, Method, NoneBelief, PerceiveError, Perceiver, Query, Workspace,
};
use beo_ipc::clock::monotonic_ns;
use beo_ipc::tasks;
use beo_ipc::text::to_field;
use beo_ipc::validate::check_deadline;
use beo_ipc::{
    CompletionLoan, Hypothesis, LoanError, NO_RESTING_POSE, NOT_COMPUTED, ObservationHeader, Percept, PerceptStatus, PoseSearch, Refusal,
    ScaleSearch, Server,
};
use nalgebra::Vector3;
use std::sync::Arc;
use std::time::Duration;

/// Voxels up to which grids are answered side by side; of larger ones a single query keeps all cores busy.
const MOST_VOXELS_SIDE_BY_SIDE: usize = 64 * 64 * 64;

/// Answers observations with one model.
pub struct Answerer {
    /// The model's name, for people.
    name: String,
    perceiver: Perceiver,
    /// Settings that observations do not state themselves.
    query: Query,
    tracks: Tracks,
    /// As many as observations are answered side by side.
    desks: Vec<Desk>,
}

/// Where one observation at a time is answered.
struct Desk {
    work: Workspace,
    percept: perception::Percept,
    query: Query,
    /// The belief about the class of an object that continues, before this frame.
    believed: Option<ClassBelief>,
    /// The same of whether it has one.
    none: Option<NoneBelief>,
    /// The class posterior, given all frames of the object.
    filtered: Vec<f64>,
    started_ns: u64,
    /// The outcome.
    outcome: Outcome,
    /// A completion that does not go into shared memory at once: occupancy and deviation, a byte per voxel each.
    bytes: [Vec<u8>; 2],
}

/// The outcome of an observation.
#[derive(Default)]
enum Outcome {
    /// Nothing yet.
    #[default]
    Waiting,
    /// Nothing is seen of an object.
    Nothing,
    /// It could not be answered; why.
    Failed(String),
    /// It is classified, and completed if that was asked for: when, or why not.
    Classified { completion: Option<Result<u64, String>> },
}

impl Desk {
    fn new(perceiver: &Perceiver, query: &Query) -> Self {
        Self {
            work: perceiver.workspace(),
            percept: perception::Percept::default(),
            query: query.clone(),
            believed: None,
            none: None,
            filtered: Vec::new(),
            started_ns: 0,
            outcome: Outcome::Waiting,
            bytes: [Vec::new(), Vec::new()],
        }
    }

    /// Sets in the query what a header asks for and what is expected of an object that it continues; `defaults` says the rest.
    fn ask(&mut self, defaults: &Query, tracks: &Tracks, header: &ObservationHeader) {
        let Self { query, believed, none, started_ns, .. } = self;
        *started_ns = monotonic_ns();
        *believed = None;
        ask(query, header, defaults.pose);
        query.log_prior.clone_from(&defaults.log_prior);
        (*none, query.expected) = (None, None);
        let Some(track) = tracks.continued(header, *started_ns) else { return };
        if header.rotation_prior_concentration == 0.0 {
            track.expect(header, query);
        }
        // From above, the whole top of an object is seen in each frame, and one frame says as much as many.
        if beo_ipc::View::from_code(header.view) != Some(beo_ipc::View::Camera) {
            return;
        }
        track.class.log_prior(&mut query.log_prior);
        // A class that is left out stays out.
        for (expected, prior) in query.log_prior.iter_mut().zip(&defaults.log_prior) {
            if *prior == f64::NEG_INFINITY {
                *expected = *prior;
            }
        }
        (*believed, *none) = (Some(track.class), track.none);
    }

    /// Classifies an observation, and lets `complete` complete it if that was asked for.
    fn answer(
        &mut self,
        perceiver: &Perceiver,
        waiting: &Waiting,
        complete: impl FnOnce(Classified<'_>, &Query, &mut [Vec<u8>; 2]) -> Result<(), String>,
    ) {
        let Self { work, percept, query, bytes, .. } = self;
        self.outcome = match perceiver.classify(&waiting.observation, query, work, percept) {
            Err(error) => Outcome::Failed(error.to_string()),
            Ok(classified) if !classified.percept().informed => Outcome::Nothing,
            Ok(classified) => {
                let is_asked = waiting.header.tasks & tasks::COMPLETION != 0;
                let completion = is_asked.then(|| complete(classified, query, bytes).map(|()| monotonic_ns()));
                Outcome::Classified { completion }
            }
        };
    }

    /// Sends a completion that lies in the desk's own memory.
    fn send_completion(&mut self, model_id: u64, server: &Server, asked: &ObservationHeader) {
        if let Outcome::Classified { completion: Some(completion @ Ok(_)) } = &mut self.outcome {
            let send = || {
                let mut loan = loan_completion(&self.percept, self.none, model_id, &self.query, server, asked)?;
                let (occupancy, deviation) = loan.occupancy_and_deviation_mut();
                occupancy.copy_from_slice(&self.bytes[0]);
                deviation.copy_from_slice(&self.bytes[1]);
                loan.send().map_err(|error| error.to_string())
            };
            *completion = send().map(|()| monotonic_ns());
        }
    }

    /// The percept of what was answered; its object is remembered.
    fn percept(&mut self, tracks: &mut Tracks, model_id: u64, waiting: &Waiting) -> Percept {
        let header = &waiting.header;
        let answering = Percept { received_ns: waiting.received_ns, model_id, ..Percept::answering(header) };
        let completion = match std::mem::take(&mut self.outcome) {
            Outcome::Classified { completion } => completion,
            // What says nothing of the object does not change what is expected of it.
            Outcome::Nothing => {
                let refusing = Percept::refusing(header, &Refusal::NothingSeen);
                return Percept { received_ns: waiting.received_ns, model_id, ..refusing };
            }
            Outcome::Failed(reason) => return internal(answering, &reason),
            Outcome::Waiting => return internal(answering, "the thread that was to answer it has failed"),
        };
        let Self { percept: answer, query, believed, none, filtered, started_ns, .. } = self;
        let mut percept = answering;
        filtered.clone_from(&answer.posterior);
        let is_filtered = believed.is_some();
        let class = match believed {
            Some(class) => {
                class.update(filtered);
                *class
            }
            None => ClassBelief::first(filtered),
        };
        let answered = Answered::new(header, *started_ns, class, none_belief(answer, *none), query, answer);
        tracks.remember(header.producer_id, header.object_id, answered);
        let stamp = |since: Duration| *started_ns + since.as_nanos() as u64;
        percept.projected_ns = stamp(answer.timings.projected);
        percept.classified_ns = stamp(answer.timings.classified);
        percept.posed_ns = stamp(answer.timings.posed);
        let classes = answer.posterior.len();
        percept.class_count = classes as u32;
        percept.class_index = answer.class as u32;
        percept.method = method_code(query.method).code();
        percept.tasks = tasks::CLASS | tasks::POSE;
        for (field, probability) in percept.posterior.iter_mut().zip(filtered.iter()) {
            *field = *probability as f32;
        }
        for (field, score) in percept.log_score.iter_mut().zip(&answer.scores) {
            *field = *score as f32;
        }
        percept.hypothesis_count = answer.hypotheses.len().min(percept.hypotheses.len()) as u32;
        for (field, h) in percept.hypotheses.iter_mut().zip(&answer.hypotheses) {
            // Of the class over time, and of the pose in this frame.
            let probability = (h.probability * filtered[h.class] / answer.posterior[h.class].max(f64::MIN_POSITIVE)) as f32;
            *field = Hypothesis { rotation_object_to_grid: quaternion(&h.rotation), class_index: h.class as u32, probability };
        }
        percept.rotation_spread_rad = answer.rotation_spread_rad as f32;
        place(&mut percept, answer);
        let beyond = BeyondClass::of(answer, *none);
        (percept.none_probability, percept.fit) = (beyond.none_probability, beyond.fit);
        (percept.resting_pose, percept.filtered) = (beyond.resting_pose, u32::from(is_filtered));
        match completion {
            Some(Ok(completed_ns)) => {
                percept.tasks |= tasks::COMPLETION;
                percept.completed_ns = completed_ns;
            }
            // The class is known all the same: the percept says that there is no completion, and why.
            Some(Err(reason)) => percept.explanation = to_field(&format!("no completion: {reason}")),
            None => {}
        }
        percept
    }
}

impl Answerer {
    /// An answerer that uses `query` for what observations do not say themselves; `name` is the model's.
    pub fn new(perceiver: Perceiver, query: Query, name: String) -> Self {
        let voxels = perceiver.model().dims().voxels();
        let desks = if voxels <= MOST_VOXELS_SIDE_BY_SIDE { rayon::current_num_threads().max(1) } else { 1 };
        let desks = (0..desks).map(|_| Desk::new(&perceiver, &query)).collect();
        Self { name, perceiver, query, tracks: Tracks::default(), desks }
    }

    /// The model that answers.
    pub fn model(&self) -> &Arc<Model> {
        self.perceiver.model()
    }

    /// The model's name, for people.
    pub fn model_name(&self) -> &str {
        &self.name
    }

    /// Observations that are answered side by side, at most.
    pub fn desks(&self) -> usize {
        self.desks.len()
    }

    /// Answers an observation that says nothing: a model for which this fails would fail for others, and the next is faster.
    ///
    /// # Errors
    /// Why it fails.
    pub fn rehearse(&mut self) -> Result<(), PerceiveError> {
        let nothing = Observation::unknown(self.model().dims());
        let (mut occupancy, mut deviation) = (vec![0_u8; nothing.dims().voxels()], vec![0_u8; nothing.dims().voxels()]);
        for Desk { work, percept, query, .. } in &mut self.desks {
            self.perceiver.classify(&nothing, query, work, percept)?.complete_into(&mut occupancy, &mut deviation)?;
        }
        Ok(())
    }

    /// Computes the percepts of valid observations, as many as there are [desks](Self::desks) at most, side by side, and sends the completions
    /// that were asked for; each percept is handed to `publish` when it stands. An observation whose deadline has passed, or in which nothing of
    /// an object is seen, is refused.
    pub fn answer(&mut self, server: &Server, waiting: &[Waiting], mut publish: impl FnMut(&Waiting, Percept)) {
        let is_late = |waiting: &Waiting| check_deadline(&waiting.header, monotonic_ns()).err();
        let Self { perceiver, query, tracks, desks, .. } = self;
        let (perceiver, model_id) = (&*perceiver, perceiver.model().id);
        let voxels = perceiver.model().dims().voxels();
        rayon::in_place_scope(|scope| {
            let (done, finished) = std::sync::mpsc::channel();
            let mut own = None;
            for (desk, waiting) in desks.iter_mut().zip(waiting) {
                if let Some(refusal) = is_late(waiting) {
                    let refusing = Percept::refusing(&waiting.header, &refusal);
                    publish(waiting, Percept { received_ns: waiting.received_ns, model_id, ..refusing });
                    continue;
                }
                desk.ask(query, tracks, &waiting.header);
                if own.is_none() {
                    own = Some((desk, waiting));
                    continue;
                }
                let done = done.clone();
                scope.spawn(move |_| {
                    desk.answer(perceiver, waiting, |classified, _, bytes| {
                        bytes.iter_mut().for_each(|bytes| bytes.resize(voxels, 0));
                        let [occupancy, deviation] = bytes;
                        classified.complete_into(occupancy, deviation).map_err(|error| error.to_string())
                    });
                    // Nobody receives it only if the daemon's own thread has panicked.
                    let _ = done.send((desk, waiting));
                });
            }
            drop(done);
            if let Some((desk, waiting)) = own {
                let none = desk.none;
                desk.answer(perceiver, waiting, |classified, query, _| {
                    complete(classified, none, model_id, query, server, &waiting.header)
                });
                publish(waiting, desk.percept(tracks, model_id, waiting));
            }
            while let Ok((desk, waiting)) = finished.recv() {
                desk.send_completion(model_id, server, &waiting.header);
                publish(waiting, desk.percept(tracks, model_id, waiting));
            }
        });
    }
}

/// Writes the completion of what was classified in place into shared memory.
fn complete(
    classified: Classified<'_>,
    none_before: Option<NoneBelief>,
    model_id: u64,
    query: &Query,
    server: &Server,
    asked: &ObservationHeader,
) -> Result<(), String> {
    let mut loan = loan_completion(classified.percept(), none_before, model_id, query, server, asked)?;
    let (occupancy, deviation) = loan.occupancy_and_deviation_mut();
    classified.complete_into(occupancy, deviation).map_err(|error| error.to_string())?;
    loan.send().map_err(|error| error.to_string())
}

/// Shared memory for the completion of an answer, its header written.
fn loan_completion(
    answer: &perception::Percept,
    none_before: Option<NoneBelief>,
    model_id: u64,
    query: &Query,
    server: &Server,
    asked: &ObservationHeader,
) -> Result<CompletionLoan, String> {
    let mut loan = server.loan_completion(asked).map_err(|error: LoanError| error.to_string())?;
    let header = loan.header_mut();
    header.model_id = model_id;
    header.class_index = answer.class as u32;
    header.method = method_code(query.method).code();
    header.rotation_object_to_grid = quaternion(&answer.rotation_object_to_grid);
    header.none_probability = BeyondClass::of(answer, none_before).none_probability;
    header.frame = asked.completion_frame;
    if query.frame == CompletionFrame::Object {
        // The canonical grid lies elsewhere and has other voxels where size and place were searched.
        header.position_m = object_position(asked, answer);
        header.voxel_size_m *= answer.placed.scale as f32;
    }
    Ok(loan)
}

/// The part of an answer besides class, pose, size and place.
struct BeyondClass {
    none_probability: f32,
    fit: f32,
    resting_pose: u32,
}

impl BeyondClass {
    /// The values of perception's answer, with marks where perception did not compute them, and with what was believed before of an object that
    /// continues. The one place where they are taken over.
    fn of(answer: &perception::Percept, none_before: Option<NoneBelief>) -> Self {
        let number = |value: Option<f64>| value.map_or(NOT_COMPUTED, |value| value as f32);
        let none = none_belief(answer, none_before).map(NoneBelief::probability);
        let (none_probability, fit) = (number(none), number(answer.fit));
        let resting_pose = answer.resting_pose.map_or(NO_RESTING_POSE, |place| place as u32);
        Self { none_probability, fit, resting_pose }
    }
}

/// What is believed, after this answer, of whether the object is of none of the classes.
fn none_belief(answer: &perception::Percept, before: Option<NoneBelief>) -> Option<NoneBelief> {
    answer.none_probability.map(|p| before.map_or(NoneBelief::first(p), |before| before.after(p)))
}

/// Writes where the object is and how big.
fn place(percept: &mut Percept, answer: &perception::Percept) {
    let voxel = f64::from(percept.voxel_size_m);
    let metres = |lengths: [f64; 3]| lengths.map(|v| (v * voxel) as f32);
    percept.object_position_m = position(percept.position_m, percept.orientation, &(answer.placed.translation_voxels * voxel));
    if let Some(found) = &answer.object_box {
        percept.object_extent_m = metres(found.extent_voxels);
        percept.object_extent_deviation_m = metres(found.extent_deviation_voxels);
        percept.object_position_deviation_m = metres(found.position_deviation_voxels);
    }
}

/// The object's centre in the frame in which the grid's placement is given, metres.
fn object_position(header: &ObservationHeader, answer: &perception::Percept) -> [f64; 3] {
    position(header.position_m, header.orientation, &(answer.placed.translation_voxels * f64::from(header.voxel_size_m)))
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
    let is_full = header.pose_search == PoseSearch::Full.code();
    // All of SO(3) is searched at one size and place. What a camera sees rests on something: its resting poses are searched.
    if is_full && header.scale_search == ScaleSearch::Search.code() {
        return Some(Refusal::RotationAndSize);
    }
    // The paper's method projects the observation once for each of two thousand rotations: half a minute, all others waiting.
    (is_full && method == Method::Paper).then_some(Refusal::PoseSearchNotSupported(PoseSearch::Full))
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn any_rotation_is_not_searched_together_with_size_and_place() {
        let header = ObservationHeader { pose_search: PoseSearch::Full.code(), ..ObservationHeader::new([30; 3]) };
        assert!(unsupported(&header, [30; 3], Method::Auto).is_none());
        let sized = ObservationHeader { scale_search: ScaleSearch::Search.code(), ..header };
        let refused = unsupported(&sized, [30; 3], Method::Auto).unwrap();
        assert!(matches!(refused, Refusal::RotationAndSize) && refused.to_string().contains("rest"));
        let resting = ObservationHeader { pose_search: PoseSearch::Rest.code(), ..sized };
        assert!(unsupported(&resting, [30; 3], Method::Auto).is_none());
    }
}
