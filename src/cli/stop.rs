//! Ending on signals with everything cleaned up; and the one that reloads.

use super::failure::Failure;
use crate::service::Signals;
use nix::sys::signal::{SigSet, Signal};
use std::fmt::Display;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// A flag that SIGINT, SIGTERM and SIGHUP (the terminal is gone) set.
pub fn on_signal() -> Result<Arc<AtomicBool>, Failure> {
    let stop = Arc::new(AtomicBool::new(false));
    let flag = stop.clone();
    ctrlc::set_handler(move || flag.store(true, Ordering::Relaxed)).map_err(cannot_listen)?;
    Ok(stop)
}

/// Holds SIGHUP back from this thread and those that it starts: to be called before any is started, if [`of_daemon`] is.
pub fn hold_hangup() -> Result<(), Failure> {
    hangup().thread_block().map_err(cannot_listen)
}

/// The signals of a daemon: SIGINT and SIGTERM end it, SIGHUP reloads its model. `ctrlc` cannot tell them apart, so SIGHUP is held back
/// from its handler ([`hold_hangup`]) and waited for here; one that came before waits. As long as `loading` is set, there is nothing to be
/// cleaned up yet, and the process ends at once.
pub fn of_daemon(loading: Arc<AtomicBool>) -> Result<Signals, Failure> {
    let signals = Signals::default();
    let stop = signals.stop.clone();
    let handle = move || {
        if loading.load(Ordering::Relaxed) {
            warn!("beo: interrupted while loading the model");
            std::process::exit(1);
        }
        stop.store(true, Ordering::Relaxed);
    };
    ctrlc::set_handler(handle).map_err(cannot_listen)?;
    let reload = signals.reload.clone();
    let wait = move || {
        while hangup().wait().is_ok() {
            reload.store(true, Ordering::Relaxed);
        }
    };
    std::thread::Builder::new().name("beo-hangup".into()).spawn(wait).map_err(cannot_listen)?;
    Ok(signals)
}

fn hangup() -> SigSet {
    SigSet::from_iter([Signal::SIGHUP])
}

fn cannot_listen(error: impl Display) -> Failure {
    Failure::Failed(format!("cannot listen for signals: {error}"))
}
