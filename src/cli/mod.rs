//! The command line, one file per subcommand.

#[macro_use]
mod output;

mod bench;
mod demo;
mod eval;
mod failure;
mod inspect;
mod logging;
mod observe;
mod perceive;
mod progress;
mod reload;
mod serve;
mod shapes;
mod status;
mod stop;
mod train;
mod watch;

pub use serve::Configuration;

use clap::{Parser, Subcommand};

use std::process::ExitCode;

/// Bayesian Eigenobjects: class, pose and completed shape of partial voxel grids, served over shared memory.
#[derive(Parser)]
#[command(name = "beo", version, about, max_term_width = 110)]
struct Arguments {
    #[command(subcommand)]
    command: Command,
    /// Worker threads; 0 for one per core
    #[arg(long, global = true, default_value_t = 0, value_name = "N")]
    threads: usize,
    /// Say more in the log; twice for everything
    #[arg(short, long, global = true, action = clap::ArgAction::Count)]
    verbose: u8,
    /// How log lines on standard error are written
    #[arg(long, global = true, value_enum, default_value_t = logging::Format::Text, value_name = "FORMAT")]
    log_format: logging::Format,
}

#[derive(Subcommand)]
enum Command {
    /// Learn a model from a folder of shapes, DIR/<class>/<split>/*
    Train(train::Train),
    /// Show what a model holds
    Inspect(inspect::Inspect),
    /// Answer shapes or partial grids without a daemon
    Perceive(perceive::Perceive),
    /// Answer observations from shared memory until SIGINT or SIGTERM
    Serve(serve::Serve),
    /// Say how the daemon does; exit code 0 if it is healthy, 1 if not
    Status(status::StatusCommand),
    /// Have the daemon serve another model, or read its file anew, without losing an observation
    Reload(reload::Reload),
    /// Write observations of shapes into shared memory, as a camera would
    Observe(observe::Observe),
    /// Print what the daemon perceives
    Watch(watch::Watch),
    /// Start daemon, producer and watcher on made-up furniture, and show what is perceived
    Demo(demo::Demo),
    /// Measure a model by the paper's protocol
    Eval(eval::Eval),
    /// Measure how fast it is
    Bench(bench::Bench),
}

/// Runs the program: exit code 0 done, 1 failed, 2 wrong usage.
pub fn run() -> ExitCode {
    let arguments = match Arguments::try_parse() {
        Ok(arguments) => arguments,
        Err(error) => {
            let _ = error.print();
            return ExitCode::from(if error.use_stderr() { 2 } else { 0 });
        }
    };
    let log = logging::start(arguments.verbose, arguments.log_format);
    if matches!(arguments.command, Command::Serve(_))
        && let Err(failure) = stop::hold_hangup()
    {
        log.failure(&failure);
        return ExitCode::from(failure.code());
    }
    if let Err(error) = rayon::ThreadPoolBuilder::new().num_threads(arguments.threads).build_global() {
        eprintln!("beo: cannot start {} worker threads: {error}", arguments.threads);
        return ExitCode::FAILURE;
    }
    let outcome = match arguments.command {
        Command::Train(command) => command.run(),
        Command::Inspect(command) => command.run(),
        Command::Perceive(command) => command.run(),
        Command::Serve(command) => command.run(),
        Command::Status(command) => command.run(),
        Command::Reload(command) => command.run(),
        Command::Observe(command) => command.run(),
        Command::Watch(command) => command.run(),
        Command::Demo(command) => command.run(),
        Command::Eval(command) => command.run(),
        Command::Bench(command) => command.run(),
    };
    match outcome {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure::Failure::ReaderGone) => ExitCode::SUCCESS,
        Err(failure) => {
            log.failure(&failure);
            ExitCode::from(failure.code())
        }
    }
}
