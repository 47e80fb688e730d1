//! Reading what the daemon says.

#![allow(unsafe_code)] // exported names, and pointers of the caller's

use crate::completion;
use crate::handles::Table;
use crate::options::{CompletionView, SubscriberOptions};
use crate::outcome::{Failure, Outcome, guard};
use crate::pointers::{must_not_be_null, read_sized, store, text, timeout};
use beo_ipc::clock::monotonic_ns;
use beo_ipc::names::DEFAULT_INSTANCE;
use beo_ipc::{InstanceName, Percept, ReconnectingSubscriber, Status, Waited};
use std::ffi::{c_char, c_int};
use std::os::fd::AsRawFd as _;
use std::time::Duration;

/// Reads percepts, completions and the status of a daemon. From `beo_subscriber_open` to `beo_subscriber_close`.
pub struct SubscriberHandle;

pub(crate) static SUBSCRIBERS: Table<ReconnectingSubscriber> = Table::new();

/// Opens a subscriber to the daemon of `instance` (NULL: "default") and stores its handle in `*subscriber`. `options` may be NULL.
///
/// `BEO_STATUS_NOT_RUNNING` if there is no daemon after `wait_ms` milliseconds: try again. Once open, it survives the daemon: see
/// `beo_subscriber_wait`. The caller closes it.
///
/// # Safety
/// `instance` is NULL or a NUL-terminated text; `options` is NULL or readable for its `size`; `subscriber` is NULL or writable.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn beo_subscriber_open(
    instance: *const c_char,
    options: *const SubscriberOptions,
    subscriber: *mut *mut SubscriberHandle,
) -> Outcome {
    guard(|| {
        must_not_be_null(subscriber, "subscriber")?;
        // SAFETY: writable, as the caller promises.
        unsafe { store(subscriber, std::ptr::null_mut()) };
        // SAFETY: a text, as the caller promises.
        let instance = InstanceName::new(unsafe { text(instance, DEFAULT_INSTANCE) }?)?;
        let mut chosen = beo_ipc::SubscriberOptions::default();
        let mut wait = Some(Duration::ZERO);
        if !options.is_null() {
            // SAFETY: readable for its size, as the caller promises.
            let options = unsafe { read_sized(options, "options") }?;
            if options.completion > 1 || options.reserved != 0 {
                let message =
                    format!("`options` has completion {} and reserved {}: use 0 or 1, and 0", options.completion, options.reserved);
                return Err(Failure::new(Outcome::InvalidArgument, message));
            }
            chosen.completion = options.completion == 1;
            wait = timeout(options.wait_ms);
        }
        let opened = ReconnectingSubscriber::open_within(&instance, &chosen, wait.unwrap_or(Duration::MAX))?;
        // SAFETY: as above.
        unsafe { store(subscriber, SUBSCRIBERS.insert(opened)) };
        Ok(Outcome::Ok)
    })
}

/// Closes a subscriber. Completions taken from it stay valid until they are released.
#[unsafe(no_mangle)]
pub extern "C" fn beo_subscriber_close(subscriber: *mut SubscriberHandle) -> Outcome {
    guard(|| {
        SUBSCRIBERS.remove(subscriber)?;
        Ok(Outcome::Ok)
    })
}

/// Waits until the daemon has sent something, at most `timeout_ms` milliseconds (negative: without end; 0: not at all). Then take all
/// percepts and completions there are: one wake-up can stand for several.
///
/// `BEO_STATUS_TIMEOUT` if nothing came, `BEO_STATUS_NOT_RUNNING` if nothing came and no daemon is there: waiting again is right for both,
/// as this call also connects to the next daemon. `BEO_STATUS_INTERRUPTED` if a signal came while it slept: the library installs no
/// handlers, the caller's have run. One that comes just before it sleeps does not end it: whoever stops by a signal waits with a timeout.
#[unsafe(no_mangle)]
pub extern "C" fn beo_subscriber_wait(subscriber: *mut SubscriberHandle, timeout_ms: i32) -> Outcome {
    guard(|| {
        SUBSCRIBERS.with(subscriber, |subscriber| match subscriber.wait(timeout(timeout_ms))? {
            Waited::Sent => Ok(Outcome::Ok),
            Waited::TimedOut => Ok(Outcome::Timeout),
            Waited::NotRunning => Ok(Outcome::NotRunning),
            Waited::Interrupted => Ok(Outcome::Interrupted),
        })
    })
}

