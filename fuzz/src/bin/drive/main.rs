//! `drive SECONDS [TARGET…]`: hostile input for every target, one process each, without cargo-fuzz and on any toolchain.
//!
//! - `--seed N`: other inputs; the same seed gives the same ones
//! - `--input FILE TARGET`: runs one input, such as one that was kept
//! - `--corpus FOLDER`: writes the seeds to FOLDER/TARGET/, for cargo-fuzz
//!
//! An input that panics, takes more memory than the target's bound, ends the process or takes longer than ten seconds is kept in
//! `artifacts/TARGET/`, and the exit code is 1.

mod attack;
mod memory;

use beo_fuzz::targets::{TARGETS, Target};
use std::path::Path;
use std::process::{Command, ExitCode};

#[global_allocator]
static MEMORY: memory::Counting = memory::Counting;

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let words: Vec<&str> = arguments.iter().map(String::as_str).collect();
    match words[..] {
        ["--corpus", folder] => write_corpus(Path::new(folder)),
        ["--input", file, name] => {
            let Some(target) = find(name) else { return ExitCode::from(2) };
            let data = std::fs::read(file).expect("a readable file");
            attack::once(target, &data)
        }
        ["--attack", name, seconds, seed] => match (find(name), seconds.parse(), seed.parse()) {
            (Some(target), Ok(seconds), Ok(seed)) => attack::run(target, seconds, seed),
            _ => ExitCode::from(2),
        },
        ["--seed", seed, seconds, ref names @ ..] => attack_all(seconds, seed, names),
        [seconds, ref names @ ..] => attack_all(seconds, "0", names),
        [] => {
            eprintln!("usage: drive [--seed N] SECONDS [TARGET…]; see --input FILE TARGET and --corpus FOLDER in the source");
            ExitCode::from(2)
        }
    }
}

fn find(name: &str) -> Option<&'static Target> {
    let found = TARGETS.iter().find(|target| target.name == name);
    if found.is_none() {
        eprintln!("no target `{name}`; there are {}", TARGETS.map(|target| target.name).join(", "));
    }
    found
}

/// Each target in a process of its own: what ends the process is found too.
fn attack_all(seconds: &str, seed: &str, names: &[&str]) -> ExitCode {
    let names = if names.is_empty() { TARGETS.map(|target| target.name).to_vec() } else { names.to_vec() };
    let mut failed = false;
    for name in names {
        let program = std::env::current_exe().expect("the path of this program");
        let status = Command::new(program).args(["--attack", name, seconds, seed]).status().expect("this program starts");
        if !status.success() {
            failed = true;
            if status.code() != Some(1) {
                println!("{name}: FOUND: {status}; the input is {}", attack::current(name).display());
            }
        }
    }
    if failed { ExitCode::FAILURE } else { ExitCode::SUCCESS }
}

fn write_corpus(folder: &Path) -> ExitCode {
    for target in &TARGETS {
        let place = folder.join(target.name);
        std::fs::create_dir_all(&place).expect("a writable folder");
        for (number, seed) in (target.seeds)().iter().enumerate() {
            std::fs::write(place.join(format!("seed-{number}")), seed).expect("a writable folder");
        }
    }
    ExitCode::SUCCESS
}
