//! Answers to wrong usage: one line that says what to do, exit code 1 or 2.

use crate::harness::{RESOLUTION, Running, beo, instance, model, run, shape, text};
use std::path::Path;

/// Runs and expects a failure with this exit code whose message names all of `parts`.
#[track_caller]
fn fails(arguments: &[&str], code: i32, parts: &[&str]) {
    let output = run(arguments);
    let message = text(&output.stderr);
    assert_eq!(output.status.code(), Some(code), "{arguments:?}: {message}");
    for part in parts {
        assert!(message.contains(part), "{arguments:?}: `{part}` is not in: {message}");
    }
    if code == 1 {
        assert_eq!(message.lines().count(), 1, "{message}");
    }
    assert!(!message.contains("panicked"), "{message}");
}

#[test]
fn help_names_every_subcommand() {
    let output = run(["--help"]);
    assert!(output.status.success());
    let commands = [
        "train", "inspect", "perceive", "serve", "status", "reload", "observe", "camera", "watch", "record", "view", "eval", "demo",
        "bench", "generate", "align",
    ];
    for command in commands {
        assert!(text(&output.stdout).contains(command));
        assert!(run([command, "--help"]).status.success());
    }
    assert!(text(&run(["serve", "--help"]).stdout).contains("SIGHUP"));
}

#[test]
fn wrong_usage_is_exit_code_2() {
    fails(&[], 2, &["Usage"]);
    fails(&["dance"], 2, &["dance"]);
    fails(&["eval", "DIR", "--model", "m", "--split", "s", "--method", "magic"], 2, &["magic", "evidence"]);
    fails(&["train", "DIR", "--out", "m", "--resolution", "7"], 2, &["7", "8 to 256"]);
    fails(&["train", "DIR", "--out", "m", "--resolution", "500"], 2, &["500", "8 to 256"]);
    fails(&["train", "DIR", "--out", "m", "--longest", "31"], 2, &["31", "1 to 30"]);
    fails(&["train", "DIR", "--out", "m", "--variance", "0"], 2, &["variance"]);
    fails(&["observe", "f.npy", "--rate", "0"], 2, &["--rate 0"]);
    fails(&["observe", "f.npy", "--rate", "nan"], 2, &["--rate"]);
    fails(&["watch", "--wait=-1"], 2, &["--wait"]);
    fails(&["demo", "--views", "0"], 2, &["--views 0"]);
    fails(&["demo", "--elevation", "90"], 2, &["5 to 85"]);
    fails(&["demo", "--objects", "sofa"], 2, &["sofa", "mug"]);
    fails(&["observe", "f.ply", "--point-clouds"], 2, &["--point-clouds"]);
    fails(&["serve", "--model", "m", "--instance", "a/b"], 2, &["a/b", "use letters"]);
}

/// Where nothing is said, the model that comes with the program is meant: it is for larger grids than this shape.
#[test]
fn the_model_beside_the_program_is_the_default() {
    let folder = tempfile::tempdir().unwrap();
    let file = shape(folder.path(), "chair", 1);
    let output = run(["perceive", file.to_str().unwrap()]);
    let message = text(&output.stderr);
    assert!(output.status.code() == Some(1) && message.contains("16×16×16") && message.contains("30×30×30"), "{message}");
    // Of a program that lies alone, the models that are found are named.
    let alone = folder.path().join("beo");
    std::fs::copy(env!("CARGO_BIN_EXE_beo"), &alone).unwrap();
    let ask = || {
        let output = std::process::Command::new(&alone).args(["serve"]).current_dir(folder.path()).output().unwrap();
        assert_eq!(output.status.code(), Some(2), "{}", text(&output.stderr));
        text(&output.stderr)
    };
    let message = ask();
    assert!(message.contains("--model") && message.contains("beo train"), "{message}");
    std::fs::create_dir(folder.path().join("models")).unwrap();
    std::fs::copy(model(), folder.path().join("models/mine.safetensors")).unwrap();
    let message = ask();
    assert!(message.contains("models/mine.safetensors"), "{message}");
}

