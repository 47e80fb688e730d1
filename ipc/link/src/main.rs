//! `beo-link`: the channels of a beo daemon on another machine, over zenoh. A client like any other; the daemon knows nothing of it.
//!
//! | file | what |
//! | --- | --- |
//! | `arguments` | the command line |
//! | `keys`, `session` | the keys of an instance; the zenoh session |
//! | `near` | the end beside the daemon |
//! | `far` | the end that plays the daemon |
//! | `clocks` | what lies between the two machines' clocks |
//! | `wire` | messages as they come over the wire, checked |
//! | `trouble` | one line for each kind of trouble |

mod arguments;
mod clocks;
mod far;
mod keys;
mod near;
mod session;
mod trouble;
mod wire;

use arguments::{Arguments, End};
use clap::Parser as _;
use session::LinkError;
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

fn main() -> ExitCode {
    let arguments = Arguments::parse();
    let stop = Arc::new(AtomicBool::new(false));
    let flag = stop.clone();
    if let Err(error) = ctrlc::set_handler(move || flag.store(true, Ordering::Relaxed)) {
        eprintln!("beo-link: cannot listen for signals: {error}");
        return ExitCode::FAILURE;
    }
    let outcome = match &arguments.end {
        End::Near(near) => near::run(near, &stop),
        End::Far(far) => far::run(far, &stop),
    };
    match outcome {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("beo-link: {error}");
            let is_usage = matches!(error, LinkError::NoEndpoint | LinkError::Endpoint(_));
            ExitCode::from(if is_usage { 2 } else { 1 })
        }
    }
}
