//! The work of an operator: status, reload, the service manager, logs, a clean end.

use crate::client::{Client, block, explanation};
use crate::harness::{PATIENCE, Running, beo, instance, model, run, serve, serve_with, text, train};
use beo_ipc::{DaemonState, Percept, PerceptStatus, Status};
use rustix::process::Signal;
use serde_json::Value;
use std::os::linux::net::SocketAddrExt as _;
use std::os::unix::net::{SocketAddr, UnixDatagram};
use std::path::{Path, PathBuf};
use std::process::Output;
use std::sync::OnceLock;
use std::time::{Duration, Instant};

/// A second model for the same grids.
fn other_model() -> &'static Path {
    static MODEL: OnceLock<(tempfile::TempDir, PathBuf)> = OnceLock::new();
    let (_, path) = MODEL.get_or_init(|| {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("other.safetensors");
        train(&path, 4);
        (folder, path)
    });
    path
}

fn status_of(name: &str, format: &[&str]) -> Output {
    run(["status", "--instance", name, "--wait", "10"].iter().chain(format))
}

fn reload(name: &str, model: &Path) -> Output {
    run(["reload".as_ref(), "--instance".as_ref(), name.as_ref(), "--model".as_ref(), model.as_os_str()])
}

/// Takes the percepts that have come.
fn collect(client: &Client, percepts: &mut Vec<Percept>) {
    while let Some(percept) = client.subscriber.take_percept().unwrap() {
        percepts.push(percept);
    }
}

/// Waits for an answer to each of `sent` observations.
fn collect_all(client: &Client, percepts: &mut Vec<Percept>, sent: u64) {
    let start = Instant::now();
    while (percepts.len() as u64) < sent {
        assert!(start.elapsed() < PATIENCE, "{} of {sent} were answered", percepts.len());
        client.subscriber.wait(Duration::from_millis(20)).unwrap();
        collect(client, percepts);
    }
}

#[test]
fn status_is_told_to_people_scripts_and_prometheus() {
    let name = instance();
    let mut daemon = serve(&name);
    let client = Client::new(&name);
    (0..3).for_each(|_| assert_eq!(client.ask(|_, voxels| block(voxels)).status, 0));
    client.ask(|_, voxels| voxels[0] = 3);
    client.status(|status| status.received == 4 && status.latency_count == 3);

    let output = status_of(&name, &[]);
    assert!(output.status.success(), "{}", text(&output.stderr));
    let lines = text(&output.stdout);
    assert!(lines.contains("is healthy") && lines.contains("4 taken = 3 answered + 1 refused + 0 dropped + 0 waiting"), "{lines}");

    let output = status_of(&name, &["--json"]);
    let value: Value = serde_json::from_str(&text(&output.stdout)).unwrap();
    assert_eq!((value["healthy"].as_bool(), value["pid"].as_u64()), (Some(true), Some(u64::from(daemon.id()))));
    assert_eq!(value["observations"]["answered"], 3);
    assert_eq!(value["model"]["name"], "small");
    assert_eq!(value["latency_us"]["count"], 3);
    let latencies = ["p50", "p90", "p99", "p99.9", "max"].map(|p| value["latency_us"][p].as_f64().unwrap());
    assert!(latencies[0] > 0.0 && latencies.is_sorted(), "{latencies:?}");

    let output = status_of(&name, &["--prometheus"]);
    let metrics = text(&output.stdout);
    assert!(metrics.contains(&format!("beo_observations_answered_total{{instance=\"{name}\"}} 3\n")), "{metrics}");
    assert_eq!(run(["status", "--json", "--prometheus"]).status.code(), Some(2));

    // A daemon that does not go on sends no heartbeat. Whoever stops and continues the tests continues it too: then once more.
    let start = Instant::now();
    loop {
        daemon.signal(Signal::STOP);
        let output = run(["status", "--instance", &name]);
        if output.status.code() == Some(1) {
            break;
        }
        assert!(start.elapsed() < PATIENCE, "{}", text(&output.stdout));
    }
    daemon.signal(Signal::CONT);

    daemon.signal(Signal::TERM);
    assert!(daemon.wait().success());
    let output = run(["status", "--instance", &name, "--prometheus"]);
    assert_eq!(output.status.code(), Some(1));
    assert!(text(&output.stdout).ends_with(&format!("beo_up{{instance=\"{name}\"}} 0")), "{}", text(&output.stdout));
    assert!(text(&output.stderr).contains("beo serve"), "{}", text(&output.stderr));
    let output = run(["status", "--instance", &name, "--json"]);
    assert!(output.status.code() == Some(1) && text(&output.stdout).contains("\"running\":false"));
}

