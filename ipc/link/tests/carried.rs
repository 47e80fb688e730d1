//! Both ends as processes, on loopback: what clients of one instance send is answered by the daemon of another, a stand-in that this test
//! plays itself.
//!
//! The reader in Python is left out, with a line, where `$BEO_PYTHON` (or `python3`) has no module `zenoh`.

use beo_ipc::clock::monotonic_ns;
use beo_ipc::text::to_field;
use beo_ipc::{
    InstanceName, ObservationHeader, Percept, Producer, ReloadError, Server, ServerOptions, Status, Subscriber, SubscriberOptions,
    request_reload, tasks,
};
use std::collections::BTreeMap;
use std::io::{BufRead as _, BufReader, Read, Write};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// No step takes longer on the slowest machine.
const PATIENCE: Duration = Duration::from_secs(120);
const DIMS: [u32; 3] = [12, 13, 14];
const VOXELS: usize = 12 * 13 * 14;

/// A process that is ended when dropped.
struct Running(Child);

impl Running {
    fn link(arguments: &[&str]) -> Self {
        let mut child =
            Command::new(env!("CARGO_BIN_EXE_beo-link")).args(arguments).stdin(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap();
        let mut lines = BufReader::new(child.stderr.take().unwrap()).lines();
        let first = lines.next().unwrap().unwrap();
        assert!(first.contains("end of"), "{first}");
        std::thread::spawn(move || lines.map_while(Result::ok).for_each(|line| eprintln!("{line}")));
        Self(child)
    }

    fn end(&mut self) -> Option<std::process::ExitStatus> {
        let _ = Command::new("kill").args(["-INT", &self.0.id().to_string()]).status();
        let start = Instant::now();
        while start.elapsed() < Duration::from_secs(20) {
            if let Ok(Some(status)) = self.0.try_wait() {
                return Some(status);
            }
            std::thread::sleep(Duration::from_millis(5));
        }
        let _ = self.0.kill();
        let _ = self.0.wait();
        None
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        if matches!(self.0.try_wait(), Ok(None)) {
            self.end();
        }
    }
}

fn name(what: &str) -> InstanceName {
    static COUNT: AtomicU32 = AtomicU32::new(0);
    InstanceName::new(&format!("link-{what}-{}-{}", std::process::id(), COUNT.fetch_add(1, Ordering::Relaxed))).unwrap()
}

/// A port that is free now.
fn free() -> SocketAddr {
    TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap()
}

/// A daemon that answers each observation with the number of its filled voxels, at once.
struct Daemon {
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
    id: u64,
    /// Observations that it took, by producer.
    taken: Arc<Mutex<BTreeMap<u64, Vec<u64>>>>,
}

impl Daemon {
    fn start(instance: &InstanceName) -> Self {
        let server = Server::open(instance, &ServerOptions::new(DIMS)).unwrap();
        let (stop, taken) = (Arc::new(AtomicBool::new(false)), Arc::<Mutex<BTreeMap<u64, Vec<u64>>>>::default());
        let (id, ends, notes) = (server.daemon_id(), stop.clone(), taken.clone());
        let thread = std::thread::spawn(move || {
            let mut beat = Instant::now();
            let mut status =
                Status { dims: DIMS, class_count: 2, heartbeat_interval_ns: 200_000_000, started_ns: monotonic_ns(), ..Status::EMPTY };
            (status.class_names[0], status.class_names[1]) = (to_field("can"), to_field("mug"));
            while !ends.load(Ordering::Relaxed) {
                if Instant::now() >= beat {
                    server.publish_status(&status).unwrap();
                    server.maintain();
                    beat = Instant::now() + Duration::from_millis(200);
                }
                server.wait(Duration::from_millis(20)).unwrap();
                if let Some(call) = server.receive_reload().unwrap() {
                    match call.model() {
                        Ok(Some(path)) if path == Path::new("/models/good") => call.answer(77, None),
                        other => call.answer(76, Some(&format!("cannot serve {other:?}"))),
                    }
                }
                while let Some(observation) = server.receive().unwrap() {
                    let received_ns = monotonic_ns();
                    let header = *observation.header();
                    let voxels = observation.voxels().unwrap();
                    let filled = voxels.iter().filter(|voxel| **voxel == 1).count();
                    notes.lock().unwrap().entry(header.producer_id).or_default().push(header.sequence);
                    if header.tasks & tasks::COMPLETION != 0 {
                        let mut loan = server.loan_completion(&header).unwrap();
                        let (occupancy, deviation) = loan.occupancy_and_deviation_mut();
                        occupancy.copy_from_slice(voxels);
                        deviation.fill(filled as u8);
                        loan.send().unwrap();
                    }
                    let mut percept =
                        Percept { class_index: 1, class_count: 2, detail: filled as u64, received_ns, ..Percept::answering(&header) };
                    percept.posterior[1] = 0.75;
                    status.answered += 1;
                    server.publish(&percept).unwrap();
                }
            }
        });
        Self { stop, thread: Some(thread), id, taken }
    }
}

impl Drop for Daemon {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        let _ = self.thread.take().unwrap().join();
    }
}

