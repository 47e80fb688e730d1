//! Shared memory that a peer cuts while it is mapped: a page that is gone is read as zeros, and counted, where it would end the daemon.
//!
//! A page of a mapping beyond the end of its file raises SIGBUS when it is touched. Whoever may write a segment may also cut it, and the
//! daemon maps the segments of all its producers. The handler puts a fresh page of zeros of this process's own in the place of the one that is
//! gone, as libwayland does with buffers of its clients (`wl_shm_buffer_begin_access`), and counts it. The daemon asks for the count after it
//! has copied an observation, and refuses one of which a page was gone.
#![allow(unsafe_code)]

use nix::libc;
use nix::sys::signal::{SaFlags, SigAction, SigHandler, SigSet, Signal, sigaction};
use std::ffi::{c_int, c_void};
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};

/// Pages that were gone.
static GONE: AtomicU64 = AtomicU64::new(0);
/// Bytes of a page; 0 until the handler is there.
static PAGE: AtomicUsize = AtomicUsize::new(0);

/// Replaces pages that are gone from now on.
///
/// # Errors
/// The system's own, in words.
pub fn outlive() -> Result<(), String> {
    PAGE.store(rustix::param::page_size(), Ordering::Relaxed);
    let action = SigAction::new(SigHandler::SigAction(on_bus_error), SaFlags::SA_SIGINFO, SigSet::empty());
    // SAFETY: the handler uses atomics and system calls alone, all of which may be called at any time, and keeps errno.
    unsafe { sigaction(Signal::SIGBUS, &action) }.map(drop).map_err(|error| error.to_string())
}

/// How many pages were gone so far.
pub fn pages_gone() -> u64 {
    GONE.load(Ordering::Relaxed)
}

extern "C" fn on_bus_error(_: c_int, info: *mut libc::siginfo_t, _: *mut c_void) {
    // SAFETY: the kernel hands a valid description to a handler with SA_SIGINFO; of a bus error it has an address.
    let (is_gone, address) = unsafe { ((*info).si_code == libc::BUS_ADRERR, (*info).si_addr() as usize) };
    // SAFETY: the location of this thread's errno is valid for as long as the thread runs.
    let errno = unsafe { *libc::__errno_location() };
    if is_gone && replace(address) {
        GONE.fetch_add(1, Ordering::Relaxed);
    } else {
        // Another kind of bus error ends the process as it ever did: the access is made again when this returns.
        // SAFETY: setting the default action has no preconditions.
        unsafe { libc::signal(libc::SIGBUS, libc::SIG_DFL) };
    }
    // SAFETY: as above.
    unsafe { *libc::__errno_location() = errno };
}

/// Puts a page of zeros where the page with this address is gone.
fn replace(address: usize) -> bool {
    let page = PAGE.load(Ordering::Relaxed);
    let start = address & !(page - 1);
    let (rights, kind) = (libc::PROT_READ | libc::PROT_WRITE, libc::MAP_PRIVATE | libc::MAP_ANONYMOUS | libc::MAP_FIXED);
    // SAFETY: the page is mapped, as touching it raised this signal rather than another, and nothing can be read from it or written to it any
    // more: what replaces it takes nothing away. Whoever unmaps the segment later unmaps the page with it.
    unsafe { libc::mmap(start as *mut c_void, page, rights, kind, -1, 0) != libc::MAP_FAILED }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::os::fd::AsRawFd;

    #[test]
    fn a_page_that_is_cut_is_read_as_zeros_and_counted() {
        outlive().unwrap();
        let page = rustix::param::page_size();
        let file = tempfile::tempfile().unwrap();
        file.set_len(3 * page as u64).unwrap();
        // SAFETY: a fresh mapping of an open file, unmapped below.
        let map = unsafe {
            libc::mmap(std::ptr::null_mut(), 3 * page, libc::PROT_READ | libc::PROT_WRITE, libc::MAP_SHARED, file.as_raw_fd(), 0)
        };
        assert_ne!(map, libc::MAP_FAILED);
        let at = |offset: usize| {
            // SAFETY: within the mapping, which another "process" cuts; read volatile as it changes behind the compiler's back.
            unsafe { map.cast::<u8>().add(offset).read_volatile() }
        };
        // SAFETY: as above.
        (0..3 * page).for_each(|offset| unsafe { map.cast::<u8>().add(offset).write_volatile(7) });
        file.set_len(page as u64).unwrap();
        let before = pages_gone();
        assert_eq!([at(page - 1), at(page), at(2 * page - 1), at(2 * page)], [7, 0, 0, 0]);
        assert_eq!(pages_gone() - before, 2);
        // SAFETY: the mapping from above.
        assert_eq!(unsafe { libc::munmap(map, 3 * page) }, 0);
    }
}
