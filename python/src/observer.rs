//! The camera's end of the channels: grids into the shared memory of a daemon.

use crate::arrays::Three;
use crate::failures::{invalid, of_opening, of_reconnecting, of_sending};
use crate::question::{Asked, Question};
use beo_ipc::{InstanceName, ObservationHeader, OpenError, ReconnectingProducer, Subscriber, SubscriberOptions};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

/// Python looks at signals, such as Ctrl-C, so often.
pub const LOOK: Duration = Duration::from_millis(50);

/// Calls `open` until it succeeds, fails for another reason than that no daemon is there, or the time is up; Ctrl-C ends it.
pub fn open_within<T: Send>(py: Python<'_>, timeout: Duration, open: impl Fn() -> Result<T, OpenError> + Sync) -> PyResult<T> {
    let start = Instant::now();
    loop {
        match py.detach(&open) {
            Err(error) if error.is_retryable() && start.elapsed() < timeout => {
                py.detach(|| std::thread::sleep(LOOK.min(timeout.saturating_sub(start.elapsed()))));
                py.check_signals()?;
            }
            opened => return opened.map_err(|error| of_opening(&error)),
        }
    }
}

/// Seconds as a duration.
pub fn seconds(name: &str, value: f64) -> PyResult<Duration> {
    let given = Duration::try_from_secs_f64(value).ok().filter(|duration| duration.as_secs() <= 86_400);
    given.ok_or_else(|| invalid(format!("{name} is {value}: use 0 to 86400 seconds")))
}

/// Writes grids into the shared memory of a daemon, as a camera's driver does, and never waits for it.
///
/// It outlives the daemon: when another one serves the instance, observations go to that.
#[pyclass(frozen, module = "beo")]
pub struct Observer {
    instance: InstanceName,
    dims: [u32; 3],
    id: u64,
    /// None once it is closed.
    producer: Mutex<Option<ReconnectingProducer>>,
}

#[pymethods]
impl Observer {
    /// Joins the daemon of an instance.
    ///
    /// instance: as `beo serve --instance` has it.
    /// timeout: seconds to wait for the daemon.
    ///
    /// Raises ConnectionError where no daemon runs by then, and another OSError where it cannot be joined.
    #[new]
    #[pyo3(signature = (instance="default", *, timeout=10.0))]
    fn new(py: Python<'_>, instance: &str, timeout: f64) -> PyResult<Self> {
        let instance = InstanceName::new(instance).map_err(invalid)?;
        let timeout = seconds("timeout", timeout)?;
        let subscriber = open_within(py, timeout, || Subscriber::open(&instance, &SubscriberOptions::default()))?;
        let start = Instant::now();
        // The daemon says with its status for which dims its model is; it comes within a second or so.
        let dims = loop {
            let status = py.detach(|| {
                let _ = subscriber.wait(LOOK);
                subscriber.status()
            });
            match status.map_err(|error| of_reconnecting(&error.into()))? {
                Some(status) => break status.dims,
                None if start.elapsed() > timeout.max(Duration::from_secs(3)) => {
                    return Err(of_opening(&OpenError::NotRunning { instance }));
                }
                None => py.check_signals()?,
            }
        };
        let template = ObservationHeader::new(dims);
        let producer = open_within(py, timeout, || ReconnectingProducer::open(&instance, &template))?;
        let id = producer.id();
        Ok(Self { instance, dims, id, producer: Mutex::new(Some(producer)) })
    }

    /// Sends a grid, and returns its number, which the percept that answers it repeats as `sequence`.
    ///
    /// grid, pose, view, camera, size, voxel_size_m, completion, frame: as for Model.perceive.
    /// object_id: your number for the object: of one object the newest observation counts, and a CarvedGrid's is its label.
    /// continues: whether the observation before of this object showed the same thing, so that its answer narrows the search.
    ///
    /// Raises TypeError and ValueError for what cannot be asked, and ConnectionError while no daemon runs: leave this grid out, and go on
    /// with the next.
    #[pyo3(signature = (
        grid, *, object_id=None, continues=false, pose=None, view=None, camera=None, size=None, voxel_size_m=None, completion=true,
        frame="grid".to_owned()
    ))]
    #[expect(clippy::too_many_arguments, reason = "keyword arguments of Python")]
    fn observe(
        &self,
        py: Python<'_>,
        grid: &Bound<'_, PyAny>,
        object_id: Option<u64>,
        continues: bool,
        pose: Option<String>,
        view: Option<String>,
        camera: Option<Three>,
        size: Option<String>,
        voxel_size_m: Option<f64>,
        completion: bool,
        frame: String,
    ) -> PyResult<u64> {
        let asked = Asked { pose, yaw_span_deg: 360.0, view, camera, size, voxel_size_m, completion, frame };
        let question = Question::read(grid, &asked)?;
        let mut header = question.header()?;
        header.object_id = object_id.or(question.carved.map(|place| place.object_id)).unwrap_or(1);
        (header.continued_object_id, header.continues) = (header.object_id, u32::from(continues));
        if header.dims != self.dims {
            let error = beo_ipc::Refusal::DimsNotOfModel { dims: header.dims, model: self.dims };
            return Err(invalid(error));
        }
        py.detach(|| {
            let mut producer = self.producer.lock().unwrap_or_else(PoisonError::into_inner);
            let producer = producer.as_mut().ok_or_else(|| PyValueError::new_err("the observer was closed: open another"))?;
            let mut loan = producer.loan().map_err(|error| of_reconnecting(&error))?;
            let template = *loan.header();
            let (producer_id, capture_ns) = (template.producer_id, template.capture_ns);
            *loan.header_mut() = ObservationHeader { producer_id, capture_ns, ..header };
            question.observation.write(loan.voxels_mut());
            Ok(loan.send().map_err(|error| of_sending(&error))?.sequence)
        })
    }

    /// Voxels of the grids, along x, y, z: those of the daemon's model.
    #[getter]
    fn dims(&self) -> (u32, u32, u32) {
        self.dims.into()
    }

    /// The number of this observer, which percepts repeat as `producer_id`.
    #[getter]
    fn producer_id(&self) -> u64 {
        self.id
    }

    /// Leaves the daemon and gives its shared memory back. Again is nothing.
    fn close(&self, py: Python<'_>) {
        py.detach(|| drop(self.producer.lock().unwrap_or_else(PoisonError::into_inner).take()));
    }

    fn __enter__(slf: Py<Self>) -> Py<Self> {
        slf
    }

    #[pyo3(signature = (*_raised))]
    fn __exit__(&self, py: Python<'_>, _raised: &Bound<'_, pyo3::types::PyTuple>) {
        self.close(py);
    }

    fn __repr__(&self) -> String {
        format!("Observer({:?})", self.instance.as_str())
    }
}
