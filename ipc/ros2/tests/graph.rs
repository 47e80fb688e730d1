//! The whole program against an independent ROS 2 graph: a made-up scene goes in as images, by the DDS implementation CycloneDDS, and comes
//! back as detections, clouds, markers and diagnostics.
//!
//! And against rclpy, which is ROS 2's own client library over another DDS implementation, Fast DDS. Each is left out, with a line, where
//! `$BEO_PYTHON` (or `python3`) lacks it. The daemon is `$BEO_PROGRAM`, or built here.

use serde_json::Value;
use std::io::{BufRead as _, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// No step takes longer on the slowest machine.
const PATIENCE: Duration = Duration::from_secs(240);
const SIZE: [usize; 2] = [320, 240];
const FOCAL: f64 = 277.0;
const CENTRE: [f64; 2] = [160.3, 119.1];
/// Longer than the 32 bytes that an observation has for it.
const FRAME: &str = "front_camera_depth_optical_frame_of_the_left_arm";

/// A process that is ended when dropped.
struct Running(Child);

impl Running {
    fn start(command: &mut Command) -> Self {
        Self(command.stdin(Stdio::null()).spawn().unwrap_or_else(|error| panic!("{command:?}: {error}")))
    }

    fn interrupt(&self) {
        let _ = Command::new("kill").args(["-INT", &self.0.id().to_string()]).status();
    }

    /// Waits for its end, and kills it if that does not come.
    fn end(&mut self, patience: Duration) -> Option<std::process::ExitStatus> {
        let start = Instant::now();
        while start.elapsed() < patience {
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
            self.interrupt();
            self.end(Duration::from_secs(20));
        }
    }
}

/// Another program that speaks to the node.
#[derive(Clone, Copy)]
enum Peer {
    /// `tests/peer.py`, over CycloneDDS.
    Cyclone,
    /// `tests/ros_peer.py`, over rclpy.
    Ros,
}

impl Peer {
    /// Its script, the modules of Python that it needs, and how to have them.
    fn needs(self) -> (&'static str, &'static str, &'static str) {
        match self {
            Self::Cyclone => ("tests/peer.py", "import cyclonedds", "cyclonedds"),
            Self::Ros => (
                "tests/ros_peer.py",
                "import rclpy, sensor_msgs.msg, visualization_msgs.msg",
                "ros-rclpy ros-rmw-fastrtps-cpp ros-sensor-msgs ros-visualization-msgs",
            ),
        }
    }

    /// The Python that can run it, if there is one.
    fn python(self) -> Option<String> {
        let (_, modules, wheels) = self.needs();
        let python = std::env::var("BEO_PYTHON").unwrap_or_else(|_| "python3".into());
        let has = Command::new(&python).args(["-c", modules]).stderr(Stdio::null()).status().is_ok_and(|status| status.success());
        if !has {
            eprintln!("skipped: {python} cannot `{modules}` (pip install {wheels}, and set BEO_PYTHON)");
        }
        has.then_some(python)
    }
}

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

/// The daemon's program.
fn beo() -> PathBuf {
    if let Some(program) = std::env::var_os("BEO_PROGRAM") {
        return program.into();
    }
    let target = Path::new(env!("CARGO_TARGET_TMPDIR")).parent().unwrap().to_owned();
    let status = Command::new(env!("CARGO"))
        .args(["build", "--locked", "--bin", "beo", "--manifest-path"])
        .arg(root().join("Cargo.toml"))
        .arg("--target-dir")
        .arg(&target)
        .status()
        .unwrap();
    assert!(status.success(), "the daemon was not built");
    target.join("debug/beo")
}

/// An instance and a DDS domain of this test's own.
fn names(test: u32) -> (String, String) {
    (format!("ros2-test-{test}-{}", std::process::id()), (100 + (std::process::id() * 2 + test) % 130).to_string())
}

fn daemon(instance: &str) -> Running {
    let model = root().join("models/household.safetensors");
    Running::start(Command::new(beo()).args(["serve", "--instance", instance, "--model"]).arg(model).stderr(Stdio::null()))
}

/// The node under test, once it has joined the graph.
fn node(instance: &str, domain: &str, more: &[&str]) -> Running {
    let mut command = Command::new(env!("CARGO_BIN_EXE_beo-ros2"));
    command.args(["--localhost-only", "--domain-id", domain, "--ros-args", "-p", &format!("instance:={instance}"), "-p", "tf:=true"]);
    let mut node = Running::start(command.args(["-r", "depth/image:=/made_up/image"]).args(more).stderr(Stdio::piped()));
    let mut said = BufReader::new(node.0.stderr.take().unwrap()).lines();
    let first = said.next().unwrap().unwrap();
    assert!(first.contains("waits for images"), "{first}");
    std::thread::spawn(move || said.map_while(Result::ok).for_each(|line| eprintln!("{line}")));
    node
}

/// A box on the table: its middle in the camera's frame, and half its sides.
struct Thing {
    middle: [f64; 3],
    half: [f64; 3],
}

/// The camera is 0.4 m above a table and looks down by 0.55 rad.
fn scene() -> (Vec<f32>, Vec<Thing>) {
    let (sin, cos) = 0.55_f64.sin_cos();
    let (up, ahead) = ([0.0, -cos, -sin], [0.0, -sin, cos]);
    let at = |forward: f64, right: f64, height: f64| {
        [right, ahead[1] * forward - up[1] * (0.4 - height), ahead[2] * forward - up[2] * (0.4 - height)]
    };
    let things = vec![
        Thing { middle: at(0.55, -0.11, 0.07), half: [0.035, 0.05, 0.07] },
        Thing { middle: at(0.6, 0.12, 0.04), half: [0.06, 0.045, 0.04] },
    ];
    let dot = |a: [f64; 3], b: [f64; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
    let turned = 0.5_f64;
    let right = [1.0, 0.0, 0.0];
    let mix = |a: [f64; 3], s: f64, b: [f64; 3], t: f64| [0, 1, 2].map(|i| a[i] * s + b[i] * t);
    let axes = [mix(right, turned.cos(), ahead, turned.sin()), mix(ahead, turned.cos(), right, -turned.sin()), up];
    let mut depth = Vec::new();
    for v in 0..SIZE[1] {
        for u in 0..SIZE[0] {
            let ray = [(u as f64 - CENTRE[0]) / FOCAL, (v as f64 - CENTRE[1]) / FOCAL, 1.0];
            let table = -0.4 / dot(up, ray);
            let mut nearest = if table > 0.0 && table < 3.0 { table } else { f64::NAN };
            for thing in &things {
                let (mut enter, mut leave) = (0.0_f64, 10.0_f64);
                for (axis, half) in axes.iter().zip(thing.half) {
                    let along = dot(*axis, ray);
                    let (middle, width) = (dot(*axis, thing.middle) / along, half / along.abs());
                    (enter, leave) = (enter.max(middle - width), leave.min(middle + width));
                }
                if enter < leave {
                    nearest = enter;
                }
            }
            depth.push(((1000.0 * nearest).round() / 1000.0) as f32);
        }
    }
    (depth, things)
}

/// Has a peer publish the scene until `count` answers came; what came back.
fn play(peer: Peer, python: &str, domain: &str, encoding: &str, count: u32) -> (Value, Vec<Thing>) {
    let folder = tempfile::tempdir().unwrap();
    let (depth, things) = scene();
    let bytes: Vec<u8> =
        depth.iter().map(|metres| if encoding == "16UC1" && metres.is_nan() { 0.0 } else { *metres }).flat_map(f32::to_le_bytes).collect();
    std::fs::write(folder.path().join("depth"), bytes).unwrap();
    let camera = serde_json::json!({
        "width": SIZE[0], "height": SIZE[1], "k": [FOCAL, 0.0, CENTRE[0], 0.0, FOCAL, CENTRE[1], 0.0, 0.0, 1.0], "frame_id": FRAME,
        "encoding": encoding, "count": count, "seconds": PATIENCE.as_secs() / 2, "pause": 0.1,
    });
    std::fs::write(folder.path().join("camera.json"), camera.to_string()).unwrap();
    let mut command = Command::new(python);
    command.arg(Path::new(env!("CARGO_MANIFEST_DIR")).join(peer.needs().0)).env("PYTHONDONTWRITEBYTECODE", "1").stdout(Stdio::piped());
    match peer {
        Peer::Cyclone => {
            let loopback = "<CycloneDDS><Domain><General><Interfaces><NetworkInterface name=\"lo\" multicast=\"false\"/></Interfaces>\
                <AllowMulticast>false</AllowMulticast></General><Discovery><ParticipantIndex>auto</ParticipantIndex>\
                <Peers><Peer address=\"127.0.0.1\"/></Peers></Discovery></Domain></CycloneDDS>";
            command.arg(domain).arg(folder.path()).env("CYCLONEDDS_URI", loopback)
        }
        // What an installed ROS 2 may have set of these is not for this test.
        Peer::Ros => command
            .arg(folder.path())
            .env("ROS_DOMAIN_ID", domain)
            .env("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
            .env("RMW_IMPLEMENTATION", "rmw_fastrtps_cpp")
            .env("ROS_LOG_DIR", folder.path()),
    };
    let mut peer = Running::start(&mut command);
    let line = BufReader::new(peer.0.stdout.take().unwrap()).lines().next().expect("the peer prints a line").unwrap();
    assert!(peer.end(PATIENCE).is_some_and(|status| status.success()));
    (serde_json::from_str(&line).unwrap(), things)
}

impl Thing {
    /// Whether a detection's middle lies in it: nearer to its own than any of its sides. How exactly things are perceived is tested elsewhere.
    fn is_found_by(&self, object: &Value) -> bool {
        distance(&numbers(&object["box"]["position"]), &self.middle) < self.half.into_iter().fold(f64::MAX, f64::min)
    }
}

fn numbers(value: &Value) -> Vec<f64> {
    value.as_array().unwrap().iter().map(|number| number.as_f64().unwrap()).collect()
}

fn distance(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt()
}

#[test]
fn a_scene_comes_back_as_detections_cloud_markers_and_diagnostics() {
    let Some(python) = Peer::Cyclone.python() else { return };
    let (instance, domain) = names(0);
    let _daemon = daemon(&instance);
    let mut node = node(&instance, &domain, &[]);
    let (found, things) = play(Peer::Cyclone, &python, &domain, "32FC1", 8);
    let arrays = found["detections"].as_array().unwrap();
    assert!(arrays.len() >= 8, "{found}");
    let classes: Vec<&str> = found["classes"].as_array().unwrap().iter().map(|name| name.as_str().unwrap()).collect();
    assert!(classes.contains(&"box") && classes.contains(&"mug"), "{classes:?}");

    let last = arrays.last().unwrap();
    let sent = 1000 + found["sent"].as_i64().unwrap();
    assert!((1001..=sent).contains(&last["header"]["sec"].as_i64().unwrap()), "{last}");
    assert_eq!((last["header"]["nanosec"].as_i64(), last["header"]["frame_id"].as_str()), (Some(500), Some(FRAME)));
    let objects = last["objects"].as_array().unwrap();
    assert_eq!(objects.len(), things.len(), "{last}");
    for thing in &things {
        let object =
            objects.iter().find(|object| thing.is_found_by(object)).unwrap_or_else(|| panic!("nothing at {:?}: {last}", thing.middle));
        assert_eq!(object["header"], last["header"]);
        let results = object["results"].as_array().unwrap();
        assert_eq!(results[0]["class"], "box", "{object}");
        let longest = |sides: Vec<f64>| sides.into_iter().fold(0.0, f64::max);
        let (size, truth) = (longest(numbers(&object["box"]["size"])), 2.0 * longest(thing.half.to_vec()));
        assert!((size / truth - 1.0).abs() < 0.4, "{size} m, in truth {truth}");
        for result in results {
            assert!(classes.contains(&result["class"].as_str().unwrap()));
            assert!((0.0..=1.0).contains(&result["score"].as_f64().unwrap()));
            assert!((distance(&numbers(&result["orientation"]), &[0.0; 4]) - 1.0).abs() < 1e-6);
            let covariance = nalgebra::SMatrix::<f64, 6, 6>::from_row_slice(&numbers(&result["covariance"]));
            assert!(covariance.iter().all(|value| value.is_finite()) && (covariance - covariance.transpose()).amax() < 1e-12);
            assert!(covariance.symmetric_eigenvalues().min() > 0.0, "{covariance}");
        }
    }

    let cloud = found["clouds"].as_array().unwrap().iter().find(|cloud| cloud["count"].as_u64() > Some(500)).unwrap();
    assert_eq!(cloud["fields"], serde_json::json!(["x", "y", "z", "occupancy", "deviation", "object"]));
    assert_eq!((cloud["header"]["frame_id"].as_str(), cloud["count"].as_u64()), (Some(FRAME), cloud["width"].as_u64()));
    let first = numbers(&cloud["first"][0]);
    assert!(things.iter().any(|thing| distance(&first[..3], &thing.middle) < 0.15) && (0.5..=1.0).contains(&first[3]), "{first:?}");

    let drawn = found["markers"].as_array().unwrap().last().unwrap().as_array().unwrap();
    for (ns, kind) in [("box", 5), ("class", 9), ("completed", 6), ("pose", 0)] {
        let of_kind = drawn.iter().filter(|marker| marker[0] == ns && marker[2] == kind && marker[3] == 0 && marker[6] == FRAME).count();
        assert!(of_kind >= things.len(), "{ns}: {drawn:?}");
    }
    assert!(drawn.iter().any(|marker| marker[4].as_str().unwrap().starts_with("box ")), "{drawn:?}");
    let health = found["diagnostics"].as_array().unwrap().last().unwrap();
    assert_eq!((health[0][0].as_u64(), health[0][1].as_str(), health[0][2].as_str()), (Some(0), Some("beo: daemon"), Some("serving")));
    assert_eq!(health[1][1], "beo: images");
    let frames = found["frames"].as_array().unwrap();
    assert!(frames.iter().any(|frame| frame[0] == FRAME && frame[1].as_str().unwrap().starts_with("beo/box_")), "{frames:?}");
    eprintln!("image written to detections read, ms: {}; of which writing: {}", found["latency_ms"], found["write_ms"]);

    node.interrupt();
    assert!(node.end(Duration::from_secs(20)).is_some_and(|status| status.success()), "the node ends by Ctrl-C");
}

#[test]
fn millimetres_are_understood_and_a_node_may_come_before_its_daemon() {
    let Some(python) = Peer::Cyclone.python() else { return };
    let (instance, domain) = names(1);
    let _node = node(&instance, &domain, &[]);
    let _daemon = daemon(&instance);
    let (found, things) = play(Peer::Cyclone, &python, &domain, "16UC1", 2);
    let last = found["detections"].as_array().unwrap().last().unwrap();
    let objects = last["objects"].as_array().unwrap();
    for thing in &things {
        assert!(objects.iter().any(|object| thing.is_found_by(object)), "{last}");
    }
}

/// ROS 2's own client library: image and camera in, markers and cloud out, under the image's stamp and frame.
#[test]
fn a_node_of_ros_itself_publishes_images_and_reads_markers_and_clouds() {
    let Some(python) = Peer::Ros.python() else { return };
    let (instance, domain) = names(2);
    let _daemon = daemon(&instance);
    let _node = node(&instance, &domain, &[]);
    let (found, things) = play(Peer::Ros, &python, &domain, "32FC1", 12);
    let sent = 1000 + found["sent"].as_i64().unwrap();
    let cloud = found["clouds"].as_array().unwrap().iter().find(|cloud| cloud["count"].as_u64() > Some(500)).unwrap();
    assert_eq!(cloud["fields"], serde_json::json!(["x", "y", "z", "occupancy", "deviation", "object"]));
    assert_eq!((cloud["header"]["frame_id"].as_str(), cloud["header"]["nanosec"].as_i64()), (Some(FRAME), Some(500)));
    assert!((1001..=sent).contains(&cloud["header"]["sec"].as_i64().unwrap()), "{cloud}");
    let first = numbers(&cloud["first"][0]);
    assert!(things.iter().any(|thing| distance(&first[..3], &thing.middle) < 0.15) && (0.5..=1.0).contains(&first[3]), "{first:?}");
    let drawn = found["markers"].as_array().unwrap().last().unwrap().as_array().unwrap();
    let texts = drawn.iter().filter(|marker| marker[0] == "class" && marker[4].as_str().unwrap().starts_with("box "));
    assert_eq!(texts.count(), things.len(), "{drawn:?}");
    assert!(found["nodes"].as_array().unwrap().contains(&"beo".into()), "{found}");
    for (topic, kind) in [("/beo/detections", "vision_msgs/msg/Detection3DArray"), ("/beo/markers", "visualization_msgs/msg/MarkerArray")] {
        assert_eq!(found["topics"][topic], serde_json::json!([kind]), "{}", found["topics"]);
    }
    eprintln!("image published to markers read, ms: {}", found["latency_ms"]);
}

#[test]
fn a_wrong_command_line_is_one_line_and_code_2() {
    for (arguments, word) in [
        (&["--ros-args", "-r", "depth/image"][..], "no remapping"),
        (&["--ros-args", "-p", "colour:=red"], "--colour"),
        (&["--ros-args", "--params-file", "a.yaml"], "not known"),
        (&["--instance", "a/b"], "instance name"),
    ] {
        let output = Command::new(env!("CARGO_BIN_EXE_beo-ros2")).args(arguments).output().unwrap();
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(2), "{said}");
        assert!(said.contains(word), "{said}");
    }
    let help = Command::new(env!("CARGO_BIN_EXE_beo-ros2")).arg("--help").output().unwrap();
    assert!(help.status.success() && String::from_utf8_lossy(&help.stdout).contains("--segmentation"));
}
