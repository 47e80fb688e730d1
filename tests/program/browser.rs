//! `beo view --web` in a real browser: headless Chromium, told what to do over its DevTools protocol.
//!
//! Left out, with a line, where there is no Chromium: `$BEO_CHROMIUM`, or `chromium` or `google-chrome` on the PATH.

use crate::camera::{self, scene};
use crate::client::Client;
use crate::harness::{PATIENCE, Running, beo, dims, instance, seen, serve};
use crate::view::get;
use base64::Engine as _;
use beo_core::grid::Rotation;
use beo_shapes::furniture;
use serde_json::{Value, json};
use std::collections::BTreeSet;
use std::net::TcpStream;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};
use tungstenite::{Message, WebSocket};

const SIZE: [u32; 2] = [1200, 800];

/// A page in a browser of its own.
struct Page {
    socket: WebSocket<TcpStream>,
    asked: u64,
    _browser: Running,
    _profile: tempfile::TempDir,
}

fn chromium() -> Option<String> {
    let named = std::env::var("BEO_CHROMIUM").ok();
    let found = named.into_iter().chain(["chromium", "google-chrome"].map(str::to_owned)).find(|program| {
        let version = Command::new(program).arg("--version").stdout(Stdio::null()).stderr(Stdio::null()).status();
        version.is_ok_and(|status| status.success())
    });
    if found.is_none() {
        eprintln!("skipped: there is no Chromium (apt-get install chromium, or set BEO_CHROMIUM)");
    }
    found
}

impl Page {
    /// Opens an address.
    fn open(program: &str, address: &str) -> Self {
        let profile = tempfile::tempdir().unwrap();
        let mut command = Command::new(program);
        // Without a graphics card; a sandbox of its own cannot be had everywhere, and the page is the project's own.
        command.args(["--headless", "--no-sandbox", "--no-first-run", "--enable-unsafe-swiftshader", "--remote-debugging-port=0"]);
        command.arg(format!("--user-data-dir={}", profile.path().display()));
        command.arg(format!("--window-size={},{}", SIZE[0], SIZE[1])).arg(address);
        let browser = Running::start(command);
        let start = Instant::now();
        let tools = loop {
            let line = browser.message();
            if let Some(tools) = line.strip_prefix("DevTools listening on ws://") {
                break tools.split('/').next().unwrap().to_owned();
            }
            assert!(start.elapsed() < PATIENCE, "the browser says not where it listens");
        };
        let connect = || {
            let stream = TcpStream::connect(&tools).unwrap();
            stream.set_read_timeout(Some(PATIENCE)).unwrap();
            stream
        };
        let path = loop {
            let pages: Vec<Value> = serde_json::from_slice(&get(&tools, "/json/list")).unwrap_or_default();
            let page = pages.iter().find(|page| page["type"] == "page" && page["url"].as_str().is_some_and(|url| url.starts_with(address)));
            if let Some(page) = page {
                break page["webSocketDebuggerUrl"].as_str().unwrap().to_owned();
            }
            assert!(start.elapsed() < PATIENCE, "the browser does not open the page");
            std::thread::sleep(Duration::from_millis(50));
        };
        let (socket, _) = tungstenite::client(&path[..], connect()).unwrap();
        Self { socket, asked: 0, _browser: browser, _profile: profile }
    }

    /// The result of a method of the protocol.
    fn call(&mut self, method: &str, parameters: Value) -> Value {
        self.asked += 1;
        let call = json!({ "id": self.asked, "method": method, "params": parameters }).to_string();
        self.socket.send(Message::Text(call.into())).unwrap();
        loop {
            let Message::Text(text) = self.socket.read().unwrap() else { continue };
            let told: Value = serde_json::from_str(&text).unwrap();
            if told["id"] == self.asked {
                return told["result"].clone();
            }
        }
    }

    /// The value of an expression.
    fn value(&mut self, expression: &str) -> Value {
        self.call("Runtime.evaluate", json!({ "expression": expression }))["result"]["value"].clone()
    }

    /// The text of an element.
    fn text(&mut self, id: &str) -> String {
        let text = self.value(&format!("document.getElementById({id:?})?.textContent ?? ''"));
        text.as_str().unwrap_or_default().to_owned()
    }

