//! The installed library, compilers, and what else a machine may have.

use crate::harness::{PATIENCE, Running, text};
use std::collections::BTreeSet;
use std::ffi::OsStr;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::sync::mpsc::Receiver;
use std::sync::{Mutex, OnceLock, PoisonError};

/// The folder of the repository.
pub fn repository() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// Says what is left out and why. Not through `println`, which the test harness keeps to itself.
pub fn skip(what: &str) {
    let _ = writeln!(std::io::stderr(), "skipped: {what}");
}

/// Whether the program can be started here.
pub fn has(program: &str) -> bool {
    Command::new(program).arg("--version").stdin(Stdio::null()).output().is_ok()
}

/// Runs a command to its end, which must come and be a success; its output.
pub fn run(mut command: Command) -> Output {
    command.stdin(Stdio::null());
    let what = format!("{command:?}");
    let mut running = Running::start(command);
    let status = running.wait();
    let all = |stream: Option<Receiver<String>>| stream.into_iter().flatten().collect::<Vec<_>>().join("\n").into_bytes();
    let output = Output { status, stdout: all(running.stdout.take()), stderr: all(running.stderr.take()) };
    assert!(output.status.success(), "{what}\n{}\n{}", text(&output.stdout), text(&output.stderr));
    output
}

/// A folder for what the tests build, kept from run to run.
pub fn scratch(name: &str) -> PathBuf {
    static FOLDER: OnceLock<PathBuf> = OnceLock::new();
    let folder = FOLDER.get_or_init(|| Path::new(env!("CARGO_TARGET_TMPDIR")).join("clients")).join(name);
    std::fs::create_dir_all(&folder).unwrap();
    folder
}

/// Where the library, its headers and its package files are installed.
pub fn prefix() -> &'static Path {
    static PREFIX: OnceLock<PathBuf> = OnceLock::new();
    PREFIX.get_or_init(|| {
        let prefix = scratch("prefix");
        let mut command = Command::new(repository().join("ipc/c/install"));
        command.arg(&prefix).env("BEO_PROFILE", "dev");
        run(command);
        prefix
    })
}

/// A language that the compiler is called for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Language {
    C,
    Cpp,
}

impl Language {
    fn compiler(self) -> Command {
        let (variable, default, standard) = match self {
            Self::C => ("CC", "cc", "-std=c11"),
            Self::Cpp => ("CXX", "c++", "-std=c++17"),
        };
        let mut command = Command::new(std::env::var_os(variable).unwrap_or(default.into()));
        command.args([standard, "-O1", "-g", "-Wall", "-Wextra", "-Wpedantic", "-Werror"]);
        command
    }

    /// Whether its compiler is here: a machine for Rust has one of C, and may have none of C++. Says so if not.
    pub fn is_here(self) -> bool {
        let here = self.compiler().arg("--version").stdin(Stdio::null()).output().is_ok();
        if !here {
            skip(&format!("{self:?}: there is no compiler"));
        }
        here
    }

    /// The source of an example.
    pub fn example(self, name: &str) -> PathBuf {
        repository().join("examples").join(match self {
            Self::C => format!("c/{name}.c"),
            Self::Cpp => format!("cpp/{name}.cpp"),
        })
    }
}

/// Compiles one source against the installed library, all warnings being errors; once per `name`, whoever asks for it.
pub fn compile<S: AsRef<OsStr>>(language: Language, source: &Path, name: &str, flags: impl IntoIterator<Item = S>) -> PathBuf {
    static COMPILED: Mutex<BTreeSet<String>> = Mutex::new(BTreeSet::new());
    let (program, library) = (scratch("bin").join(name), prefix().join("lib"));
    let mut compiled = COMPILED.lock().unwrap_or_else(PoisonError::into_inner);
    if compiled.contains(name) {
        return program;
    }
    let mut command = language.compiler();
    command.arg(source).args(flags).arg("-o").arg(&program);
    command.arg("-I").arg(prefix().join("include")).arg("-L").arg(&library).args(["-lbeo", "-lm", "-pthread"]);
    command.arg(format!("-Wl,-rpath,{}", library.display()));
    run(command);
    compiled.insert(name.to_owned());
    program
}

/// The flags for AddressSanitizer and the undefined-behaviour sanitizer, if the compiler has them.
pub fn sanitizers() -> &'static [&'static str] {
    const FLAGS: [&str; 2] = ["-fsanitize=address,undefined", "-fno-sanitize-recover=all"];
    static HAS: OnceLock<bool> = OnceLock::new();
    let has = *HAS.get_or_init(|| {
        let source = scratch("bin").join("empty.c");
        std::fs::write(&source, "int main(void) { return 0; }\n").unwrap();
        let mut command = Language::C.compiler();
        command.args(FLAGS).arg(&source).arg("-o").arg(scratch("bin").join("empty"));
        let works = command.output().is_ok_and(|output| output.status.success());
        if !works {
            skip("sanitizers: the compiler has none");
        }
        works
    });
    if has { &FLAGS } else { &[] }
}

/// Starts a program with these arguments.
pub fn start<S: AsRef<OsStr>>(program: &Path, arguments: impl IntoIterator<Item = S>) -> Running {
    let mut command = Command::new(program);
    command.args(arguments).stdin(Stdio::null());
    Running::start(command)
}

/// Waits for the end of a program, which must succeed; what it printed since the last look.
pub fn finish(mut running: Running) -> Vec<String> {
    let status = running.wait();
    let rest = |stream: Option<Receiver<String>>| -> Vec<String> { stream.into_iter().flatten().collect() };
    let (lines, messages) = (rest(running.stdout.take()), rest(running.stderr.take()));
    assert!(status.success(), "{status}: {}", messages.join("\n"));
    lines
}

/// Waits for a message of a program.
pub fn await_message(running: &Running, wanted: &str) {
    let messages = running.stderr.as_ref().unwrap();
    while !messages.recv_timeout(PATIENCE).expect("a message before the program ends").contains(wanted) {}
}
