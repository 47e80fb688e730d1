//! The results of the interface's functions: a status, and for errors a text that says what was wrong, where, and what to do.

use crate::handles::HandleError;
use beo_camera::{FrameError, GridError, IntrinsicsError, PlacementError, SensorModelError};
use beo_ipc::{CarvedGridError, InstanceNameError, LoanError, OpenError, ReceiveError, ReconnectError, SendError, WaitError};
use std::cell::RefCell;
use std::ffi::{CStr, CString, c_char};
use std::panic::{AssertUnwindSafe, catch_unwind};

/// The outcome of a call. 0: done. Above 0: nothing is broken, try again (later, or after what the text says). Below 0: an error, of
/// which `beo_last_error` says more.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(i32)]
pub enum Outcome {
    /// Done.
    Ok = 0,
    /// There is nothing to take.
    Empty = 1,
    /// The time was up before it happened.
    Timeout = 2,
    /// No daemon serves the instance (yet, or any more).
    NotRunning = 3,
    /// A signal came while the call waited.
    Interrupted = 4,
    /// Another thread is using this handle.
    Busy = 5,
    /// All memory for observations is loaned or still held by readers.
    NoFreeChunk = 6,
    /// Two completions are held: release one.
    TooManyHeld = 7,
    /// The frame does not show enough: no plane that objects could stand on, or too few readings of the object.
    NotSeen = 8,
    /// An argument is NULL or out of its range.
    InvalidArgument = -1,
    /// The `size` field of a struct, or a length, is not what it must be.
    WrongSize = -2,
    /// The handle was closed or released before, is of another kind, or never existed.
    BadHandle = -3,
    /// The instance's name is not a name.
    BadInstance = -4,
    /// The grid's dims are outside 8 to 256.
    BadDims = -5,
    /// The daemon was built with other message layouts or another version of iceoryx2.
    OtherVersion = -6,
    /// Clients of a daemon with other settings still hold its services.
    OtherSettings = -7,
    /// There is not enough free shared memory.
    NoSharedMemory = -8,
    /// The shared memory belongs to another user.
    NoAccess = -9,
    /// As many clients are connected as the daemon was configured for.
    Full = -10,
    /// A message contradicts itself and was thrown away.
    Broken = -11,
    /// The system or iceoryx2 failed.
    Failed = -12,
    /// A fault of this library.
    Internal = -13,
}

impl Outcome {
    /// All of them.
    const ALL: [Self; 22] = [
        Self::Ok,
        Self::Empty,
        Self::Timeout,
        Self::NotRunning,
        Self::Interrupted,
        Self::Busy,
        Self::NoFreeChunk,
        Self::TooManyHeld,
        Self::NotSeen,
        Self::InvalidArgument,
        Self::WrongSize,
        Self::BadHandle,
        Self::BadInstance,
        Self::BadDims,
        Self::OtherVersion,
        Self::OtherSettings,
        Self::NoSharedMemory,
        Self::NoAccess,
        Self::Full,
        Self::Broken,
        Self::Failed,
        Self::Internal,
    ];

