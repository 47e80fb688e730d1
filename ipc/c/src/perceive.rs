//! One call from a grid to its percept.

#![allow(unsafe_code)] // exported names, and pointers of the caller's

use crate::outcome::{Failure, Outcome, guard};
use crate::pointers::{must_not_be_null, numbers, read, store, text, timeout};
use crate::producer::{PRODUCERS, ProducerHandle, set_header};
use crate::subscriber::{SUBSCRIBERS, SubscriberHandle};
use beo_ipc::names::DEFAULT_INSTANCE;
use beo_ipc::{InstanceName, ObservationHeader, Percept, ReconnectingProducer, ReconnectingSubscriber, SubscriberOptions, Waited};
use std::ffi::c_char;
use std::time::{Duration, Instant};

/// Sends one grid to the daemon of `instance` (NULL: "default"), waits for its percept and copies that to `*percept`. The whole, waiting
/// for the daemon included, takes at most `timeout_ms` milliseconds (negative: without end).
///
/// `header` says what the grid is and what is asked for: start from `beo_observation_header_init`. `voxels` are `voxel_count` bytes, as
/// many as the header's dims say. `BEO_STATUS_TIMEOUT` if no percept came, `BEO_STATUS_NOT_RUNNING` if there was no daemon. A refused grid
/// has a percept too: see its `status` and `explanation`.
///
/// This opens and closes a producer and a subscriber: for a stream of grids, keep them and use `beo_perceive_with`.
///
/// # Safety
/// `instance` is NULL or a NUL-terminated text; `header` is NULL or readable; `voxels` is NULL or has `voxel_count` readable bytes;
/// `percept` is NULL or writable.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn beo_perceive(
    instance: *const c_char,
    header: *const ObservationHeader,
    voxels: *const u8,
    voxel_count: usize,
    timeout_ms: i32,
    percept: *mut Percept,
) -> Outcome {
    guard(|| {
        must_not_be_null(percept, "percept")?;
        // SAFETY: a text, readable, and readable bytes, as the caller promises.
        let (instance, header, voxels) =
            unsafe { (text(instance, DEFAULT_INSTANCE)?, read(header, "header")?, numbers(voxels, voxel_count, "voxels")?) };
        let instance = InstanceName::new(instance)?;
        let time = Time::new(timeout_ms);
        let at_most = || time.left().unwrap_or(Duration::MAX);
        let template = ObservationHeader::new(header.dims);
        let mut producer = ReconnectingProducer::open_within(&instance, &template, at_most())?;
        let mut subscriber = ReconnectingSubscriber::open_within(&instance, &SubscriberOptions::default(), at_most())?;
        match ask(&mut producer, &mut subscriber, Some(&header), voxels, &time)? {
            Ok(answer) => {
                // SAFETY: writable, as the caller promises.
                unsafe { store(percept, answer) };
                Ok(Outcome::Ok)
            }
            Err(outcome) => Ok(outcome),
        }
    })
}

/// Sends one grid through `producer`, waits for its percept at `subscriber`, at most `timeout_ms` milliseconds (negative: without end), and
/// copies it to `*percept`. Percepts of other observations that come before it are taken and thrown away.
///
/// As `beo_perceive` for the rest; `header` may be NULL as for `beo_loan_commit`.
///
/// # Safety
/// `header` is NULL or readable; `voxels` is NULL or has `voxel_count` readable bytes; `percept` is NULL or writable.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn beo_perceive_with(
    producer: *mut ProducerHandle,
    subscriber: *mut SubscriberHandle,
    header: *const ObservationHeader,
    voxels: *const u8,
    voxel_count: usize,
    timeout_ms: i32,
    percept: *mut Percept,
) -> Outcome {
    guard(|| {
        must_not_be_null(percept, "percept")?;
        // SAFETY: NULL or readable, as the caller promises.
        let header = if header.is_null() { None } else { Some(unsafe { read(header, "header") }?) };
        // SAFETY: readable bytes, as the caller promises.
        let voxels = unsafe { numbers(voxels, voxel_count, "voxels") }?;
        let time = Time::new(timeout_ms);
        let answer = PRODUCERS.with(producer, |producer| {
            SUBSCRIBERS.with(subscriber, |subscriber| ask(producer, subscriber, header.as_ref(), voxels, &time))
        })?;
        match answer {
            Ok(answer) => {
                // SAFETY: writable, as the caller promises.
                unsafe { store(percept, answer) };
                Ok(Outcome::Ok)
            }
            Err(outcome) => Ok(outcome),
        }
    })
}

/// The time that a call may take.
struct Time {
    start: Instant,
    limit: Option<Duration>,
}

impl Time {
    fn new(timeout_ms: i32) -> Self {
        Self { start: Instant::now(), limit: timeout(timeout_ms) }
    }

    fn left(&self) -> Option<Duration> {
        self.limit.map(|limit| limit.saturating_sub(self.start.elapsed()))
    }

    fn is_up(&self) -> bool {
        self.left() == Some(Duration::ZERO)
    }
}

/// The percept of this grid, or why there is none yet.
fn ask(
    producer: &mut ReconnectingProducer,
    subscriber: &mut ReconnectingSubscriber,
    header: Option<&ObservationHeader>,
    voxels: &[u8],
    time: &Time,
) -> Result<Result<Percept, Outcome>, Failure> {
    let mut loan = producer.loan()?;
    if loan.voxels_mut().len() != voxels.len() {
        let message = format!("there are {} voxels, dims {:?} need {}", voxels.len(), producer.dims(), loan.voxels_mut().len());
        return Err(Failure::new(Outcome::WrongSize, message));
    }
    loan.voxels_mut().copy_from_slice(voxels);
    if let Some(header) = header {
        set_header(&mut loan, header)?;
    }
    let sequence = loan.send()?.sequence;
    loop {
        while let Some(percept) = subscriber.take_percept()? {
            if (percept.producer_id, percept.sequence) == (producer.id(), sequence) {
                return Ok(Ok(percept));
            }
        }
        if time.is_up() {
            return Ok(Err(if subscriber.is_connected() { Outcome::Timeout } else { Outcome::NotRunning }));
        }
        if subscriber.wait(time.left())? == Waited::Interrupted {
            return Ok(Err(Outcome::Interrupted));
        }
    }
}
