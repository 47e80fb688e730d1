//! The Python examples with the official iceoryx2 wheel, in a virtual environment of their own.

use crate::examples::Examples;
use crate::harness::{RESOLUTION, Running, instance, serve};
use crate::toolchain::{await_message, finish, prefix, repository, scratch, skip};
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
    let start = move |name: &str, arguments: &[&str]| {
        let source = repository().join("examples/python").join(format!("{name}.py"));
        // Without bytecode files beside the sources.
        let mut command = Command::new(python);
        command.arg("-B").arg(source).args(arguments).env("BEO_LIBRARY", prefix().join("lib/libbeo.so.2")).stdin(Stdio::null());
        Running::start(command)
    };
    Some(Examples { language: "Python", start: Box::new(start) })
}

#[test]
fn query_completion_and_pose_are_recorded_for_rerun() {
    let Some(python) = interpreter() else { return };
    let has_rerun = Command::new(python).args(["-c", "import rerun"]).output().is_ok_and(|output| output.status.success());
    if !has_rerun {
        return skip("the recording for Rerun: rerun-sdk is not installed in BEO_CLIENTS_PYTHON");
    }
    let name = instance();
    let _daemon = serve(&name);
    let file = scratch("rerun").join("recording.rrd");
    let _ = std::fs::remove_file(&file);
    let examples = examples().expect("there is Python");
    let recorder = (examples.start)("log_to_rerun", &[&name, "2", file.to_str().unwrap()]);
    await_message(&recorder, "listening");
    finish((examples.start)("camera", &[&name, "2", &RESOLUTION.to_string()]));
    assert_eq!(finish(recorder), ["showed 2 percepts"]);
    let recording = std::fs::read(&file).unwrap();
    for entity in ["sensor/query/seen", "sensor/query/hidden", "sensor/completion/filled", "sensor/pose/0/axes", "class"] {
        assert!(recording.windows(entity.len()).any(|bytes| bytes == entity.as_bytes()), "{entity} is not in the recording");
    }
}
