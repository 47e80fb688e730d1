//! The reader's end of the channels: percepts of a daemon, with their completions.

use crate::arrays::{array, vector};
use crate::failures::{invalid, of_reconnecting};
use crate::observer::{LOOK, open_within, seconds};
use crate::percept::Hypothesis;
use beo_ipc::clock::monotonic_ns;
use beo_ipc::text::from_field;
use beo_ipc::{
    Completion, InstanceName, NO_RESTING_POSE, NOT_COMPUTED, Percept, PerceptStatus, ReconnectError, ReconnectingSubscriber, Status,
    SubscriberOptions, Unit, Waited, cut, tasks,
};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyList};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

/// A daemon's first status is waited for so long.
const FIRST_STATUS: Duration = Duration::from_secs(3);

/// A percept that a daemon published: the answer to one observation of some camera.
///
/// Lengths are metres in the frame `frame_id` where the camera says metres (`is_metric`), else voxels.
#[pyclass(frozen, get_all, module = "beo")]
pub struct PublishedPercept {
    /// "ok", or why there is no answer: "nothing_seen", "expired", "dims_not_of_model" and so on.
    status: &'static str,
    /// The same for people; empty where all is well.
    explanation: String,
    /// Who wrote the observation: Observer.producer_id.
    producer_id: u64,
    /// The observation's number, as Observer.observe returned it.
    sequence: u64,
    /// The producer's number for the object.
    object_id: u64,
    /// The daemon's number for this percept; it counts from 1.
    answer_number: u64,
    /// The run of the daemon: another one after a restart.
    daemon_id: u64,
    /// The model that answered.
    model_id: u64,
    /// Name of the most probable class; None where there is none.
    class_name: Option<String>,
    /// Probability of every class, by name, given that the object is of one of them.
    probabilities: Py<PyDict>,
    /// Probability that the object is of none of the classes; None where the model cannot say.
    none_probability: Option<f32>,
    /// How well the object fits its class, 0 to 1; None where it was not computed.
    fit: Option<f32>,
    /// How it may be turned, a list of Hypothesis, the most probable first.
    hypotheses: Py<PyList>,
    /// Expected angle to the first hypothesis, radians.
    rotation_spread_rad: f32,
    /// Which of its class's resting poses the object lies in; None where these were not searched.
    resting_pose: Option<u32>,
    /// Whether earlier observations of the object count in this answer.
    filtered: bool,
    /// What cuts the object off: "border", "occluder", both, or nothing.
    cut: Vec<&'static str>,
    /// The frame of positions.
    frame_id: String,
    /// Whether lengths are metres.
    is_metric: bool,
    /// The grid's centre, (3,).
    position_m: Py<PyAny>,
    /// Takes grid axes to axes of the frame: a unit quaternion x, y, z, w.
    orientation: Py<PyAny>,
    /// Edge of a voxel.
    voxel_size_m: f32,
    /// The centre of the object's box, (3,); the grid's centre where neither size nor place was searched.
    object_position_m: Py<PyAny>,
    /// Its standard deviation along the grid's axes, (3,); 0 where it was not searched.
    object_position_deviation_m: Py<PyAny>,
    /// Lengths of the object's box along its axes, (3,); 0 where they were not estimated.
    object_extent_m: Py<PyAny>,
    /// Their standard deviation, (3,).
    object_extent_deviation_m: Py<PyAny>,
    /// When the sensor data was taken, nanoseconds of CLOCK_MONOTONIC (time.monotonic_ns).
    capture_ns: u64,
    /// When the daemon took the observation.
    received_ns: u64,
    /// When the percept was sent.
    published_ns: u64,
    /// When it was read here.
    read_ns: u64,
    /// The sensor's own stamp, passed through.
    sensor_stamp_ns: u64,
    /// The completed shape: probability that each voxel is filled, float32 [x][y][z]; None without completions.
    occupancy: Option<Py<PyAny>>,
    /// Standard deviation of that probability, float32 [x][y][z].
    deviation: Option<Py<PyAny>>,
}

#[pymethods]
impl PublishedPercept {
    fn __repr__(&self, py: Python<'_>) -> PyResult<String> {
        let Some(name) = &self.class_name else {
            return Ok(format!("PublishedPercept(#{} {}: {})", self.sequence, self.status, self.explanation));
        };
        let probability: f64 = self.probabilities.bind(py).get_item(name)?.map_or(Ok(0.0), |p| p.extract())?;
        Ok(format!("PublishedPercept(#{} {name} {:.1} %)", self.sequence, 100.0 * probability))
    }
}

/// What was read of one answer.
struct Read {
    percept: Percept,
    completion: Option<([usize; 3], [Vec<f32>; 2])>,
    status: Option<Status>,
    read_ns: u64,
}