    /// The text for a number, whoever made it up.
    pub fn text(number: i32) -> &'static CStr {
        Self::ALL.into_iter().find(|outcome| *outcome as i32 == number).map_or(c"unknown status", Self::own_text)
    }

    const fn own_text(self) -> &'static CStr {
        match self {
            Self::Ok => c"done",
            Self::Empty => c"there is nothing to take",
            Self::Timeout => c"the time was up before it happened",
            Self::NotRunning => c"no daemon serves the instance: start one, or wait for it",
            Self::Interrupted => c"a signal came while the call waited",
            Self::Busy => c"another thread is using this handle",
            Self::NoFreeChunk => c"all memory for observations is loaned or held: commit or abandon loans, and try again",
            Self::TooManyHeld => c"too many completions are held: release one, and try again",
            Self::NotSeen => c"the frame does not show enough of it: try again with the next",
            Self::InvalidArgument => c"an argument is NULL or out of its range",
            Self::WrongSize => c"a size field or a length is not what it must be",
            Self::BadHandle => c"the handle was closed or released before, or is of another kind",
            Self::BadInstance => c"the instance's name is not a name",
            Self::BadDims => c"the grid's dims are outside 8 to 256",
            Self::OtherVersion => c"the daemon has other message layouts: rebuild both sides from the same version of beo",
            Self::OtherSettings => c"clients of a daemon with other settings still hold its services: stop them",
            Self::NoSharedMemory => c"not enough free shared memory",
            Self::NoAccess => c"the shared memory belongs to another user",
            Self::Full => c"as many clients are connected as the daemon was configured for",
            Self::Broken => c"a message contradicted itself and was thrown away",
            Self::Failed => c"the system or iceoryx2 failed",
            Self::Internal => c"a fault of libbeo: please report it",
        }
    }
}

/// Why a call was not done.
#[derive(Debug)]
pub(crate) struct Failure {
    pub outcome: Outcome,
    message: String,
}

impl Failure {
    pub fn new(outcome: Outcome, message: impl Into<String>) -> Self {
        Self { outcome, message: message.into() }
    }
}

/// Runs the body of an exported function: turns a failure into its status and the thread's last error, and stops a panic, which must not
/// cross into C.
pub(crate) fn guard(body: impl FnOnce() -> Result<Outcome, Failure>) -> Outcome {
    match catch_unwind(AssertUnwindSafe(body)) {
        Ok(Ok(outcome)) => outcome,
        Ok(Err(failure)) => report(failure),
        Err(panic) => {
            let reason = panic.downcast_ref::<&str>().copied().or_else(|| panic.downcast_ref::<String>().map(String::as_str));
            report(Failure::new(Outcome::Internal, format!("a fault of libbeo, please report it: {}", reason.unwrap_or("panic"))))
        }
    }
}

thread_local! {
    static LAST_ERROR: RefCell<CString> = RefCell::default();
}

fn report(failure: Failure) -> Outcome {
    let text = CString::new(failure.message.replace('\0', "\u{fffd}")).unwrap_or_default();
    // While a thread ends there may be no place left for its last error.
    let _ = LAST_ERROR.try_with(|last| last.replace(text));
    failure.outcome
}

/// The text of the last failure of this thread, valid until its next one.
pub(crate) fn last_error() -> *const c_char {
    LAST_ERROR.try_with(|last| last.borrow().as_ptr()).unwrap_or(c"".as_ptr())
}

impl From<OpenError> for Failure {
    fn from(error: OpenError) -> Self {
        let outcome = match &error {
            OpenError::NotRunning { .. } => Outcome::NotRunning,
            OpenError::LayoutMismatch { .. } | OpenError::OtherVersion { .. } => Outcome::OtherVersion,
            OpenError::OtherSettings { .. } => Outcome::OtherSettings,
            OpenError::NotEnoughSharedMemory { .. } => Outcome::NoSharedMemory,
            OpenError::NoAccess { .. } => Outcome::NoAccess,
            OpenError::Full { .. } => Outcome::Full,
            OpenError::BadDims(_) => Outcome::BadDims,
            _ => Outcome::Failed,
        };
        Self::new(outcome, error.to_string())
    }
}

impl From<LoanError> for Failure {
    fn from(error: LoanError) -> Self {
        let outcome = if error == LoanError::NoFreeChunk { Outcome::NoFreeChunk } else { Outcome::Failed };
        Self::new(outcome, error.to_string())
    }
}

impl From<ReceiveError> for Failure {
    fn from(error: ReceiveError) -> Self {
        let outcome = match &error {
            ReceiveError::TooManyHeld => Outcome::TooManyHeld,
            ReceiveError::Broken { .. } => Outcome::Broken,
            _ => Outcome::Failed,
        };
        Self::new(outcome, error.to_string())
    }
}

