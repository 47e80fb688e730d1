//! An observation of a broken or hostile producer gives a percept that says so to that producer, and nothing else.

use crate::client::{Client, DIMS, block, explanation};
use crate::faults::roles::{Actor, Role};
use crate::harness::{PATIENCE, RESOLUTION, instance, segments, serve};
use beo_ipc::{InstanceName, NO_CLASS, ObservationHeader, Percept, PerceptStatus, PoseSearch, tasks};
use iceoryx2::port::publisher::Publisher;
use iceoryx2::prelude::{NodeBuilder, SignalHandlingMode, ipc};
use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rustix::process::Signal;
use std::collections::BTreeMap;
use std::fs::{File, OpenOptions};
use std::os::unix::fs::FileExt;
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::time::Instant;

const HEADERS: u64 = 2000;
/// Observations that are written to while the daemon reads them.
const SCRIBBLED: u32 = 500;

/// Asks for the class of a good observation, changed.
fn ask(client: &Client, change: impl FnOnce(&mut ObservationHeader, &mut [u8])) -> Percept {
    client.ask(|header, voxels| {
        header.tasks = tasks::CLASS;
        block(voxels);
        change(header, voxels);
    })
}

/// A number of any bits.
fn bits(random: &mut ChaCha8Rng) -> u32 {
    match random.random_range(0..4_u32) {
        0 => random.next_u32(),
        1 => random.random_range(0..4),
        _ => [0, 1, 2, 3, 7, 8, 16, 255, 256, 65_536, 0x7fff_ffff, 0x8000_0000, u32::MAX][random.random_range(0..13_usize)],
    }
}

fn single(random: &mut ChaCha8Rng) -> f32 {
    match random.random_range(0..3_u32) {
        0 => f32::from_bits(random.next_u32()),
        1 => [0.0, -0.0, 1.0, -1.0, f32::NAN, f32::INFINITY, f32::MAX, f32::MIN_POSITIVE][random.random_range(0..8_usize)],
        _ => random.random(),
    }
}

fn double(random: &mut ChaCha8Rng) -> f64 {
    if random.random() { f64::from_bits(random.next_u64()) } else { f64::from(single(random)) }
}

/// Changes any fields of a good header but those that `Loan::send` sets; nearly every header of the second kind has any bits everywhere.
fn spoil(header: &mut ObservationHeader, random: &mut ChaCha8Rng) {
    let share = if random.random() { 0.08 } else { 0.9 };
    macro_rules! perhaps {
        ($field:expr, $value:expr) => {
            if random.random_bool(share) {
                $field = $value;
            }
        };
    }
    perhaps!(header.abi_version, bits(random));
    perhaps!(header.pose_search, bits(random));
    perhaps!(header.producer_id, random.next_u64());
    perhaps!(header.object_id, random.next_u64());
    perhaps!(header.capture_ns, random.next_u64());
    perhaps!(header.sensor_stamp_ns, random.next_u64());
    perhaps!(header.deadline_ns, u64::from(bits(random)));
    perhaps!(header.position_m, [(); 3].map(|()| double(random)));
    perhaps!(header.orientation, [(); 4].map(|()| double(random)));
    perhaps!(header.voxel_size_m, single(random));
    perhaps!(header.dims, [(); 3].map(|()| bits(random)));
    perhaps!(header.tasks, bits(random));
    perhaps!(header.completion_frame, bits(random));
    perhaps!(header.outside, bits(random));
    perhaps!(header.view, bits(random));
    perhaps!(header.frame_id, [random.next_u32() as u8; 32]);
    perhaps!(header.continued_object_id, random.next_u64());
    perhaps!(header.continues, bits(random));
    perhaps!(header.rotation_prior_concentration, single(random));
    perhaps!(header.rotation_prior, [(); 4].map(|()| single(random)));
    perhaps!(header.sensor_position_m, [(); 3].map(|()| single(random)));
    perhaps!(header.scale_search, bits(random));
    perhaps!(header.known_side_m, single(random));
    perhaps!(header.known_side_deviation_m, single(random));
    perhaps!(header.unit, bits(random));
    perhaps!(header.cut, bits(random));
    perhaps!(header.share_support, single(random));
    perhaps!(header.share_edge, single(random));
    perhaps!(header.share_far, single(random));
    perhaps!(header.surface_deviation_m, single(random));
    perhaps!(header.reserved, [random.next_u32() as u8; 56]);
}

