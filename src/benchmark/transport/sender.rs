//! The writing process: it starts the reader, hands over what the plan says, and collects what the reader measured.

use super::ends::{LONGEST_WAIT, Outgoing, PATIENCE, TransportError, fill, system};
use super::plan::{Plan, bytes};
use super::receiver::{names, place, socket_address};
use super::{ours, raw, stream};
use crate::benchmark::machine::pin;
use crate::benchmark::percentiles::Percentiles;
use iceoryx2::prelude::{ipc, ipc_threadsafe};
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use std::io::Read;
use std::os::fd::AsFd;
use std::os::unix::net::{UnixListener, UnixStream};
use std::process::{Child, ChildStdout, Command, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// What the reader is given to fall asleep before the next grid.
const PAUSE: Duration = Duration::from_micros(100);
/// Bytes that the pipe may hold: what Linux allows everyone.
const PIPE_BYTES: usize = 1 << 20;

/// Runs `plan` with a reading process, started by `command`, that calls [`super::receive`] with the same plan and `name`. `seen` is
/// called after each stretch. Gives the percentiles of every step, in the plan's order.
pub fn measure(
    name: &str,
    plan: &Plan,
    command: Command,
    stop: &AtomicBool,
    mut seen: impl FnMut(),
) -> Result<Vec<Percentiles>, TransportError> {
    let listener = UnixListener::bind_addr(&socket_address(name)?).map_err(system("bind a socket"))?;
    let mut reader = ReadingProcess::start(command, stop)?;
    let socket = reader.accept(&listener)?;
    // After the reader was started, which takes a core of its own.
    pin(0);
    let pipe = reader.child.stdin.take().ok_or_else(|| system("open a pipe")(std::io::ErrorKind::BrokenPipe.into()))?;
    // More is faster; where the system does not allow it, the pipe stays as it is.
    let _ = rustix::pipe::fcntl_setpipe_size(&pipe, PIPE_BYTES);
    let mut ends: Vec<[Box<dyn Outgoing + '_>; 5]> = Vec::new();
    for &side in &plan.sides {
        let (instance, plain) = names(name, side)?;
        ends.push([
            Box::new(ours::Sending::open(&instance, side)?),
            Box::new(raw::Sending::<ipc_threadsafe::Service>::open(&plain, side)?),
            Box::new(raw::Sending::<ipc::Service>::open(&format!("{plain}-local"), side)?),
            Box::new(stream::Sending::new(&socket, bytes(side))),
            Box::new(stream::Sending::new(&pipe, bytes(side))),
        ]);
    }
    for step in plan.steps() {
        reader.expect(b'r')?;
        for count in 0..step.warm_up + step.messages {
            let begin = Instant::now();
            while begin.elapsed() < PAUSE {
                std::hint::spin_loop();
            }
            ends[step.grid][place(step.exchange.way)].send(fill(step.exchange.work, count))?;
            reader.expect(b'.')?;
        }
        seen();
    }
    reader.finish(plan.steps().count())
}

/// The reading process; killed when dropped before its end.
struct ReadingProcess<'a> {
    child: Child,
    output: ChildStdout,
    stop: &'a AtomicBool,
}

impl<'a> ReadingProcess<'a> {
    fn start(mut command: Command, stop: &'a AtomicBool) -> Result<Self, TransportError> {
        let mut child = command.stdin(Stdio::piped()).stdout(Stdio::piped()).spawn().map_err(system("start the reading process"))?;
        let output = child.stdout.take().ok_or_else(|| system("read from the reading process")(std::io::ErrorKind::BrokenPipe.into()))?;
        Ok(Self { child, output, stop })
    }

    fn accept(&mut self, listener: &UnixListener) -> Result<UnixStream, TransportError> {
        wait_for(listener, &mut self.child, self.stop)?;
        listener.accept().map(|(stream, _)| stream).map_err(system("accept the reading process"))
    }

    /// Waits for one byte.
    fn expect(&mut self, expected: u8) -> Result<(), TransportError> {
        wait_for(&self.output, &mut self.child, self.stop)?;
        let mut byte = [0];
        match self.output.read_exact(&mut byte) {
            Ok(()) if byte[0] == expected => Ok(()),
            _ => Err(TransportError::Silent),
        }
    }

    /// The figures of `steps` steps, and the end of the process.
    fn finish(mut self, steps: usize) -> Result<Vec<Percentiles>, TransportError> {
        wait_for(&self.output, &mut self.child, self.stop)?;
        let mut text = String::new();
        self.output.read_to_string(&mut text).map_err(system("read the figures"))?;
        let figures: Vec<Percentiles> = serde_json::from_str(&text).map_err(|error| system("read the figures")(error.into()))?;
        self.has_ended_within(PATIENCE);
        if figures.len() == steps { Ok(figures) } else { Err(TransportError::Silent) }
    }

    fn has_ended_within(&mut self, patience: Duration) -> bool {
        let start = Instant::now();
        loop {
            match self.child.try_wait() {
                Ok(None) if start.elapsed() < patience => std::thread::sleep(Duration::from_millis(5)),
                ended => return !matches!(ended, Ok(None)),
            }
        }
    }
}

impl Drop for ReadingProcess<'_> {
    /// Ends it as Ctrl-C would, so that it leaves nothing in shared memory; what does not end is killed.
    fn drop(&mut self) {
        if !self.has_ended_within(Duration::ZERO) {
            if let Some(pid) = rustix::process::Pid::from_raw(self.child.id() as i32) {
                let _ = rustix::process::kill_process(pid, rustix::process::Signal::INT);
            }
            if !self.has_ended_within(Duration::from_secs(5)) {
                let _ = self.child.kill();
                let _ = self.child.wait();
            }
        }
    }
}

/// Waits until something can be read or accepted, as long as `child` runs.
fn wait_for(what: &impl AsFd, child: &mut Child, stop: &AtomicBool) -> Result<(), TransportError> {
    let start = Instant::now();
    let longest = Timespec { tv_sec: 0, tv_nsec: LONGEST_WAIT.as_nanos() as i64 };
    while start.elapsed() < PATIENCE && !stop.load(Ordering::Relaxed) {
        match poll(&mut [PollFd::new(what, PollFlags::IN)], Some(&longest)) {
            Ok(0) | Err(rustix::io::Errno::INTR) if !matches!(child.try_wait(), Ok(None)) => return Err(TransportError::Silent),
            Ok(0) | Err(rustix::io::Errno::INTR) => {}
            Ok(_) => return Ok(()),
            Err(error) => return Err(system("wait for the reading process")(error.into())),
        }
    }
    if stop.load(Ordering::Relaxed) { Err(TransportError::Interrupted) } else { Err(TransportError::Silent) }
}
