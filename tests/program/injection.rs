//! System calls that fail, each in turn: no file that was there is lost, no wrong answer is given, and one line says what failed.
//!
//! A small library is put before the system's (`LD_PRELOAD`), in which the n-th call of a kind on files under a folder fails. It is compiled
//! here; where there is no C compiler, that is said.

use crate::client::{Client, block};
use crate::harness::{PATIENCE, Running, beo, instance, model, serve, serve_with, small_library, text};
use beo_ipc::Percept;
use rustix::process::Signal;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::sync::OnceLock;
use std::sync::mpsc::Receiver;
use std::time::{Duration, Instant};

const LIBRARY: &str = r#"
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/types.h>
#include <unistd.h>

static long count;

static int is_due(const char *call, const char *path) {
    const char *which = getenv("FAULT_CALL"), *folder = getenv("FAULT_FOLDER"), *at = getenv("FAULT_AT"), *mark = getenv("FAULT_MARK");
    if (!which || !folder || !at || !mark || strcmp(which, call) != 0 || strncmp(path, folder, strlen(folder)) != 0) return 0;
    if (__atomic_add_fetch(&count, 1, __ATOMIC_SEQ_CST) != atol(at)) return 0;
    int (*make)(const char *, mode_t) = dlsym(RTLD_NEXT, "creat");
    close(make(mark, 0600));
    return 1;
}

static const char *path_of(int fd, char *path, size_t size) {
    char link[64];
    snprintf(link, sizeof link, "/proc/self/fd/%d", fd);
    ssize_t length = readlink(link, path, size - 1);
    path[length < 0 ? 0 : length] = 0;
    return path;
}

#define FAILS(call, path, error) do { if (is_due(call, path)) { errno = error; return -1; } } while (0)

ssize_t write(int fd, const void *bytes, size_t length) {
    char path[4096];
    FAILS("write", path_of(fd, path, sizeof path), ENOSPC);
    ssize_t (*next)(int, const void *, size_t) = dlsym(RTLD_NEXT, "write");
    return next(fd, bytes, length);
}

ssize_t pread64(int fd, void *bytes, size_t length, off64_t at) {
    char path[4096];
    FAILS("pread64", path_of(fd, path, sizeof path), EIO);
    ssize_t (*next)(int, void *, size_t, off64_t) = dlsym(RTLD_NEXT, "pread64");
    return next(fd, bytes, length, at);
}

int fsync(int fd) {
    char path[4096];
    FAILS("fsync", path_of(fd, path, sizeof path), EIO);
    int (*next)(int) = dlsym(RTLD_NEXT, "fsync");
    return next(fd);
}

void *mmap(void *start, size_t length, int rights, int flags, int fd, off_t at) {
    char path[4096];
    if (fd >= 0 && is_due("mmap", path_of(fd, path, sizeof path))) { errno = ENOMEM; return MAP_FAILED; }
    void *(*next)(void *, size_t, int, int, int, off_t) = dlsym(RTLD_NEXT, "mmap");
    return next(start, length, rights, flags, fd, at);
}

/* Allocations of a page or more, of no file in particular. Not through dlsym, which allocates. */
extern void *__libc_malloc(size_t), *__libc_calloc(size_t, size_t), *__libc_realloc(void *, size_t);

static int has_no_memory(size_t size) {
    const char *folder = size < 4096 ? NULL : getenv("FAULT_FOLDER");
    if (!folder || !is_due("malloc", folder)) return 0;
    errno = ENOMEM;
    return 1;
}

void *malloc(size_t size) { return has_no_memory(size) ? NULL : __libc_malloc(size); }
void *calloc(size_t count, size_t size) { return has_no_memory(count * size) ? NULL : __libc_calloc(count, size); }
void *realloc(void *old, size_t size) { return has_no_memory(size) ? NULL : __libc_realloc(old, size); }

int rename(const char *from, const char *to) {
    FAILS("rename", to, EIO);
    int (*next)(const char *, const char *) = dlsym(RTLD_NEXT, "rename");
    return next(from, to);
}

int open64(const char *path, int flags, ...) {
    FAILS("open64", path, flags & O_CREAT ? ENOSPC : EMFILE);
    va_list rest;
    va_start(rest, flags);
    mode_t mode = va_arg(rest, mode_t);
    va_end(rest);
    int (*next)(const char *, int, ...) = dlsym(RTLD_NEXT, "open64");
    return next(path, flags, mode);
}
"#;

