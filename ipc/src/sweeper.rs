//! A thread of the daemon that removes the empty segments of killed processes, also while the daemon's own threads wait for one, and what
//! iceoryx2 forgets of them.

use std::io;
use std::sync::mpsc::{RecvTimeoutError, Sender, channel};
use std::thread::JoinHandle;
use std::time::Duration;

use iceoryx2::prelude::{Config, SemanticString as _};

use crate::orphans;
use crate::remains::Places;

/// Time between two looks at the names in /dev/shm, each of some tens of microseconds.
const INTERVAL: Duration = Duration::from_millis(250);

/// Looks for empty segments for each look for what was forgotten, which blocks nobody.
const LOOKS: usize = 8;

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
    pub fn start(config: &Config) -> io::Result<Self> {
        let (running, ended) = channel();
        let (prefix, places) = (config.global.prefix.as_bytes().to_vec(), Places::of(config));
        let sweep = move || {
            for look in 1_usize.. {
                if ended.recv_timeout(INTERVAL) != Err(RecvTimeoutError::Timeout) {
                    return;
                }
                orphans::remove(&prefix);
                if look.is_multiple_of(LOOKS) {
                    places.remove_forgotten();
                }
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