#[test]
fn any_header_is_answered_with_a_status_and_the_next_good_one_as_before() {
    let name = instance();
    let daemon = serve(&name);
    let (hostile, honest) = (Client::new(&name), Client::new(&name));
    let before = ask(&honest, |_, _| {});
    assert_eq!(before.status, 0);
    let mut random = ChaCha8Rng::seed_from_u64(2017);
    let mut seen = BTreeMap::new();
    for _ in 0..HEADERS {
        let mut wanted = ObservationHeader::default();
        let wrong = if random.random_bool(0.1) { Some((random.random_range(0..RESOLUTION.pow(3)), random.random())) } else { None };
        let percept = ask(&hostile, |header, voxels| {
            wrong.into_iter().for_each(|(voxel, code)| voxels[voxel] = code);
            spoil(header, &mut random);
            wanted = *header;
        });
        let status = PerceptStatus::from_code(percept.status).expect("a status that this version knows");
        *seen.entry(percept.status).or_insert(0) += 1;
        assert_eq!((percept.object_id, percept.capture_ns), (wanted.object_id, wanted.capture_ns));
        assert_ne!(status, PerceptStatus::Internal, "{wanted:?}: {}", explanation(&percept));
        if status != PerceptStatus::Ok {
            assert_eq!((percept.class_index, percept.class_count), (NO_CLASS, 0));
            assert!(!explanation(&percept).is_empty(), "{wanted:?}");
        }
        let numbers = percept.position_m.iter().chain(&percept.orientation).copied().chain(percept.posterior.iter().map(|p| f64::from(*p)));
        assert!(numbers.chain([f64::from(percept.voxel_size_m)]).all(f64::is_finite), "{percept:?}");
    }
    assert!(seen.len() >= 6, "headers of all kinds were sent: {seen:?}");
    let after = ask(&honest, |_, _| {});
    assert_eq!((after.status, after.class_index, after.posterior), (0, before.class_index, before.posterior));
    assert_eq!(after.daemon_id, before.daemon_id, "the same run of the daemon {}", daemon.id());
}

#[test]
fn sequence_and_time_may_jump_and_a_past_deadline_is_refused() {
    let name = instance();
    let _daemon = serve(&name);
    let client = Client::new(&name);
    for capture_ns in [u64::MAX, 1, beo_ipc::clock::monotonic_ns() + 3_600_000_000_000] {
        let percept = ask(&client, |header, _| header.capture_ns = capture_ns);
        assert_eq!((percept.status, percept.capture_ns), (0, capture_ns), "passed through");
    }
    let late = ask(&client, |header, _| header.deadline_ns = 1);
    assert_eq!(late.status, PerceptStatus::Expired.code());
    assert!(explanation(&late).contains("deadline") && late.detail > 0);
    assert_eq!(late.class_index, NO_CLASS);
    let in_time = ask(&client, |header, _| header.deadline_ns = u64::MAX);
    assert_eq!(in_time.status, 0);
    client.status(|status| (status.received, status.answered, status.refused) == (5, 4, 1));
}

/// A publisher of observations of at most so many bytes that does not use our library.
fn stranger(instance: &str, most_bytes: usize) -> Publisher<ipc::Service, [u8], ObservationHeader> {
    let node =
        NodeBuilder::new().signal_handling_mode(SignalHandlingMode::Disabled).config(&beo_ipc::node::config()).create::<ipc::Service>();
    let node = node.unwrap();
    let service = InstanceName::new(instance).unwrap().observation().as_str().try_into().unwrap();
    let service = node.service_builder(&service).publish_subscribe::<[u8]>().user_header::<ObservationHeader>().open().unwrap();
    service.publisher_builder().initial_max_slice_len(most_bytes).create().unwrap()
}

