//! The command line, one file per subcommand.

mod eval;
mod failure;
mod inspect;
mod perceive;
mod progress;
mod shapes;
mod train;

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
    /// Measure a model by the paper's protocol
    Eval(eval::Eval),
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
        Command::Eval(command) => command.run(),
    };
    match outcome {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            eprintln!("beo: {failure}");
            ExitCode::from(failure.code())
        }
    }
}

/// Log lines go to standard error: warnings, with -v what happens, with -vv everything.
fn start_log(verbose: u8) {
    use tracing_subscriber::filter::LevelFilter;
    let level = match verbose {
        0 => LevelFilter::WARN,
        1 => LevelFilter::INFO,
        _ => LevelFilter::DEBUG,
    };
    let _ = tracing_subscriber::fmt().with_max_level(level).with_writer(std::io::stderr).with_ansi(false).try_init();
}
