//! Resources that are missing, too small, damaged or another's: one line that says what to do, exit code 1, before anything is lost.
//!
//! Small disks are file systems of a mount namespace, other users are processes without rights: both need root, and without it those
//! tests say that they are left out.

use crate::client::{Client, block};
use crate::harness::{RESOLUTION, instance, library, model, run, serve, serve_with, shape, small_library, text};
use beo_core::model::Metadata;
use beo_shapes::furniture;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rustix::process::{Pid, Resource, Rlimit, prlimit};
use safetensors::SafeTensors;
use std::collections::BTreeMap;
use std::fs::{File, OpenOptions};
use std::os::unix::fs::{FileExt, PermissionsExt};
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

/// Expects one line with all of `parts`, and exit code 1.
#[track_caller]
fn refused(output: &Output, parts: &[&str]) {
    let message = text(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{message}");
    for part in parts {
        assert!(message.contains(part), "`{part}` is not in: {message}");
    }
    assert_eq!(message.trim_end().lines().count(), 1, "{message}");
    assert!(!message.contains("panicked"), "{message}");
}

fn is_root() -> bool {
    rustix::process::geteuid().is_root()
}

/// Runs a script where `$1` is an empty file system of `size`, and `$2` onwards are `arguments`; `None` where that is not allowed.
fn on_small_disk(mounted_on: &Path, size: &str, script: &str, arguments: &[&Path]) -> Option<Output> {
    let script = format!("mount -t tmpfs -o size={size} tmpfs \"$1\" || exit 77; {script}");
    let mut command = Command::new("unshare");
    // Whoever is not root is, in a user namespace of its own, where that is allowed.
    command.arg(if is_root() { "-m" } else { "-Urm" });
    command.args(["sh", "-c", &script, "sh"]).arg(mounted_on).args(arguments).stdin(Stdio::null());
    let is_there = |output: &Output| output.status.code() != Some(77) && !text(&output.stderr).starts_with("unshare:");
    let output = command.output().ok().filter(is_there);
    if output.is_none() {
        eprintln!("left out: a small file system needs `unshare`, and root or user namespaces");
    }
    output
}

/// The program as the user `nobody`; `None` where that is not possible.
fn as_nobody(arguments: &[&str]) -> Option<Output> {
    let program = Path::new(env!("CARGO_BIN_EXE_beo"));
    let others = |path: &Path| path.metadata().is_ok_and(|m| m.permissions().mode() & 0o005 == 0o005);
    let mut command = Command::new("setpriv");
    command.args(["--reuid=65534", "--regid=65534", "--clear-groups"]).arg(program).args(arguments).stdin(Stdio::null());
    let output =
        (is_root() && program.ancestors().filter(|path| *path != Path::new("")).all(others)).then(|| command.output().ok()).flatten();
    if output.is_none() {
        eprintln!("left out: another user needs root, `setpriv`, and a program that others may run");
    }
    output
}

/// A copy of the small model, and the length of its header.
fn copy(folder: &Path) -> (PathBuf, usize, usize) {
    let bytes = std::fs::read(model()).unwrap();
    let path = folder.join("copy.safetensors");
    std::fs::write(&path, &bytes).unwrap();
    (path, 8 + u64::from_le_bytes(bytes[..8].try_into().unwrap()) as usize, bytes.len())
}

/// Flips a bit, tries to load, and flips it back.
fn survives_flip(file: &File, path: &Path, bit: usize) -> bool {
    let mut byte = [0];
    file.read_exact_at(&mut byte, bit as u64 / 8).unwrap();
    file.write_all_at(&[byte[0] ^ 1 << (bit % 8)], bit as u64 / 8).unwrap();
    let is_usable = beo_core::model::load(path).is_ok();
    file.write_all_at(&byte, bit as u64 / 8).unwrap();
    is_usable
}

#[test]
fn every_flipped_bit_of_a_models_header_and_any_of_its_body_is_found() {
    let folder = tempfile::tempdir().unwrap();
    let (path, header, len) = copy(folder.path());
    let file = OpenOptions::new().read(true).write(true).open(&path).unwrap();
    let missed: Vec<usize> = (0..8 * header).filter(|bit| survives_flip(&file, &path, *bit)).collect();
    assert!(missed.is_empty(), "bits {missed:?} of the header's {}", 8 * header);
    let mut random = ChaCha8Rng::seed_from_u64(6);
    let missed: Vec<usize> =
        (0..2000).map(|_| random.random_range(8 * header..8 * len)).filter(|bit| survives_flip(&file, &path, *bit)).collect();
    assert!(missed.is_empty(), "bits {missed:?} of the body");
    assert!(beo_core::model::load(&path).is_ok(), "all were flipped back");
}

/// Writes the small model with other metadata and the checksums that belong to them. Where the size of the grid changes, its body is
/// holes.
fn remade(path: &Path, change: impl FnOnce(&mut Metadata)) {
    remade_with(path, change, |_, _| {});
}

/// The same, with other bytes of its tensors.
fn remade_with(path: &Path, change: impl FnOnce(&mut Metadata), mut spoil: impl FnMut(&str, &mut [u8])) {
    let small = std::fs::read(model()).unwrap();
    let (_, info) = SafeTensors::read_metadata(&small).unwrap();
    let description: serde_json::Value = serde_json::from_str(&info.metadata().as_ref().unwrap()["beo"]).unwrap();
    let mut metadata: Metadata = serde_json::from_value(description["metadata"].clone()).unwrap();
    let mut checksums: BTreeMap<String, u32> = serde_json::from_value(description["checksums"].clone()).unwrap();
    let mut body = small[8 + u64::from_le_bytes(small[..8].try_into().unwrap()) as usize..].to_vec();
    for (name, tensor) in info.tensors() {
        let bytes = &mut body[tensor.data_offsets.0..tensor.data_offsets.1];
        spoil(&name, bytes);
        checksums.insert(name, crc32fast::hash(bytes));
    }
    change(&mut metadata);
    let mut table = BTreeMap::new();
    let mut header = serde_json::Map::new();
    let mut end = 0;
    let mut tensors: Vec<_> = info.tensors().into_iter().collect();
    tensors.sort_by_key(|(_, tensor)| tensor.data_offsets);
    for (name, tensor) in tensors {
        let mut shape = tensor.shape.clone();
        let mut bytes = tensor.data_offsets.1 - tensor.data_offsets.0;
        if name == "basis" {
            bytes = bytes / shape[0] * metadata.dims.voxels();
            shape[0] = metadata.dims.voxels();
        }
        let entry = serde_json::json!({ "dtype": tensor.dtype, "shape": shape, "data_offsets": [end, end + bytes] });
        end += bytes;
        table.insert(name.clone(), (tensor.dtype.to_string(), shape, bytes));
        header.insert(name, entry);
    }
    let checksum = crc32fast::hash(serde_json::to_string(&(&metadata, &checksums, &table)).unwrap().as_bytes());
    let metadata_dims = metadata.dims;
    let [metadata, checksums] = [serde_json::to_string(&metadata), serde_json::to_string(&checksums)].map(Result::unwrap);
    let description = format!("{{\"metadata\":{metadata},\"checksums\":{checksums},\"checksum\":{checksum}}}");
    header.insert("__metadata__".into(), serde_json::json!({ "beo": description }));
    let header = serde_json::to_vec(&header).unwrap();
    let file = File::create(path).unwrap();
    file.write_all_at(&(header.len() as u64).to_le_bytes(), 0).unwrap();
    file.write_all_at(&header, 8).unwrap();
    file.set_len((8 + header.len() + end) as u64).unwrap();
    if metadata_dims == crate::harness::dims() {
        file.write_all_at(&body, (8 + header.len()) as u64).unwrap();
    }
}

#[test]
fn a_model_that_memory_cannot_hold_is_refused_before_it_is_loaded() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("enormous.safetensors");
    remade(&path, |metadata| {
        metadata.dims = beo_core::grid::Dims::cube(64).unwrap();
        metadata.classes.iter_mut().for_each(|class| class.basis_size = 250);
    });
    let name = path.to_str().unwrap();
    let limited = |arguments: &[&str]| {
        let mut command = Command::new("sh");
        command.args(["-c", "ulimit -v 1500000; exec \"$0\" \"$@\"", env!("CARGO_BIN_EXE_beo")]).args(arguments).stdin(Stdio::null());
        command.output().unwrap()
    };
    refused(&limited(&["serve", "--model", name, "--instance", &instance()]), &[name, "MB of memory", "MB left", "--resolution"]);
    refused(&limited(&["perceive", "x.off", "--model", name]), &[name, "MB of memory"]);
}