/// A name of a file can hold what a terminal obeys: it moved the cursor and cleared the screen.
#[test]
fn names_of_files_do_not_reach_a_terminal_as_commands() {
    let folder = tempfile::tempdir().unwrap();
    let shapes = folder.path().join("shapes");
    std::fs::create_dir_all(shapes.join("chair/train")).unwrap();
    let hostile = shapes.join("chair/train/\u{1b}[2J\u{7}.off");
    std::fs::write(&hostile, "no").unwrap();
    let good = shape(folder.path(), "chair", 1);
    let named = folder.path().join("\u{1b}[31mred.binvox");
    std::fs::copy(&good, &named).unwrap();
    let [hostile, named, shapes] = [&hostile, &named, &shapes].map(|path| path.to_str().unwrap());
    let model = model().to_str().unwrap();
    for arguments in [
        &["perceive", named, "--model", model][..],
        &["perceive", hostile, "--model", model],
        &["inspect", hostile],
        &["train", shapes, "--out", "m"],
        &["perceive", "--\u{1b}[31m"],
        &["serve", "--model", hostile, "--log-format", "json"],
        &["align", shapes, "--out", hostile],
    ] {
        let output = run(arguments);
        let said = text(&output.stdout) + &text(&output.stderr);
        assert!(!said.is_empty() && !said.contains(|c: char| c.is_control() && c != '\n'), "{arguments:?}: {said:?}");
    }
}

/// Ctrl-C ends a command that waits for a daemon; it waited for as long as it had been told.
#[test]
fn whoever_waits_for_a_daemon_can_be_interrupted() {
    let (name, folder) = (instance(), tempfile::tempdir().unwrap());
    let out = folder.path().join("a.mcap");
    let file = shape(folder.path(), "chair", 1);
    let commands =
        [&["watch"][..], &["status"], &["record", out.to_str().unwrap()], &["view", "--port", "0"], &["observe", file.to_str().unwrap()]];
    for arguments in commands {
        let mut waiting = Running::start(beo(arguments.iter().chain(&["--instance", &name, "--wait", "86400"])));
        let start = std::time::Instant::now();
        // Before it listens for signals, the first ends it; later ones must do so too.
        loop {
            std::thread::sleep(std::time::Duration::from_millis(100));
            if waiting.has_ended() {
                break;
            }
            waiting.signal(rustix::process::Signal::INT);
            assert!(start.elapsed() < crate::harness::PATIENCE, "{arguments:?} does not end");
        }
        assert!(!out.exists());
    }
}

#[test]
fn flags_that_cannot_act_are_wrong_usage() {
    let model = model().to_str().unwrap();
    let clouds = ["perceive", "f.ply", "--model", model, "--point-clouds"];
    fails(&clouds, 2, &["--point-clouds"]);
    for (flag, value) in [("--up", Some("y")), ("--longest", Some("9")), ("--close", Some("hull")), ("--resample", None)] {
        let arguments = ["perceive", "f.npy", "--model", model, "--view", "none", flag].into_iter().chain(value);
        fails(&arguments.collect::<Vec<_>>(), 2, &[flag, "--view none"]);
    }
}

#[test]
fn what_cannot_be_done_is_exit_code_1_and_one_line() {
    let name = instance();
    fails(&["watch", "--instance", &name, "--wait", "0"], 1, &[&name, "beo serve"]);
    fails(&["observe", "f.npy", "--instance", &name, "--wait", "0"], 1, &[&name]);
    fails(&["status", "--instance", &name], 1, &[&name, "beo serve"]);
    fails(&["reload", "--instance", &name], 1, &[&name, "beo serve"]);
    fails(&["inspect", "no-such-file"], 1, &["no-such-file"]);
    fails(&["train", "no-such-folder", "--out", "m"], 1, &["no-such-folder"]);
    fails(&["demo", "--model", "no-such-file"], 1, &["no-such-file"]);
}

#[test]
fn a_damaged_model_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let good = std::fs::read(model()).unwrap();
    let path = folder.path().join("bad.safetensors");
    let path_text = path.to_str().unwrap();
    let header_len = u64::from_le_bytes(good[..8].try_into().unwrap()) as usize;
    // Spread over the length, the header, the table of tensors and the body.
    let places = [0, 3, 8, 9, header_len / 2, header_len + 7, header_len + 8, (header_len + good.len()) / 2, good.len() - 1];
    for place in places {
        let mut bad = good.clone();
        bad[place] ^= 1 << (place % 8);
        std::fs::write(&path, &bad).unwrap();
        fails(&["inspect", path_text], 1, &["bad.safetensors"]);
    }
    for length in [0, 7, 8, header_len, good.len() - 1] {
        std::fs::write(&path, &good[..length]).unwrap();
        fails(&["inspect", path_text], 1, &["bad.safetensors"]);
    }
    std::fs::write(&path, &good).unwrap();
    assert!(run(["inspect", "--verify", path_text]).status.success());
}