/// The library, compiled once; none where there is no compiler.
fn library_of_faults() -> Option<&'static Path> {
    static LIBRARY_FILE: OnceLock<Option<(tempfile::TempDir, PathBuf)>> = OnceLock::new();
    let made = LIBRARY_FILE.get_or_init(|| {
        let folder = tempfile::tempdir().unwrap();
        let [source, out] = ["faults.c", "faults.so"].map(|name| folder.path().join(name));
        std::fs::write(&source, LIBRARY).unwrap();
        let mut command = Command::new(std::env::var_os("CC").unwrap_or("cc".into()));
        command.args(["-shared", "-fPIC", "-O1", "-o"]).arg(&out).arg(&source).arg("-ldl").stdin(Stdio::null());
        let output = command.output().ok()?;
        assert!(output.status.success(), "{}", text(&output.stderr));
        Some((folder, out))
    });
    if made.is_none() {
        eprintln!("left out: calls that fail need a C compiler");
    }
    made.as_ref().map(|(_, path)| path.as_path())
}

/// Sets up a command so that its n-th `call` on files under `folder` fails; the file `mark` says that it did.
fn failing<'a>(command: &'a mut Command, call: &str, folder: &Path, n: usize, mark: &Path, library: &Path) -> &'a mut Command {
    let _ = std::fs::remove_file(mark);
    command.env("LD_PRELOAD", library).env("FAULT_CALL", call).env("FAULT_FOLDER", folder).env("FAULT_AT", n.to_string());
    command.env("FAULT_MARK", mark)
}

/// Runs `command` with each `call` failing in turn, and hands what came of it to `check`; how many there were.
fn each(call: &str, folder: &Path, command: impl Fn() -> Command, check: impl Fn(usize, &Output)) -> usize {
    let Some(library) = library_of_faults() else { return usize::MAX };
    let marks = tempfile::tempdir().unwrap();
    let mark = marks.path().join("failed");
    for n in 1.. {
        let mut command = command();
        failing(&mut command, call, folder, n, &mark, library);
        let output = command.output().unwrap();
        if !mark.exists() {
            assert!(output.status.success(), "{call}: {}", text(&output.stderr));
            return n - 1;
        }
        check(n, &output);
    }
    unreachable!("a command makes finitely many calls")
}

/// It failed with a message, not by a panic or a signal.
#[track_caller]
fn is_told(call: &str, n: usize, output: &Output) {
    let message = text(&output.stderr);
    assert!(
        output.status.code() == Some(1) && !message.contains("panicked") && !message.is_empty(),
        "{call} {n}: {:?} {message}",
        output.status
    );
}

#[test]
fn a_training_that_cannot_write_leaves_the_model_that_was_there() {
    let folder = tempfile::tempdir().unwrap();
    let shapes = folder.path().join("shapes");
    small_library(&shapes);
    let models = folder.path().join("models");
    std::fs::create_dir(&models).unwrap();
    let out = models.join("a.safetensors");
    std::fs::copy(model(), &out).unwrap();
    let before = std::fs::read(&out).unwrap();
    let train = || {
        let [shapes, out] = [&shapes, &out].map(|path| path.to_str().unwrap());
        beo(["train", shapes, "--out", out, "--resolution", "16", "--most", "2", "--least", "2"])
    };
    for call in ["open64", "write", "fsync", "rename"] {
        let count = each(call, &models, train, |n, output| {
            let is_old = std::fs::read(&out).unwrap() == before;
            // The folder itself is brought to the disk last, when the new file is there.
            if !output.status.success() || is_old {
                is_told(call, n, output);
                assert!(is_old, "{call} {n}: the model before is gone");
            } else {
                beo_core::model::verify(&out).unwrap();
                std::fs::write(&out, &before).unwrap();
            }
            let left: Vec<_> = std::fs::read_dir(&models).unwrap().map(|entry| entry.unwrap().file_name()).collect();
            assert_eq!(left, ["a.safetensors"], "{call} {n}");
        });
        assert!(count > 0, "no {call} was made to fail");
        std::fs::write(&out, &before).unwrap();
    }
}

