//! The command line, one file per subcommand.

#[macro_use]
mod output;

mod align;
mod answers;
mod arguments;
#[cfg(feature = "lab")]
mod bench;
mod camera;
mod connecting;
#[cfg(feature = "lab")]
mod demo;
#[cfg(feature = "lab")]
mod eval;
#[cfg(feature = "lab")]
mod eval_tables;
mod failure;
mod found_models;
mod generate;
mod inspect;
#[cfg(feature = "lab")]
mod leave_one_out;
mod logging;
#[cfg(feature = "record")]
mod narrating;
mod observe;
mod perceive;
mod pictures;
mod progress;
#[cfg(feature = "record")]
mod record;
mod reload;
mod serve;
mod shapes;
mod status;
mod stop;
mod train;
#[cfg(feature = "view")]
mod view;
mod watch;
mod wording;

pub use answers::{as_json, as_text, label, ranking};
pub use serve::Configuration;
pub use status::{StatusForm, status_report};

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

// The help of each is that of its arguments.
#[derive(Subcommand)]
enum Command {
    Train(train::Train),
    Align(align::Align),
    Generate(generate::Generate),
    Inspect(inspect::Inspect),
    Perceive(perceive::Perceive),
    Serve(serve::Serve),
    Status(status::StatusCommand),
    Reload(reload::Reload),
    Observe(observe::Observe),
    Camera(camera::Camera),
    Watch(watch::Watch),
    #[cfg(feature = "record")]
    Record(record::Record),
    #[cfg(feature = "view")]
    View(view::View),
    #[cfg(feature = "lab")]
    Demo(demo::Demo),
    #[cfg(feature = "lab")]
    Eval(eval::Eval),
    #[cfg(feature = "lab")]
    Bench(bench::Bench),
}

/// Prints help, or what is wrong with the arguments: in colours, unless an argument holds what a terminal would obey.
fn print_error(error: &clap::Error) {
    let text = error.render().to_string();
    if error.use_stderr() && text.contains(|c: char| c.is_control() && c != '\n') {
        warn!("{}", text.trim_end());
    } else {
        let _ = error.print();
    }
}

/// Runs the program: exit code 0 done, 1 failed, 2 wrong usage.
pub fn run() -> ExitCode {
    let arguments = match Arguments::try_parse() {
        Ok(arguments) => arguments,
        Err(error) => {
            print_error(&error);
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
        warn!("beo: cannot start {} worker threads: {error}", arguments.threads);
        return ExitCode::FAILURE;
    }
    let outcome = match arguments.command {
        Command::Train(command) => command.run(),
        Command::Align(command) => command.run(),
        Command::Generate(command) => command.run(),
        Command::Inspect(command) => command.run(),
        Command::Perceive(command) => command.run(),
        Command::Serve(command) => command.run(),
        Command::Status(command) => command.run(),
        Command::Reload(command) => command.run(),
        Command::Observe(command) => command.run(),
        Command::Camera(command) => command.run(),
        Command::Watch(command) => command.run(),
        #[cfg(feature = "record")]
        Command::Record(command) => command.run(),
        #[cfg(feature = "view")]
        Command::View(command) => command.run(),
        #[cfg(feature = "lab")]
        Command::Demo(command) => command.run(),
        #[cfg(feature = "lab")]
        Command::Eval(command) => command.run(),
        #[cfg(feature = "lab")]
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
