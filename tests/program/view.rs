//! `beo view`: what viewers get over WebSockets, by a client of the protocol that shares nothing with the server but the WebSocket itself.

use crate::camera::scene;
use crate::client::{Client, block};
use crate::harness::{PATIENCE, Running, beo, dims, instance, run, seen, serve, text};
use beo::recording::Topic;
use beo_core::grid::Rotation;
use beo_ipc::PoseSearch;
use beo_shapes::furniture;
use foxglove::Decode;
use foxglove::messages::{CompressedImage, FrameTransform, Log, PointCloud, PoseInFrame, SceneUpdate};
use rustix::process::Signal;
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::io::{BufRead as _, BufReader, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::time::{SystemTime, UNIX_EPOCH};
use tungstenite::client::IntoClientRequest;
use tungstenite::{Message, WebSocket};

/// The view of an instance on any free port, and that port.
fn view(name: &str, more: &[&str]) -> (Running, u16) {
    let view = Running::start(beo(["view", "--instance", name, "--port", "0"].iter().chain(more)));
    let line = view.line();
    assert!(line.starts_with(&format!("viewing `{name}` at ws://127.0.0.1:")), "{line}");
    assert!(view.line().starts_with("layout: "));
    (view, port_in(&line))
}

/// The port of the address of this machine in a line.
fn port_in(line: &str) -> u16 {
    let digits = line.split("127.0.0.1:").nth(1).map(|rest| rest.chars().take_while(char::is_ascii_digit).collect::<String>());
    digits.unwrap().parse().unwrap()
}

/// What a server has at a path; it may leave the connection open.
pub fn get(server: &str, path: &str) -> Vec<u8> {
    let mut stream = TcpStream::connect(server).unwrap();
    stream.set_read_timeout(Some(PATIENCE)).unwrap();
    stream.write_all(format!("GET {path} HTTP/1.1\r\nHost: {server}\r\n\r\n").as_bytes()).unwrap();
    let mut answer = BufReader::new(stream);
    let head: Vec<String> = answer.by_ref().lines().map(Result::unwrap).take_while(|line| !line.is_empty()).collect();
    assert_eq!(head[0], "HTTP/1.1 200 OK");
    let length = head.iter().filter_map(|line| line.split_once(':')).find(|(name, _)| name.eq_ignore_ascii_case("content-length"));
    let mut body = vec![0; length.unwrap().1.trim().parse().unwrap()];
    answer.read_exact(&mut body).unwrap();
    body
}

/// A message of a channel: its topic, when it was logged, and its bytes.
struct Received {
    topic: String,
    logged_ns: u64,
    data: Vec<u8>,
}

impl Received {
    fn json(&self) -> Value {
        serde_json::from_slice(&self.data).unwrap()
    }
}

/// A viewer.
struct Viewer {
    socket: WebSocket<TcpStream>,
    /// What was advertised, by the number of the channel.
    channels: BTreeMap<u64, Value>,
}

impl Viewer {
    fn connect(port: u16) -> Self {
        let stream = TcpStream::connect(("127.0.0.1", port)).unwrap();
        stream.set_read_timeout(Some(PATIENCE)).unwrap();
        let mut request = format!("ws://127.0.0.1:{port}").into_client_request().unwrap();
        request.headers_mut().insert("sec-websocket-protocol", "foxglove.sdk.v1".parse().unwrap());
        let (socket, response) = tungstenite::client(request, stream).unwrap();
        assert_eq!(response.headers()["sec-websocket-protocol"], "foxglove.sdk.v1");
        let mut viewer = Self { socket, channels: BTreeMap::new() };
        assert_eq!(viewer.told()["op"], "serverInfo");
        while viewer.channels.len() < Topic::ALL.len() {
            let advertised = viewer.told();
            assert_eq!(advertised["op"], "advertise");
            for channel in advertised["channels"].as_array().unwrap() {
                viewer.channels.insert(channel["id"].as_u64().unwrap(), channel.clone());
            }
        }
        viewer
    }

    /// The next message that is no channel's.
    fn told(&mut self) -> Value {
        loop {
            if let Message::Text(text) = self.socket.read().unwrap() {
                return serde_json::from_str(&text).unwrap();
            }
        }
    }

    /// Subscribes to all topics, and waits until that is in force.
    fn subscribe(&mut self) {
        let all: Vec<Value> = self.channels.keys().map(|id| json!({ "id": id, "channelId": id })).collect();
        let subscribe = json!({ "op": "subscribe", "subscriptions": all }).to_string();
        self.socket.send(Message::Text(subscribe.into())).unwrap();
        // The daemon's health comes once a second.
        while self.next().expect("a status").topic != "/beo/status" {}
    }

    /// The next message of a channel; `None` after the server's goodbye, or the connection's end.
    fn next(&mut self) -> Option<Received> {
        loop {
            match self.socket.read() {
                Ok(Message::Binary(bytes)) => {
                    assert_eq!(bytes[0], 1, "the operation `message data`");
                    let number = u32::from_le_bytes(bytes[1..5].try_into().unwrap());
                    let logged_ns = u64::from_le_bytes(bytes[5..13].try_into().unwrap());
                    let topic = self.channels[&u64::from(number)]["topic"].as_str().unwrap().to_owned();
                    return Some(Received { topic, logged_ns, data: bytes[13..].to_vec() });
                }
                Ok(Message::Close(_)) | Err(_) => return None,
                Ok(_) => {}
            }
        }
    }

    /// The messages of an answer by topic, from its percept on to its surface.
    fn answer(&mut self, sequence: u64) -> BTreeMap<String, Received> {
        let mut answer = BTreeMap::new();
        while !answer.contains_key("/beo/completion") {
            let message = self.next().expect("an answer");
            let is_wanted = message.topic == "/beo/percept" && message.json()["sequence"] == sequence;
            if is_wanted || answer.contains_key("/beo/percept") {
                answer.insert(message.topic.clone(), message);
            }
        }
        answer
    }
}

fn now_ns() -> u64 {
    SystemTime::now().duration_since(UNIX_EPOCH).unwrap().as_nanos() as u64
}

/// How long before its sending the observation was taken.
const TAKEN_BEFORE_NS: u64 = 5_000_000_000;

#[test]
fn viewers_get_every_answer_with_its_class_and_the_time_of_its_capture() {
    let name = instance();
    let _daemon = serve(&name);
    let (_view, port) = view(&name, &[]);
    // Who does not speak the protocol is turned away, and hinders nobody.
    let mut stranger = TcpStream::connect(("127.0.0.1", port)).unwrap();
    stranger.write_all(b"GET / HTTP/1.1\r\nHost: there\r\n\r\n").unwrap();
    stranger.set_read_timeout(Some(PATIENCE)).unwrap();
    let _ = stranger.read(&mut [0; 64]);
    let mut silent = TcpStream::connect(("127.0.0.1", port)).unwrap();
    silent.write_all(b"\x16\x03\x01\0\0").unwrap();

    let mut viewer = Viewer::connect(port);
    for channel in viewer.channels.values() {
        let topic = Topic::ALL.into_iter().find(|topic| topic.name() == channel["topic"]).expect("a known topic");
        assert_eq!(channel["encoding"], topic.encoding());
        assert_eq!(channel["schemaName"], topic.schema().unwrap().name);
    }
    viewer.subscribe();
    let client = Client::new(&name);
    let object = furniture::make(furniture::CLASSES[2], dims(), 1001).expect("a class of the generator");
    let before_ns = now_ns();
    let (mut capture_ns, clock) = (0, beo::recording::Clock::now());
    let asked = client.send(|header, voxels| {
        header.object_id = 7;
        header.pose_search = PoseSearch::Yaw.code();
        header.view = beo_ipc::View::TopDown.code();
        header.frame_id = beo_ipc::text::to_field("camera");
        header.capture_ns -= TAKEN_BEFORE_NS;
        capture_ns = header.capture_ns;
        seen(&object, &Rotation::identity()).write(voxels);
    });
    let percept = client.percept(asked);
    let answer = viewer.answer(percept.sequence);
    let class = &answer["/beo/percept"].json()["class"];
    let class = class.as_str().expect("a class");
    let status = client.status(|_| true);
    assert_eq!(class, status.class_names().nth(percept.class_index as usize).unwrap());

    // The clocks' offset is asked for here and there, not at the same time.
    let is_capture = |seconds: u32, nanoseconds: u32| {
        let stamp_ns = u64::from(seconds) * 1_000_000_000 + u64::from(nanoseconds);
        let expected_ns = clock.day_ns(capture_ns);
        assert!(stamp_ns.abs_diff(expected_ns) < TAKEN_BEFORE_NS / 2, "{stamp_ns} for {expected_ns}");
    };
    let cloud = PointCloud::decode(&answer["/beo/observation"].data[..]).unwrap();
    let stamp = cloud.timestamp.unwrap();
    is_capture(stamp.sec(), stamp.nsec());
    assert_eq!(cloud.frame_id, "camera");
    assert!(!cloud.data.is_empty());
    let object = SceneUpdate::decode(&answer["/beo/object"].data[..]).unwrap();
    let entity = &object.entities[0];
    assert_eq!(entity.id, "camera1/object7 object");
    assert!(entity.texts[0].text.starts_with(class));
    let stamp = entity.timestamp.unwrap();
    is_capture(stamp.sec(), stamp.nsec());
    assert!(entity.lifetime.unwrap().sec() > 0, "what is not perceived again disappears");
    let bars = SceneUpdate::decode(&answer["/beo/classes"].data[..]).unwrap();
    assert!(bars.entities[0].texts[0].text.starts_with(class));
    let surface = SceneUpdate::decode(&answer["/beo/completion"].data[..]).unwrap();
    assert!(surface.entities[0].triangles[0].indices.len() > 100);
    assert!(!PointCloud::decode(&answer["/beo/completion_points"].data[..]).unwrap().data.is_empty());
    assert_eq!(PoseInFrame::decode(&answer["/beo/pose"].data[..]).unwrap().frame_id, "camera");
    assert_eq!(FrameTransform::decode(&answer["/tf"].data[..]).unwrap().child_frame_id, "camera1/object7");
    assert!(Log::decode(&answer["/beo/log"].data[..]).unwrap().message.contains(class));
    assert!(answer.values().all(|message| (before_ns..=now_ns()).contains(&message.logged_ns)));
    loop {
        let message = viewer.next().expect("a status");
        if message.topic == "/beo/status" && message.json()["observations"]["answered"] == 1 {
            assert_eq!(message.json()["healthy"], true);
            break;
        }
    }
}

/// The camera draws for the viewer as for `--png`: the same picture, but for the objects' captions and all that a frame's number changes.
#[test]
fn viewers_get_the_pictures_of_a_camera_while_they_look() {
    let (name, folder) = (instance(), tempfile::tempdir().unwrap());
    let (frames, drawn) = (folder.path().join("frames"), folder.path().join("drawn"));
    std::fs::create_dir_all(&frames).unwrap();
    scene(&frames);
    let _daemon = serve(&name);
    let (_view, port) = view(&name, &[]);
    let mut viewer = Viewer::connect(port);
    viewer.subscribe();
    let arguments = ["camera", frames.to_str().unwrap(), "--instance", &name, "--frame-id", "wrist", "--loop", "--rate", "20"];
    let mut camera = Running::start(beo(arguments.into_iter().chain(["--png", drawn.to_str().unwrap()])));
    // The camera looks for viewers four times a second.
    let [first, second] = [(); 2].map(|()| {
        loop {
            let message = viewer.next().expect("a picture");
            if message.topic == "/beo/picture" {
                break CompressedImage::decode(&message.data[..]).unwrap();
            }
        }
    });
    assert_eq!((&*first.frame_id, &*first.format), ("wrist", "png"));
    let [earlier, later] = [&first, &second].map(|image| image.timestamp.map(|stamp| (stamp.sec(), stamp.nsec())).unwrap());
    assert!(earlier < later);
    camera.signal(Signal::INT);
    assert!(camera.wait().success());
    let file = std::fs::read_dir(&drawn).unwrap().next().unwrap().unwrap().path();
    assert_eq!(decoded(&first.data), decoded(&std::fs::read(file).unwrap()));
}

/// Size and pixels.
fn decoded(png: &[u8]) -> ((u32, u32), Vec<u8>) {
    let mut reader = png::Decoder::new(std::io::Cursor::new(png)).read_info().unwrap();
    let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
    reader.next_frame(&mut pixels).unwrap();
    (reader.info().size(), pixels)
}

#[test]
fn a_viewer_that_never_reads_delays_neither_the_others_nor_the_end() {
    let name = instance();
    let _daemon = serve(&name);
    let (mut view, port) = view(&name, &[]);
    let mut stuck = Viewer::connect(port);
    stuck.subscribe();
    let mut reader = Viewer::connect(port);
    reader.subscribe();
    let client = Client::new(&name);
    let asked = 400;
    let read = std::thread::spawn(move || {
        let mut percepts = 0;
        loop {
            let message = reader.next().expect("the last answer");
            if message.topic == "/beo/percept" {
                percepts += 1;
                if message.json()["object_id"] == asked {
                    return percepts;
                }
            }
        }
    });
    for object in 1..=asked {
        let percept = client.ask(|header, voxels| {
            header.object_id = object;
            block(voxels);
        });
        assert_eq!(percept.object_id, object);
    }
    assert!(read.join().unwrap() > 0);
    view.signal(Signal::INT);
    assert!(view.wait().success(), "a viewer that does not listen to the goodbye does not keep it from ending");
    // Less was still on its way to the one that did not read than was sent to it.
    let late = std::iter::from_fn(|| stuck.next()).filter(|message| message.topic == "/beo/percept").count();
    assert!(late < asked as usize, "{late}");
}

#[test]
fn an_interrupt_says_goodbye_to_viewers_and_leaves_the_port() {
    for signal in [Signal::INT, Signal::TERM] {
        let name = instance();
        let _daemon = serve(&name);
        let (mut view, port) = view(&name, &[]);
        let mut viewer = Viewer::connect(port);
        viewer.subscribe();
        view.signal(signal);
        assert!(view.wait().success());
        // The goodbye is sent where there is time for it; the connection ends in any case.
        while viewer.next().is_some() {}
        assert!(TcpStream::connect(("127.0.0.1", port)).is_err());
    }
}

#[test]
fn an_address_that_cannot_be_listened_on_is_one_line_that_says_what_to_do() {
    let taken = TcpListener::bind("127.0.0.1:0").unwrap();
    let port = taken.local_addr().unwrap().port().to_string();
    for (arguments, advice) in
        [(["--port", &port], "another program has this port"), (["--host", "192.0.2.1"], "an address of this machine")]
    {
        let output = run(["view", "--instance", &instance()].into_iter().chain(arguments));
        let message = text(&output.stderr);
        assert_eq!(output.status.code(), Some(1), "{message}");
        assert_eq!(message.trim_end().lines().count(), 1, "{message}");
        assert!(message.contains("cannot listen on ") && message.contains(advice), "{message}");
    }
}

#[test]
fn impossible_times_are_wrong_usage() {
    for seconds in ["0", "-1", "nan", "1e300"] {
        let output = run(["view", &format!("--keep={seconds}")]);
        assert_eq!(output.status.code(), Some(2), "{seconds}: {}", text(&output.stderr));
    }
}

#[test]
fn the_page_for_browsers_leads_to_the_viewers_port() {
    let name = instance();
    let _daemon = serve(&name);
    let (view, port) = view(&name, &["--web", "0"]);
    let line = view.line();
    assert!(line.starts_with("in a browser: http://127.0.0.1:"), "{line}");
    let get = |path: &str| text(&get(&format!("127.0.0.1:{}", port_in(&line)), path));
    assert!(get("/").contains("<script type=\"module\" src=\"main.js\">"));
    let server: Value = serde_json::from_str(&get("/server.json")).unwrap();
    assert_eq!(server["port"], port);
    Viewer::connect(port).subscribe();
}

#[test]
fn the_layout_shows_topics_that_there_are() {
    let output = run(["view", "--layout"]);
    assert!(output.status.success());
    let layout: Value = serde_json::from_slice(&output.stdout).unwrap();
    let panels = layout["configById"].as_object().unwrap();
    let mut topics: Vec<&str> = panels["3D!beo"]["topics"].as_object().unwrap().keys().map(String::as_str).collect();
    topics.push(panels["Indicator!health"]["path"].as_str().unwrap().split('.').next().unwrap());
    for plot in ["Plot!latency", "Plot!load"] {
        topics.extend(
            panels[plot]["paths"].as_array().unwrap().iter().map(|path| path["value"].as_str().unwrap().split('.').next().unwrap()),
        );
    }
    topics.push(panels["Image!picture"]["imageMode"]["imageTopic"].as_str().unwrap());
    topics.push(panels["RosOut!log"]["topicToRender"].as_str().unwrap());
    topics.push(panels["RawMessages!percept"]["topicPath"].as_str().unwrap());
    for topic in topics {
        assert!(Topic::ALL.iter().any(|known| known.name() == topic), "{topic}");
    }
    let drawn = layout["layout"].to_string();
    assert!(panels.keys().all(|panel| drawn.contains(panel.as_str())), "each panel has its place");
}