#[test]
fn what_a_full_queue_loses_is_counted() {
    let name = instance();
    let daemon = serve(&name);
    let client = Client::new(&name);
    client.ask(|_, voxels| block(voxels));
    daemon.signal(Signal::STOP);
    // One object each: none replaces another once it is taken.
    for object in 0..100 {
        client.send(|header, voxels| {
            header.object_id = object;
            block(voxels);
        });
    }
    daemon.signal(Signal::CONT);
    let status = client.status(|status| status.received + status.overflowed == 101 && status.waiting() == 0);
    assert!(status.overflowed > 0, "{status:?}");
    assert_eq!((status.received, status.dropped, status.refused), (status.answered, 0, 0));
}

#[test]
fn reload_under_load_loses_nothing_and_switches_once() {
    let (name, first, second) = (instance(), model(), other_model());
    let _daemon = serve(&name);
    let client = Client::new(&name);
    let before = client.ask(|_, voxels| block(voxels)).model_id;
    let (mut percepts, mut sent) = (Vec::new(), 0);
    let mut send = |percepts: &mut Vec<Percept>| {
        // Each its own object, and never more than wait at a time.
        sent += 1;
        client.send(|header, voxels| {
            header.object_id = sent;
            block(voxels);
        });
        collect_all(&client, percepts, sent - 5.min(sent));
        sent
    };
    let mut last = 0;
    let reloaded = std::thread::scope(|scope| {
        let reload = scope.spawn(|| reload(&name, second));
        while !reload.is_finished() {
            last = send(&mut percepts);
        }
        (0..20).for_each(|_| last = send(&mut percepts));
        reload.join().unwrap()
    });
    collect_all(&client, &mut percepts, last);
    assert!(reloaded.status.success(), "{}", text(&reloaded.stderr));
    assert!(percepts.iter().all(|percept| percept.status == 0));
    let mut sequences: Vec<u64> = percepts.iter().map(|percept| percept.sequence).collect();
    sequences.sort_unstable();
    // The first observation was answered before.
    assert_eq!(sequences, (2..last + 2).collect::<Vec<_>>());
    let mut models: Vec<u64> = percepts.iter().map(|percept| percept.model_id).collect();
    models.dedup();
    assert!(models.len() == 2 && models[0] == before, "{models:?}");
    assert!(text(&reloaded.stdout).contains(&format!("{:016x}", models[1])));
    let status = client.status(|status| status.model_id == models[1] && status.waiting() == 0 && status.answered > last);
    assert_eq!((status.reloads, status.reloads_refused, status.state), (1, 0, DaemonState::Serving.code()));
    assert_eq!((status.dropped, status.overflowed, status.answered), (0, 0, last + 1));
    assert_eq!(beo_ipc::text::from_field(&status.model_name), "other");
    assert_ne!(first, second);
    // What is read anew is the file that is served now.
    let again = run(["reload", "--instance", &name]);
    assert!(again.status.success() && text(&again.stdout).contains(&format!("{:016x}", models[1])), "{}", text(&again.stderr));
}

