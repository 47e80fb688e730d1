//! Telling the service manager how it goes: the protocol of sd_notify(3), one datagram to the socket that NOTIFY_SOCKET names.

use beo_ipc::clock::monotonic_ns;
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
        let number = |name| env::var(name).ok().and_then(|text| text.parse::<u64>().ok());
        // The manager may mean another process of the service.
        let meant = number("WATCHDOG_PID").is_none_or(|pid| pid == u64::from(std::process::id()));
        let watchdog_ns = number("WATCHDOG_USEC").filter(|us| meant && *us > 0).map(|us| us.saturating_mul(1000) / 2);
        Self { socket, watchdog_ns, last_alive_ns: 0, last_status_ns: 0 }
    }

    /// Observations are answered from now on (again).
    pub fn ready(&mut self, status: &str) {
        self.send(&format!("READY=1\nSTATUS={status}\n"));
        self.last_status_ns = monotonic_ns();
    }

    /// Another model is being loaded.
    pub fn reloading(&self) {
        self.send(&format!("RELOADING=1\nMONOTONIC_USEC={}\n", monotonic_ns() / 1000));
    }

    /// The end has begun.
    pub fn stopping(&self) {
        self.send("STOPPING=1\nSTATUS=stopping\n");
    }

    /// To be called whenever the loop comes round, and only there: a sign of life when one is due, and a line of status now and then.
    pub fn alive(&mut self, status: impl FnOnce() -> String) {
        if self.socket.is_none() {
            return;
        }
        let now = monotonic_ns();
        if self.watchdog_ns.is_some_and(|interval| now.saturating_sub(self.last_alive_ns) >= interval) {
            self.last_alive_ns = now;
            self.send("WATCHDOG=1\n");
        }
        if now.saturating_sub(self.last_status_ns) >= STATUS_NS {
            self.last_status_ns = now;
            self.send(&format!("STATUS={}\n", status()));
        }
    }

    /// What the manager does not take is lost: it never delays an observation.
    fn send(&self, message: &str) {
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
