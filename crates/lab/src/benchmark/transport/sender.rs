//! The writing process: it starts the reader, hands over what the plan says, and collects what the reader measured.

use super::ends::{LONGEST_WAIT, Outgoing, PATIENCE, TransportError, fill, system};
use super::plan::{ReaderPlan, bytes};
use super::receiver::{names, place, socket_address};
use super::{ours, raw, stream};
use crate::benchmark::cores::{pin, usable};
use crate::benchmark::percentiles::Percentiles;
use crate::process::Process;
use iceoryx2::prelude::{ipc, ipc_threadsafe};
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use std::io::{Read, Write};
use std::os::fd::AsFd;
use std::os::unix::net::{UnixListener, UnixStream};
use std::process::{ChildStdin, ChildStdout, Command, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// The time for the reader to fall asleep before the next grid.
const PAUSE: Duration = Duration::from_micros(100);
/// Bytes that the pipe may hold: what Linux allows everyone.
const PIPE_BYTES: usize = 1 << 20;

/// Hands over what `plan` says to a reading process, started by `command`, that calls [`super::receive`] with what it finds on a line of
/// standard input. The two have a core each, where there are two. `seen` is called after each stretch. Gives the percentiles of every
/// step, in the plan's order.
///
/// # Errors
/// [`TransportError`]; whatever it is, the reading process has been ended.
pub fn measure(
    plan: &ReaderPlan,
    command: &mut Command,
    stop: &AtomicBool,
    seen: impl FnMut(),
) -> Result<Vec<Percentiles>, TransportError> {
    let cores = usable();
    let (Some(first), Some(last)) = (cores.first(), cores.last()) else { return hand_over(plan, &cores, command, stop, seen) };
    pin(&[*first], || hand_over(plan, &[*last], command, stop, seen))
}

fn hand_over(
    plan: &ReaderPlan,
    readers: &[usize],
    command: &mut Command,
    stop: &AtomicBool,
    mut seen: impl FnMut(),
) -> Result<Vec<Percentiles>, TransportError> {
    let ReaderPlan { name, plan: measured } = plan;
    let listener = UnixListener::bind_addr(&socket_address(name)?).map_err(system("bind a socket"))?;
    let (mut reader, pipe) = ReadingProcess::start(readers, command, plan, stop)?;
    let socket = reader.accept(&listener)?;
    // More is faster; where the system does not allow it, the pipe stays as it is.
    let _ = rustix::pipe::fcntl_setpipe_size(&pipe, PIPE_BYTES);
    let mut ends: Vec<[Box<dyn Outgoing + '_>; 5]> = Vec::new();
    for &side in &measured.sides {
        let (instance, plain) = names(name, side)?;
        ends.push([
            Box::new(ours::Sending::open(&instance, side)?),
            Box::new(raw::Sending::<ipc_threadsafe::Service>::open(&plain, side)?),
            Box::new(raw::Sending::<ipc::Service>::open(&format!("{plain}-local"), side)?),
            Box::new(stream::Sending::new(&socket, bytes(side))),
            Box::new(stream::Sending::new(&pipe, bytes(side))),
        ]);
    }
    for step in measured.steps() {
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
    reader.finish(measured.steps().count())
}

/// The reading process, and what it says.
struct ReadingProcess<'a> {
    process: Process,
    output: ChildStdout,
    stop: &'a AtomicBool,
}

impl<'a> ReadingProcess<'a> {
    /// Starts it on these cores, and says on a line what it is to do. Its input must be dropped before it: it may be reading.
    fn start(
        cores: &[usize],
        command: &mut Command,
        plan: &ReaderPlan,
        stop: &'a AtomicBool,
    ) -> Result<(Self, ChildStdin), TransportError> {
        let start = || Process::start("the reading process", command.stdin(Stdio::piped())).map_err(TransportError::from);
        let mut process = pin(cores, start)?;
        let (mut input, output) = (process.input()?, process.output()?);
        let line = serde_json::to_string(plan).map_err(|error| system("write the plan")(error.into()))?;
        writeln!(input, "{line}").map_err(system("write the plan"))?;
        Ok((Self { process, output, stop }, input))
    }

    fn accept(&mut self, listener: &UnixListener) -> Result<UnixStream, TransportError> {
        wait_for(listener, &mut self.process, self.stop)?;
        listener.accept().map(|(stream, _)| stream).map_err(system("accept the reading process"))
    }

    /// Waits for one byte.
    fn expect(&mut self, expected: u8) -> Result<(), TransportError> {
        wait_for(&self.output, &mut self.process, self.stop)?;
        let mut byte = [0];
        match self.output.read_exact(&mut byte) {
            Ok(()) if byte[0] == expected => Ok(()),
            _ => Err(TransportError::Silent),
        }
    }

    /// The figures of `steps` steps, and the end of the process.
    fn finish(mut self, steps: usize) -> Result<Vec<Percentiles>, TransportError> {
        wait_for(&self.output, &mut self.process, self.stop)?;
        let mut text = String::new();
        self.output.read_to_string(&mut text).map_err(system("read the figures"))?;
        self.process.finish(PATIENCE)?;
        let figures: Vec<Percentiles> = serde_json::from_str(&text).map_err(|error| system("read the figures")(error.into()))?;
        if figures.len() == steps { Ok(figures) } else { Err(TransportError::Silent) }
    }
}

/// Waits until something can be read or accepted, as long as `process` runs.
fn wait_for(what: &impl AsFd, process: &mut Process, stop: &AtomicBool) -> Result<(), TransportError> {
    let start = Instant::now();
    let longest = Timespec { tv_sec: 0, tv_nsec: LONGEST_WAIT.as_nanos() as i64 };
    while start.elapsed() < PATIENCE && !stop.load(Ordering::Relaxed) {
        match poll(&mut [PollFd::new(what, PollFlags::IN)], Some(&longest)) {
            Ok(0) | Err(rustix::io::Errno::INTR) if !process.is_running() => return Err(TransportError::Silent),
            Ok(0) | Err(rustix::io::Errno::INTR) => {}
            Ok(_) => return Ok(()),
            Err(error) => return Err(system("wait for the reading process")(error.into())),
        }
    }
    if stop.load(Ordering::Relaxed) { Err(TransportError::Interrupted) } else { Err(TransportError::Silent) }
}
