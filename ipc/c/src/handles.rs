//! Handles are numbers that are never given twice, kept in a table per kind; the pointers that C sees are never followed.
//!
//! So a handle that was closed, released twice or taken for another kind is found out, whatever was done since. A look-up takes tens of
//! nanoseconds, against microseconds for what the calls do.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, TryLockError};

/// The fault of a handle.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum HandleError {
    Null,
    Unknown,
    Busy,
}

impl std::fmt::Display for HandleError {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter.write_str(match self {
            Self::Null => "the handle is NULL: open or take one first",
            Self::Unknown => "the handle was closed or released before, is of another kind, or was never one",
            Self::Busy => "another thread is using this handle: one at a time",
        })
    }
}

/// The open handles of one kind.
pub(crate) struct Table<T> {
    entries: Mutex<BTreeMap<usize, Arc<Mutex<T>>>>,
}

/// One count for all kinds: a number is at home in one table only.
static LAST: AtomicUsize = AtomicUsize::new(0);

impl<T> Table<T> {
    pub const fn new() -> Self {
        Self { entries: Mutex::new(BTreeMap::new()) }
    }

    /// A handle for `value`, as the pointer that C sees.
    pub fn insert<Opaque>(&self, value: T) -> *mut Opaque {
        let number = LAST.fetch_add(1, Ordering::Relaxed) + 1;
        self.lock().insert(number, Arc::new(Mutex::new(value)));
        std::ptr::without_provenance_mut(number)
    }

    /// Calls `body` with what the handle stands for, unless another thread is doing so.
    pub fn with<Opaque, R, E: From<HandleError>>(&self, handle: *mut Opaque, body: impl FnOnce(&mut T) -> Result<R, E>) -> Result<R, E> {
        let entry = self.lock().get(&number(handle)?).cloned().ok_or(HandleError::Unknown)?;
        let mut value = match entry.try_lock() {
            Ok(value) => value,
            // After a panic inside a call the value is whole enough to be closed, and to be tried again.
            Err(TryLockError::Poisoned(poisoned)) => poisoned.into_inner(),
            Err(TryLockError::WouldBlock) => return Err(HandleError::Busy.into()),
        };
        body(&mut value)
    }

    /// Ends a handle. What it stands for is dropped now, or at the end of the call that another thread is in.
    pub fn remove<Opaque>(&self, handle: *mut Opaque) -> Result<(), HandleError> {
        // Dropped after the table is unlocked.
        let entry = self.lock().remove(&number(handle)?);
        entry.map(drop).ok_or(HandleError::Unknown)
    }

    /// Ends a handle and gives what it stood for.
    pub fn take<Opaque>(&self, handle: *mut Opaque) -> Result<T, HandleError> {
        let number = number(handle)?;
        let mut entries = self.lock();
        let entry = entries.remove(&number).ok_or(HandleError::Unknown)?;
        match Arc::try_unwrap(entry) {
            Ok(value) => Ok(value.into_inner().unwrap_or_else(PoisonError::into_inner)),
            Err(entry) => {
                entries.insert(number, entry);
                Err(HandleError::Busy)
            }
        }
    }

    fn lock(&self) -> MutexGuard<'_, BTreeMap<usize, Arc<Mutex<T>>>> {
        // Nothing panics while the lock is held.
        self.entries.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

fn number<Opaque>(handle: *mut Opaque) -> Result<usize, HandleError> {
    match handle.addr() {
        0 => Err(HandleError::Null),
        number => Ok(number),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    static TABLE: Table<Vec<u8>> = Table::new();
    static OTHER: Table<Vec<u8>> = Table::new();

    fn push(handle: *mut u8, byte: u8) -> Result<usize, HandleError> {
        TABLE.with(handle, |bytes| {
            bytes.push(byte);
            Ok(bytes.len())
        })
    }

    #[test]
    fn a_handle_works_until_it_is_removed_and_never_again() {
        let handle: *mut u8 = TABLE.insert(Vec::new());
        assert_eq!((push(handle, 1), push(handle, 2)), (Ok(1), Ok(2)));
        assert_eq!(TABLE.remove(handle), Ok(()));
        assert_eq!(TABLE.remove(handle), Err(HandleError::Unknown));
        let next: *mut u8 = TABLE.insert(Vec::new());
        assert_ne!(next, handle);
        assert_eq!(push(handle, 1), Err(HandleError::Unknown));
        assert_eq!(TABLE.take(next), Ok(vec![]));
        assert_eq!(TABLE.take(next), Err(HandleError::Unknown));
    }

    #[test]
    fn null_and_handles_of_another_kind_are_found_out() {
        assert_eq!(push(std::ptr::null_mut(), 1), Err(HandleError::Null));
        let other: *mut u8 = OTHER.insert(Vec::new());
        assert_eq!(push(other, 1), Err(HandleError::Unknown));
        assert_eq!(TABLE.remove(std::ptr::without_provenance_mut::<u8>(usize::MAX)), Err(HandleError::Unknown));
    }

    #[test]
    fn who_comes_second_is_told_so_and_closing_waits_for_the_first() {
        let value = Arc::new(());
        static SHARED: Table<Arc<()>> = Table::new();
        let handle: *mut u8 = SHARED.insert(value.clone());
        let inside = SHARED.with(handle, |_| {
            assert_eq!(SHARED.with(handle, |_| Ok::<_, HandleError>(())), Err(HandleError::Busy));
            assert_eq!(SHARED.take(handle), Err(HandleError::Busy));
            assert_eq!(SHARED.remove(handle), Ok(()));
            assert_eq!(Arc::strong_count(&value), 2, "still in use");
            Ok::<_, HandleError>(())
        });
        assert_eq!((inside, Arc::strong_count(&value)), (Ok(()), 1));
    }

    #[test]
    fn a_panic_inside_a_call_does_not_lose_the_handle() {
        let handle: *mut u8 = TABLE.insert(Vec::new());
        let address = handle.addr();
        let panicked = std::thread::spawn(move || {
            TABLE.with(std::ptr::without_provenance_mut::<u8>(address), |_| -> Result<(), HandleError> { panic!("on purpose") })
        });
        assert!(panicked.join().is_err());
        assert_eq!(push(handle, 1), Ok(1));
    }
}
