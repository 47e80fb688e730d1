//! An allocator that knows the most that was allocated at a time.

#![allow(unsafe_code)] // an allocator

use std::alloc::{GlobalAlloc, Layout, System};
use std::sync::atomic::{AtomicUsize, Ordering};

/// The system's allocator, counted.
pub struct Counting;

/// More than this at once is refused: better an end with a known input than a machine without memory.
const REFUSED: usize = 4 << 30;

static CURRENT: AtomicUsize = AtomicUsize::new(0);
static MOST: AtomicUsize = AtomicUsize::new(0);

/// Starts counting anew; gives what is allocated now.
pub fn restart() -> usize {
    let current = CURRENT.load(Ordering::Relaxed);
    MOST.store(current, Ordering::Relaxed);
    current
}

/// The most that was allocated at a time since the last start.
pub fn most() -> usize {
    MOST.load(Ordering::Relaxed)
}

fn add(size: usize) {
    let current = CURRENT.fetch_add(size, Ordering::Relaxed) + size;
    MOST.fetch_max(current, Ordering::Relaxed);
}

// SAFETY: everything is passed on to the system's allocator; `realloc` and `alloc_zeroed` are counted too.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        if layout.size() > REFUSED {
            return std::ptr::null_mut();
        }
        add(layout.size());
        // SAFETY: as the caller promises.
        unsafe { System.alloc(layout) }
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        if layout.size() > REFUSED {
            return std::ptr::null_mut();
        }
        add(layout.size());
        // SAFETY: as the caller promises.
        unsafe { System.alloc_zeroed(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        CURRENT.fetch_sub(layout.size(), Ordering::Relaxed);
        // SAFETY: as the caller promises.
        unsafe { System.dealloc(pointer, layout) }
    }

    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        if size > REFUSED {
            return std::ptr::null_mut();
        }
        // Old and new can be there at the same time.
        add(size);
        CURRENT.fetch_sub(layout.size(), Ordering::Relaxed);
        // SAFETY: as the caller promises.
        unsafe { System.realloc(pointer, layout, size) }
    }
}