/// Whatever the limit, the answer or one line: threads that multiply matrices were not counted, and the process was aborted.
#[test]
fn a_limit_of_addresses_gives_an_answer_or_one_line() {
    let folder = tempfile::tempdir().unwrap();
    let file = shape(folder.path(), "chair", 1);
    let mut answered = 0;
    for limit_kb in (60_000..700_000).step_by(40_000) {
        let mut command = Command::new("sh");
        let script = format!("ulimit -v {limit_kb}; exec \"$0\" \"$@\"");
        command.args(["-c", &script, env!("CARGO_BIN_EXE_beo"), "perceive", "--threads", "2"]);
        let output = command.arg(&file).arg("--model").arg(model()).stdin(Stdio::null()).output().unwrap();
        let message = text(&output.stderr);
        match output.status.code() {
            Some(0) => answered += 1,
            Some(1) => assert_eq!(message.trim_end().lines().count(), 1, "{limit_kb} kB: {message}"),
            // Below what the program itself takes, the system's loader says so.
            code => assert!(code == Some(127) && message.contains("shared libraries"), "{limit_kb} kB: {code:?} {message}"),
        }
    }
    assert!(answered > 0, "700 MB are enough");
}

#[test]
fn a_model_that_memory_cannot_hold_beside_the_one_that_serves_is_not_reloaded() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("large.safetensors");
    remade(&path, |metadata| metadata.classes.iter_mut().for_each(|class| class.basis_size = 250));
    let instance = instance();
    let daemon = serve(&instance);
    let size = std::fs::read_to_string(format!("/proc/{}/statm", daemon.id())).unwrap();
    let pages: u64 = size.split_whitespace().next().unwrap().parse().unwrap();
    // Room for the threads that load, not for what they would.
    let limit = Rlimit { current: Some(pages * rustix::param::page_size() as u64 + (30 << 20)), maximum: None };
    prlimit(Pid::from_raw(daemon.id() as i32), Resource::As, limit).unwrap();
    let output = run(["reload", "--instance", &instance, "--model", path.to_str().unwrap()]);
    refused(&output, &["large.safetensors", "MB of memory", "ulimit -v", "goes on"]);
    assert_eq!(Client::new(&instance).ask(|_, voxels| block(voxels)).status, 0);
}