/// Who does not use our library numbers as it likes, in the name of whom it likes.
#[test]
fn forged_numbers_and_names_are_answered_and_count_no_losses() {
    let name = instance();
    let _daemon = serve(&name);
    let honest = Client::new(&name);
    ask(&honest, |_, _| {});
    let publisher = stranger(&name, RESOLUTION.pow(3));
    let send = |producer_id, sequence| {
        let mut sample = publisher.loan_slice_uninit(RESOLUTION.pow(3)).unwrap();
        *sample.user_header_mut() = ObservationHeader { producer_id, sequence, tasks: tasks::CLASS, ..ObservationHeader::new(DIMS) };
        sample.write_from_fn(|voxel| u8::from(voxel < RESOLUTION.pow(2))).send().unwrap();
        let percept = honest.percept((producer_id, sequence));
        assert_eq!(percept.status, 0, "{}", explanation(&percept));
    };
    let jumps = [1, u64::MAX, 0, 1 << 63, 7, u64::MAX - 1, u64::MAX];
    jumps.iter().for_each(|sequence| send(5, *sequence));
    // As the honest producer, and as more producers than there are.
    jumps.iter().skip(1).for_each(|sequence| send(honest.producer.id(), *sequence));
    (0..300).for_each(|producer| send(1000 + producer, u64::MAX - producer));
    assert_eq!(ask(&honest, |_, _| {}).status, 0);
    let sent = 1 + 7 + 6 + 300 + 1;
    let status = honest.status(|status| status.received == sent && status.waiting() == 0);
    assert_eq!((status.answered, status.overflowed), (sent, 0), "{status:?}");
}

#[test]
fn a_quaternion_near_unit_is_repeated_at_length_one() {
    let name = instance();
    let _daemon = serve(&name);
    let client = Client::new(&name);
    let percept = ask(&client, |header, _| header.orientation = [0.0, 0.0, 0.0, 1.0009]);
    assert_eq!((percept.status, percept.orientation), (0, [0.0, 0.0, 0.0, 1.0]));
    let percept = ask(&client, |header, _| header.orientation = [0.0, 0.0, 0.0, 1.002]);
    assert_eq!(percept.status, PerceptStatus::BadHeader.code());
}

/// The place of `needle` in one of the files that this process has in shared memory, opened for writing.
fn find(needle: &[u8]) -> (File, u64) {
    let found = segments(std::process::id()).into_iter().find_map(|path| {
        let bytes = std::fs::read(&path).ok()?;
        let at = bytes.windows(needle.len()).position(|window| window == needle)?;
        Some((OpenOptions::new().write(true).open(&path).ok()?, at as u64))
    });
    found.expect("a loan lies in shared memory")
}

#[test]
fn what_is_written_while_the_daemon_reads_gives_a_valid_answer_or_a_refusal() {
    let name = instance();
    let _daemon = serve(&name);
    let (client, honest) = (Client::new(&name), Client::new(&name));
    let before = ask(&honest, |_, _| {});
    // Where the scribbler writes, if anywhere.
    let target: Mutex<Option<(File, u64)>> = Mutex::new(None);
    let (stop, writes, mut random) = (AtomicBool::new(false), AtomicU32::new(0), ChaCha8Rng::seed_from_u64(1));
    let mut seen = BTreeMap::new();
    std::thread::scope(|scope| {
        let scribbler = scope.spawn(|| {
            let mut random = ChaCha8Rng::seed_from_u64(2);
            while !stop.load(Ordering::Relaxed) {
                if let Some((file, at)) = &*target.lock().unwrap() {
                    let codes = [0, 1, 255, if random.random_bool(0.01) { 77 } else { 0 }];
                    let bytes: Vec<u8> = (0..64).map(|_| codes[random.random_range(0..4_usize)]).collect();
                    file.write_all_at(&bytes, at + random.random_range(0..RESOLUTION.pow(3) as u64 - 64)).unwrap();
                    writes.fetch_add(1, Ordering::Relaxed);
                }
                std::thread::yield_now();
            }
        });
        let start = Instant::now();
        let mut sent = 0;
        while sent < SCRIBBLED || seen.len() < 2 || writes.load(Ordering::Relaxed) < SCRIBBLED {
            assert!(start.elapsed() < PATIENCE, "{writes:?} writes gave {seen:?}");
            let mut loan = client.producer.loan().unwrap();
            let needle: [u8; 64] = std::array::from_fn(|_| random.next_u32() as u8);
            loan.voxels_mut()[..64].copy_from_slice(&needle);
            let place = find(&needle);
            loan.voxels_mut().fill(0);
            block(loan.voxels_mut());
            *target.lock().unwrap() = Some(place);
            let percept = client.percept((client.producer.id(), loan.send().unwrap().sequence));
            *target.lock().unwrap() = None;
            let status = PerceptStatus::from_code(percept.status).unwrap();
            assert!(matches!(status, PerceptStatus::Ok | PerceptStatus::BadVoxel), "{}", explanation(&percept));
            if status == PerceptStatus::Ok {
                assert!((percept.posterior.iter().sum::<f32>() - 1.0).abs() < 1e-4);
            }
            *seen.entry(percept.status).or_insert(0) += 1;
            sent += 1;
        }
        stop.store(true, Ordering::Relaxed);
        scribbler.join().unwrap();
    });
    let after = ask(&honest, |_, _| {});
    assert_eq!((after.status, after.posterior), (0, before.posterior));
}

