//! Telling the service manager how it goes: the protocol of sd_notify(3), one datagram to the socket that NOTIFY_SOCKET names.
//!
//! The messages and the watchdog's time are those of the crate `sd-notify`. The socket is our own, as that crate's (0.5) waits where the
//! manager does not read, which would delay observations, and knows no abstract addresses, which containers use.

use beo_ipc::clock::monotonic_ns;
use sd_notify::NotifyState;
use std::env;
use std::ffi::OsStr;
use std::io;
use std::os::linux::net::SocketAddrExt as _;
use std::os::unix::ffi::OsStrExt as _;
use std::os::unix::net::{SocketAddr, UnixDatagram};

/// Time between two lines of status.
const STATUS_NS: u64 = 5_000_000_000;

/// The service manager, if one listens.
pub struct Supervisor {
    socket: Option<(UnixDatagram, SocketAddr)>,
    /// Time between two signs of life, if the manager wants them: half of what it allows.
    watchdog_ns: Option<u64>,
    last_alive_ns: u64,
    last_status_ns: u64,
}

impl Supervisor {
    /// The one that the environment names; one that cannot be reached is warned of and left alone.
    pub fn from_environment() -> Self {
        let socket = env::var_os("NOTIFY_SOCKET")
            .filter(|name| !name.is_empty())
            .and_then(|name| open(&name).inspect_err(|error| tracing::warn!(%error, socket = ?name, "NOTIFY_SOCKET cannot be used")).ok());
        let allowed = sd_notify::watchdog_enabled().filter(|allowed| !allowed.is_zero());
        let watchdog_ns = allowed.map(|allowed| u64::try_from(allowed.as_nanos() / 2).unwrap_or(u64::MAX));
        Self { socket, watchdog_ns, last_alive_ns: 0, last_status_ns: 0 }
    }

    /// Observations are answered from now on (again).
    pub fn ready(&mut self, status: &str) {
        self.send(&[NotifyState::Ready, NotifyState::Status(status)]);
        self.last_status_ns = monotonic_ns();
    }

    /// Another model is being loaded.
    pub fn reloading(&self) {
        self.send(&[NotifyState::Reloading, NotifyState::MonotonicUsec((monotonic_ns() / 1000).into())]);
    }

    /// The end has begun.
    pub fn stopping(&self) {
        self.send(&[NotifyState::Stopping, NotifyState::Status("stopping")]);
    }

    /// To be called whenever the loop comes round, and only there: a sign of life when one is due, and a line of status now and then.
    pub fn alive(&mut self, status: impl FnOnce() -> String) {
        if self.socket.is_none() {
            return;
        }
        let now = monotonic_ns();
        if self.watchdog_ns.is_some_and(|interval| now.saturating_sub(self.last_alive_ns) >= interval) {
            self.last_alive_ns = now;
            self.send(&[NotifyState::Watchdog]);
        }
        if now.saturating_sub(self.last_status_ns) >= STATUS_NS {
            self.last_status_ns = now;
            self.send(&[NotifyState::Status(&status())]);
        }
    }

    /// A message that the manager does not take is lost: it never delays an observation.
    fn send(&self, states: &[NotifyState<'_>]) {
        let message: String = states.iter().map(|state| format!("{state}\n")).collect();
        if let Some((socket, address)) = &self.socket
            && let Err(error) = socket.send_to_addr(message.as_bytes(), address)
        {
            tracing::warn!(%error, "the service manager was not told");
        }
    }
}

fn open(name: &OsStr) -> io::Result<(UnixDatagram, SocketAddr)> {
    let address = match name.as_bytes() {
        [b'/', ..] => SocketAddr::from_pathname(name)?,
        [b'@', name @ ..] => SocketAddr::from_abstract_name(name)?,
        _ => return Err(io::Error::new(io::ErrorKind::Unsupported, "it must start with / or @")),
    };
    let socket = UnixDatagram::unbound()?;
    socket.set_nonblocking(true)?;
    Ok((socket, address))
}