/// Found by fuzzing: a method's blend that weighs the score of another was an index out of bounds at the first query.
#[test]
fn a_calibration_that_weighs_what_is_not_computed_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("remade.safetensors");
    remade(&path, |_| {});
    assert!(beo_core::model::load(&path).is_ok(), "remade as it was");
    let changes: [fn(&mut Metadata); 3] =
        [|m| m.calibration.evidence.hull = 0.4, |m| m.calibration.auto.distance = 1.0, |m| m.calibration.mean.evidence = 1.0];
    for change in changes {
        remade(&path, change);
        refused(&run(["serve", "--model", path.to_str().unwrap()]), &["remade.safetensors", "does not compute"]);
    }
}

/// Each of these was "healthy": a daemon that served it answered every observation with no numbers.
#[test]
fn a_model_that_holds_no_numbers_is_refused_with_the_tensors_name() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("remade.safetensors");
    // NaN and infinity, little-endian, of half, single and double precision.
    let half: [&[u8]; 2] = [&[0x00, 0x7e], &[0x00, 0xfc]];
    let [single, double] = [f32::NAN.to_le_bytes().to_vec(), f64::INFINITY.to_le_bytes().to_vec()];
    let cases: [(&str, &[u8]); 8] = [
        ("basis", half[0]),
        ("basis", half[1]),
        ("class_mean", &single),
        ("class_covariance", &single),
        ("class_directions", &single),
        ("class_variances", &double),
        ("hull_top_mean", &single),
        ("hull_top_covariance", &single),
    ];
    for (tensor, value) in cases {
        let mut found = false;
        remade_with(
            &path,
            |_| {},
            |name, bytes| {
                if name == tensor {
                    bytes[3 * value.len()..4 * value.len()].copy_from_slice(value);
                    found = true;
                }
            },
        );
        assert!(found, "{tensor}");
        let parts = ["remade.safetensors", &format!("tensor `{tensor}`"), "not a number"];
        refused(&run(["serve", "--model", path.to_str().unwrap(), "--instance", &instance()]), &parts);
        refused(&run(["inspect", path.to_str().unwrap()]), &parts);
    }
}