#[test]
fn a_model_that_cannot_be_served_is_refused_and_the_one_before_goes_on() {
    let name = instance();
    let folder = tempfile::tempdir().unwrap();
    let served = folder.path().join("served.safetensors");
    std::fs::copy(model(), &served).unwrap();
    let daemon = serve_with(&name, &served, |command| command);
    let client = Client::new(&name);
    let before = client.ask(|_, voxels| block(voxels));

    let mut bytes = std::fs::read(model()).unwrap();
    let middle = bytes.len() / 2;
    bytes[middle] ^= 4;
    let damaged = folder.path().join("damaged.safetensors");
    std::fs::write(&damaged, bytes).unwrap();
    // The shipped model is for larger grids.
    let larger = Path::new(env!("CARGO_MANIFEST_DIR")).join("models/modelnet10.safetensors");
    let absent = folder.path().join("absent.safetensors");
    for (file, reason) in [(&damaged, "checksum"), (&larger, "30×30×30"), (&absent, "absent.safetensors")] {
        let output = reload(&name, file);
        let message = text(&output.stderr);
        assert!(output.status.code() == Some(1) && message.contains(reason) && message.lines().count() == 1, "{message}");
        let line = daemon.message();
        assert!(line.contains("refused") && line.contains(reason), "{line}");
        let percept = client.ask(|_, voxels| block(voxels));
        assert_eq!((percept.status, percept.model_id, percept.posterior), (0, before.model_id, before.posterior));
    }
    client.status(|status| status.reloads_refused == 3 && status.reloads == 0);

    // By signal: the file that is served is read anew, here first damaged, then another model.
    std::fs::rename(&damaged, &served).unwrap();
    daemon.signal(Signal::HUP);
    client.status(|status| status.reloads_refused == 4);
    assert_eq!(client.ask(|_, voxels| block(voxels)).model_id, before.model_id);
    let whole = folder.path().join("whole.safetensors");
    std::fs::copy(other_model(), &whole).unwrap();
    std::fs::rename(&whole, &served).unwrap();
    daemon.signal(Signal::HUP);
    let status = client.status(|status| status.reloads == 1);
    assert_ne!(status.model_id, before.model_id);
    assert_eq!(client.ask(|_, voxels| block(voxels)).model_id, status.model_id);
}

#[test]
fn a_hangup_reloads_and_other_signals_end() {
    for ending in [Signal::INT, Signal::TERM] {
        let name = instance();
        let mut daemon = serve(&name);
        let client = Client::new(&name);
        for reloads in 1..4 {
            daemon.signal(Signal::HUP);
            client.status(|status| status.reloads == reloads && status.state == DaemonState::Serving.code());
            assert_eq!(client.ask(|_, voxels| block(voxels)).status, 0);
        }
        daemon.signal(ending);
        assert_eq!(daemon.wait().code(), Some(0), "{ending:?}");
    }
    // Who has no model to read anew ends with the terminal.
    let name = instance();
    let _daemon = serve(&name);
    let mut watch = Running::start(beo(["watch", "--instance", &name]));
    assert!(watch.message().starts_with("watching"));
    watch.signal(Signal::HUP);
    assert_eq!(watch.wait().code(), Some(0));
}

/// A stand-in for the service manager.
struct Manager(UnixDatagram);

impl Manager {
    /// The next messages, up to the first that holds `wanted`; that one.
    fn told(&self, wanted: &str) -> String {
        let mut buffer = [0; 4096];
        loop {
            let length = match self.0.recv(&mut buffer) {
                Ok(length) => length,
                // Whoever is stopped and goes on while it waits is told so.
                Err(error) if error.kind() == std::io::ErrorKind::Interrupted => continue,
                Err(error) => panic!("nobody said {wanted}: {error}"),
            };
            let message = String::from_utf8(buffer[..length].to_vec()).unwrap();
            if message.lines().any(|line| line.starts_with(wanted)) {
                return message;
            }
        }
    }
}

