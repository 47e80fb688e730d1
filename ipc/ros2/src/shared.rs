//! The state that the threads share.

use crate::frames::Frames;
use crate::health::Health;
use beo_ipc::Status;
use std::sync::atomic::{AtomicBool, AtomicU64};
use std::sync::{Mutex, MutexGuard, PoisonError};

/// The state of the node.
#[derive(Debug, Default)]
pub struct Shared {
    /// The node ends.
    pub stop: AtomicBool,
    /// Our producer's id; 0 before there is one.
    pub producer_id: AtomicU64,
    /// How it does.
    pub health: Health,
    frames: Mutex<Frames>,
    status: Mutex<Option<Status>>,
}

impl Shared {
    /// The frames under way. A thread that panicked while it held them left whole entries.
    pub fn frames(&self) -> MutexGuard<'_, Frames> {
        self.frames.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The daemon's last status; none while no daemon is there.
    pub fn status(&self) -> Option<Status> {
        *self.status.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The daemon said something new, or is gone.
    pub fn set_status(&self, status: Option<Status>) {
        *self.status.lock().unwrap_or_else(PoisonError::into_inner) = status;
    }
}