#[test]
fn a_factor_without_a_positive_diagonal_and_another_spelling_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("remade.safetensors");
    // −1 in half precision, in the first place of the first triangle.
    let negative = |name: &str, bytes: &mut [u8]| {
        if name == "view_whitening" {
            bytes[..2].copy_from_slice(&[0x00, 0xbc]);
        }
    };
    remade_with(&path, |_| {}, negative);
    refused(&run(["inspect", path.to_str().unwrap()]), &["tensor `view_whitening`", "diagonal"]);
    // A space where none was written changes no value, and no checksum of values.
    let small = std::fs::read(model()).unwrap();
    let length = u64::from_le_bytes(small[..8].try_into().unwrap()) as usize;
    let text = std::str::from_utf8(&small[8..8 + length]).unwrap();
    let other = text.replacen("{\\\"metadata\\\":", "{ \\\"metadata\\\":", 1);
    assert_eq!(other.len(), text.len() + 1);
    let bytes = [&(other.len() as u64).to_le_bytes(), other.as_bytes(), &small[8 + length..]].concat();
    std::fs::write(&path, bytes).unwrap();
    refused(&run(["inspect", path.to_str().unwrap()]), &["remade.safetensors", "not spelled as it was written"]);
}

/// The sum of the sizes overflowed before they were looked at.
#[test]
fn a_class_with_impossibly_many_components_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("remade.safetensors");
    remade(&path, |metadata| metadata.classes.iter_mut().for_each(|class| class.basis_size = usize::MAX / 2));
    refused(&run(["inspect", path.to_str().unwrap()]), &["remade.safetensors", "components"]);
}

/// `cp` of another file over one that is loaded or served: what was read before is still there.
#[test]
fn a_model_that_is_rewritten_in_place_ends_no_daemon() {
    let folder = tempfile::tempdir().unwrap();
    let (served, ..) = copy(folder.path());
    let name = instance();
    let _daemon = serve_with(&name, &served, |command| command);
    let client = Client::new(&name);
    let before = client.ask(|_, voxels| block(voxels));
    let whole = std::fs::read(&served).unwrap();
    let overwrite = |bytes: &[u8]| std::fs::write(&served, bytes).unwrap();
    let reload = || run(["reload", "--instance", &name]);
    for length in [0, 5, whole.len() / 2, whole.len() - 1] {
        overwrite(&whole[..length]);
        assert_eq!(client.ask(|_, voxels| block(voxels)).posterior, before.posterior, "cut to {length}");
        refused(&reload(), &["copy.safetensors", "goes on"]);
    }
    // While it is read: every reload ends one way or the other.
    std::thread::scope(|scope| {
        let reloads = scope.spawn(|| (0..5).for_each(|_| assert!(reload().status.code().is_some_and(|code| code < 2))));
        while !reloads.is_finished() {
            overwrite(&whole);
        }
        reloads.join().unwrap();
    });
    overwrite(&whole);
    assert!(reload().status.success());
    assert_eq!(client.ask(|_, voxels| block(voxels)).posterior, before.posterior);
}

/// Found by fuzzing: a name of a number format with a control character came back in the message.
#[test]
fn a_damaged_models_message_has_no_control_characters() {
    let folder = tempfile::tempdir().unwrap();
    let (path, ..) = copy(folder.path());
    let mut bytes = std::fs::read(&path).unwrap();
    let at = bytes.windows(5).position(|window| window == b"\"F32\"").unwrap();
    bytes[at + 3] = 0x7f;
    std::fs::write(&path, bytes).unwrap();
    let output = run(["inspect", path.to_str().unwrap()]);
    refused(&output, &["copy.safetensors"]);
    assert!(!text(&output.stderr).trim_end().contains(char::is_control), "{:?}", text(&output.stderr));
}

#[test]
fn a_model_that_is_missing_unreadable_or_no_model_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let serve = |path: &str| run(["serve", "--instance", &instance(), "--model", path]);
    refused(&serve("no-such-folder/model.safetensors"), &["no-such-folder/model.safetensors", "No such file"]);
    refused(&serve(folder.path().to_str().unwrap()), &[folder.path().to_str().unwrap(), "not a regular file"]);
    // Whoever opens a pipe that nobody writes to waits for ever.
    let pipe = folder.path().join("pipe");
    rustix::fs::mknodat(rustix::fs::CWD, &pipe, rustix::fs::FileType::Fifo, rustix::fs::Mode::RUSR, 0).unwrap();
    refused(&serve(pipe.to_str().unwrap()), &["pipe", "not a regular file"]);
    let empty = folder.path().join("empty.safetensors");
    File::create(&empty).unwrap();
    refused(&serve(empty.to_str().unwrap()), &["empty.safetensors"]);
    std::fs::set_permissions(&empty, std::fs::Permissions::from_mode(0o600)).unwrap();
    std::fs::set_permissions(folder.path(), std::fs::Permissions::from_mode(0o755)).unwrap();
    if let Some(output) = as_nobody(&["serve", "--instance", &instance(), "--model", empty.to_str().unwrap()]) {
        refused(&output, &["empty.safetensors", "ermission denied"]);
    }
}