/// The clients of the far instance.
struct Clients {
    producer: Producer,
    subscriber: Subscriber,
}

impl Clients {
    fn open(instance: &InstanceName) -> Self {
        let subscriber = Subscriber::open_within(instance, &SubscriberOptions { completion: true }, PATIENCE).unwrap();
        let template = ObservationHeader { object_id: 5, ..ObservationHeader::new(DIMS) };
        Self { producer: Producer::open_within(instance, &template, PATIENCE).unwrap(), subscriber }
    }

    /// Sends an observation with so many filled voxels; its number.
    fn send(&self, filled: usize, tasks: u32) -> u64 {
        let mut loan = self.producer.loan().unwrap();
        loan.voxels_mut().fill(0);
        loan.voxels_mut()[..filled].fill(1);
        loan.header_mut().tasks = tasks;
        loan.send().unwrap().sequence
    }

    /// The next percept; none if none comes in time.
    fn percept(&self, patience: Duration) -> Option<Percept> {
        let start = Instant::now();
        loop {
            if let Some(percept) = self.subscriber.take_percept().unwrap() {
                return Some(percept);
            }
            if start.elapsed() > patience {
                return None;
            }
            self.subscriber.wait(Duration::from_millis(20)).unwrap();
        }
    }

    /// Sends until an answer comes: the link stands.
    fn until_answered(&self) -> Percept {
        let start = Instant::now();
        while start.elapsed() < PATIENCE {
            self.send(1, tasks::CLASS);
            if let Some(percept) = self.percept(Duration::from_millis(200)) {
                while self.percept(Duration::from_millis(300)).is_some() {}
                return percept;
            }
        }
        panic!("no answer came over the link");
    }
}

/// Both ends of a link from the daemon of an instance to another instance.
fn linked(near: &InstanceName, far: &InstanceName) -> [Running; 2] {
    let endpoint = format!("tcp/{}", free());
    let near_end = Running::link(&["near", "--instance", near.as_str(), "--listen", &endpoint]);
    [near_end, Running::link(&["far", "--instance", near.as_str(), "--as", far.as_str(), "--connect", &endpoint])]
}

#[test]
fn ten_thousand_observations_come_back_as_they_went_with_their_numbers_and_stamps() {
    let (near, far) = (name("near"), name("far"));
    let daemon = Daemon::start(&near);
    let ends = linked(&near, &far);
    let clients = Clients::open(&far);
    let first = clients.until_answered();
    assert_eq!((first.daemon_id, first.producer_id, first.object_id), (daemon.id, clients.producer.id(), 5));

    let (before, count) = (clients.producer.sent(), 10_000);
    let (mut answers, mut sum, mut added_ns) = (BTreeMap::new(), 0, Vec::new());
    for n in 0..count {
        let filled = (n % 200) as usize;
        sum += filled as u64;
        clients.send(filled, tasks::CLASS);
        // As many under way as a reader of percepts is late for.
        while clients.producer.sent() - before - answers.len() as u64 >= 8 {
            let percept = clients.percept(PATIENCE).expect("an answer");
            let now_ns = monotonic_ns();
            let stamps = [percept.capture_ns, percept.written_ns, percept.received_ns, percept.published_ns, now_ns];
            // One machine, so that translated stamps are right but for the stated error, which is less than a round trip.
            assert!(stamps.windows(2).all(|pair| pair[0] <= pair[1] + 20_000_000), "{stamps:?}");
            added_ns.push(now_ns.saturating_sub(percept.written_ns));
            answers.insert(percept.sequence, percept.detail);
        }
    }
    while answers.len() < count as usize {
        let percept = clients.percept(PATIENCE).expect("an answer");
        answers.insert(percept.sequence, percept.detail);
    }
    assert_eq!(answers.keys().copied().collect::<Vec<_>>(), (before + 1..=before + count).collect::<Vec<_>>());
    assert_eq!(answers.values().sum::<u64>(), sum);
    let taken = daemon.taken.lock().unwrap()[&clients.producer.id()].clone();
    assert_eq!(taken, (1..=before + count).collect::<Vec<_>>(), "each once, in order, under its producer's number");
    added_ns.sort_unstable();
    let at = |share: f64| added_ns[(share * (added_ns.len() - 1) as f64) as usize] as f64 / 1e6;
    eprintln!("there and back with 8 under way, ms: p50 {:.3}, p99 {:.3}", at(0.5), at(0.99));
    let mut alone: Vec<u64> = (0..300)
        .map(|_| {
            clients.send(3, tasks::CLASS);
            let percept = clients.percept(PATIENCE).expect("an answer");
            monotonic_ns().saturating_sub(percept.written_ns)
        })
        .collect();
    alone.sort_unstable();
    eprintln!("there and back alone, ms: p50 {:.3}, p99 {:.3}", alone[150] as f64 / 1e6, alone[297] as f64 / 1e6);

    // A completion comes with its percept, whole.
    let sequence = clients.send(77, tasks::ALL);
    let percept = clients.percept(PATIENCE).expect("an answer");
    let completion = clients.subscriber.take_completion().unwrap().expect("before its percept");
    assert_eq!((percept.sequence, completion.header().sequence, completion.header().daemon_id), (sequence, sequence, daemon.id));
    assert_eq!(completion.occupancy().iter().filter(|voxel| **voxel == 1).count(), 77);
    assert!(completion.deviation().iter().all(|voxel| *voxel == 77) && completion.occupancy().len() == VOXELS);
    let status = clients.subscriber.status().unwrap().unwrap();
    assert_eq!((status.daemon_id, status.class_names().collect::<Vec<_>>()), (daemon.id, vec!["can", "mug"]));
    for mut end in ends {
        assert!(end.end().is_some_and(|status| status.success()));
    }
}