impl From<SendError> for Failure {
    fn from(error: SendError) -> Self {
        let outcome = if error == SendError::ProducerGone { Outcome::NotRunning } else { Outcome::Failed };
        Self::new(outcome, error.to_string())
    }
}

impl From<WaitError> for Failure {
    fn from(error: WaitError) -> Self {
        Self::new(Outcome::Failed, error.to_string())
    }
}

impl From<ReconnectError> for Failure {
    fn from(error: ReconnectError) -> Self {
        match error {
            ReconnectError::Open(error) => error.into(),
            ReconnectError::Loan(error) => error.into(),
            ReconnectError::Receive(error) => error.into(),
            ReconnectError::Wait(error) => error.into(),
            error => Self::new(Outcome::Failed, error.to_string()),
        }
    }
}

impl From<InstanceNameError> for Failure {
    fn from(error: InstanceNameError) -> Self {
        Self::new(Outcome::BadInstance, error.to_string())
    }
}

impl From<IntrinsicsError> for Failure {
    fn from(error: IntrinsicsError) -> Self {
        Self::new(Outcome::InvalidArgument, error.to_string())
    }
}

impl From<SensorModelError> for Failure {
    fn from(error: SensorModelError) -> Self {
        Self::new(Outcome::InvalidArgument, error.to_string())
    }
}

impl From<FrameError> for Failure {
    fn from(error: FrameError) -> Self {
        Self::new(Outcome::WrongSize, error.to_string())
    }
}

impl From<GridError> for Failure {
    fn from(error: GridError) -> Self {
        let outcome = match &error {
            GridError::Dims(_) => Outcome::BadDims,
            GridError::Length { .. } => Outcome::WrongSize,
            GridError::VoxelSize(_) | GridError::Place => Outcome::InvalidArgument,
        };
        Self::new(outcome, error.to_string())
    }
}

impl From<PlacementError> for Failure {
    fn from(error: PlacementError) -> Self {
        match error {
            PlacementError::Grid(error) => error.into(),
            seen => Self::new(Outcome::NotSeen, seen.to_string()),
        }
    }
}

impl From<CarvedGridError> for Failure {
    fn from(error: CarvedGridError) -> Self {
        let outcome = match &error {
            CarvedGridError::Dims(_) => Outcome::BadDims,
            // What the daemon would refuse, now or in later versions.
            _ => Outcome::InvalidArgument,
        };
        Self::new(outcome, error.to_string())
    }
}

impl From<HandleError> for Failure {
    fn from(error: HandleError) -> Self {
        let outcome = match error {
            HandleError::Null => Outcome::InvalidArgument,
            HandleError::Unknown => Outcome::BadHandle,
            HandleError::Busy => Outcome::Busy,
        };
        Self::new(outcome, error.to_string())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pointers::text_of;

    #[test]
    fn a_panic_becomes_a_status_and_a_text() {
        let outcome = guard(|| panic!("broken on purpose"));
        assert_eq!(outcome, Outcome::Internal);
        assert!(text_of(last_error()).contains("broken on purpose"));
    }

    #[test]
    fn a_failure_leaves_its_text_to_its_own_thread_alone() {
        guard(|| Err(Failure::new(Outcome::Failed, "here\0there")));
        assert_eq!(text_of(last_error()), "here\u{fffd}there");
        std::thread::spawn(|| assert_eq!(text_of(last_error()), "")).join().unwrap();
        assert_eq!(guard(|| Ok(Outcome::Ok)), Outcome::Ok);
        assert_eq!(text_of(last_error()), "here\u{fffd}there", "only failures replace it");
    }

    #[test]
    fn every_status_has_a_text_of_its_own() {
        let texts: std::collections::BTreeSet<_> = (-20..20).map(Outcome::text).collect();
        assert_eq!(texts.len(), Outcome::ALL.len() + 1);
        assert_eq!(Outcome::text(i32::MIN), c"unknown status");
    }
}
