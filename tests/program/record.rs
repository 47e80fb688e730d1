//! `beo record`: what a daemon is asked and answers, read back from the file and decoded.

use crate::client::{Client, block};
use crate::harness::{PATIENCE, Running, beo, dims, instance, run, seen, serve, text};
use beo::recording::Topic;
use beo_core::grid::Rotation;
use beo_ipc::PoseSearch;
use beo_shapes::furniture;
use foxglove::messages::{FrameTransform, Log, PointCloud, PoseInFrame, SceneUpdate};
use foxglove::{Decode, Encode};
use rustix::process::Signal;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

/// A message as it lies in the file.
struct Message {
    schema: String,
    encoding: String,
    log_ns: u64,
    publish_ns: u64,
    data: Vec<u8>,
}

/// The messages of each topic of a finished recording, in order.
fn messages(path: &Path) -> BTreeMap<String, Vec<Message>> {
    let bytes = std::fs::read(path).unwrap();
    let summary = mcap::Summary::read(&bytes).unwrap().expect("a finished file has its summary");
    let mut topics: BTreeMap<String, Vec<Message>> = summary.channels.values().map(|channel| (channel.topic.clone(), Vec::new())).collect();
    for message in mcap::MessageStream::new(&bytes).unwrap() {
        let message = message.unwrap();
        let schema = message.channel.schema.as_ref().unwrap();
        topics.get_mut(&message.channel.topic).unwrap().push(Message {
            schema: schema.name.clone(),
            encoding: format!("{}/{}", message.channel.message_encoding, schema.encoding),
            log_ns: message.log_time,
            publish_ns: message.publish_time,
            data: message.data.into_owned(),
        });
    }
    topics
}

fn decoded<T: Decode + Encode>(messages: &[Message]) -> Vec<T> {
    let decode = |message: &Message| {
        assert_eq!((&*message.schema, &*message.encoding), (&*T::get_schema().unwrap().name, "protobuf/protobuf"));
        T::decode(&message.data[..]).unwrap_or_else(|_| panic!("{} does not decode", message.schema))
    };
    messages.iter().map(decode).collect()
}

fn now_ns() -> u64 {
    SystemTime::now().duration_since(UNIX_EPOCH).unwrap().as_nanos() as u64
}

/// Where a recording is until it ends.
fn partial(out: &Path) -> PathBuf {
    out.with_file_name(format!("{}.partial", out.file_name().unwrap().to_str().unwrap()))
}

/// Waits until so many percepts have reached the file of a recorder that is running.
fn await_percepts(out: &Path, wanted: usize) {
    let start = Instant::now();
    let there = || {
        let bytes = std::fs::read(partial(out)).unwrap();
        let messages = mcap::MessageStream::new_with_options(&bytes, mcap::read::Options::IgnoreEndMagic.into()).unwrap();
        messages.map_while(Result::ok).filter(|message| message.channel.topic == "/beo/percept").count()
    };
    while there() < wanted {
        assert!(start.elapsed() < PATIENCE, "{} of {wanted} percepts reach the file", there());
        std::thread::sleep(Duration::from_millis(50));
    }
}