/// A wire between the ends that can be cut.
struct Wire {
    address: SocketAddr,
    is_cut: Arc<AtomicBool>,
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Wire {
    fn to(target: SocketAddr) -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        listener.set_nonblocking(true).unwrap();
        let address = listener.local_addr().unwrap();
        let (is_cut, stop) = (Arc::new(AtomicBool::new(false)), Arc::new(AtomicBool::new(false)));
        let (cut, ends) = (is_cut.clone(), stop.clone());
        let thread = std::thread::spawn(move || {
            let mut strands: Vec<JoinHandle<()>> = Vec::new();
            while !ends.load(Ordering::Relaxed) {
                let Ok((one, _)) = listener.accept() else {
                    std::thread::sleep(Duration::from_millis(5));
                    continue;
                };
                let Some(other) = (!cut.load(Ordering::Relaxed)).then(|| TcpStream::connect(target).ok()).flatten() else { continue };
                for (from, to) in [(one.try_clone().unwrap(), other.try_clone().unwrap()), (other, one)] {
                    let (cut, ends) = (cut.clone(), ends.clone());
                    strands
                        .push(std::thread::spawn(move || strand(from, to, || cut.load(Ordering::Relaxed) || ends.load(Ordering::Relaxed))));
                }
            }
            strands.into_iter().for_each(|strand| drop(strand.join()));
        });
        Self { address, is_cut, stop, thread: Some(thread) }
    }
}

impl Drop for Wire {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        let _ = self.thread.take().unwrap().join();
    }
}

/// Copies until either side or the wire is gone.
fn strand(mut from: TcpStream, mut to: TcpStream, is_cut: impl Fn() -> bool) {
    from.set_nonblocking(false).unwrap();
    to.set_nonblocking(false).unwrap();
    from.set_read_timeout(Some(Duration::from_millis(20))).unwrap();
    let mut buffer = [0; 65_536];
    while !is_cut() {
        match from.read(&mut buffer) {
            Ok(0) => break,
            Ok(count) => {
                if to.write_all(&buffer[..count]).is_err() {
                    break;
                }
            }
            Err(error) if matches!(error.kind(), std::io::ErrorKind::WouldBlock | std::io::ErrorKind::TimedOut) => {}
            Err(_) => break,
        }
    }
    let _ = from.shutdown(std::net::Shutdown::Both);
    let _ = to.shutdown(std::net::Shutdown::Both);
}

fn until(what: &str, mut is_so: impl FnMut() -> bool) {
    let start = Instant::now();
    while !is_so() {
        assert!(start.elapsed() < PATIENCE, "{what}");
        std::thread::sleep(Duration::from_millis(20));
    }
}

#[test]
fn a_link_that_was_cut_and_a_daemon_that_was_restarted_are_as_they_were_before() {
    let (near, far, address) = (name("near"), name("far"), free());
    let wire = Wire::to(address);
    let daemon = Daemon::start(&near);
    let _near_end = Running::link(&["near", "--instance", near.as_str(), "--listen", &format!("tcp/{address}")]);
    let far_address = format!("tcp/{}", wire.address);
    let _far_end = Running::link(&["far", "--instance", near.as_str(), "--as", far.as_str(), "--connect", &far_address]);
    let clients = Clients::open(&far);
    let first = clients.until_answered();

    wire.is_cut.store(true, Ordering::Relaxed);
    until("the daemon is gone for the far clients", || !clients.subscriber.daemon_runs());
    wire.is_cut.store(false, Ordering::Relaxed);
    drop(clients);
    let clients = Clients::open(&far);
    let again = clients.until_answered();
    assert_eq!((again.daemon_id, again.producer_id), (first.daemon_id, clients.producer.id()));

    drop(daemon);
    until("the daemon is gone for the far clients", || !clients.subscriber.daemon_runs());
    drop(clients);
    let daemon = Daemon::start(&near);
    let clients = Clients::open(&far);
    assert_eq!(clients.until_answered().daemon_id, daemon.id);
}

