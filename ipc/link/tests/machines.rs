//! Two machines on one: network, mounts (so shared memory and iceoryx2's files) and clocks of their own, joined by a wire. On the near one
//! runs the real daemon; on the far one, whose clock is a day ahead, the program's own clients see, ask and reload it over the link.
//!
//! Left out, with a line, where `$BEO_PROGRAM` does not name the program `beo`, or where this may not make namespaces (util-linux, iproute2).

use std::io::{BufRead as _, BufReader, Read};
use std::path::Path;
use std::process::{Child, Command, Output, Stdio};
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::time::{Duration, Instant};

/// No step takes longer on the slowest machine.
const PATIENCE: Duration = Duration::from_secs(120);
const DAY_S: u64 = 86_400;
/// Of documentation (RFC 5737): no machine has them.
const NEAR: &str = "192.0.2.1";
const FAR: &str = "192.0.2.2";

/// A process that is ended when dropped, by this signal.
struct Running(Child, &'static str);

impl Drop for Running {
    fn drop(&mut self) {
        let _ = Command::new("kill").args([self.1, &self.0.id().to_string()]).stderr(Stdio::null()).status();
        let start = Instant::now();
        while start.elapsed() < Duration::from_secs(20) {
            if !matches!(self.0.try_wait(), Ok(None)) {
                return;
            }
            std::thread::sleep(Duration::from_millis(5));
        }
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// Namespaces, as long as the process lives that holds them.
struct Machine {
    _holder: Running,
    process: String,
}

impl Machine {
    /// A machine whose clock is ahead by so many seconds; none where that may not be.
    fn new(ahead_s: u64) -> Option<Self> {
        // Where iceoryx2 keeps its segments and its files.
        let lonely = "mount -t tmpfs -o size=1g,mode=1777 tmpfs /dev/shm && mkdir -p /tmp/iceoryx2 && mount -t tmpfs tmpfs /tmp/iceoryx2 \
                      && ip link set lo up && echo $$ && exec sleep 600";
        let clock = ["--time", &format!("--monotonic={ahead_s}"), &format!("--boottime={ahead_s}")].map(str::to_owned);
        let mut command = Command::new("unshare");
        command.args(["--net", "--mount"]).args(&clock).args(["--fork", "--kill-child", "sh", "-c", lonely]);
        let child = command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::null()).spawn().ok()?;
        let mut holder = Running(child, "-KILL");
        let process = BufReader::new(holder.0.stdout.take()?).lines().next()?.ok()?;
        Some(Self { _holder: holder, process })
    }

    /// A command on it.
    fn command(&self, program: &str) -> Command {
        let mut command = Command::new("nsenter");
        command.args(["--target", &self.process, "--net", "--mount", "--time", "--", program]).stdin(Stdio::null());
        command
    }

    fn run(&self, program: &str, arguments: &[&str]) -> Output {
        let output = self.command("timeout").args([&PATIENCE.as_secs().to_string(), program]).args(arguments).output().unwrap();
        assert_ne!(output.status.code(), Some(124), "{program} {arguments:?} does not end");
        output
    }

    /// A command that runs on, and what it says on standard output and error.
    fn start(&self, program: &str, arguments: &[&str]) -> (Running, Receiver<String>) {
        let mut child = self.command(program).args(arguments).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
        let (say, said) = channel();
        let streams: [Box<dyn Read + Send>; 2] = [Box::new(child.stdout.take().unwrap()), Box::new(child.stderr.take().unwrap())];
        for stream in streams {
            let say = say.clone();
            std::thread::spawn(move || BufReader::new(stream).lines().map_while(Result::ok).try_for_each(|line| say.send(line)));
        }
        (Running(child, "-INT"), said)
    }
}

/// The next line that is said with some words in it.
fn next_line(said: &Receiver<String>, words: &str) -> String {
    let start = Instant::now();
    while start.elapsed() < PATIENCE {
        match said.recv_timeout(Duration::from_millis(100)) {
            Ok(line) if line.contains(words) => return line,
            Ok(line) => eprintln!("{line}"),
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => break,
        }
    }
    panic!("nothing is said with `{words}`");
}

/// A wire between two machines.
fn wire(near: &Machine, far: &Machine) -> bool {
    let configured = |machine: &Machine, arguments: &[&str]| machine.run("ip", arguments).status.success();
    configured(near, &["link", "add", "wire", "type", "veth", "peer", "name", "wire", "netns", &far.process])
        && [(near, NEAR), (far, FAR)].into_iter().all(|(machine, address)| {
            configured(machine, &["addr", "add", &format!("{address}/24"), "dev", "wire"])
                && configured(machine, &["link", "set", "wire", "up"])
        })
}

fn machines() -> Option<(String, Machine, Machine)> {
    let Ok(beo) = std::env::var("BEO_PROGRAM") else {
        eprintln!("skipped: BEO_PROGRAM does not name the program beo");
        return None;
    };
    let machines = Machine::new(0).zip(Machine::new(DAY_S)).filter(|(near, far)| wire(near, far));
    if machines.is_none() {
        eprintln!("skipped: namespaces cannot be made here (root, util-linux and iproute2 are needed)");
    }
    machines.map(|(near, far)| (beo, near, far))
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// The number after a key of one line of JSON, what follows its point left out.
fn number(line: &str, key: &str) -> u64 {
    let from = line.find(&format!("\"{key}\":")).unwrap_or_else(|| panic!("no {key} in {line}")) + key.len() + 3;
    let digits: String = line[from..].trim_start().chars().take_while(char::is_ascii_digit).collect();
    digits.parse().unwrap_or_else(|_| panic!("{key} is no number in {line}"))
}

#[test]
fn clients_a_day_ahead_see_ask_and_reload_a_daemon_on_another_machine_through_a_cut() {
    let Some((beo, near, far)) = machines() else { return };
    let model = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../models/household.safetensors");
    let model = model.canonicalize().unwrap();
    let model = model.to_str().unwrap();
    let folder = tempfile::tempdir().unwrap();
    let shapes = folder.path().to_str().unwrap();
    assert!(
        Command::new(&beo)
            .args(["generate", "household", "--count", "1", "--out", shapes])
            .stdout(Stdio::null())
            .status()
            .unwrap()
            .success()
    );
    let mug = std::fs::read_dir(folder.path().join("mug/train")).unwrap().next().unwrap().unwrap().path();
    let mug = mug.to_str().unwrap();

    let (_daemon, said) = near.start(&beo, &["serve", "--model", model]);
    next_line(&said, "serving");
    let (link, endpoint) = (env!("CARGO_BIN_EXE_beo-link"), format!("tcp/{NEAR}:7447"));
    let (_near_end, near_says) = near.start(link, &["near", "--listen", &endpoint]);
    let (_far_end, far_says) = far.start(link, &["far", "--connect", &endpoint]);
    next_line(&near_says, "near end");
    next_line(&far_says, "is played; the other clock is -86");

    // The clocks are a day apart, and nobody knows of it but the link.
    let uptime = |machine: &Machine| -> f64 {
        let said = text(&machine.run("cat", &["/proc/uptime"]).stdout);
        said.split_whitespace().next().unwrap().parse().unwrap()
    };
    assert!((uptime(&far) - uptime(&near) - DAY_S as f64).abs() < PATIENCE.as_secs_f64());
    let status = far.run(&beo, &["status", "--wait", "60", "--json"]);
    assert!(status.status.success(), "{}{}", text(&status.stdout), text(&status.stderr));
    let line = text(&status.stdout);
    assert!(number(&line, "uptime_s") < PATIENCE.as_secs() && number(&line, "heartbeat_age_s") < PATIENCE.as_secs(), "{line}");

    let pictures = folder.path().join("pictures");
    // Watches, asks, and reads as many percepts.
    let ask = |count: usize| -> Vec<String> {
        let counted = count.to_string();
        let arguments = ["watch", "--json", "--count", &counted, "--png", pictures.to_str().unwrap()];
        let (_watcher, said) = far.start(&beo, &arguments);
        next_line(&said, "watching");
        let output = far.run(&beo, &["observe", mug, "--count", &counted, "--rate", "20"]);
        assert!(output.status.success(), "{}{}", text(&output.stdout), text(&output.stderr));
        (0..count).map(|_| next_line(&said, "\"posterior\"")).collect()
    };
    let lines = ask(20);
    for line in &lines {
        assert!(line.contains("\"class\":\"mug\""), "{line}");
        // From the capture here to the percept that was published there, by one clock: neither nothing nor a day.
        assert!((1..PATIENCE.as_micros() as u64).contains(&number(line, "latency_us")), "{line}");
    }
    // Completions came too: what they say is drawn.
    assert!(std::fs::read_dir(&pictures).unwrap().count() >= 20);

    let reload = |model: &str| far.run(&beo, &["reload", "--model", model]);
    let served = reload(model);
    assert!(served.status.success() && text(&served.stdout).contains("serves model"), "{}{}", text(&served.stdout), text(&served.stderr));
    let refused = reload("/nowhere.safetensors");
    assert_eq!(refused.status.code(), Some(1));
    assert!(text(&refused.stderr).contains("refused the model") && text(&refused.stderr).contains("/nowhere"), "{}", text(&refused.stderr));

    // For three seconds and more the wire is cut: clients are told that no daemon runs, and go on when it is there again.
    let set = |state: &str| assert!(near.run("ip", &["link", "set", "wire", state]).status.success());
    set("down");
    let start = Instant::now();
    while far.run(&beo, &["status"]).status.success() {
        assert!(start.elapsed() < PATIENCE, "the far end plays on without a link");
        std::thread::sleep(Duration::from_millis(200));
    }
    set("up");
    let back = far.run(&beo, &["status", "--wait", "100", "--json"]);
    assert!(back.status.success(), "{}{}", text(&back.stdout), text(&back.stderr));
    assert_eq!(ask(5).len(), 5);
}
