//! Scratch memory for tasks that run side by side: as many pieces as tasks ever ran at once, used again from query to query.

use std::sync::{Mutex, PoisonError};

/// Pieces of scratch memory that nobody uses at the moment.
pub(crate) struct Pool<T>(Mutex<Vec<T>>);

impl<T> Default for Pool<T> {
    fn default() -> Self {
        Self(Mutex::new(Vec::new()))
    }
}

impl<T> Pool<T> {
    /// Runs a task with a piece of memory, made if all are in use. The lock is held only to take it and to put it back.
    pub fn with<R>(&self, make: impl FnOnce() -> T, task: impl FnOnce(&mut T) -> R) -> R {
        let free = self.0.lock().unwrap_or_else(PoisonError::into_inner).pop();
        let mut memory = free.unwrap_or_else(make);
        let outcome = task(&mut memory);
        self.0.lock().unwrap_or_else(PoisonError::into_inner).push(memory);
        outcome
    }
}