#[test]
fn the_service_manager_is_told_what_happens() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("notify");
    let in_files = path.to_str().unwrap().to_owned();
    let in_no_file = format!("beo-test-{}", instance());
    let abstract_address = SocketAddr::from_abstract_name(&in_no_file).unwrap();
    let sockets =
        [(in_files, UnixDatagram::bind(&path).unwrap()), (format!("@{in_no_file}"), UnixDatagram::bind_addr(&abstract_address).unwrap())];
    for (variable, socket) in sockets {
        socket.set_read_timeout(Some(PATIENCE)).unwrap();
        let manager = Manager(socket);
        let name = instance();
        let mut daemon = serve_with(&name, model(), |command| command.env("NOTIFY_SOCKET", &variable).env("WATCHDOG_USEC", "100000"));
        let ready = manager.told("READY=1");
        assert!(ready.contains("STATUS=serving small"), "{ready}");
        // The channels are open by then.
        let client = Client::new(&name);
        assert_eq!(client.ask(|_, voxels| block(voxels)).status, 0);
        (0..3).for_each(|_| drop(manager.told("WATCHDOG=1")));
        assert!(manager.told("STATUS=").contains("1 answered"));
        daemon.signal(Signal::HUP);
        assert!(manager.told("RELOADING=1").contains("MONOTONIC_USEC="));
        manager.told("READY=1");
        daemon.signal(Signal::TERM);
        manager.told("STOPPING=1");
        assert!(daemon.wait().success());
    }
}

#[test]
fn a_manager_that_cannot_be_reached_is_no_reason_to_fail() {
    for variable in ["/nonexistent/socket", "vsock:2:1234", "@", ""] {
        let name = instance();
        let _daemon = serve_with(&name, model(), |command| command.env("NOTIFY_SOCKET", variable));
        assert_eq!(Client::new(&name).ask(|_, voxels| block(voxels)).status, 0, "{variable}");
    }
}

#[test]
fn a_flood_of_warnings_is_counted_not_written() {
    const BAD: u64 = 300;
    let name = instance();
    let mut daemon = serve_with(&name, model(), |command| command.args(["--log-format", "json"]));
    let client = Client::new(&name);
    (0..BAD).for_each(|_| assert_eq!(client.ask(|_, voxels| voxels[0] = 9).status, PerceptStatus::BadVoxel.code()));
    daemon.signal(Signal::TERM);
    assert!(daemon.wait().success());
    let lines: Vec<Value> = daemon.stderr.take().unwrap().iter().map(|line| serde_json::from_str(&line).expect(&line)).collect();
    let of = |message: &str| lines.iter().filter(move |line| line["message"] == message).collect::<Vec<_>>();
    let shown = of("an observation was refused");
    assert!(shown.iter().all(|line| line["level"] == "WARN" && line["refusal"].as_str().unwrap().contains("voxel 0 is 9")));
    let left_out: u64 = of("lines of a flood were left out").iter().map(|line| line["left_out"].as_u64().unwrap()).sum();
    assert!(left_out > 0, "{lines:?}");
    assert_eq!(shown.len() as u64 + left_out, BAD);
}

#[test]
fn a_failure_is_a_json_line_too() {
    let output = run(["serve", "--model", "no-such-file", "--log-format", "json"]);
    assert_eq!(output.status.code(), Some(1));
    let line: Value = serde_json::from_str(&text(&output.stderr)).unwrap();
    assert!(line["level"] == "ERROR" && line["message"].as_str().unwrap().contains("no-such-file"), "{line}");
}

/// Whether everything that was taken was answered, refused or dropped.
fn is_accounted_for(status: &Status) -> bool {
    status.received > 0 && status.waiting() == 0
}

/// The last status that a daemon sent before it ended.
fn last_status(client: &Client, daemon: &mut Running) -> Status {
    assert!(daemon.wait().success());
    client.status(is_accounted_for)
}

