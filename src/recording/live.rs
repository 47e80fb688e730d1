//! The live view: a WebSocket server of Foxglove's protocol, `foxglove.sdk.v1`, as a sink.
//!
//! Each viewer has a queue of its own. Where that is full, because the viewer or the way to it is slow, the oldest messages are dropped:
//! nobody else waits for it. Viewers can read, and nothing more: the server offers no other capability.

use super::topics::{EncodeError, Sink, Times, Topic};
use foxglove::{ChannelBuilder, Context, FoxgloveError, PartialMetadata, RawChannel, WebSocketServerHandle};
use std::io::ErrorKind;
use std::net::Ipv6Addr;
use std::sync::Arc;
use std::sync::mpsc::channel;
use std::time::Duration;

/// Messages that wait for one viewer, at most: those of some seven answers. A surface of 30³ voxels takes some 150 kB.
const BACKLOG: usize = 64;

/// A server that cannot be started.
#[derive(Debug, thiserror::Error)]
pub enum LiveError {
    /// The address cannot be listened on.
    #[error("cannot listen on {address}: {cause}; {advice}")]
    Listen {
        /// Host and port.
        address: String,
        /// The operating system's words.
        cause: std::io::Error,
        /// The remedy.
        advice: &'static str,
    },
    /// The server has another fault.
    #[error("cannot start the server of the live view: {0}")]
    Server(#[from] FoxgloveError),
}

impl LiveError {
    /// Of an address that cannot be listened on.
    pub fn listen(address: String, cause: std::io::Error) -> Self {
        let advice = match cause.kind() {
            ErrorKind::AddrInUse => {
                "another program has this port, perhaps another view: end it, or take another port (0: any that is free)"
            }
            ErrorKind::AddrNotAvailable => "--host must be an address of this machine",
            ErrorKind::PermissionDenied => "ports below 1024 are the administrator's: take a higher one",
            _ => "see --host and --port",
        };
        LiveError::Listen { address, cause, advice }
    }
}

/// The server, with a channel for every topic.
pub struct Live {
    server: WebSocketServerHandle,
    /// In the order of [`Topic::ALL`].
    channels: Vec<Arc<RawChannel>>,
    host: String,
    /// Server and channels find each other by it, and do not keep it.
    _context: Arc<Context>,
}

impl Live {
    /// Listens on a host's port, or on any free one where it is 0; `name` is what viewers call it.
    ///
    /// # Errors
    /// [`LiveError`].
    pub fn start(host: &str, port: u16, name: &str) -> Result<Self, LiveError> {
        // Addresses of version 6 have colons of their own.
        let host = if host.parse::<Ipv6Addr>().is_ok() { format!("[{host}]") } else { host.to_owned() };
        let context = Context::new();
        let channel = |topic: Topic| {
            let builder = ChannelBuilder::new(topic.name()).context(&context);
            builder.message_encoding(topic.encoding()).schema(topic.schema()).build_raw()
        };
        let channels = Topic::ALL.into_iter().map(channel).collect::<Result<_, _>>()?;
        let server = context.websocket_server().name(name).bind(host.clone(), port).message_backlog_size(BACKLOG);
        let server = server.start_blocking().map_err(|error| match error {
            FoxgloveError::Bind(cause) => LiveError::listen(format!("{host}:{port}"), cause),
            error => LiveError::Server(error),
        })?;
        Ok(Self { server, channels, host, _context: context })
    }

    /// The address that viewers connect to.
    pub fn url(&self) -> String {
        format!("ws://{}:{}", self.host, self.port())
    }

    /// The port that it listens on.
    pub fn port(&self) -> u16 {
        self.server.port()
    }

    /// Says goodbye to all viewers, and waits at most so long for those that do not listen.
    pub fn stop(self, patience: Duration) {
        let (done, ended) = channel();
        let stopping = self.server.stop();
        // A viewer that does not read keeps its goodbye from being sent: the process ends without it.
        std::thread::spawn(move || {
            stopping.wait_blocking();
            let _ = done.send(());
        });
        let _ = ended.recv_timeout(patience);
    }
}

impl Sink for Live {
    type Error = EncodeError;

    fn wants(&self, topic: Topic) -> bool {
        self.channels[topic as usize].has_sinks()
    }

    fn write(&mut self, topic: Topic, times: Times, bytes: &[u8]) -> Result<(), EncodeError> {
        self.channels[topic as usize].log_with_meta(bytes, PartialMetadata::with_log_time(times.logged_ns));
        Ok(())
    }
}
