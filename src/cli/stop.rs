//! Ending on signals with everything cleaned up.

use super::failure::Failure;
use crate::service::Signals;
use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

/// A flag that SIGINT, SIGTERM and SIGHUP (the terminal is gone) set.
pub fn on_signal() -> Result<Arc<AtomicBool>, Failure> {
    let stop = Arc::new(AtomicBool::new(false));
    [SIGINT, SIGTERM, SIGHUP].into_iter().try_for_each(|signal| set(signal, &stop))?;
    Ok(stop)
}

/// What a daemon listens to: SIGINT and SIGTERM end it, SIGHUP reloads its model.
pub fn of_daemon() -> Result<Signals, Failure> {
    let signals = Signals::default();
    [SIGINT, SIGTERM].into_iter().try_for_each(|signal| set(signal, &signals.stop))?;
    set(SIGHUP, &signals.reload)?;
    Ok(signals)
}

fn set(signal: i32, flag: &Arc<AtomicBool>) -> Result<(), Failure> {
    signal_hook::flag::register(signal, flag.clone())
        .map(|_| ())
        .map_err(|error| Failure::Failed(format!("cannot listen for signals: {error}")))
}