/// The encoder hands some failing writes on without their cause: a full disk was "Record parse failed".
#[test]
fn a_recording_that_cannot_be_written_says_why_and_leaves_the_one_that_was_there() {
    let (name, folder) = (instance(), tempfile::tempdir().unwrap());
    let _daemon = serve_with(&name, model(), |command| command);
    let out = folder.path().join("a.mcap");
    let record = || beo(["record", out.to_str().unwrap(), "--instance", &name, "--seconds", "0.1"]);
    let partial = |name: &std::ffi::OsStr| name.to_str().unwrap().starts_with("a.mcap.partial");
    for call in ["open64", "write", "fsync", "rename"] {
        std::fs::write(&out, "before").unwrap();
        let count = each(call, folder.path(), record, |n, output| {
            // The folder itself is brought to the disk last, when the recording is there.
            if !output.status.success() {
                is_told(call, n, output);
                let message = text(&output.stderr);
                let is_full = matches!(call, "open64" | "write");
                assert!(!is_full || message.contains("disk is full") || message.contains("No space left"), "{call} {n}: {message}");
                assert_eq!(std::fs::read(&out).unwrap(), b"before", "{call} {n}");
            }
            for entry in std::fs::read_dir(folder.path()).unwrap().map(Result::unwrap).filter(|entry| partial(&entry.file_name())) {
                let content = std::fs::read(entry.path()).unwrap();
                assert!(content.starts_with(b"\x89MCAP0\r\n") || content.is_empty(), "{call} {n}");
                std::fs::remove_file(entry.path()).unwrap();
            }
            std::fs::write(&out, "before").unwrap();
        });
        assert!(count > 0, "no {call} was made to fail");
        assert_ne!(std::fs::read(&out).unwrap(), b"before");
    }
}

#[test]
fn a_model_that_cannot_be_read_gives_no_answer() {
    let folder = tempfile::tempdir().unwrap();
    let file = crate::harness::shape(folder.path(), "chair", 1);
    let models = folder.path().join("models");
    std::fs::create_dir(&models).unwrap();
    let path = models.join("a.safetensors");
    std::fs::copy(model(), &path).unwrap();
    let perceive = || beo(["perceive", file.to_str().unwrap(), "--model", path.to_str().unwrap()]);
    for call in ["open64", "pread64"] {
        let count = each(call, &models, perceive, |n, output| {
            is_told(call, n, output);
            assert!(output.stdout.is_empty(), "{call} {n}: {}", text(&output.stdout));
        });
        assert!(count > 0, "no {call} was made to fail");
    }
}

#[test]
fn a_reload_that_cannot_read_changes_nothing() {
    let Some(faults) = library_of_faults() else { return };
    let folder = tempfile::tempdir().unwrap();
    let models = folder.path().join("models");
    std::fs::create_dir(&models).unwrap();
    let path = models.join("a.safetensors");
    std::fs::copy(model(), &path).unwrap();
    // In the header, among the tensors, and when all is read once more.
    for n in [1, 2, 5, 20] {
        let (name, mark) = (instance(), folder.path().join("failed"));
        let _daemon = serve_with(&name, model(), |command| failing(command, "pread64", &models, n, &mark, faults));
        let client = Client::new(&name);
        let before = client.ask(|_, voxels| block(voxels));
        let reload = || crate::harness::run(["reload", "--instance", &name, "--model", path.to_str().unwrap()]);
        let output = reload();
        assert!(mark.exists());
        is_told("pread64", n, &output);
        let after = client.ask(|_, voxels| block(voxels));
        assert_eq!((after.status, after.posterior, after.model_id), (0, before.posterior, before.model_id));
        assert!(reload().status.success(), "the next is read");
    }
}

/// An allocation that fails ends the program with the allocator's message; the n-th, with n doubled each time, as there are thousands.
fn each_allocation(folder: &Path, command: impl Fn() -> Command, check: impl Fn(usize, &Output)) -> usize {
    let Some(library) = library_of_faults() else { return usize::MAX };
    let marks = tempfile::tempdir().unwrap();
    let mark = marks.path().join("failed");
    let (mut n, mut count) = (1, 0);
    loop {
        let mut command = command();
        failing(&mut command, "malloc", folder, n, &mark, library);
        let output = command.output().unwrap();
        if !mark.exists() {
            assert!(output.status.success(), "malloc: {}", text(&output.stderr));
            return count;
        }
        check(n, &output);
        (n, count) = (2 * n, count + 1);
    }
}

/// It went on without, or it said what it lacked, by itself or by its allocator, which ends it.
#[track_caller]
fn lacks_memory(n: usize, output: &Output) {
    let message = text(&output.stderr);
    let is_told = message.contains("memory") && !message.contains("panicked");
    let is_end = output.status.code() == Some(1) || message.contains("memory allocation of");
    assert!(output.status.success() || is_told && is_end, "allocation {n}: {:?} {message}", output.status);
}

