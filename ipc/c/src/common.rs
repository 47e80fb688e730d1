//! Functions that need no handle.

#![allow(unsafe_code)] // exported names, and a pointer of the caller's

use crate::outcome::{self, Outcome, guard};
use crate::pointers::{must_not_be_null, store};
use beo_ipc::limits::voxel_count;
use beo_ipc::{ABI_VERSION, ObservationHeader, OpenError};
use std::ffi::c_char;

/// The version of the library that is linked: compare it with `BEO_ABI_VERSION`, the version of this header.
#[unsafe(no_mangle)]
pub extern "C" fn beo_abi_version() -> u32 {
    ABI_VERSION
}

/// The meaning of a status, in English. Never NULL, for any number; owned by the library, valid for ever.
#[unsafe(no_mangle)]
pub extern "C" fn beo_status_text(status: i32) -> *const c_char {
    Outcome::text(status).as_ptr()
}

/// The message of the last call of this thread that did not succeed: what was wrong, where, and what to do. Never NULL, empty if all
/// succeeded; owned by the library, valid until this thread's next call that fails.
#[unsafe(no_mangle)]
pub extern "C" fn beo_last_error() -> *const c_char {
    outcome::last_error()
}

/// Now, in nanoseconds of CLOCK_MONOTONIC: the clock of all stamps, the same in all processes of a machine.
#[unsafe(no_mangle)]
pub extern "C" fn beo_monotonic_ns() -> u64 {
    beo_ipc::clock::monotonic_ns()
}

/// Fills in `header` for a grid of nx × ny × nz voxels: known pose; class and completion; centred at the frame's origin; scale not known.
///
/// `BEO_STATUS_BAD_DIMS` if an axis has fewer than 8 or more than 256 voxels.
///
/// # Safety
/// `header` is NULL or writable.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn beo_observation_header_init(header: *mut ObservationHeader, nx: u32, ny: u32, nz: u32) -> Outcome {
    guard(|| {
        must_not_be_null(header, "header")?;
        let dims = [nx, ny, nz];
        voxel_count(dims).ok_or(OpenError::BadDims(dims))?;
        // SAFETY: writable, as the caller promises.
        unsafe { store(header, ObservationHeader::new(dims)) };
        Ok(Outcome::Ok)
    })
}
