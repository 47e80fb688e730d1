//! The command line, one file per subcommand.

#[macro_use]
mod output;

mod bench;
mod demo;
mod eval;
mod failure;
mod inspect;
mod observe;
mod perceive;
mod progress;
mod serve;
mod shapes;
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
    start_log(arguments.verbose);
    if let Err(error) = rayon::ThreadPoolBuilder::new().num_threads(arguments.threads).build_global() {
        eprintln!("beo: cannot start {} worker threads: {error}", arguments.threads);
        return ExitCode::FAILURE;
    }
    let outcome = match arguments.command {
        Command::Train(command) => command.run(),
        Command::Inspect(command) => command.run(),
        Command::Perceive(command) => command.run(),
        Command::Serve(command) => command.run(),
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
            eprintln!("beo: {failure}");
            ExitCode::from(failure.code())
        }
    }
}

/// Log lines go to standard error: warnings, with -v what happens, with -vv everything.
fn start_log(verbose: u8) {
    use tracing_subscriber::filter::{LevelFilter, Targets};
    use tracing_subscriber::prelude::*;
    let level = match verbose {
        0 => LevelFilter::WARN,
        1 => LevelFilter::INFO,
        _ => LevelFilter::DEBUG,
    };
    // iceoryx2 warns of what is meant, such as an explicit configuration: only its errors are passed on unless asked for.
    let iceoryx2 = if verbose > 1 { LevelFilter::DEBUG } else { LevelFilter::ERROR };
    let targets = Targets::new().with_default(level).with_target("iceoryx2", iceoryx2).with_target("iceoryx2_bb_loggers", iceoryx2);
    let lines = tracing_subscriber::fmt::layer().with_writer(std::io::stderr).with_ansi(false);
    let _ = tracing_subscriber::registry().with(targets).with(lines).try_init();
}
