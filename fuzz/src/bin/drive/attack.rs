//! One target for some time.

use crate::memory;
use beo_fuzz::mutation::Mutator;
use beo_fuzz::targets::Target;
use std::collections::BTreeSet;
use std::io::Write;
use std::os::unix::fs::FileExt;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

/// An input that takes longer hangs.
const HANGS: Duration = Duration::from_secs(10);

/// Where the last panic was.
static PANIC: Mutex<String> = Mutex::new(String::new());

/// Inputs run so far: a number that stands still is a hang.
static RUN: AtomicU64 = AtomicU64::new(0);

/// The file that holds the input being run, for when it ends the process.
pub fn current(name: &str) -> PathBuf {
    folder(name).join("current")
}

fn folder(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("artifacts").join(name)
}

/// Runs one input without catching anything.
pub fn once(target: &Target, data: &[u8]) -> ExitCode {
    let before = memory::restart();
    let start = Instant::now();
    (target.run)(data);
    let (bytes, bound) = (memory::most() - before, (target.most_bytes)(data.len()));
    println!("{}: {} bytes, {:?}, {bytes} bytes of memory of {bound} allowed", target.name, data.len(), start.elapsed());
    if bytes > bound { ExitCode::FAILURE } else { ExitCode::SUCCESS }
}

/// Runs hostile inputs for `seconds`.
pub fn run(target: &'static Target, seconds: u64, seed: u64) -> ExitCode {
    std::fs::create_dir_all(folder(target.name)).expect("a writable folder");
    let current = std::fs::File::create(current(target.name)).expect("a writable folder");
    std::panic::set_hook(Box::new(|panic| {
        let place = panic.location().map_or(String::new(), |place| format!("{}:{}", place.file(), place.line()));
        *PANIC.lock().unwrap_or_else(|poisoned| poisoned.into_inner()) =
            format!("panic at {place}: {}", panic.payload_as_str().unwrap_or("?"));
    }));
    let seeds = (target.seeds)();
    // What is made once and kept is not the input's.
    seeds.iter().for_each(|seed| (target.run)(seed));
    std::thread::spawn(move || watch(target.name));

    let mut mutator = Mutator::new(seeds, seed);
    let mut found = BTreeSet::new();
    let mut input = Vec::new();
    let (start, mut count, mut ratio) = (Instant::now(), 0_u64, 0.0_f64);
    while start.elapsed() < Duration::from_secs(seconds) {
        mutator.next_input(&mut input);
        let _ = current.write_all_at(&input, 0).and_then(|()| current.set_len(input.len() as u64));
        let before = memory::restart();
        let outcome = catch_unwind(AssertUnwindSafe(|| (target.run)(&input)));
        let (bytes, bound) = (memory::most().saturating_sub(before), (target.most_bytes)(input.len()));
        count += 1;
        RUN.store(count, Ordering::Relaxed);
        ratio = ratio.max(bytes as f64 / bound as f64);
        let fault = match outcome {
            Err(_) => Some(PANIC.lock().unwrap_or_else(|poisoned| poisoned.into_inner()).clone()),
            Ok(()) if bytes > bound => Some(format!("more memory than {bound} bytes")),
            Ok(()) => None,
        };
        // One input for each place: numbers in the text differ from input to input.
        if let Some(fault) = fault
            && found.insert(fault.split(": ").next().map_or(0, |place| if place.starts_with("more") { 0 } else { hash(place) }))
        {
            println!("{}: FOUND: {fault} ({bytes} bytes of memory); kept as {}", target.name, keep(target.name, &input).display());
        }
    }
    let _ = std::fs::remove_file(self::current(target.name));
    println!(
        "{}: {count} inputs in {seconds} s, seed {seed}: {} findings; at most {:.1} % of the memory allowed",
        target.name,
        found.len(),
        100.0 * ratio
    );
    if found.is_empty() { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}

fn hash(text: &str) -> u32 {
    crc32fast::hash(text.as_bytes())
}

fn keep(name: &str, input: &[u8]) -> PathBuf {
    let path = folder(name).join(format!("{:08x}", crc32fast::hash(input)));
    std::fs::File::create(&path).and_then(|mut file| file.write_all(input)).expect("a writable folder");
    path
}

/// Ends the process when an input takes too long.
fn watch(name: &str) {
    let mut last = u64::MAX;
    loop {
        std::thread::sleep(HANGS);
        let now = RUN.load(Ordering::Relaxed);
        if now == last {
            println!("{name}: FOUND: an input that takes longer than {HANGS:?}");
            std::process::exit(3);
        }
        last = now;
    }
}
