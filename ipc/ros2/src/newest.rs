//! A place for the newest of a kind: who takes is never behind by more than one.

use std::sync::{Condvar, Mutex, PoisonError};
use std::time::Duration;

/// The newest thing that was put and not yet taken.
#[derive(Debug)]
pub struct Newest<T> {
    place: Mutex<Option<T>>,
    came: Condvar,
}

impl<T> Default for Newest<T> {
    fn default() -> Self {
        Self { place: Mutex::new(None), came: Condvar::new() }
    }
}

impl<T> Newest<T> {
    /// Puts it in the place of what was there; whether something was.
    pub fn put(&self, thing: T) -> bool {
        let before = self.place.lock().unwrap_or_else(PoisonError::into_inner).replace(thing);
        self.came.notify_one();
        before.is_some()
    }

    /// Takes it, after waiting for at most `timeout`.
    pub fn take(&self, timeout: Duration) -> Option<T> {
        let place = self.place.lock().unwrap_or_else(PoisonError::into_inner);
        let (mut place, _) = self.came.wait_timeout_while(place, timeout, |place| place.is_none()).unwrap_or_else(PoisonError::into_inner);
        place.take()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_the_newest_is_there() {
        let newest = Newest::default();
        assert_eq!(newest.take(Duration::ZERO), None);
        assert!(!newest.put(1));
        assert!(newest.put(2));
        assert_eq!((newest.take(Duration::from_secs(9)), newest.take(Duration::ZERO)), (Some(2), None));
    }
}
