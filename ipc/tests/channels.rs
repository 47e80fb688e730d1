//! The channels between real processes and over real shared memory.
//!
//! The other processes are this test binary again, in a role given by the environment (see [`a_role_in_another_process`]). Every test has
//! an instance of its own; children are ended by id; nothing asserts how long something takes, waiting only ends after a while.

mod waiting;

use std::io::{BufRead, BufReader, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdout, Command, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use beo_ipc::{
    Completion, InstanceName, LoanError, ObservationHeader, OpenError, Percept, PerceptStatus, PoseSearch, Producer, Refusal, Server,
    ServerOptions, Status, Subscriber, SubscriberOptions, text,
};
use iceoryx2::prelude::*;
use rustix::process::{Pid, Signal, kill_process};
use waiting::{PATIENCE, eventually};

const DIMS: [u32; 3] = [30; 3];
const WITH_COMPLETION: SubscriberOptions = SubscriberOptions { completion: true };

// -----------------------------------------------------------------------------------------------------------------------------------------
// What the processes agree on

fn voxel(index: usize, sequence: u64) -> u8 {
    [0, 1, 255][(index + sequence as usize) % 3]
}

/// The answer of the stand-in daemon: any function of every voxel will do.
fn answer(header: &ObservationHeader, voxels: &[u8]) -> Percept {
    let mut percept = Percept::answering(header);
    percept.model_id = 77;
    percept.class_count = 3;
    percept.class_index = (voxels.iter().enumerate().map(|(index, &voxel)| index as u64 * u64::from(voxel)).sum::<u64>() % 3) as u32;
    for (class, probability) in [0, 1, 255].into_iter().zip(&mut percept.posterior) {
        *probability = voxels.iter().filter(|&&voxel| voxel == class).count() as f32 / voxels.len() as f32;
    }
    percept.log_score[1] = -3.5;
    percept.hypothesis_count = 1;
    percept.hypotheses[0].rotation_object_to_grid = [0.0, 0.6, 0.0, 0.8];
    percept.hypotheses[0].probability = 0.25;
    percept
}

fn occupancy(voxel: u8) -> u8 {
    voxel / 2
}

fn deviation(voxel: u8) -> u8 {
    255 - voxel
}

fn template() -> ObservationHeader {
    ObservationHeader {
        object_id: 9,
        sensor_stamp_ns: 123,
        voxel_size_m: 0.01,
        position_m: [1.0, -2.0, 3.5],
        orientation: [0.6, 0.0, 0.8, 0.0],
        frame_id: text::to_field("camera"),
        pose_search: PoseSearch::Yaw.code(),
        ..ObservationHeader::new(DIMS)
    }
}

fn status() -> Status {
    let mut status = Status::EMPTY;
    (status.model_id, status.dims, status.class_count) = (77, DIMS, 3);
    for (field, name) in status.class_names.iter_mut().zip(["bed", "chair", "Tür"]) {
        *field = text::to_field(name);
    }
    status
}

/// One round of the stand-in daemon.
fn serve(server: &Server) {
    while let Some(observation) = server.receive().unwrap() {
        match observation.voxels() {
            Ok(voxels) => {
                let mut completion = server.loan_completion(observation.header()).unwrap();
                let (filled, uncertain) = completion.occupancy_and_deviation_mut();
                for (index, &voxel) in voxels.iter().enumerate() {
                    (filled[index], uncertain[index]) = (occupancy(voxel), deviation(voxel));
                }
                completion.header_mut().class_index = 2;
                completion.send().unwrap();
                server.publish(&answer(observation.header(), voxels)).unwrap();
            }
            Err(refusal) => server.publish(&Percept::refusing(observation.header(), &refusal)).unwrap(),
        }
    }
}

fn send(producer: &Producer) -> u64 {
    let mut loan = producer.loan().unwrap();
    let sequence = producer.sent() + 1;
    for (index, byte) in loan.voxels_mut().iter_mut().enumerate() {
        *byte = voxel(index, sequence);
    }
    assert_eq!(loan.send().unwrap().sequence, sequence);
    sequence
}

fn check_percept(percept: &Percept) {
    let voxels: Vec<u8> = (0..27_000).map(|index| voxel(index, percept.sequence)).collect();
    let header = ObservationHeader {
        producer_id: percept.producer_id,
        sequence: percept.sequence,
        capture_ns: percept.capture_ns,
        written_ns: percept.written_ns,
        ..template()
    };
    let Percept { daemon_id, answer_number, published_ns, .. } = *percept;
    assert_eq!(*percept, Percept { daemon_id, answer_number, published_ns, ..answer(&header, &voxels) });
    assert!(percept.daemon_id != 0 && percept.answer_number != 0 && percept.producer_id != 0);
    assert!(0 < percept.capture_ns && percept.capture_ns <= percept.written_ns && percept.written_ns <= percept.published_ns);
}

fn check_completion(completion: &Completion) {
    let header = completion.header();
    assert_eq!((header.model_id, header.object_id, header.class_index, header.dims), (0, 9, 2, DIMS));
    assert_eq!((header.position_m, header.orientation), (template().position_m, template().orientation));
    assert_eq!(text::from_field(&header.frame_id), "camera");
    assert_eq!((completion.occupancy().len(), completion.deviation().len()), (27_000, 27_000));
    for index in 0..27_000 {
        let voxel = voxel(index, header.sequence);
        assert_eq!((completion.occupancy()[index], completion.deviation()[index]), (occupancy(voxel), deviation(voxel)), "{index}");
    }
}

// -----------------------------------------------------------------------------------------------------------------------------------------
// The other processes

/// Not a test by itself: what a child process does.
#[test]
fn a_role_in_another_process() {
    let (Ok(role), Ok(instance)) = (std::env::var("BEO_IPC_TEST_ROLE"), std::env::var("BEO_IPC_TEST_INSTANCE")) else { return };
    let instance = InstanceName::new(&instance).unwrap();
    static STOP: AtomicBool = AtomicBool::new(false);
    // Ends when its parent says so, or is gone.
    std::thread::spawn(|| {
        let _ = std::io::stdin().read_line(&mut String::new());
        STOP.store(true, Ordering::Relaxed);
    });
    let running = || !STOP.load(Ordering::Relaxed);
    match role.as_str() {
        "server" => {
            let server = Server::open(&instance, &ServerOptions::new(DIMS)).unwrap();
            say(format!("serving {}", server.daemon_id()));
            while running() {
                server.wait(Duration::from_millis(20)).unwrap();
                serve(&server);
                server.publish_status(&status()).unwrap();
                server.maintain();
            }
        }
        "producer" => {
            let producer = Producer::open_within(&instance, &template(), PATIENCE).unwrap();
            say(format!("producing {}", producer.id()));
            for _ in 0..3 {
                send(&producer);
            }
            while running() {
                std::thread::sleep(Duration::from_millis(5));
            }
        }
        "subscriber" => {
            let subscriber = Subscriber::open_within(&instance, &WITH_COMPLETION, PATIENCE).unwrap();
            say("subscribed".to_owned());
            while running() {
                subscriber.wait(Duration::from_millis(20)).unwrap();
                while let Some(percept) = subscriber.take_percept().unwrap() {
                    say(format!("percept {}", percept.sequence));
                }
            }
        }
        role => panic!("no role {role}"),
    }
}

fn say(line: String) {
    // Marked, as the test harness prints lines of its own.
    println!("\n@{line}");
    std::io::stdout().flush().unwrap();
}

struct Peer {
    child: Child,
    output: BufReader<ChildStdout>,
}

impl Peer {
    fn start(role: &str, instance: &InstanceName) -> Self {
        let mut child = Command::new(std::env::current_exe().unwrap())
            .args(["--exact", "a_role_in_another_process", "--nocapture"])
            .env("BEO_IPC_TEST_ROLE", role)
            .env("BEO_IPC_TEST_INSTANCE", instance.as_str())
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let output = BufReader::new(child.stdout.take().unwrap());
        Self { child, output }
    }

    /// The rest of the next line that starts with `word`.
    fn hear(&mut self, word: &str) -> String {
        let mut line = String::new();
        loop {
            line.clear();
            assert!(self.output.read_line(&mut line).unwrap() > 0, "the other process ended before it said {word}");
            if let Some(rest) = line.trim_end().strip_prefix('@').and_then(|said| said.strip_prefix(word)) {
                return rest.trim().to_owned();
            }
        }
    }

    fn signal(&self, signal: Signal) {
        kill_process(Pid::from_child(&self.child), signal).unwrap();
    }

    /// Stops the process, and returns when all its threads have stopped.
    fn freeze(&self) {
        self.signal(Signal::STOP);
        let threads = format!("/proc/{}/task", self.child.id());
        eventually("the other process freezes", || {
            let stopped = std::fs::read_dir(&threads).unwrap().all(|thread| {
                let stat = std::fs::read_to_string(thread.unwrap().path().join("stat")).unwrap();
                // After the name in brackets comes the state.
                stat.rsplit_once(") ").is_some_and(|(_, rest)| rest.starts_with('T'))
            });
            stopped.then_some(())
        });
    }

    fn kill(&mut self) {
        self.child.kill().unwrap();
        self.child.wait().unwrap();
    }

    fn stop(mut self) {
        drop(self.child.stdin.take());
        let status = eventually("the other process ends", || self.child.try_wait().unwrap());
        assert!(status.success());
    }
}

impl Drop for Peer {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

fn instance(test: &str) -> InstanceName {
    InstanceName::new(&format!("test-{test}-{}", std::process::id())).unwrap()
}

/// The files of POSIX shared memory that a process has mapped, but for iceoryx2's own tiny management files, which may stay.
fn mapped_segments(pid: u32) -> Vec<PathBuf> {
    let maps = std::fs::read_to_string(format!("/proc/{pid}/maps")).unwrap();
    let mut segments: Vec<PathBuf> = maps
        .lines()
        .filter_map(|line| line.find("/dev/shm/").map(|start| PathBuf::from(&line[start..])))
        .filter(|path| !path.to_string_lossy().contains("global_mgmt"))
        .collect();
    segments.sort();
    segments.dedup();
    segments
}

// -----------------------------------------------------------------------------------------------------------------------------------------
// Tests

#[test]
fn an_observation_comes_back_as_percept_and_completion_across_processes() {
    let instance = instance("round-trip");
    let mut server = Peer::start("server", &instance);
    let daemon_id: u64 = server.hear("serving").parse().unwrap();
    let subscriber = Subscriber::open_within(&instance, &WITH_COMPLETION, PATIENCE).unwrap();
    assert!(subscriber.daemon_runs());
    let mut producer = Peer::start("producer", &instance);
    let producer_id: u64 = producer.hear("producing").parse().unwrap();

    let (mut percepts, mut completions) = (Vec::new(), 0);
    while percepts.len() < 3 {
        eventually("a wake-up", || subscriber.wait(Duration::from_millis(100)).unwrap().then_some(()));
        while let Some(percept) = subscriber.take_percept().unwrap() {
            percepts.push(percept);
        }
        while let Some(completion) = subscriber.take_completion().unwrap() {
            check_completion(&completion);
            assert_eq!((completion.header().daemon_id, completion.header().producer_id), (daemon_id, producer_id));
            completions += 1;
        }
    }
    for (index, percept) in percepts.iter().enumerate() {
        assert_eq!((percept.sequence, percept.producer_id, percept.daemon_id), (index as u64 + 1, producer_id, daemon_id));
        check_percept(percept);
    }
    assert!(completions > 0);

    let status = eventually("a status", || subscriber.status().unwrap());
    assert_eq!((status.daemon_id, status.pid, status.model_id, status.dims), (daemon_id, server.child.id(), 77, DIMS));
    assert_eq!(status.class_names().collect::<Vec<_>>(), ["bed", "chair", "Tür"]);
    assert!(status.heartbeat_ns > 0);
    producer.stop();
    server.stop();
}

#[test]
fn a_late_subscriber_gets_the_last_percept_completion_and_status() {
    let instance = instance("late");
    let mut peer = Peer::start("server", &instance);
    peer.hear("serving");
    let early = Subscriber::open_within(&instance, &SubscriberOptions::default(), PATIENCE).unwrap();
    let producer = Producer::open_within(&instance, &template(), PATIENCE).unwrap();
    for _ in 0..5 {
        let sequence = send(&producer);
        eventually("its percept", || early.take_percept().unwrap().filter(|percept| percept.sequence == sequence));
    }
    assert!(early.take_completion().unwrap().is_none(), "completions were not subscribed to");

    let late = Subscriber::open(&instance, &WITH_COMPLETION).unwrap();
    let percept = eventually("the last percept", || late.take_percept().unwrap());
    assert_eq!(percept.sequence, 5);
    check_percept(&percept);
    assert_eq!(late.take_percept().unwrap(), None);
    let completion = eventually("the last completion", || late.take_completion().unwrap());
    assert_eq!(completion.header().sequence, 5);
    check_completion(&completion);
    eventually("a status", || late.status().unwrap());
    peer.stop();
}

#[test]
fn without_a_daemon_clients_are_told_so_and_can_wait_for_it() {
    let instance = instance("not-running");
    let error = Producer::open(&instance, &template()).unwrap_err();
    assert!(matches!(error, OpenError::NotRunning { .. }) && error.is_retryable(), "{error}");
    let error = Subscriber::open(&instance, &WITH_COMPLETION).unwrap_err();
    assert!(error.to_string().contains(instance.as_str()) && error.to_string().contains("beo serve"), "{error}");
    let error = Subscriber::open_within(&instance, &WITH_COMPLETION, Duration::from_millis(50)).unwrap_err();
    assert!(error.is_retryable(), "{error}");

    let waiting = {
        let instance = instance.clone();
        std::thread::spawn(move || {
            Subscriber::open_within(&instance, &WITH_COMPLETION, PATIENCE).map(|subscriber| subscriber.daemon_runs())
        })
    };
    let server = Server::open(&instance, &ServerOptions::new(DIMS)).unwrap();
    assert!(waiting.join().unwrap().unwrap());
    // A client that holds the services is not a daemon.
    let subscriber = Subscriber::open(&instance, &WITH_COMPLETION).unwrap();
    drop(server);
    assert!(!subscriber.daemon_runs());
    let error = Producer::open(&instance, &template()).unwrap_err();
    assert!(error.is_retryable(), "{error}");
    let error = Subscriber::open(&instance, &WITH_COMPLETION).unwrap_err();
    assert!(error.is_retryable(), "{error}");
}

#[test]
fn a_second_daemon_is_refused_with_the_process_of_the_first() {
    let instance = instance("second");
    let mut peer = Peer::start("server", &instance);
    peer.hear("serving");
    let options = ServerOptions { subscribers: 3, ..ServerOptions::new(DIMS) };
    for options in [options, ServerOptions::new(DIMS)] {
        let error = Server::open(&instance, &options).unwrap_err();
        let OpenError::AlreadyRunning { pid, .. } = &error else { panic!("{error}") };
        assert_eq!(*pid, Some(peer.child.id()));
        assert!(!error.to_string().contains('\n'), "{error}");
    }
    // The first is none the worse, and another instance runs beside it.
    let beside = InstanceName::new(&format!("{instance}-b")).unwrap();
    let server = Server::open(&beside, &ServerOptions::new(DIMS)).unwrap();
    let subscriber = Subscriber::open(&instance, &SubscriberOptions::default()).unwrap();
    let producer = Producer::open(&instance, &template()).unwrap();
    let sequence = send(&producer);
    eventually("its percept", || subscriber.take_percept().unwrap().filter(|percept| percept.sequence == sequence));
    assert!(server.receive().unwrap().is_none());
    peer.stop();
}

#[test]
fn after_a_killed_daemon_another_starts_and_the_clients_go_on() {
    let instance = instance("killed");
    let mut first = Peer::start("server", &instance);
    let first_id: u64 = first.hear("serving").parse().unwrap();
    let subscriber = Subscriber::open_within(&instance, &WITH_COMPLETION, PATIENCE).unwrap();
    let producer = Producer::open_within(&instance, &template(), PATIENCE).unwrap();
    send(&producer);
    let percept = eventually("a percept of the first", || subscriber.take_percept().unwrap());
    assert_eq!(percept.daemon_id, first_id);
    let held = eventually("a completion of the first", || subscriber.take_completion().unwrap());
    first.kill();

    let mut second = Peer::start("server", &instance);
    let second_id: u64 = second.hear("serving").parse().unwrap();
    assert_ne!(first_id, second_id);
    let percept = eventually("a percept of the second", || {
        send(&producer);
        subscriber.take_percept().unwrap()
    });
    assert_eq!(percept.daemon_id, second_id);
    check_percept(&percept);
    // What is held of the dead one stays readable.
    check_completion(&held);
    eventually("a completion of the second", || {
        subscriber.take_completion().unwrap().filter(|completion| completion.header().daemon_id == second_id)
    });
    second.kill();
    subscriber.maintain();
    eventually("the death is noticed", || {
        subscriber.maintain();
        (!subscriber.daemon_runs()).then_some(())
    });
}

#[test]
fn a_frozen_subscriber_delays_nobody() {
    let instance = instance("frozen");
    let server = Server::open(&instance, &ServerOptions::new(DIMS)).unwrap();
    let mut frozen = Peer::start("subscriber", &instance);
    frozen.hear("subscribed");
    let live = Subscriber::open(&instance, &WITH_COMPLETION).unwrap();
    let header = ObservationHeader { producer_id: 1, ..template() };
    let publish = |sequence| {
        let header = ObservationHeader { sequence, ..header };
        let mut completion = server.loan_completion(&header).unwrap();
        completion.occupancy_and_deviation_mut().0.fill(sequence as u8);
        completion.send().unwrap();
        server.publish(&Percept::answering(&header)).unwrap();
    };
    publish(1);
    assert_eq!(frozen.hear("percept"), "1");
    frozen.freeze();
    for sequence in 2..=3000 {
        publish(sequence);
        if sequence % 7 == 0 {
            while live.take_percept().unwrap().is_some() {}
            while live.take_completion().unwrap().is_some() {}
        }
    }
    let mut last = None;
    while let Some(percept) = live.take_percept().unwrap() {
        last = Some(percept.sequence);
    }
    assert_eq!(last, Some(3000));
    // The frozen one holds the newest 32, and reads on when it thaws.
    frozen.signal(Signal::CONT);
    assert_eq!(frozen.hear("percept"), "2969");
    while frozen.hear("percept") != "3000" {}
    frozen.stop();
}

#[test]
fn who_does_not_read_keeps_the_newest() {
    let instance = instance("overflow");
    let server = Server::open(&instance, &ServerOptions::new(DIMS)).unwrap();
    let producer = Producer::open(&instance, &template()).unwrap();
    let other = Producer::open(&instance, &template()).unwrap();
    assert_ne!(producer.id(), other.id());
    for _ in 0..40 {
        send(&producer);
    }
    send(&other);
    let mut received = Vec::new();
    while let Some(observation) = server.receive().unwrap() {
        let voxels = observation.voxels().unwrap();
        assert_eq!(voxels[1234], voxel(1234, observation.header().sequence));
        received.push((observation.header().producer_id, observation.header().sequence));
    }
    // A flood of one does not displace another's.
    let of = |id| received.iter().filter(|(from, _)| *from == id).map(|(_, sequence)| *sequence).collect::<Vec<_>>();
    assert_eq!(of(producer.id()), (25..=40).collect::<Vec<_>>());
    assert_eq!(of(other.id()), [1]);

    let subscriber = Subscriber::open(&instance, &WITH_COMPLETION).unwrap();
    for sequence in 1..=50 {
        let header = ObservationHeader { sequence, ..template() };
        server.loan_completion(&header).unwrap().send().unwrap();
        server.publish(&Percept::answering(&header)).unwrap();
    }
    let mut percepts = Vec::new();
    while let Some(percept) = subscriber.take_percept().unwrap() {
        percepts.push(percept.sequence);
    }
    assert_eq!(percepts, (19..=50).collect::<Vec<_>>());
    let completions: Vec<_> = (0..2).map(|_| subscriber.take_completion().unwrap().unwrap()).collect();
    assert_eq!(completions.iter().map(|completion| completion.header().sequence).collect::<Vec<_>>(), [49, 50]);
    server.loan_completion(&template()).unwrap().send().unwrap();
    assert_eq!(subscriber.take_completion().unwrap_err(), beo_ipc::ReceiveError::TooManyHeld);
    drop(completions);
    assert!(subscriber.take_completion().unwrap().is_some());
}

#[test]
fn a_hostile_header_is_refused_and_its_percept_says_why() {
    let instance = instance("hostile");
    let server = Server::open(&instance, &ServerOptions::new(DIMS)).unwrap();
    let producer = Producer::open(&instance, &template()).unwrap();
    let subscriber = Subscriber::open(&instance, &SubscriberOptions::default()).unwrap();
    type Change = fn(&mut ObservationHeader);
    let cases: [(Change, PerceptStatus, &str); 5] = [
        (|header| header.dims = [u32::MAX; 3], PerceptStatus::BadDims, "dims are"),
        (|header| header.dims = [30, 30, 31], PerceptStatus::BadDims, "the payload has 27000 bytes"),
        (|header| header.position_m[2] = f64::NAN, PerceptStatus::BadHeader, "position_m is not finite"),
        (|header| header.orientation = [0.0; 4], PerceptStatus::BadHeader, "orientation has norm 0e0;"),
        (|header| header.abi_version = 1, PerceptStatus::UnknownVersion, "abi_version is 1; this daemon speaks version 2"),
    ];
    for (change, status, explanation) in cases {
        let mut loan = producer.loan().unwrap();
        change(loan.header_mut());
        let sent = loan.send().unwrap();
        assert_eq!(sent.readers, 1);
        serve(&server);
        let percept = subscriber.take_percept().unwrap().unwrap();
        assert_eq!((percept.status, percept.producer_id, percept.sequence), (status.code(), producer.id(), sent.sequence));
        assert!(text::from_field(&percept.explanation).starts_with(explanation), "{}", text::from_field(&percept.explanation));
        assert!(percept.position_m.iter().all(|value| value.is_finite()));
    }
    // A refusal by the daemon itself takes the same way.
    server.publish(&Percept::refusing(&template(), &Refusal::BadVoxel { index: 3, value: 9 })).unwrap();
    assert_eq!(subscriber.take_percept().unwrap().unwrap().detail, 3);
}

#[test]
fn a_dropped_loan_leaves_no_trace() {
    let instance = instance("abandon");
    let server = Server::open(&instance, &ServerOptions::new(DIMS)).unwrap();
    let producer = Producer::open(&instance, &template()).unwrap();
    for _ in 0..200 {
        drop(producer.loan().unwrap());
    }
    assert!(server.receive().unwrap().is_none());
    assert_eq!(producer.loan().unwrap().send().unwrap().sequence, 1);
    // Memory that is all loaned is said to be so, and comes back.
    let mut loans = Vec::new();
    let error = loop {
        match producer.loan() {
            Ok(loan) => loans.push(loan),
            Err(error) => break error,
        }
    };
    assert_eq!(error, LoanError::NoFreeChunk);
    assert!(loans.len() >= 2);
    drop(loans);
    // A loan outlives its producer.
    let loan = producer.loan().unwrap();
    drop(producer);
    drop(loan);
    assert!(matches!(Producer::open(&instance, &ObservationHeader::new([7, 30, 30])), Err(OpenError::BadDims(_))));
}

#[test]
fn peers_beyond_the_limit_are_refused_until_one_leaves() {
    let instance = instance("full");
    let server = Server::open(&instance, &ServerOptions { producers: 2, subscribers: 1, ..ServerOptions::new(DIMS) }).unwrap();
    let first = Producer::open(&instance, &template()).unwrap();
    let _second = Producer::open(&instance, &template()).unwrap();
    let error = Producer::open(&instance, &template()).unwrap_err();
    assert!(matches!(error, OpenError::Full { .. }), "{error}");
    drop(first);
    Producer::open(&instance, &template()).unwrap();
    let _subscriber = Subscriber::open(&instance, &SubscriberOptions::default()).unwrap();
    let error = Subscriber::open(&instance, &SubscriberOptions::default()).unwrap_err();
    assert!(matches!(error, OpenError::Full { .. }), "{error}");
    drop(server);
}

#[test]
fn the_place_of_a_killed_producer_is_free_again() {
    let instance = instance("killed-producer");
    let server = Server::open(&instance, &ServerOptions { producers: 1, ..ServerOptions::new(DIMS) }).unwrap();
    let mut peer = Peer::start("producer", &instance);
    peer.hear("producing");
    eventually("its first observation", || server.receive().unwrap());
    peer.kill();
    let producer = eventually("its place", || {
        server.maintain();
        Producer::open(&instance, &template()).ok()
    });
    send(&producer);
    let from = |id| move |observation: &beo_ipc::Observation| observation.header().producer_id == id;
    eventually("an observation of the next", || server.receive().unwrap().filter(from(producer.id())));
}

#[test]
fn a_daemon_takes_over_from_its_predecessor_what_clients_kept_unless_it_needs_more() {
    let instance = instance("takeover");
    let options = ServerOptions { subscribers: 4, ..ServerOptions::new(DIMS) };
    let first = Server::open(&instance, &options).unwrap();
    let subscriber = Subscriber::open(&instance, &WITH_COMPLETION).unwrap();
    drop(first);
    let error = Server::open(&instance, &ServerOptions { subscribers: 5, ..options }).unwrap_err();
    assert!(matches!(error, OpenError::OtherSettings { .. }) && error.to_string().contains("stop the clients"), "{error}");
    let smaller = Server::open(&instance, &ServerOptions { dims: [20, 30, 10], ..options }).unwrap();
    smaller.publish(&Percept::answering(&template())).unwrap();
    assert_eq!(eventually("its percept", || subscriber.take_percept().unwrap()).daemon_id, smaller.daemon_id());
    // It cannot complete grids that are larger than it was made for.
    let error = smaller.loan_completion(&template()).unwrap_err();
    assert_eq!(error, LoanError::TooLarge { asked: 54_000, possible: 12_000 });
}

#[test]
fn another_message_layout_is_refused_by_clients_and_daemon() {
    let instance = instance("layout");
    let node = NodeBuilder::new()
        .signal_handling_mode(SignalHandlingMode::Disabled)
        .config(&beo_ipc::node::config())
        .create::<ipc_threadsafe::Service>()
        .unwrap();
    let attributes = AttributeSpecifier::new()
        .define(&beo_ipc::channel::LAYOUT_ATTRIBUTE.try_into().unwrap(), &"0123456789abcdef".try_into().unwrap())
        .unwrap();
    for (attributes, found) in [(attributes, "0123456789abcdef"), (AttributeSpecifier::new(), "none")] {
        let service = node
            .service_builder(&instance.percept().as_str().try_into().unwrap())
            .publish_subscribe::<Percept>()
            .create_with_attributes(&attributes)
            .unwrap();
        let errors = [
            Subscriber::open(&instance, &WITH_COMPLETION).unwrap_err(),
            Producer::open(&instance, &template()).unwrap_err(),
            Server::open(&instance, &ServerOptions::new(DIMS)).unwrap_err(),
        ];
        for error in errors {
            assert!(matches!(error, OpenError::LayoutMismatch { .. }), "{error}");
            let text = error.to_string();
            assert!(text.contains(found) && text.contains(&instance.percept()) && text.contains("rebuild"), "{text}");
            assert!(!error.is_retryable());
        }
        drop(service);
    }
    // Another type under our name.
    let service = node.service_builder(&instance.percept().as_str().try_into().unwrap()).publish_subscribe::<Status>().create().unwrap();
    let error = Subscriber::open(&instance, &WITH_COMPLETION).unwrap_err();
    assert!(matches!(error, OpenError::OtherVersion { .. }), "{error}");
    drop(service);
}

/// Stands for the percepts of the version before.
#[derive(Debug, Clone, Copy, ZeroCopySend)]
#[repr(C)]
#[type_name("beo.v1.Percept")]
struct PerceptOfVersion1([u64; 150]);

#[test]
fn a_peer_of_another_version_is_told_both_versions_in_one_line() {
    let instance = instance("version");
    let node = NodeBuilder::new()
        .signal_handling_mode(SignalHandlingMode::Disabled)
        .config(&beo_ipc::node::config())
        .create::<ipc_threadsafe::Service>()
        .unwrap();
    let service = node.service_builder(&instance.percept().as_str().try_into().unwrap()).publish_subscribe::<PerceptOfVersion1>();
    let _service = service.create().unwrap();
    for error in [
        Subscriber::open(&instance, &SubscriberOptions::default()).unwrap_err(),
        Producer::open(&instance, &template()).unwrap_err(),
        Server::open(&instance, &ServerOptions::new(DIMS)).unwrap_err(),
    ] {
        let text = error.to_string();
        assert!(matches!(error, OpenError::OtherVersion { .. }) && text.lines().count() == 1, "{text}");
        for part in [&instance.percept(), "version 1", "beo.v1.Percept", "version 2", "rebuild both"] {
            assert!(text.contains(part), "{part}: {text}");
        }
    }
}

#[test]
fn every_percept_has_the_next_number_of_its_daemon_and_the_status_the_last() {
    let instance = instance("numbers");
    let server = Server::open(&instance, &ServerOptions::new(DIMS)).unwrap();
    let subscriber = Subscriber::open(&instance, &SubscriberOptions::default()).unwrap();
    for _ in 0..40 {
        server.publish(&Percept::answering(&template())).unwrap();
    }
    let numbers: Vec<u64> = std::iter::from_fn(|| subscriber.take_percept().unwrap()).map(|percept| percept.answer_number).collect();
    assert_eq!(numbers, (9..=40).collect::<Vec<_>>(), "32 are kept: that 8 are gone is seen by their numbers");
    server.publish_status(&Status { answer_number: 7, ..status() }).unwrap();
    assert_eq!(subscriber.status().unwrap().unwrap().answer_number, 40);
}

#[test]
fn a_clean_exit_leaves_no_segment() {
    let instance = instance("clean");
    let mut server = Peer::start("server", &instance);
    server.hear("serving");
    let mut subscriber = Peer::start("subscriber", &instance);
    subscriber.hear("subscribed");
    let mut producer = Peer::start("producer", &instance);
    producer.hear("producing");
    assert_eq!(subscriber.hear("percept"), "1");
    let segments: Vec<PathBuf> = [&server, &subscriber, &producer].into_iter().flat_map(|peer| mapped_segments(peer.child.id())).collect();
    let bytes: u64 = segments.iter().filter_map(|path| path.metadata().ok()).map(|file| file.len()).sum();
    if std::env::var_os("BEO_IPC_TEST_PRINT").is_some() {
        segments.iter().for_each(|path| eprintln!("{:>9} {}", path.metadata().map_or(0, |file| file.len()), path.display()));
    }
    assert!(segments.len() > 8 && bytes > 5_000_000, "{} segments, {bytes} bytes: {segments:?}", segments.len());
    // A few MB at 30³; a segment that two processes share counts twice.
    assert!(bytes < 20_000_000, "{bytes} bytes: {segments:?}");
    producer.stop();
    subscriber.stop();
    server.stop();
    let left: Vec<_> = segments.iter().filter(|path| Path::exists(path)).collect();
    assert!(left.is_empty(), "left behind: {left:?}");
}

#[test]
fn what_a_relay_forwards_keeps_its_producer_numbers_daemon_and_stamps() {
    let instance = instance("forward");
    let server = Server::open(&instance, &ServerOptions::new(DIMS)).unwrap();
    let subscriber = Subscriber::open(&instance, &WITH_COMPLETION).unwrap();
    let producer = Producer::open(&instance, &template()).unwrap();
    let mut loan = producer.loan().unwrap();
    let header = ObservationHeader { producer_id: 4711, sequence: 99, written_ns: 5, capture_ns: 4, ..*loan.header() };
    *loan.header_mut() = header;
    loan.voxels_mut().fill(1);
    assert_eq!(loan.forward().unwrap().sequence, 99);
    let observation = eventually("an observation", || server.receive().unwrap());
    assert_eq!(*observation.header(), header);

    let percept = Percept { daemon_id: 8, answer_number: 77, published_ns: 6, ..Percept::answering(&header) };
    server.forward(&percept).unwrap();
    assert_eq!(eventually("a percept", || subscriber.take_percept().unwrap()), percept);
    let status = Status { daemon_id: 8, heartbeat_ns: 9, pid: 1, ..status() };
    server.forward_status(&status).unwrap();
    assert_eq!(eventually("a status", || subscriber.status().unwrap()), status);
}
