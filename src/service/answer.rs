//! One observation in, percept and completion out.

use super::streams::Waiting;
use crate::grid::View;
use crate::perception::{self, Method, PerceiveError, Perceiver, Query, Workspace};
use beo_ipc::clock::monotonic_ns;
use beo_ipc::text::to_field;
use beo_ipc::{Hypothesis, LoanError, Percept, PerceptStatus, PoseSearch, Refusal, Server, tasks};

/// Quaternion x, y, z, w of no rotation.
const IDENTITY: [f32; 4] = [0.0, 0.0, 0.0, 1.0];

/// Answers observations with one model.
pub struct Answerer {
    perceiver: Perceiver,
    work: Workspace,
    percept: perception::Percept,
    query: Query,
}

impl Answerer {
    /// An answerer that uses `query` but for the view and the completion, which observations ask for themselves.
    pub fn new(perceiver: Perceiver, query: Query) -> Self {
        Self { work: perceiver.workspace(), percept: perception::Percept::default(), perceiver, query }
    }

    /// Computes the percept of a valid observation and sends its completion if it was asked for; the percept is returned to be
    /// published after it.
    pub fn answer(&mut self, server: &Server, waiting: &Waiting) -> Percept {
        let header = &waiting.header;
        let mut percept = Percept { received_ns: waiting.received_ns, model_id: self.perceiver.model().id, ..Percept::answering(header) };
        if let Err(error) = self.classify(waiting) {
            return internal(percept, &error.to_string());
        }
        percept.classified_ns = monotonic_ns();
        let answer = &self.percept;
        let classes = answer.posterior.len();
        percept.class_count = classes as u32;
        percept.class_index = answer.class as u32;
        percept.method = method_code(self.query.method).code();
        percept.tasks = tasks::CLASS | tasks::POSE;
        for s in 0..classes {
            percept.posterior[s] = answer.posterior[s] as f32;
            percept.log_evidence[s] = answer.scores.get(s).copied().unwrap_or(0.0) as f32;
        }
        // The pose is known: one hypothesis, without spread.
        percept.hypothesis_count = 1;
        percept.hypotheses[0] = Hypothesis {
            rotation_object_to_grid: IDENTITY,
            class_index: percept.class_index,
            probability: percept.posterior[answer.class],
        };
        percept.posed_ns = percept.classified_ns;
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
        self.query.view = match beo_ipc::View::from_code(waiting.header.view) {
            Some(beo_ipc::View::TopDown) => Some(View::Top),
            _ => None,
        };
        self.perceiver.classify(&waiting.observation, &self.query, &mut self.work, &mut self.percept)
    }

    /// Writes the completion in place into shared memory.
    fn complete(&mut self, server: &Server, waiting: &Waiting) -> Result<(), String> {
        self.perceiver.complete(&self.query, &mut self.work, &mut self.percept).map_err(|error| error.to_string())?;
        let mut loan = server.loan_completion(&waiting.header).map_err(|error: LoanError| error.to_string())?;
        let header = loan.header_mut();
        header.model_id = self.perceiver.model().id;
        header.class_index = self.percept.class as u32;
        header.method = method_code(self.query.method).code();
        // In known pose, the grid stands as the object does: both frames are the same.
        header.frame = waiting.header.completion_frame;
        let (occupancy, deviation) = loan.occupancy_and_deviation_mut();
        for (bytes, values) in [(occupancy, &self.percept.occupancy), (deviation, &self.percept.deviation)] {
            bytes.iter_mut().zip(values).for_each(|(byte, value)| *byte = (value * 255.0 + 0.5) as u8);
        }
        loan.send().map_err(|error| error.to_string())
    }
}

/// Why a valid header cannot be answered by this daemon, if so.
pub fn unsupported(header: &beo_ipc::ObservationHeader, model: [u32; 3]) -> Option<Refusal> {
    if header.dims != model {
        return Some(Refusal::DimsNotOfModel { dims: header.dims, model });
    }
    match PoseSearch::from_code(header.pose_search) {
        Some(PoseSearch::Known) | None => None, // unknown numbers were refused with the header
        Some(search) => Some(Refusal::PoseSearchNotSupported(search)),
    }
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
