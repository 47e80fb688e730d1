//! The Python examples with the official iceoryx2 wheel, in a virtual environment of their own.

use crate::examples::Examples;
use crate::toolchain::{repository, scratch, skip, start};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::OnceLock;

/// A Python that has what the examples need: `BEO_CLIENTS_PYTHON`, or one made here. None where PyPI is out of reach.
pub fn interpreter() -> Option<&'static Path> {
    static PYTHON: OnceLock<Option<PathBuf>> = OnceLock::new();
    PYTHON
        .get_or_init(|| {
            let python = match std::env::var_os("BEO_CLIENTS_PYTHON") {
                Some(python) => PathBuf::from(python),
                None => make(),
            };
            let mut command = Command::new(&python);
            command.args(["-c", "import iceoryx2, numpy"]).stdin(Stdio::null());
            let works = command.output().is_ok_and(|output| output.status.success());
            if !works {
                skip("the Python clients: a virtual environment with iceoryx2==0.10.0 and numpy cannot be had here");
            }
            works.then_some(python)
        })
        .as_deref()
}

fn make() -> PathBuf {
    let venv = scratch("venv");
    let python = venv.join("bin/python");
    let run = |program: &Path, arguments: &[&Path]| {
        Command::new(program).args(arguments).stdin(Stdio::null()).output().is_ok_and(|output| output.status.success())
    };
    let requirements = repository().join("examples/python/requirements.txt");
    let _ = run(Path::new("python3"), &["-m".as_ref(), "venv".as_ref(), &venv])
        && run(
            Path::new("timeout"),
            &["300".as_ref(), &python, "-m".as_ref(), "pip".as_ref(), "-q".as_ref(), "install".as_ref(), "-r".as_ref(), &requirements],
        );
    python
}

/// The examples, where Python can run them.
pub fn examples() -> Option<Examples> {
    let python = interpreter()?;
    let start = |name: &str, arguments: &[&str]| {
        let source = repository().join("examples/python").join(format!("{name}.py"));
        let arguments: Vec<_> = arguments.iter().map(|argument| argument.into()).collect();
        // Without bytecode files beside the sources.
        start(python, ["-B".into(), source.into_os_string()].into_iter().chain(arguments))
    };
    Some(Examples { language: "Python", start: Box::new(start) })
}
