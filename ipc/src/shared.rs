//! The `unsafe` of this crate but for a question to the system (`in_use`): the borders between shared memory or file descriptors and Rust's rules.

#![allow(unsafe_code)]

use std::mem::MaybeUninit;
use std::os::fd::BorrowedFd;

use iceoryx2::port::listener::Listener;
use iceoryx2::prelude::{FileDescriptorBased as _, ZeroCopySend};
use iceoryx2::sample_mut::SampleMut;
use iceoryx2::sample_mut_uninit::SampleMutUninit;

use crate::control::{ReloadReply, ReloadRequest};
use crate::messages::{CompletionHeader, ObservationHeader, Percept, Status};
use crate::node::Ipc;

mod sealed {
    pub trait Sealed {}
}

/// The messages that can go elsewhere as bytes. Only here it is said which: integers, floats and arrays of them, without padding (checked by
/// `layout!`), for which any bytes are a value.
pub trait Plain: Copy + sealed::Sealed {}

macro_rules! plain {
    ($($message:ident),+) => { $(impl sealed::Sealed for $message {} impl Plain for $message {})+ };
}
plain!(ObservationHeader, Percept, CompletionHeader, Status, ReloadRequest, ReloadReply);

/// The bytes of a message, as they lie in shared memory.
pub(crate) fn bytes_of<M: Plain>(message: &M) -> &[u8] {
    // SAFETY: a `Plain` message is `repr(C)` without padding, so that all its bytes are initialised, and bytes need no alignment.
    unsafe { std::slice::from_raw_parts(std::ptr::from_ref(message).cast(), size_of::<M>()) }
}

/// The message at the beginning of some bytes; `None` if there are too few.
pub(crate) fn message_of<M: Plain>(bytes: &[u8]) -> Option<M> {
    if bytes.len() < size_of::<M>() {
        return None;
    }
    // SAFETY: there are enough bytes, they are read without regard to alignment, and any bytes are a value of a `Plain` message.
    Some(unsafe { std::ptr::read_unaligned(bytes.as_ptr().cast()) })
}

/// Takes a copy of a message that another process could still be changing.
///
/// Only for this crate's messages: plain numbers, for which any bit pattern is a value.
pub(crate) fn copy_of<Message: ZeroCopySend + Copy>(shared: &Message) -> Message {
    // SAFETY: a reference is valid and aligned for reads. The volatile read happens once, so that what is checked afterwards is the copy; a
    // concurrent write by a misbehaving peer can tear it, and any torn value is still a value, since the messages consist of integers,
    // floats and arrays of them.
    unsafe { std::ptr::read_volatile(shared) }
}

/// Takes a loaned slice of bytes as initialised, with whatever it held before: no pass over the memory, which at 254³ takes milliseconds.
pub(crate) fn with_old_content<Header: ZeroCopySend + std::fmt::Debug>(
    loan: SampleMutUninit<Ipc, [MaybeUninit<u8>], Header>,
) -> SampleMut<Ipc, [u8], Header> {
    // SAFETY: the bytes lie in a POSIX shared-memory object, which the kernel hands out zeroed, and hold whatever was stored there since:
    // memory from outside the abstract machine, never uninitialised, and every value of a byte is a valid u8.
    unsafe { loan.assume_init() }
}

/// The socket of a listener, for as long as the listener lives.
pub(crate) fn descriptor_of(listener: &Listener<Ipc>) -> BorrowedFd<'_> {
    // SAFETY: the descriptor is open as long as its listener, which the borrow keeps alive; nobody closes it by hand.
    unsafe { BorrowedFd::borrow_raw(listener.file_descriptor().native_handle()) }
}