/// Reads what a daemon publishes. Iterating over it gives percepts for ever, each a PublishedPercept; Ctrl-C ends it.
///
/// A reader that does not read loses its oldest percepts, which `missed` counts, and delays nobody. It outlives the daemon: when another
/// one serves the instance, it goes on with that.
#[pyclass(frozen, module = "beo")]
pub struct Subscriber {
    instance: InstanceName,
    /// None once it is closed.
    link: Mutex<Option<ReconnectingSubscriber>>,
}

impl Subscriber {
    /// Waits, at most so long, for the next percept.
    fn next_within(&self, at_most: Duration) -> PyResult<Option<Read>> {
        let mut link = self.link.lock().unwrap_or_else(PoisonError::into_inner);
        let link = link.as_mut().ok_or_else(|| PyValueError::new_err("the subscriber was closed: open another"))?;
        if let Some(read) = take(link).map_err(|error| of_reconnecting(&error))? {
            return Ok(Some(read));
        }
        if link.wait(Some(at_most)).map_err(|error| of_reconnecting(&error))? != Waited::Sent {
            return Ok(None);
        }
        take(link).map_err(|error| of_reconnecting(&error))
    }
}

/// The oldest percept not yet taken, with the completion that belongs to it.
fn take(link: &mut ReconnectingSubscriber) -> Result<Option<Read>, ReconnectError> {
    let Some(percept) = link.take_percept()? else { return Ok(None) };
    let read_ns = monotonic_ns();
    let mut completion = None;
    if percept.tasks & tasks::COMPLETION != 0 {
        // It was sent before its percept; those of others, whose percepts were lost, are passed over.
        while let Some(found) = link.take_completion()? {
            let header = found.header();
            if (header.daemon_id, header.producer_id, header.sequence) == (percept.daemon_id, percept.producer_id, percept.sequence) {
                completion = Some(shares(&found));
                break;
            }
        }
    }
    Ok(Some(Read { percept, completion, status: link.status()?, read_ns }))
}

/// Probabilities and deviations, 0 to 1.
fn shares(completion: &Completion) -> ([usize; 3], [Vec<f32>; 2]) {
    let numbers = |bytes: &[u8]| bytes.iter().map(|byte| f32::from(*byte) / 255.0).collect();
    (completion.header().dims.map(|side| side as usize), [numbers(completion.occupancy()), numbers(completion.deviation())])
}

impl PublishedPercept {
    fn new(py: Python<'_>, read: Read) -> PyResult<Self> {
        let Read { percept, completion, status, read_ns } = read;
        let is_ok = percept.status == PerceptStatus::Ok.code();
        let status = status.filter(|status| status.model_id == percept.model_id);
        let name = |class: u32| -> String {
            let field = status.as_ref().and_then(|status| status.class_names.get(class as usize));
            field.map_or_else(|| "?".to_owned(), |field| from_field(field).to_owned())
        };
        let probabilities = PyDict::new(py);
        if is_ok {
            for (class, probability) in percept.posterior.iter().take(percept.class_count as usize).enumerate() {
                probabilities.set_item(name(class as u32), probability)?;
            }
        }
        let hypotheses = percept.hypotheses.iter().take(if is_ok { percept.hypothesis_count as usize } else { 0 });
        let hypothesis = |h: &beo_ipc::Hypothesis| {
            let rotation = vector(py, &h.rotation_object_to_grid.map(f64::from))?;
            Py::new(py, Hypothesis::new(name(h.class_index), h.probability.into(), rotation))
        };
        let hypotheses: Vec<Py<Hypothesis>> = hypotheses.map(hypothesis).collect::<PyResult<_>>()?;
        let computed = |value: f32| (value != NOT_COMPUTED).then_some(value);
        let wide = |lengths: [f32; 3]| vector(py, &lengths.map(f64::from));
        let (occupancy, deviation) = match completion {
            Some((dims, [occupancy, deviation])) => (Some(array(py, &occupancy, dims)?), Some(array(py, &deviation, dims)?)),
            None => (None, None),
        };
        Ok(Self {
            status: word(percept.status),
            explanation: from_field(&percept.explanation).to_owned(),
            producer_id: percept.producer_id,
            sequence: percept.sequence,
            object_id: percept.object_id,
            answer_number: percept.answer_number,
            daemon_id: percept.daemon_id,
            model_id: percept.model_id,
            class_name: is_ok.then(|| name(percept.class_index)),
            probabilities: probabilities.unbind(),
            none_probability: computed(percept.none_probability),
            fit: computed(percept.fit),
            hypotheses: PyList::new(py, hypotheses)?.unbind(),
            rotation_spread_rad: percept.rotation_spread_rad,
            resting_pose: (percept.resting_pose != NO_RESTING_POSE).then_some(percept.resting_pose),
            filtered: percept.filtered != 0,
            cut: cut::words(percept.cut).collect(),
            frame_id: from_field(&percept.frame_id).to_owned(),
            is_metric: percept.unit == Unit::Metres.code(),
            position_m: vector(py, &percept.position_m)?,
            orientation: vector(py, &percept.orientation)?,
            voxel_size_m: percept.voxel_size_m,
            object_position_m: vector(py, &percept.object_position_m)?,
            object_position_deviation_m: wide(percept.object_position_deviation_m)?,
            object_extent_m: wide(percept.object_extent_m)?,
            object_extent_deviation_m: wide(percept.object_extent_deviation_m)?,
            capture_ns: percept.capture_ns,
            received_ns: percept.received_ns,
            published_ns: percept.published_ns,
            read_ns,
            sensor_stamp_ns: percept.sensor_stamp_ns,
            occupancy,
            deviation,
        })
    }
}