    /// A picture: width, height, and RGB of each pixel.
    fn picture(&mut self) -> (u32, u32, Vec<[u8; 3]>) {
        let shot = self.call("Page.captureScreenshot", json!({ "format": "png" }));
        let bytes = base64::engine::general_purpose::STANDARD.decode(shot["data"].as_str().unwrap()).unwrap();
        // Where people can look at it.
        std::fs::write(std::path::Path::new(env!("CARGO_TARGET_TMPDIR")).join("view.png"), &bytes).unwrap();
        let mut reader = png::Decoder::new(std::io::Cursor::new(bytes)).read_info().unwrap();
        let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
        let info = reader.next_frame(&mut pixels).unwrap();
        let samples = info.color_type.samples();
        (info.width, info.height, pixels[..info.buffer_size()].chunks_exact(samples).map(|p| [p[0], p[1], p[2]]).collect())
    }
}

#[test]
fn the_page_shows_live_what_is_perceived() {
    let Some(program) = chromium() else { return };
    let name = instance();
    let _daemon = serve(&name);
    let view = Running::start(beo(["view", "--instance", &name, "--port", "0", "--web", "0"]));
    let address = loop {
        if let Some((_, address)) = view.line().split_once("in a browser: ") {
            break address.trim().to_owned();
        }
    };
    let mut page = Page::open(&program, &address);
    let client = Client::new(&name);
    let object = furniture::make(furniture::CLASSES[2], dims(), 1001).expect("a class of the generator");
    let start = Instant::now();
    let class = loop {
        let asked = client.send(|header, voxels| {
            header.object_id = 7;
            header.pose_search = beo_ipc::PoseSearch::Yaw.code();
            header.view = beo_ipc::View::TopDown.code();
            header.frame_id = beo_ipc::text::to_field("camera");
            seen(&object, &Rotation::identity()).write(voxels);
        });
        let percept = client.percept(asked);
        let class = client.status(|_| true).class_names().nth(percept.class_index as usize).unwrap().to_owned();
        if page.text("objects").contains(&class) {
            break class;
        }
        assert!(start.elapsed() < PATIENCE, "the page shows no {class}: {}, {}", page.text("health"), page.text("objects"));
        std::thread::sleep(Duration::from_millis(100));
    };
    // Health comes once a second, and the log has a line for each answer.
    while page.text("health") != "healthy" && page.text("health") != "serving" {
        assert!(start.elapsed() < PATIENCE, "{}", page.text("health"));
        std::thread::sleep(Duration::from_millis(50));
    }
    assert_eq!(page.text("instance"), name);
    assert!(page.text("lines").contains(&class));
    // The camera's picture: that of its frame, and what its colours mean beside it.
    let folder = tempfile::tempdir().unwrap();
    scene(folder.path());
    let _camera = Running::start(beo(["camera", folder.path().to_str().unwrap(), "--instance", &name, "--loop", "--rate", "5"]));
    let is_hidden = "document.getElementById('camera').hidden";
    while page.value(is_hidden) != false {
        assert!(start.elapsed() < PATIENCE, "the page shows no picture");
        std::thread::sleep(Duration::from_millis(50));
    }
    let side = |name: &str| format!("document.getElementById('picture').{name}");
    let sides = ["width", "height"].map(|name| page.value(&side(name)).as_u64().unwrap() as u32);
    assert!((0..2).all(|axis| sides[axis] > camera::SIZE[axis]), "{sides:?}");
    // Something is drawn in the scene: shaded, so of many colours, where an empty one has those of its ground and lines.
    loop {
        let (width, height, pixels) = page.picture();
        let scene = pixels.iter().enumerate().filter(|(i, _)| (*i as u32 % width) < width / 2 && *i as u32 / width > height / 8);
        let colours: BTreeSet<[u8; 3]> = scene.map(|(_, pixel)| *pixel).collect();
        if colours.len() > 100 {
            break;
        }
        assert!(start.elapsed() < PATIENCE, "the scene has {} colours", colours.len());
        std::thread::sleep(Duration::from_millis(100));
    }
}
