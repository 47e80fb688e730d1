//! Errors of the channels: what was wrong, where, and what to do.

use std::time::Duration;

use crate::messages::ABI_VERSION;
use crate::names::InstanceName;

/// Why a role could not be opened.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum OpenError {
    /// No daemon serves the instance (yet): try again.
    #[error("no daemon serves the instance `{instance}`: start `beo serve --instance {instance}`, or wait for it")]
    NotRunning {
        /// Which instance.
        instance: InstanceName,
    },
    /// Another daemon serves the instance.
    #[error("a daemon{} already serves the instance `{instance}`: stop it, or choose another `--instance`", pid_text(.pid))]
    AlreadyRunning {
        /// Which instance.
        instance: InstanceName,
        /// The other daemon's process, if it could be found out.
        pid: Option<u32>,
    },
    /// The peers were built with different message layouts.
    #[error(
        "`{service}` has the message layout {found}, this program needs {expected} of version {ABI_VERSION}: rebuild both from the same \
         version of beo"
    )]
    LayoutMismatch {
        /// Which service.
        service: String,
        /// This program's layout hash.
        expected: String,
        /// The other side's layout hash, or `none`.
        found: String,
    },
    /// The service exists with other types, or was made by another version of iceoryx2.
    #[error("`{service}` is of another version ({cause}): rebuild both sides from the same version of beo and iceoryx2")]
    OtherVersion {
        /// Which service.
        service: String,
        /// Which version it is of, or iceoryx2's word for it.
        cause: String,
    },
    /// Clients still hold the services of a daemon that had other limits.
    #[error(
        "`{service}` is still held by clients of a daemon with other settings ({cause}): stop the clients of the instance, then start again"
    )]
    OtherSettings {
        /// Which service.
        service: String,
        /// The difference.
        cause: String,
    },
    /// The memory for the segments is not there; writing to them would be a bus error later.
    #[error(
        "not enough shared memory: {needed} bytes are needed and {available} are free in {place}: free some (`ls -l {place}`), or enlarge it (`mount -o remount,size=... {place}`)"
    )]
    NotEnoughSharedMemory {
        /// Where: the directory of POSIX shared memory.
        place: String,
        /// Bytes needed.
        needed: u64,
        /// Bytes free.
        available: u64,
    },
    /// The shared memory could not be joined, most often because it belongs to another user.
    #[error(
        "cannot join the shared-memory domain ({cause}): all its processes must run as one user; this one has uid {uid}, {root} belongs to uid {owner}"
    )]
    NoAccess {
        /// iceoryx2's word for it.
        cause: String,
        /// This process' effective user.
        uid: u32,
        /// Where iceoryx2 keeps its files.
        root: String,
        /// Whose files they are, or `?`.
        owner: String,
    },
    /// As many peers as the daemon was configured for are connected.
    #[error("`{service}` has no place left for another {role}: stop one, or configure the daemon for more")]
    Full {
        /// Which service.
        service: String,
        /// The role that was to be connected.
        role: &'static str,
    },
    /// The dims are outside the limits.
    #[error("dims {0:?} are not possible: each axis must have {min} to {max} voxels", min = crate::limits::MIN_DIM, max = crate::limits::MAX_DIM)]
    BadDims([u32; 3]),
    /// Anything else, in iceoryx2's words.
    #[error("cannot open {what}: {cause}")]
    Failed {
        /// The service that was to be opened.
        what: String,
        /// iceoryx2's or the system's word for it.
        cause: String,
    },
}

impl OpenError {
    /// Whether waiting helps: the daemon is just not there yet.
    pub fn is_retryable(&self) -> bool {
        matches!(self, Self::NotRunning { .. })
    }
}

fn pid_text(pid: &Option<u32>) -> String {
    pid.map(|pid| format!(" (process {pid})")).unwrap_or_default()
}

/// Why no memory could be loaned.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum LoanError {
    /// All chunks are loaned, queued or held by readers.
    #[error("no free chunk for a sample: readers or this process hold all of them: release samples and try again")]
    NoFreeChunk,
    /// More than the segment was made for.
    #[error("{asked} bytes do not fit: the segment was made for samples of {possible}")]
    TooLarge {
        /// Bytes asked for.
        asked: usize,
        /// Bytes possible.
        possible: usize,
    },
    /// Anything else, in iceoryx2's words.
    #[error("cannot loan a sample: {0}")]
    Failed(String),
}

/// Why a sample was not sent.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum SendError {
    /// There was no memory to send it in.
    #[error(transparent)]
    Loan(#[from] LoanError),
    /// The producer that it was loaned from is gone: closed, or let go because its daemon was gone.
    #[error("the producer was closed, or its daemon went away, after this was loaned: it is lost, loan anew")]
    ProducerGone,
    /// A reader was killed while it connected, and what it left cannot be removed yet.
    #[error("a reader was killed while it connected, and its empty segment in /dev/shm is still there: try again with the next one")]
    PeerInTheWay,
    /// Anything else, in iceoryx2's words.
    #[error("cannot send a sample: {0}")]
    Failed(String),
}

/// Why nothing was received.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum ReceiveError {
    /// The samples taken earlier are still held.
    #[error("too many samples are held: drop one before taking another")]
    TooManyHeld,
    /// The sample contradicts itself: its payload is not what its header says. It was released.
    #[error("a sample was broken: its payload has {found} bytes, its header says {expected}")]
    Broken {
        /// Bytes the header says.
        expected: usize,
        /// Bytes found.
        found: usize,
    },
    /// Anything else, in iceoryx2's words.
    #[error("cannot receive: {0}")]
    Failed(String),
}

/// Why waiting failed.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("cannot wait for an event: {0}")]
pub struct WaitError(pub(crate) String);

/// Why a reconnecting role failed.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ReconnectError {
    /// It could not be connected (again).
    #[error(transparent)]
    Open(#[from] OpenError),
    /// Waiting failed.
    #[error(transparent)]
    Wait(#[from] WaitError),
    /// No memory could be loaned.
    #[error(transparent)]
    Loan(#[from] LoanError),
    /// Nothing could be received.
    #[error(transparent)]
    Receive(#[from] ReceiveError),
    /// The descriptor for the caller's own `poll` could not be made.
    #[error("cannot make a file descriptor to poll ({0}): see `ulimit -n`")]
    Descriptor(#[from] std::io::Error),
}

/// Calls `open` until it succeeds, fails for another reason than that the daemon is not there, or `timeout` has passed.
pub(crate) fn retry_within<T>(timeout: Duration, mut open: impl FnMut() -> Result<T, OpenError>) -> Result<T, OpenError> {
    const PAUSE: Duration = Duration::from_millis(20);
    let start = std::time::Instant::now();
    loop {
        match open() {
            Err(error) if error.is_retryable() && start.elapsed() < timeout => {
                std::thread::sleep(PAUSE.min(timeout.saturating_sub(start.elapsed())));
            }
            result => return result,
        }
    }
}
