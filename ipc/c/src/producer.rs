//! Writing observations.

#![allow(unsafe_code)] // exported names, and pointers of the caller's

use crate::handles::Table;
use crate::options::ProducerOptions;
use crate::outcome::{Failure, Outcome, guard};
use crate::pointers::{must_not_be_null, read, read_sized, store, text, timeout};
use beo_ipc::Loan;
use beo_ipc::names::DEFAULT_INSTANCE;
use beo_ipc::{ABI_VERSION, InstanceName, ObservationHeader, ReconnectingProducer};
use std::ffi::c_char;
use std::time::Duration;

/// Writes observations of one size. From `beo_producer_open` to `beo_producer_close`.
pub struct ProducerHandle;

/// Memory for one observation. From `beo_producer_loan` to `beo_loan_commit` or `beo_loan_abandon`.
pub struct LoanHandle;

pub(crate) static PRODUCERS: Table<ReconnectingProducer> = Table::new();
static LOANS: Table<Loan> = Table::new();

/// Opens a producer of grids of nx × ny × nz voxels for the daemon of `instance` (NULL: "default") and stores its handle in `*producer`.
/// `options` may be NULL.
///
/// `BEO_STATUS_NOT_RUNNING` if there is no daemon after `wait_ms` milliseconds: try again. Once open, it survives the daemon. Memory for
/// all its grids is taken and touched here: 1.1 MB at 30³, 164 MB at 254³. The caller closes it.
///
/// # Safety
/// `instance` is NULL or a NUL-terminated text; `options` is NULL or readable for its `size`; `producer` is NULL or writable.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn beo_producer_open(
    instance: *const c_char,
    nx: u32,
    ny: u32,
    nz: u32,
    options: *const ProducerOptions,
    producer: *mut *mut ProducerHandle,
) -> Outcome {
    guard(|| {
        must_not_be_null(producer, "producer")?;
        // SAFETY: writable, as the caller promises.
        unsafe { store(producer, std::ptr::null_mut()) };
        // SAFETY: a text, as the caller promises.
        let instance = InstanceName::new(unsafe { text(instance, DEFAULT_INSTANCE) }?)?;
        let mut wait = Some(Duration::ZERO);
        if !options.is_null() {
            // SAFETY: readable for its size, as the caller promises.
            wait = timeout(unsafe { read_sized(options, "options") }?.wait_ms);
        }
        let template = ObservationHeader::new([nx, ny, nz]);
        let opened = ReconnectingProducer::open_within(&instance, &template, wait.unwrap_or(Duration::MAX))?;
        // SAFETY: as above.
        unsafe { store(producer, PRODUCERS.insert(opened)) };
        Ok(Outcome::Ok)
    })
}

/// Closes a producer. Its loans stay writable, but can only be abandoned.
#[unsafe(no_mangle)]
pub extern "C" fn beo_producer_close(producer: *mut ProducerHandle) -> Outcome {
    guard(|| {
        PRODUCERS.remove(producer)?;
        Ok(Outcome::Ok)
    })
}

/// The identifier of this producer, stored in `*id`: percepts repeat it as `producer_id`.
///
/// # Safety
/// `id` is NULL or writable.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn beo_producer_id(producer: *mut ProducerHandle, id: *mut u64) -> Outcome {
    guard(|| {
        must_not_be_null(id, "id")?;
        let number = PRODUCERS.with(producer, |producer| Ok::<_, Failure>(producer.id()))?;
        // SAFETY: writable, as the caller promises.
        unsafe { store(id, number) };
        Ok(Outcome::Ok)
    })
}

/// Loans memory for one grid: stores a handle in `*loan`, where the voxels are in `*voxels`, and how many in `*voxel_count`, which may be
/// NULL. Write every voxel: 0 empty, 1 filled, 255 unknown; voxel (x, y, z) is at `(x * ny + y) * nz + z`.
///
/// `BEO_STATUS_NOT_RUNNING` while no daemon is there: leave this grid out, and try again with the next. The caller commits or abandons the
/// loan; two can be held at a time whatever the readers do, beyond that `BEO_STATUS_NO_FREE_CHUNK` can be returned.
///
/// # Safety
/// `loan`, `voxels` and `voxel_count` are each NULL or writable.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn beo_producer_loan(
    producer: *mut ProducerHandle,
    loan: *mut *mut LoanHandle,
    voxels: *mut *mut u8,
    voxel_count: *mut usize,
) -> Outcome {
    guard(|| {
        must_not_be_null(loan, "loan")?;
        must_not_be_null(voxels, "voxels")?;
        // SAFETY: writable, as the caller promises.
        unsafe { store(loan, std::ptr::null_mut()) };
        let mut loaned = PRODUCERS.with(producer, |producer| producer.loan().map_err(Failure::from))?;
        let (start, count) = (loaned.voxels_mut().as_mut_ptr(), loaned.voxels_mut().len());
        // SAFETY: all NULL or writable, as the caller promises. Shared memory does not move when the loan does.
        unsafe {
            store(voxels, start);
            store(voxel_count, count);
            store(loan, LOANS.insert(loaned));
        }
        Ok(Outcome::Ok)
    })
}

/// Sends the grid and stores its number, which its percept repeats, in `*sequence`, which may be NULL. Never waits for a reader. The loan
/// and its voxels end here, unless the header is refused with `BEO_STATUS_INVALID_ARGUMENT`. `BEO_STATUS_NOT_RUNNING` if the producer was
/// closed, or let go of a daemon that went away, after the loan: the grid is lost.
///
/// `header` says what the grid is and what is asked for; start from `beo_observation_header_init`; NULL stands for what that fills in.
/// `producer_id`, `sequence` and `written_ns` are filled in here, and `capture_ns` if it is 0: with the time of the loan.
///
/// # Safety
/// `header` is NULL or readable; `sequence` is NULL or writable.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn beo_loan_commit(loan: *mut LoanHandle, header: *const ObservationHeader, sequence: *mut u64) -> Outcome {
    guard(|| {
        if !header.is_null() {
            // SAFETY: readable, as the caller promises.
            let header = unsafe { read(header, "header") }?;
            LOANS.with(loan, |loan| set_header(loan, &header))?;
        }
        let sent = LOANS.take(loan)?.send()?;
        // SAFETY: NULL or writable, as the caller promises.
        unsafe { store(sequence, sent.sequence) };
        Ok(Outcome::Ok)
    })
}

/// Gives the memory back without sending anything. The loan and its voxels end here.
#[unsafe(no_mangle)]
pub extern "C" fn beo_loan_abandon(loan: *mut LoanHandle) -> Outcome {
    guard(|| {
        LOANS.remove(loan)?;
        Ok(Outcome::Ok)
    })
}

/// Gives a loan the caller's header, but for what the producer knows better.
pub(crate) fn set_header(loan: &mut Loan, header: &ObservationHeader) -> Result<(), Failure> {
    let own = *loan.header();
    if header.abi_version != ABI_VERSION {
        let message = format!(
            "`header`.abi_version is {}, this library has {ABI_VERSION}: start from beo_observation_header_init",
            header.abi_version
        );
        return Err(Failure::new(Outcome::InvalidArgument, message));
    }
    if header.dims != own.dims {
        let message = format!("`header`.dims are {:?}, the producer was opened for {:?}", header.dims, own.dims);
        return Err(Failure::new(Outcome::InvalidArgument, message));
    }
    let capture_ns = if header.capture_ns == 0 { own.capture_ns } else { header.capture_ns };
    *loan.header_mut() = ObservationHeader { producer_id: own.producer_id, capture_ns, ..*header };
    Ok(())
}