#[test]
fn perceive_answers_what_it_can_and_names_what_it_cannot() {
    let folder = tempfile::tempdir().unwrap();
    let chair = shape(folder.path(), "chair", 500);
    let bad = folder.path().join("bad.off");
    std::fs::write(&bad, "OFF 3 1").unwrap();
    let model = model().to_str().unwrap();
    let output = run(["perceive", chair.to_str().unwrap(), bad.to_str().unwrap(), chair.to_str().unwrap(), "--model", model]);
    assert_eq!(output.status.code(), Some(1));
    assert_eq!(text(&output.stdout).lines().count(), 2);
    assert!(text(&output.stderr).contains("bad.off"), "{}", text(&output.stderr));
}

#[test]
fn a_reader_that_goes_away_ends_the_command_quietly() {
    let folder = tempfile::tempdir().unwrap();
    let chair = shape(folder.path(), "chair", 500);
    let mut command = beo(["perceive".as_ref(), "--model".as_ref(), model().as_os_str()]);
    command.args(std::iter::repeat_n(&chair, 50));
    let mut running = Running::start(command);
    drop(running.stdout.take());
    let status = running.wait();
    let messages: Vec<String> = running.stderr.take().unwrap().iter().collect();
    assert!(status.success() && messages.is_empty(), "{status}: {messages:?}");
}

/// Writes a NumPy file of bytes.
fn npy(path: &Path, shape: [usize; 3], bytes: &[u8]) {
    let mut header = format!("{{'descr': '|u1', 'fortran_order': False, 'shape': ({}, {}, {}), }}", shape[0], shape[1], shape[2]);
    while (header.len() + 11) % 64 != 0 {
        header.push(' ');
    }
    header.push('\n');
    let mut file = b"\x93NUMPY\x01\x00".to_vec();
    file.extend((header.len() as u16).to_le_bytes());
    file.extend(header.as_bytes());
    file.extend(bytes);
    std::fs::write(path, file).unwrap();
}

#[test]
fn grids_of_bytes_are_read_as_they_are() {
    let folder = tempfile::tempdir().unwrap();
    let model = model().to_str().unwrap();
    let n = RESOLUTION;
    let path = folder.path().join("grid.npy");
    let file = path.to_str().unwrap();
    npy(&path, [n; 3], &vec![255; n * n * n]);
    let output = run(["perceive", file, "--view", "none", "--json", "--model", model]);
    let line: serde_json::Value = serde_json::from_str(&text(&output.stdout)).unwrap();
    for p in line["posterior"].as_object().unwrap().values() {
        assert!((p.as_f64().unwrap() - 0.1).abs() < 1e-9, "nothing known: the prior");
    }
    npy(&path, [n, n, n + 1], &vec![255; n * n * (n + 1)]);
    let output = run(["perceive", file, "--view", "none", "--model", model]);
    assert!(text(&output.stderr).contains("16×16×17"), "{}", text(&output.stderr));
    let mut bytes = vec![0; n * n * n];
    bytes[n + 1] = 2;
    npy(&path, [n; 3], &bytes);
    let output = run(["perceive", file, "--view", "none", "--model", model]);
    assert!(text(&output.stderr).contains("(0, 1, 1)"), "{}", text(&output.stderr));
}

#[test]
fn settings_come_from_a_file_and_flags_override_it() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("beo.toml");
    let file = path.to_str().unwrap();
    std::fs::write(&path, "modle = 'x'").unwrap();
    fails(&["serve", "--config", file], 1, &["modle", "known settings"]);
    std::fs::write(&path, "model = 'absent.safetensors'\ninstance = 'a/b'").unwrap();
    fails(&["serve", "--config", file], 1, &["beo.toml", "'/'"]);
    fails(&["serve", "--config", file, "--instance", "fine"], 1, &["absent.safetensors"]);
}