#[test]
fn shapes_of_other_dims_than_the_models_are_named_with_both() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("big.binvox");
    let mut bytes = Vec::new();
    let object = furniture::make("chair", beo_core::grid::Dims::cube(RESOLUTION + 4).unwrap(), 1).unwrap();
    beo_shapes::write_binvox(&mut bytes, &object).unwrap();
    std::fs::write(&path, bytes).unwrap();
    let name = path.to_str().unwrap();
    let output = run(["perceive", name, "--model", model().to_str().unwrap()]);
    assert_eq!(output.status.code(), Some(1));
    let message = text(&output.stderr);
    assert!(message.contains("20×20×20") && message.contains("16×16×16") && message.contains(name), "{message}");
    let instance = instance();
    let _daemon = serve(&instance);
    refused(&run(["observe", name, "--instance", &instance]), &["20×20×20", "16×16×16", name]);
}

#[test]
fn another_users_daemon_is_out_of_reach_and_the_client_is_told_so() {
    let instance = instance();
    let _daemon = serve(&instance);
    let Some(output) = as_nobody(&["watch", "--instance", &instance, "--wait", "0"]) else { return };
    refused(&output, &["user"]);
}

#[test]
fn too_little_shared_memory_is_found_before_it_is_a_bus_error() {
    let daemon = "exec \"$2\" serve --model \"$3\" --instance small-shm";
    let program = Path::new(env!("CARGO_BIN_EXE_beo"));
    let Some(output) = on_small_disk(Path::new("/dev/shm"), "1M", daemon, &[program, model()]) else { return };
    refused(&output, &["/dev/shm", "bytes are needed", "are free", "remount"]);
}

/// Each command ended by signal 7 and without a word where 0 to 16 kB were free.
#[test]
fn commands_beside_a_full_shared_memory_say_so() {
    let folder = tempfile::tempdir().unwrap();
    let file = shape(folder.path(), "chair", 1);
    let script = r#"
        "$2" serve --model "$3" --instance full-shm > "$5/served" & daemon=$!
        until grep -q serving "$5/served"; do sleep 0.05; done
        for left in 0 4 8 12 16 32; do
            rm -f /dev/shm/filler
            free=$(stat -f --format=%a /dev/shm)
            dd if=/dev/zero of=/dev/shm/filler bs=4096 count=$((free - left / 4)) 2> /dev/null
            for command in status "watch --count 1" "observe $4" reload "record $5/a.mcap" "serve --model $3 --poll"; do
                case $command in serve*) name=another ;; *) name=full-shm ;; esac
                "$2" $command --instance $name > "$5/out" 2> "$5/err"
                echo "$? $left kB, $command: $(cat "$5/err")"
            done
        done
        rm -f /dev/shm/filler
        "$2" status --instance full-shm > /dev/null && echo "0 healthy afterwards"
        kill -INT $daemon; wait $daemon; echo "$? daemon"
    "#;
    let program = Path::new(env!("CARGO_BIN_EXE_beo"));
    let Some(output) = on_small_disk(Path::new("/dev/shm"), "16M", script, &[program, model(), &file, folder.path()]) else { return };
    let said = text(&output.stdout);
    let lines: Vec<&str> = said.lines().collect();
    assert_eq!(lines.len(), 6 * 6 + 2, "{said}{}", text(&output.stderr));
    for line in &lines[..36] {
        let is_told = line.contains("/dev/shm") && line.contains("bytes are needed") && line.contains("are free");
        assert!(line.starts_with("1 ") && is_told, "{said}");
    }
    assert_eq!(lines[36..], ["0 healthy afterwards", "0 daemon"], "{said}");
}

