//! Messages from bytes and back, as they lie in shared memory.

#![allow(unsafe_code)] // any bytes are a message

use beo_ipc::control::ReloadRequest;
use beo_ipc::{CompletionHeader, ObservationHeader, Percept, PictureHeader, Status};

/// A message: plain numbers and arrays of them, without padding, for which any bits are a value.
///
/// # Safety
/// That it is so.
pub unsafe trait Plain: Copy {}
// SAFETY: `repr(C)` of integers, floats and arrays of them; that the fields fill the whole size is checked where they are declared.
unsafe impl Plain for ObservationHeader {}
// SAFETY: as above.
unsafe impl Plain for Percept {}
// SAFETY: as above.
unsafe impl Plain for CompletionHeader {}
// SAFETY: as above.
unsafe impl Plain for Status {}
// SAFETY: as above.
unsafe impl Plain for PictureHeader {}
// SAFETY: as above.
unsafe impl Plain for ReloadRequest {}

/// The message that begins `data`, and what follows it; where the bytes are too few, the rest of the message is 0.
pub fn message<T: Plain>(data: &[u8]) -> (T, &[u8]) {
    let (head, rest) = data.split_at(data.len().min(size_of::<T>()));
    let mut bytes = vec![0; size_of::<T>()];
    bytes[..head.len()].copy_from_slice(head);
    // SAFETY: as many bytes as a message has, and any bits are one.
    (unsafe { bytes.as_ptr().cast::<T>().read_unaligned() }, rest)
}

/// The bytes of a message.
pub fn bytes_of<T: Plain>(message: &T) -> Vec<u8> {
    // SAFETY: a message has no padding, so that all its bytes have values.
    unsafe { std::slice::from_raw_parts(std::ptr::from_ref(message).cast::<u8>(), size_of::<T>()) }.to_vec()
}