#[test]
fn a_recording_holds_every_observation_and_answer_in_foxgloves_schemas() {
    let (name, folder) = (instance(), tempfile::tempdir().unwrap());
    let out = folder.path().join("a.mcap");
    let _daemon = serve(&name);
    // Two completions are kept for a reader: however late the recorder is, it loses none of the two that are on their way.
    let rounds = [[0, 2], [4, 8]];
    let count = rounds.as_flattened().len();
    let before_ns = now_ns();
    let arguments = ["record", out.to_str().unwrap(), "--instance", &name, "--count", &count.to_string()];
    let mut recorder = Running::start(beo(arguments));
    assert!(recorder.message().starts_with("recording"));
    // The producer stays until all is recorded: of one that has gone nothing is found any more.
    let client = Client::new(&name);
    for (round, classes) in rounds.iter().enumerate() {
        if round > 0 {
            await_percepts(&out, 2 * round);
        }
        for class in classes {
            let object = furniture::make(furniture::CLASSES[*class], dims(), 1001).expect("a class of the generator");
            client.send(|header, voxels| {
                header.object_id = *class as u64 + 1;
                header.pose_search = PoseSearch::Yaw.code();
                header.view = beo_ipc::View::TopDown.code();
                seen(&object, &Rotation::identity()).write(voxels);
            });
        }
    }
    assert!(recorder.wait().success());
    assert!(!partial(&out).exists());
    let recorded = format!("recorded {count} percepts, {count} completions and {count} observations");
    assert!(recorder.line().starts_with(&recorded));

    let topics = messages(&out);
    assert_eq!(topics.keys().collect::<Vec<_>>(), {
        let mut names = Topic::ALL.map(Topic::name).to_vec();
        names.sort();
        names
    });
    let clouds = decoded::<PointCloud>(&topics["/beo/observation"]);
    let completions = decoded::<SceneUpdate>(&topics["/beo/completion"]);
    let completed = decoded::<PointCloud>(&topics["/beo/completion_points"]);
    let objects = decoded::<SceneUpdate>(&topics["/beo/object"]);
    let bars = decoded::<SceneUpdate>(&topics["/beo/classes"]);
    let poses = decoded::<PoseInFrame>(&topics["/beo/pose"]);
    let transforms = decoded::<FrameTransform>(&topics["/tf"]);
    let log = decoded::<Log>(&topics["/beo/log"]);
    let percepts: Vec<serde_json::Value> =
        topics["/beo/percept"].iter().map(|message| serde_json::from_slice(&message.data).unwrap()).collect();
    let scenes = [completions.len(), objects.len(), bars.len()];
    let others = [clouds.len(), completed.len(), poses.len(), transforms.len(), percepts.len(), log.len() - 1];
    assert!(scenes.iter().chain(&others).all(|found| *found == count), "{scenes:?} {others:?}");
    for topic in ["/beo/percept", "/beo/status"] {
        assert_eq!(topics[topic][0].encoding, "json/jsonschema");
    }
    let status: serde_json::Value = serde_json::from_slice(&topics["/beo/status"][0].data).unwrap();
    assert_eq!((&status["instance"], &status["healthy"]), (&name.as_str().into(), &true.into()));
    assert!(log[0].message.contains("chair"), "the log begins with the model: {}", log[0].message);
    for messages in topics.values() {
        assert!(messages.iter().all(|m| before_ns <= m.publish_ns && m.publish_ns <= m.log_ns && m.log_ns <= now_ns()));
        assert!(messages.windows(2).all(|pair| pair[0].log_ns <= pair[1].log_ns));
    }

    for (n, percept) in percepts.iter().enumerate() {
        // The daemon may answer in another order than it was asked: what belongs together names the same object.
        let object = format!("camera1/object{}", percept["object_id"]);
        assert_eq!(transforms[n].child_frame_id, object);
        assert_eq!(transforms[n].parent_frame_id, "world");
        let rotation = transforms[n].rotation.unwrap();
        let best = &percept["hypotheses"][0]["rotation"];
        let z = best[2].as_f64().unwrap();
        assert!((rotation.z - z).abs() < 1e-6 || percept["hypotheses"][0]["class"] != percept["class"]);
        assert_eq!(poses[n].pose.unwrap().orientation, Some(rotation));
        let entity = &objects[n].entities[0];
        assert_eq!(entity.id, format!("{object} object"));
        assert!(entity.texts[0].text.starts_with(percept["class"].as_str().unwrap()));
        assert!(entity.arrows.len() >= 4, "three axes and at least one front");
        assert!(bars[n].entities[0].texts[0].text.starts_with(percept["class"].as_str().unwrap()));
        let surface = &completions[n].entities[0];
        let triangles = &surface.triangles[0];
        assert_eq!(surface.id, format!("{object} completion"));
        assert!(triangles.indices.len() > 100 && triangles.indices.len().is_multiple_of(3));
        assert_eq!(triangles.points.len(), triangles.colors.len());
        assert!(triangles.indices.iter().all(|corner| (*corner as usize) < triangles.points.len()));
        assert!(triangles.colors.iter().all(|colour| (0.0..=1.0).contains(&colour.a)));
        assert_eq!((clouds[n].point_stride, completed[n].point_stride), (24, 24));
        assert!(!clouds[n].data.is_empty() && clouds[n].data.len().is_multiple_of(24));
        assert_eq!(completed[n].data.len() as u64, 24 * percept["completion"]["filled"].as_u64().unwrap());
    }
}

/// How long before its sending an observation was taken.
const TAKEN_BEFORE_NS: u64 = 5_000_000_000;

/// Of a recorder that is killed, all but the last second is there, however little it is.
#[test]
fn what_is_recorded_reaches_the_file_within_a_second_or_so() {
    let (name, folder) = (instance(), tempfile::tempdir().unwrap());
    let out = folder.path().join("a.mcap");
    let _daemon = serve(&name);
    let mut recorder = Running::start(beo(["record", out.to_str().unwrap(), "--instance", &name]));
    assert!(recorder.message().starts_with("recording"));
    Client::new(&name).ask(|_, voxels| voxels[77] = 9);
    await_percepts(&out, 1);
    recorder.signal(Signal::KILL);
    assert!(!recorder.wait().success());
    await_percepts(&out, 1);
    assert!(!out.exists(), "a recording that was cut has not the name of a whole one");
}