#[test]
fn a_call_for_another_model_is_answered_by_the_daemon_of_the_other_machine() {
    let (near, far) = (name("near"), name("far"));
    let daemon = Daemon::start(&near);
    let [mut near_end, _far_end] = linked(&near, &far);
    let clients = Clients::open(&far);
    clients.until_answered();
    let ask = |model: Option<&str>| request_reload(&far, model.map(Path::new), PATIENCE);
    assert_eq!(ask(Some("/models/good")).unwrap(), 77);
    for (model, words) in [(Some("/models/bad"), "cannot serve Ok(Some(\"/models/bad\"))"), (None, "cannot serve Ok(None)")] {
        let error = ask(model).unwrap_err();
        assert!(matches!(&error, ReloadError::Refused(why) if why == words), "{error}");
    }
    // Several at a time are answered one after the other.
    std::thread::scope(|scope| {
        let asked: Vec<_> = (0..3).map(|_| scope.spawn(|| ask(Some("/models/good")))).collect();
        asked.into_iter().for_each(|asked| assert_eq!(asked.join().unwrap().unwrap(), 77));
    });
    // A link that is cut while a call waits: it is told so.
    drop(daemon);
    near_end.end();
    let error = ask(Some("/models/good")).unwrap_err().to_string();
    assert!(["gave no answer", "nothing is heard", "no daemon", "ended"].iter().any(|words| error.contains(words)), "{error}");
}

#[test]
fn a_zenoh_client_in_python_reads_percepts_clock_and_status_by_the_contract() {
    let python = std::env::var("BEO_PYTHON").unwrap_or_else(|_| "python3".into());
    if !Command::new(&python).args(["-c", "import zenoh"]).stderr(Stdio::null()).status().is_ok_and(|status| status.success()) {
        eprintln!("skipped: {python} has no module zenoh (pip install eclipse-zenoh, and set BEO_PYTHON)");
        return;
    }
    let (near, address) = (name("near"), free());
    let endpoint = format!("tcp/{address}");
    let daemon = Daemon::start(&near);
    let _near_end = Running::link(&["near", "--instance", near.as_str(), "--listen", &endpoint]);
    let clients = Clients::open(&near);
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/reader.py");
    let mut command = Command::new(&python);
    command.args([script, &endpoint, near.as_str(), "5", "60"]).env("PYTHONDONTWRITEBYTECODE", "1").stdout(Stdio::piped());
    let mut reader = Running(command.spawn().unwrap());
    let mut lines = BufReader::new(reader.0.stdout.take().unwrap()).lines().map_while(Result::ok);
    assert_eq!(lines.next().as_deref(), Some("ready"));
    let numbers: Vec<u64> = (0..5)
        .map(|_| {
            let number = clients.send(9, tasks::CLASS);
            assert!(clients.percept(PATIENCE).is_some());
            number
        })
        .collect();
    let line = lines.next().unwrap();
    for number in &numbers {
        let percept = format!(
            "{{\"bytes\": 1280, \"producer\": \"{}\", \"object\": 5, \"sequence\": {number}, \"class\": 1, \"p\": 0.75}}",
            clients.producer.id()
        );
        assert!(line.contains(&percept), "{percept}: {line}");
    }
    assert!(line.contains("\"clock_is_between\": true") && line.contains("[\"can\", \"mug\"]"), "{line}");
    drop(daemon);
}

#[test]
fn a_wrong_command_line_and_a_port_in_use_are_one_line() {
    let taken = TcpListener::bind("127.0.0.1:0").unwrap();
    let endpoint = format!("tcp/{}", taken.local_addr().unwrap());
    for (arguments, code, word) in [
        (&["near"][..], 2, "--listen ENDPOINT or --connect ENDPOINT"),
        (&["far", "--connect", "127.0.0.1:7447"], 2, "is no endpoint"),
        (&["near", "--listen", &endpoint], 1, "cannot open tcp/"),
        (&["near", "--listen", "tcp/127.0.0.1:0", "--config", "/nowhere"], 1, "configuration"),
    ] {
        let output = Command::new(env!("CARGO_BIN_EXE_beo-link")).args(arguments).output().unwrap();
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(code), "{arguments:?}: {said}");
        assert!(said.contains(word) && said.trim_end().lines().count() == 1, "{arguments:?}: {said}");
    }
}