#[test]
fn memory_that_is_not_to_be_had_costs_no_model_and_gives_no_other_answer() {
    let folder = tempfile::tempdir().unwrap();
    let (shapes, models) = (folder.path().join("shapes"), folder.path().join("models"));
    small_library(&shapes);
    std::fs::create_dir(&models).unwrap();
    let out = models.join("a.safetensors");
    std::fs::copy(model(), &out).unwrap();
    let before = std::fs::read(&out).unwrap();
    let file = crate::harness::shape(folder.path(), "chair", 1);
    let perceive = || beo(["perceive", file.to_str().unwrap(), "--model", out.to_str().unwrap(), "--threads", "1", "--json"]);
    let answer = perceive().output().unwrap();
    assert!(answer.status.success(), "{}", text(&answer.stderr));
    let count = each_allocation(&models, perceive, |n, output| {
        lacks_memory(n, output);
        assert!(output.stdout.is_empty() || is_same_answer(&output.stdout, &answer.stdout), "{n}: {}", text(&output.stdout));
    });
    assert!(count > 5, "{count} allocations");
    let train = || {
        let [shapes, out] = [&shapes, &out].map(|path| path.to_str().unwrap());
        beo(["train", shapes, "--out", out, "--resolution", "16", "--most", "2", "--least", "2", "--threads", "1"])
    };
    let count = each_allocation(&models, train, |n, output| {
        lacks_memory(n, output);
        if std::fs::read(&out).unwrap() != before {
            beo_core::model::verify(&out).unwrap();
            assert!(output.status.success(), "allocation {n}: a model from a training that failed");
            std::fs::write(&out, &before).unwrap();
        }
    });
    assert!(count > 5, "{count} allocations");
}

/// But for how long it took.
fn is_same_answer(one: &[u8], other: &[u8]) -> bool {
    let of = |bytes: &[u8]| {
        let answer: serde_json::Value = serde_json::from_slice(bytes).ok()?;
        Some((answer.get("class")?.clone(), answer.get("posterior")?.clone()))
    };
    of(one).is_some() && of(one) == of(other)
}

/// The answer to the block from above. A client that is not heard joins anew, as often as it takes.
fn sooner_or_later(name: &str) -> Percept {
    let start = Instant::now();
    loop {
        let client = Client::new(name);
        let asked = Instant::now();
        while asked.elapsed() < Duration::from_millis(700) {
            let (producer, _) = client.send(|_, voxels| block(voxels));
            client.subscriber.wait(Duration::from_millis(100)).unwrap();
            let mut percepts = std::iter::from_fn(|| client.subscriber.take_percept().unwrap());
            if let Some(percept) = percepts.find(|percept| percept.producer_id == producer) {
                return percept;
            }
        }
        assert!(start.elapsed() < PATIENCE, "no answer");
    }
}

/// Shared memory that cannot be mapped: at its start a daemon ends with a line; afterwards it is a client that is not heard, and the next is.
#[test]
fn a_daemon_that_cannot_map_says_so_or_answers_as_before() {
    let Some(faults) = library_of_faults() else { return };
    let expected = {
        let name = instance();
        let _daemon = serve(&name);
        sooner_or_later(&name).posterior
    };
    let folder = tempfile::tempdir().unwrap();
    let mark = folder.path().join("failed");
    let (mut ended, mut went_on, mut told) = (0, 0, 0);
    for n in 1.. {
        let name = instance();
        let mut command = beo(["serve".as_ref(), "--instance".as_ref(), name.as_ref(), "--model".as_ref(), model().as_os_str()]);
        failing(&mut command, "mmap", Path::new("/dev/shm"), n, &mark, faults);
        let mut daemon = Running::start(command);
        let said = daemon.stdout.as_ref().unwrap().recv_timeout(PATIENCE);
        if said.is_err() {
            let status = daemon.wait();
            let messages: Vec<String> = daemon.stderr.take().iter().flat_map(Receiver::iter).collect();
            assert!(mark.exists(), "{messages:?}");
            assert_eq!(status.code(), Some(1), "mapping {n}: {messages:?}");
            assert!(!messages.is_empty() && messages.iter().all(|line| !line.contains("panicked")), "mapping {n}: {messages:?}");
            ended += 1;
            continue;
        }
        let answered = [(); 2].map(|()| sooner_or_later(&name));
        for percept in answered {
            assert_eq!((percept.status, percept.posterior), (0, expected), "mapping {n}");
        }
        daemon.signal(Signal::TERM);
        assert!(daemon.wait().success(), "mapping {n}");
        let messages: Vec<String> = daemon.stderr.take().iter().flat_map(Receiver::iter).collect();
        told += usize::from(messages.iter().any(|line| line.contains("out of reach")));
        if !mark.exists() {
            break;
        }
        went_on += 1;
    }
    assert!(ended > 0 && went_on > 0 && told > 0, "{ended} ended, {went_on} went on, {told} told of a client out of reach");
}