#[test]
fn on_sigterm_what_waits_is_answered() {
    let name = instance();
    let mut daemon = serve(&name);
    let client = Client::new(&name);
    daemon.signal(Signal::STOP);
    // As many as fit the queue.
    for object in 0..10 {
        client.send(|header, voxels| {
            header.object_id = object;
            block(voxels);
        });
    }
    daemon.signal(Signal::TERM);
    daemon.signal(Signal::CONT);
    let status = last_status(&client, &mut daemon);
    assert_eq!((status.received, status.answered, status.state), (10, 10, DaemonState::Stopping.code()));
    let mut percepts = Vec::new();
    collect(&client, &mut percepts);
    assert_eq!(percepts.len(), 10);
}

/// The outcome of so many observations that waited when the daemon was told to end, and was then stopped, once it had begun to answer
/// them, for longer than it has; with the percepts that are kept for a reader.
fn stopped_while_it_ends(sent: u64) -> (Status, Vec<Percept>) {
    let name = instance();
    // The paper's search takes as long as any: of so many, some wait yet when the first percept is seen.
    let mut daemon = serve_with(&name, model(), |command| command.args(["--method", "paper"]));
    let clients: Vec<Client> = (0..sent.div_ceil(14)).map(|_| Client::new(&name)).collect();
    daemon.signal(Signal::STOP);
    for (object, client) in clients.iter().cycle().take(sent as usize).enumerate() {
        client.send(|header, voxels| {
            (header.object_id, header.pose_search) = (object as u64, beo_ipc::PoseSearch::Yaw.code());
            block(voxels);
        });
    }
    daemon.signal(Signal::TERM);
    daemon.signal(Signal::CONT);
    let (start, mut percepts) = (Instant::now(), Vec::new());
    while percepts.is_empty() {
        assert!(start.elapsed() < PATIENCE, "the daemon answers nothing");
        clients[0].subscriber.wait(Duration::from_millis(20)).unwrap();
        collect(&clients[0], &mut percepts);
    }
    daemon.signal(Signal::STOP);
    std::thread::sleep(Duration::from_secs(1));
    daemon.signal(Signal::CONT);
    let status = last_status(&clients[0], &mut daemon);
    collect(&clients[0], &mut percepts);
    (status, percepts)
}

/// The time that the daemon has runs out while it is stopped, however fast it is.
#[test]
fn on_sigterm_what_there_is_no_time_for_is_refused_and_counted() {
    let (sent, start) = (112, Instant::now());
    let (status, percepts) = loop {
        let (status, percepts) = stopped_while_it_ends(sent);
        assert_eq!((status.received, status.dropped, status.failed), (sent, 0, 0));
        assert!(status.answered > 0, "{status:?}");
        // Whoever is stopped for long between the first percept and the signal comes too late: then once more.
        if status.refused > 0 {
            break (status, percepts);
        }
        assert!(start.elapsed() < PATIENCE, "all were answered before the daemon could be stopped");
    };
    assert_eq!(status.answered + status.refused, sent);
    // The last ones, as many as are kept for a reader.
    let stopped = percepts.iter().filter(|percept| percept.status == PerceptStatus::Stopping.code()).collect::<Vec<_>>();
    assert!(!stopped.is_empty() && stopped.len() as u64 <= status.refused);
    assert!(stopped.iter().all(|percept| explanation(percept).contains("stops")));
}

#[test]
fn a_producer_that_never_pauses_does_not_keep_the_daemon_from_ending() {
    let name = instance();
    let mut daemon = serve(&name);
    let client = Client::new(&name);
    client.ask(|_, voxels| block(voxels));
    std::thread::scope(|scope| {
        let flood = scope.spawn(|| {
            while client.producer.daemon_runs() {
                client.send(|header, voxels| {
                    header.object_id = header.capture_ns;
                    block(voxels);
                });
            }
        });
        client.status(|status| status.received > 500);
        daemon.signal(Signal::TERM);
        assert!(daemon.wait().success());
        flood.join().unwrap();
    });
    let status = client.status(is_accounted_for);
    assert_eq!(status.state, DaemonState::Stopping.code());
}
