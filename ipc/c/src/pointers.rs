//! The only place that follows the caller's pointers. Each function says what the caller must have promised; NULL and wrong sizes are
//! found out, anything else that is not true of a pointer cannot be.

#![allow(unsafe_code)]

use crate::outcome::{Failure, Outcome};
use std::ffi::{CStr, c_char};
use std::time::Duration;

/// A struct whose first field is its size as a `u32`.
///
/// # Safety
/// `repr(C)`, made of plain numbers and pointers, with a `u32` first.
pub(crate) unsafe trait Sized32: Copy {}

// SAFETY: the first field of each is `size: u32`, and all are `repr(C)` structs of numbers and pointers.
unsafe impl Sized32 for crate::options::SubscriberOptions {}
// SAFETY: as above.
unsafe impl Sized32 for crate::options::ProducerOptions {}
// SAFETY: as above.
unsafe impl Sized32 for crate::options::CompletionView {}
// SAFETY: as above.
unsafe impl Sized32 for crate::options::DepthFrame {}
// SAFETY: as above.
unsafe impl Sized32 for crate::options::CameraOptions {}

fn null(name: &str) -> Failure {
    Failure::new(Outcome::InvalidArgument, format!("`{name}` is NULL"))
}

/// The text at `pointer`, or `default` for NULL.
///
/// # Safety
/// `pointer` is NULL or points to a NUL-terminated text that lives, unchanged, as long as the result is used.
pub(crate) unsafe fn text(pointer: *const c_char, default: &str) -> Result<&str, Failure> {
    if pointer.is_null() {
        return Ok(default);
    }
    // SAFETY: not NULL, so a NUL-terminated text, as promised.
    let text = unsafe { CStr::from_ptr(pointer) };
    text.to_str().map_err(|_| Failure::new(Outcome::BadInstance, "the instance's name is not UTF-8"))
}

/// A copy of what is at `pointer`.
///
/// # Safety
/// `pointer` is NULL or points to a valid `T` that nobody writes meanwhile.
pub(crate) unsafe fn read<T: Copy>(pointer: *const T, name: &str) -> Result<T, Failure> {
    if pointer.is_null() {
        return Err(null(name));
    }
    // SAFETY: not NULL, so a readable `T`, as promised; an unaligned read asks for no more than C's own copy would.
    Ok(unsafe { pointer.read_unaligned() })
}

/// A copy of the struct at `pointer` after its size has been checked.
///
/// # Safety
/// `pointer` is NULL or points to as many readable bytes as its first field says.
pub(crate) unsafe fn read_sized<T: Sized32>(pointer: *const T, name: &str) -> Result<T, Failure> {
    // SAFETY: NULL or readable, as promised, and the first field is a u32.
    let size = unsafe { read(pointer.cast::<u32>(), name) }?;
    if size as usize != size_of::<T>() {
        return Err(Failure::new(
            Outcome::WrongSize,
            format!(
                "`{name}`.size is {size}, this library knows {}: set it to its sizeof, and build with this library's beo.h",
                size_of::<T>()
            ),
        ));
    }
    // SAFETY: as many bytes are readable as the first field says, as promised.
    unsafe { read(pointer, name) }
}

/// Fails if `pointer` is NULL: to be asked before anything is done whose result could then not be stored.
pub(crate) fn must_not_be_null<T>(pointer: *const T, name: &str) -> Result<(), Failure> {
    if pointer.is_null() { Err(null(name)) } else { Ok(()) }
}

/// Stores `value` at `pointer`; NULL is passed over.
///
/// # Safety
/// `pointer` is NULL or points to writable memory for a `T` that nobody else uses meanwhile.
pub(crate) unsafe fn store<T: Copy>(pointer: *mut T, value: T) {
    if !pointer.is_null() {
        // SAFETY: not NULL, so writable, as promised.
        unsafe { pointer.write_unaligned(value) };
    }
}

/// The numbers at `pointer`.
///
/// # Safety
/// `T` is a plain number. `pointer` is NULL or points to `len` of them, readable, that live, unchanged, as long as the result is used.
pub(crate) unsafe fn numbers<'a, T: Copy>(pointer: *const T, len: usize, name: &str) -> Result<&'a [T], Failure> {
    check(pointer, len, name)?;
    // SAFETY: not NULL and aligned, so `len` readable numbers, as promised, and no more than isize::MAX bytes.
    Ok(unsafe { std::slice::from_raw_parts(pointer, len) })
}

/// The numbers at `pointer`, to be written and not to be read before: memory that C has just allocated holds any numbers.
///
/// # Safety
/// `T` is a plain number, of which every bit pattern is one. `pointer` is NULL or points to room for `len` of them, writable, that nobody
/// else uses as long as the result is used.
pub(crate) unsafe fn numbers_mut<'a, T: Copy>(pointer: *mut T, len: usize, name: &str) -> Result<&'a mut [T], Failure> {
    check(pointer, len, name)?;
    // SAFETY: not NULL and aligned, so room for `len` numbers, as promised, and no more than isize::MAX bytes. Memory that comes from
    // outside of Rust holds some bytes, whichever, and any bytes are numbers.
    Ok(unsafe { std::slice::from_raw_parts_mut(pointer, len) })
}

fn check<T>(pointer: *const T, len: usize, name: &str) -> Result<(), Failure> {
    must_not_be_null(pointer, name)?;
    if len > isize::MAX as usize / size_of::<T>() {
        return Err(Failure::new(Outcome::WrongSize, format!("`{name}` has {len} values: more than a computer has")));
    }
    if !pointer.is_aligned() {
        return Err(Failure::new(Outcome::InvalidArgument, format!("`{name}` is not aligned as its type asks for")));
    }
    Ok(())
}

/// A timeout in milliseconds; negative: without end.
pub(crate) fn timeout(milliseconds: i32) -> Option<Duration> {
    u64::try_from(milliseconds).ok().map(Duration::from_millis)
}

#[cfg(test)]
pub(crate) fn text_of(pointer: *const c_char) -> String {
    // SAFETY: only for texts of this library, which are NUL-terminated and live at least until the next failure of the thread.
    unsafe { CStr::from_ptr(pointer) }.to_str().unwrap().to_owned()
}