/// The word for a status.
fn word(code: u32) -> &'static str {
    match PerceptStatus::from_code(code) {
        Some(PerceptStatus::Ok) => "ok",
        Some(PerceptStatus::BadDims) => "bad_dims",
        Some(PerceptStatus::DimsNotOfModel) => "dims_not_of_model",
        Some(PerceptStatus::BadVoxel) => "bad_voxel",
        Some(PerceptStatus::BadHeader) => "bad_header",
        Some(PerceptStatus::UnknownVersion) => "unknown_version",
        Some(PerceptStatus::PoseSearchNotSupported) => "pose_search_not_supported",
        Some(PerceptStatus::Internal) => "internal",
        Some(PerceptStatus::Stopping) => "stopping",
        Some(PerceptStatus::Expired) => "expired",
        Some(PerceptStatus::NothingSeen) => "nothing_seen",
        None => "unknown",
    }
}

#[pymethods]
impl Subscriber {
    /// Joins the daemon of an instance as a reader.
    ///
    /// instance: as `beo serve --instance` has it.
    /// completion: whether completed shapes are read too.
    /// timeout: seconds to wait for the daemon.
    ///
    /// Raises ConnectionError where no daemon runs by then, and another OSError where it cannot be joined.
    #[new]
    #[pyo3(signature = (instance="default", *, completion=false, timeout=10.0))]
    fn new(py: Python<'_>, instance: &str, completion: bool, timeout: f64) -> PyResult<Self> {
        let instance = InstanceName::new(instance).map_err(invalid)?;
        let options = SubscriberOptions { completion };
        let mut link = open_within(py, seconds("timeout", timeout)?, || ReconnectingSubscriber::open(&instance, &options))?;
        // The names of the classes come with the status, which is there at once or within a second; percepts are kept meanwhile.
        let start = Instant::now();
        while py.detach(|| link.status()).map_err(|error| of_reconnecting(&error))?.is_none() && start.elapsed() < FIRST_STATUS {
            py.detach(|| link.wait(Some(LOOK))).map_err(|error| of_reconnecting(&error))?;
            py.check_signals()?;
        }
        Ok(Self { instance, link: Mutex::new(Some(link)) })
    }

    /// The next percept, waiting at most `timeout` seconds for it; None if none came.
    #[pyo3(signature = (timeout=1.0))]
    fn take(&self, py: Python<'_>, timeout: f64) -> PyResult<Option<PublishedPercept>> {
        let (timeout, start) = (seconds("timeout", timeout)?, Instant::now());
        loop {
            let left = timeout.saturating_sub(start.elapsed());
            if let Some(read) = py.detach(|| self.next_within(left.min(LOOK)))? {
                return PublishedPercept::new(py, read).map(Some);
            }
            py.check_signals()?;
            if start.elapsed() >= timeout {
                return Ok(None);
            }
        }
    }

    /// How many percepts were published between those that were taken, and lost here.
    #[getter]
    fn missed(&self, py: Python<'_>) -> u64 {
        py.detach(|| self.link.lock().unwrap_or_else(PoisonError::into_inner).as_ref().map_or(0, ReconnectingSubscriber::missed))
    }

    /// Whether a daemon serves the instance, as far as is known since the last wait.
    #[getter]
    fn is_connected(&self, py: Python<'_>) -> bool {
        py.detach(|| self.link.lock().unwrap_or_else(PoisonError::into_inner).as_ref().is_some_and(ReconnectingSubscriber::is_connected))
    }

    /// Leaves the daemon and gives its shared memory back. Again is nothing.
    fn close(&self, py: Python<'_>) {
        py.detach(|| drop(self.link.lock().unwrap_or_else(PoisonError::into_inner).take()));
    }

    fn __iter__(slf: Py<Self>) -> Py<Self> {
        slf
    }

    fn __next__(&self, py: Python<'_>) -> PyResult<PublishedPercept> {
        loop {
            if let Some(read) = py.detach(|| self.next_within(LOOK))? {
                return PublishedPercept::new(py, read);
            }
            py.check_signals()?;
        }
    }

    fn __enter__(slf: Py<Self>) -> Py<Self> {
        slf
    }

    #[pyo3(signature = (*_raised))]
    fn __exit__(&self, py: Python<'_>, _raised: &Bound<'_, pyo3::types::PyTuple>) {
        self.close(py);
    }

    fn __repr__(&self) -> String {
        format!("Subscriber({:?})", self.instance.as_str())
    }
}