/// A file descriptor for the caller's own poll or epoll loop: readable when the daemon has sent something, and now and then for a look at
/// the daemon. When it is readable, call `beo_subscriber_wait` with a timeout of 0, then take everything.
///
/// It stays the same over restarts of the daemon. It belongs to the subscriber: do not close or read it; it ends with the subscriber.
///
/// # Safety
/// `file_descriptor` is NULL or writable.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn beo_subscriber_file_descriptor(subscriber: *mut SubscriberHandle, file_descriptor: *mut c_int) -> Outcome {
    guard(|| {
        must_not_be_null(file_descriptor, "file_descriptor")?;
        let descriptor = SUBSCRIBERS.with(subscriber, |subscriber| Ok::<_, Failure>(subscriber.file_descriptor()?.as_raw_fd()))?;
        // SAFETY: writable, as the caller promises.
        unsafe { store(file_descriptor, descriptor) };
        Ok(Outcome::Ok)
    })
}

/// Copies the oldest percept not yet taken to `*percept`. A caller that does not take loses its oldest ones: 32 are kept.
///
/// `BEO_STATUS_EMPTY` if there is none.
///
/// # Safety
/// `percept` is NULL or writable.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn beo_subscriber_take_percept(subscriber: *mut SubscriberHandle, percept: *mut Percept) -> Outcome {
    guard(|| {
        must_not_be_null(percept, "percept")?;
        let Some(taken) = SUBSCRIBERS.with(subscriber, |subscriber| subscriber.take_percept().map_err(Failure::from))? else {
            return Ok(Outcome::Empty);
        };
        // SAFETY: writable, as the caller promises.
        unsafe { store(percept, taken) };
        Ok(Outcome::Ok)
    })
}

/// How many percepts were published between those that this subscriber has taken, and lost here, to `*missed`: more came than are kept for a
/// reader, or they came from a daemon before it was connected to. Compare it with what it was before: it only grows.
///
/// # Safety
/// `missed` is NULL or writable.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn beo_subscriber_missed(subscriber: *mut SubscriberHandle, missed: *mut u64) -> Outcome {
    guard(|| {
        must_not_be_null(missed, "missed")?;
        let count = SUBSCRIBERS.with(subscriber, |subscriber| Ok::<_, Failure>(subscriber.missed()))?;
        // SAFETY: writable, as the caller promises.
        unsafe { store(missed, count) };
        Ok(Outcome::Ok)
    })
}

/// Takes the oldest completion not yet taken, where it lies: stores its handle in `*completion`, and where its arrays are in `*view`. A
/// completion comes before the percept of the same observation.
///
/// `BEO_STATUS_EMPTY` if there is none, or if the subscriber was opened without completions. The caller releases it; two can be held at a
/// time, for a third `BEO_STATUS_TOO_MANY_HELD` is returned. One that is held keeps the channel of a daemon that is gone: one with a
/// model of other dims can then not start.
///
/// # Safety
/// `completion` is NULL or writable; `view` is NULL or readable and writable for its `size`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn beo_subscriber_take_completion(
    subscriber: *mut SubscriberHandle,
    completion: *mut *mut completion::CompletionHandle,
    view: *mut CompletionView,
) -> Outcome {
    guard(|| {
        must_not_be_null(completion, "completion")?;
        // SAFETY: readable for its size, as the caller promises.
        unsafe { read_sized(view, "view") }?;
        // SAFETY: writable, as the caller promises.
        unsafe { store(completion, std::ptr::null_mut()) };
        let Some(taken) = SUBSCRIBERS.with(subscriber, |subscriber| subscriber.take_completion().map_err(Failure::from))? else {
            return Ok(Outcome::Empty);
        };
        let (arrays, handle) = completion::keep(taken);
        // SAFETY: both writable, as the caller promises; the size of the view has been checked.
        unsafe {
            store(view, arrays);
            store(completion, handle);
        }
        Ok(Outcome::Ok)
    })
}

/// Copies the newest status of the daemon to `*status` (its model, class names, counters, latencies), and how old its heartbeat is to
/// `*heartbeat_age_ns`, which may be NULL. A heartbeat older than a few times `heartbeat_interval_ns` means that the daemon hangs or is
/// gone.
///
/// `BEO_STATUS_EMPTY` before the first one, which comes within about a second of opening.
///
/// # Safety
/// `status` is NULL or writable; `heartbeat_age_ns` is NULL or writable.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn beo_subscriber_status(
    subscriber: *mut SubscriberHandle,
    status: *mut Status,
    heartbeat_age_ns: *mut u64,
) -> Outcome {
    guard(|| {
        must_not_be_null(status, "status")?;
        let Some(newest) = SUBSCRIBERS.with(subscriber, |subscriber| subscriber.status().map_err(Failure::from))? else {
            return Ok(Outcome::Empty);
        };
        // SAFETY: both NULL or writable, as the caller promises.
        unsafe {
            store(status, newest);
            store(heartbeat_age_ns, monotonic_ns().saturating_sub(newest.heartbeat_ns));
        }
        Ok(Outcome::Ok)
    })
}
