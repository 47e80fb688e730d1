//! A thread of the daemon that removes the empty segments of killed processes, also while the daemon's own threads wait for one.

use std::io;
use std::sync::mpsc::{RecvTimeoutError, Sender, channel};
use std::thread::JoinHandle;
use std::time::Duration;

use crate::orphans;

/// Time between two looks at the names in /dev/shm, each of some tens of microseconds.
const INTERVAL: Duration = Duration::from_millis(250);

/// Sweeps until dropped. With it no process of the machine waits longer for an empty segment than it takes to be taken for an orphan.
///
/// Only the daemon has one: client libraries start no threads and look themselves before they connect (`peers`).
#[derive(Debug)]
pub(crate) struct Sweeper {
    /// `None` once dropped, which ends the thread.
    running: Option<Sender<()>>,
    thread: Option<JoinHandle<()>>,
}

impl Sweeper {
    /// Starts the thread.
    pub fn start(prefix: Vec<u8>) -> io::Result<Self> {
        let (running, ended) = channel();
        let sweep = move || {
            while ended.recv_timeout(INTERVAL) == Err(RecvTimeoutError::Timeout) {
                orphans::remove(&prefix);
            }
        };
        let thread = std::thread::Builder::new().name("beo-sweeper".to_owned()).spawn(sweep)?;
        Ok(Self { running: Some(running), thread: Some(thread) })
    }
}

impl Drop for Sweeper {
    fn drop(&mut self) {
        drop(self.running.take());
        // A panic of the thread was reported by itself.
        drop(self.thread.take().map(JoinHandle::join));
    }
}