/// A recording that was cut stays, whoever records to the same name next.
#[test]
fn no_recording_overwrites_one_that_was_cut() {
    let (name, folder) = (instance(), tempfile::tempdir().unwrap());
    let out = folder.path().join("a.mcap");
    let _daemon = serve(&name);
    std::fs::write(partial(&out), "cut").unwrap();
    let mut recorder = Running::start(beo(["record", out.to_str().unwrap(), "--instance", &name]));
    assert!(recorder.message().ends_with("a.mcap.partial-2 until it ends"));
    recorder.signal(Signal::INT);
    assert!(recorder.wait().success());
    assert_eq!(std::fs::read(partial(&out)).unwrap(), b"cut");
    assert!(messages(&out).contains_key("/beo/log"));
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 2);
}

#[test]
fn a_recording_that_is_ended_by_a_signal_is_whole() {
    for signal in [Signal::INT, Signal::TERM] {
        let (name, folder) = (instance(), tempfile::tempdir().unwrap());
        let out = folder.path().join("a.mcap");
        let _daemon = serve(&name);
        let mut recorder = Running::start(beo(["record", out.to_str().unwrap(), "--instance", &name]));
        assert!(recorder.message().starts_with("recording"));
        let client = Client::new(&name);
        client.ask(|_, voxels| voxels[77] = 9);
        client.ask(|header, voxels| {
            header.object_id = 5;
            // Taken long before it was sent: the time of a message is when the sensor saw it.
            header.capture_ns -= TAKEN_BEFORE_NS;
            header.position_m = [0.5, -0.25, 1.0];
            header.voxel_size_m = 0.01;
            header.frame_id = beo_ipc::text::to_field("camera");
            block(voxels);
        });
        await_percepts(&out, 2);
        recorder.signal(signal);
        assert!(recorder.wait().success());
        let topics = messages(&out);
        let clouds = decoded::<PointCloud>(&topics["/beo/observation"]);
        assert_eq!((clouds.len(), &*clouds[0].frame_id), (1, "camera"));
        let times = &topics["/beo/observation"][0];
        assert!(times.publish_ns + TAKEN_BEFORE_NS <= times.log_ns, "{} {}", times.publish_ns, times.log_ns);
        let pose = clouds[0].pose.unwrap().position.unwrap();
        assert_eq!([pose.x, pose.y, pose.z], [0.5, -0.25, 1.0]);
        // The highest layer of the block is the ninth of 16 voxels of a centimetre: its centre is half a voxel above the grid's.
        let z = |point: &[u8]| f32::from_le_bytes(point[8..12].try_into().unwrap());
        assert!(clouds[0].data.chunks(24).all(|point| (z(point) - 0.005).abs() < 1e-6));
        let log = decoded::<Log>(&topics["/beo/log"]);
        assert!(
            log.iter().any(|entry| entry.level() == foxglove::messages::log::Level::Warning && entry.message.contains("voxel 77 is 9"))
        );
    }
}

#[test]
fn a_full_disk_is_named() {
    let name = instance();
    let _daemon = serve(&name);
    let mut recorder = Running::start(beo(["record", "/dev/full", "--instance", &name, "--seconds", "60"]));
    let status = recorder.wait();
    let message = recorder.message();
    assert_eq!(status.code(), Some(1));
    assert!(message.contains("/dev/full is incomplete: the disk is full"), "{message}");
}

#[test]
fn a_second_recorder_takes_what_was_seen_from_the_completions() {
    let (name, folder) = (instance(), tempfile::tempdir().unwrap());
    let _daemon = serve(&name);
    let outs = ["a.mcap", "b.mcap"].map(|file| folder.path().join(file));
    let mut first = Running::start(beo(["record", outs[0].to_str().unwrap(), "--instance", &name, "--count", "1"]));
    assert!(first.message().starts_with("recording"));
    let mut second = Running::start(beo(["record", outs[1].to_str().unwrap(), "--instance", &name, "--count", "1"]));
    assert!(second.message().starts_with("warning: another recorder"));
    assert!(second.message().starts_with("recording"));
    // The producer stays until both are done: a recorder that wakes up late finds nothing of one that has gone.
    let client = Client::new(&name);
    client.ask(|_, voxels| block(voxels));
    assert!(first.wait().success() && second.wait().success());
    let [a, b] = outs.map(|out| decoded::<PointCloud>(&messages(&out)["/beo/observation"]));
    assert_eq!((a.len(), &a[0].data), (1, &b[0].data));
}

#[test]
fn impossible_lengths_are_wrong_usage() {
    for seconds in ["0", "-1", "nan", "1e300"] {
        let output = run(["record", "/dev/null", &format!("--seconds={seconds}")]);
        assert_eq!(output.status.code(), Some(2), "{seconds}: {}", text(&output.stderr));
    }
}