/// How many bytes an observation has stands in memory that its producer can write: nothing beyond its own chunk is taken for it.
#[test]
fn a_forged_length_reaches_no_further_than_the_producers_chunk() {
    // No number of the header is this one.
    const BYTES: usize = 521;
    let name = instance();
    let _daemon = serve(&name);
    let honest = Client::new(&name);
    ask(&honest, |_, _| {});
    let publisher = stranger(&name, BYTES);
    let mut random = ChaCha8Rng::seed_from_u64(3);
    for (sequence, length) in [(1, RESOLUTION.pow(3) as u64), (2, u64::MAX), (3, BYTES as u64)] {
        let mut sample = publisher.loan_slice_uninit(BYTES).unwrap();
        *sample.user_header_mut() = ObservationHeader { producer_id: 5, sequence, tasks: tasks::CLASS, ..ObservationHeader::new(DIMS) };
        let needle: [u8; 64] = std::array::from_fn(|_| random.next_u32() as u8);
        let sample = sample.write_from_fn(|byte| needle.get(byte).copied().unwrap_or(0));
        let (file, payload) = find(&needle);
        // Before the payload comes our header, and before that iceoryx2's, with the number of elements.
        let mut before = vec![0; 600.min(payload as usize)];
        let start = payload - before.len() as u64;
        File::open(format!("/proc/self/fd/{}", std::os::fd::AsRawFd::as_raw_fd(&file))).unwrap().read_exact_at(&mut before, start).unwrap();
        let at = before.windows(8).rposition(|bytes| bytes == (BYTES as u64).to_le_bytes()).expect("the number of elements");
        file.write_all_at(&length.to_le_bytes(), start + at as u64).unwrap();
        sample.send().unwrap();
        let percept = honest.percept((5, sequence));
        assert_eq!(percept.status, PerceptStatus::BadDims.code(), "{}", explanation(&percept));
        assert!(explanation(&percept).contains(&format!("has {BYTES} bytes")), "{}", explanation(&percept));
    }
    assert_eq!(ask(&honest, |_, _| {}).status, 0);
}

/// Whoever may write a segment may cut it: what waits in it is gone, and nothing else.
#[test]
fn a_producer_that_cuts_its_memory_ends_nobody_else() {
    let name = instance();
    let mut daemon = serve(&name);
    let honest = Client::new(&name);
    let before = ask(&honest, |_, _| {});
    for length in [0, 4096, 5000] {
        let mut hostile = Actor::start(Role::Producer { every_ms: 5, search: PoseSearch::Known }, &name);
        honest.percept_of(hostile.id);
        let refused = honest.status(|_| true).refused;
        // Now the daemon has mapped its segment, and what comes waits in it.
        daemon.signal(Signal::STOP);
        drop(hostile.heard("sent"));
        (0..3).for_each(|_| drop(hostile.hear("sent")));
        hostile.process.signal(Signal::STOP);
        let cut: Vec<_> = segments(hostile.process.id()).into_iter().filter(|path| path.extension().is_some_and(|e| e == "data")).collect();
        assert!(!cut.is_empty());
        for path in &cut {
            OpenOptions::new().write(true).open(path).unwrap().set_len(length).unwrap();
        }
        daemon.signal(Signal::CONT);
        honest.status(|status| status.refused > refused && status.waiting() == 0);
        let after = ask(&honest, |_, _| {});
        assert_eq!((after.status, after.posterior, after.daemon_id), (0, before.posterior, before.daemon_id));
        hostile.kill();
    }
    daemon.signal(Signal::TERM);
    assert!(daemon.wait().success());
}