#[test]
fn a_training_that_could_not_be_kept_does_not_begin() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::set_permissions(folder.path(), std::fs::Permissions::from_mode(0o755)).unwrap();
    let shapes = folder.path().join("shapes");
    library(&shapes);
    let locked = folder.path().join("locked");
    std::fs::create_dir(&locked).unwrap();
    let out = locked.join("model.safetensors");
    if let Some(output) = as_nobody(&["train", shapes.to_str().unwrap(), "--out", out.to_str().unwrap()]) {
        refused(&output, &["locked/model.safetensors", "ermission denied"]);
    }
    // A file stands where a folder is needed: nobody can write there, not even root.
    let file = shape(folder.path(), "chair", 1);
    let out = file.join("model.safetensors");
    refused(&run(["train", shapes.to_str().unwrap(), "--out", out.to_str().unwrap()]), &["chair-1.binvox"]);
    let train = "exec \"$2\" train \"$3\" --resolution 16 --least 8 --out \"$1/model.safetensors\"";
    let program = Path::new(env!("CARGO_BIN_EXE_beo"));
    let Some(output) = on_small_disk(&locked, "256k", train, &[program, &shapes]) else { return };
    // Before it come the lines about shapes that were left out.
    let message = text(&output.stderr);
    let last = message.trim_end().lines().last().unwrap_or_default();
    assert_eq!(output.status.code(), Some(1), "{message}");
    assert!(last.contains("locked/model.safetensors") && last.contains("does not fit") && last.contains("are free"), "{message}");
}

/// It once deleted `a.partial` beside `a.safetensors`, and a model of that very name.
#[test]
fn a_training_replaces_its_result_and_nothing_else() {
    let folder = tempfile::tempdir().unwrap();
    let shapes = folder.path().join("shapes");
    small_library(&shapes);
    let [out, other] = ["a.safetensors", "a.partial"].map(|name| folder.path().join(name));
    std::fs::write(&other, "a file of someone's").unwrap();
    let train = |out: &Path| {
        run(["train", shapes.to_str().unwrap(), "--resolution", "16", "--most", "2", "--least", "2", "--out", out.to_str().unwrap()])
    };
    let first = train(&out);
    assert!(first.status.success(), "{}", text(&first.stderr));
    assert_eq!(std::fs::read_to_string(&other).unwrap(), "a file of someone's");
    // Two at once, to one name: either's is whole.
    std::thread::scope(|scope| {
        let both = [(); 2].map(|()| scope.spawn(|| train(&other)));
        for training in both {
            assert!(training.join().unwrap().status.success());
        }
    });
    assert_eq!(std::fs::read(&out).unwrap(), std::fs::read(&other).unwrap());
    let left: Vec<_> = std::fs::read_dir(folder.path()).unwrap().map(|entry| entry.unwrap().file_name()).collect();
    assert_eq!(left.len(), 3, "{left:?}");
    // A device is no place for a model, least of all to be replaced by one.
    let output = run(["train", shapes.to_str().unwrap(), "--resolution", "16", "--out", "/dev/null"]);
    assert!(output.status.code() == Some(1) && text(&output.stderr).contains("not a regular file"), "{}", text(&output.stderr));
    assert!(!std::fs::metadata("/dev/null").unwrap().is_file());
}

/// No cut file under a final name, whichever command runs out of room.
#[test]
fn a_full_disk_leaves_no_cut_file() {
    let folder = tempfile::tempdir().unwrap();
    let disk = folder.path().join("disk");
    std::fs::create_dir(&disk).unwrap();
    let program = Path::new(env!("CARGO_BIN_EXE_beo"));
    let file = shape(folder.path(), "chair", 1);
    // 64 kB: a picture has more.
    let scripts = [
        "exec \"$2\" generate furniture --count 300 --resolution 16 --out \"$1/shapes\"",
        "exec \"$2\" perceive \"$3\" --model \"$4\" --png \"$1/p\" --ply \"$1/p\"",
    ];
    for script in scripts {
        let all = format!(
            "{{ {}; }} 2>&1; echo \"exit code $?\"; cd \"$1\"; find . -type f -size 0; find . -name '.*.partial'",
            script.replace("exec ", "")
        );
        let Some(output) = on_small_disk(&disk, "64k", &all, &[program, &file, model()]) else { return };
        let said = text(&output.stdout);
        let (_, left) = said.split_once("exit code 1\n").unwrap_or_else(|| panic!("{said}"));
        assert!(said.contains("No space left") && left.is_empty(), "{said}");
    }
}

#[test]
fn a_configuration_file_that_is_none_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("large.toml");
    std::fs::write(&path, "#".repeat(70_000)).unwrap();
    refused(&run(["serve", "--config", path.to_str().unwrap()]), &["large.toml", "65536 bytes"]);
    refused(&run(["serve", "--config", "/dev/zero"]), &["/dev/zero", "not a regular file"]);
}
