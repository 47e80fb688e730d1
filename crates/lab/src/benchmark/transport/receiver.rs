//! The reading process. It owns the channels, as a daemon does; it says by one byte each on standard output that it is ready for a
//! stretch and that it is done with a grid, and ends with its percentiles as one line of JSON.

use super::ends::{Incoming, Reader, TransportError, expected, fill, system};
use super::plan::{ReaderPlan, Way, bytes};
use super::{ours, raw, stream};
use crate::benchmark::percentiles::Percentiles;
use beo_core::grid::Dims;
use iceoryx2::prelude::{ipc, ipc_threadsafe};
use std::fs::File;
use std::io::Write;
use std::os::fd::AsFd;
use std::os::linux::net::SocketAddrExt;
use std::os::unix::net::{SocketAddr, UnixStream};
use std::sync::atomic::AtomicBool;

/// Instance of our channels and name of the plain services for grids of one side.
pub(super) fn names(name: &str, side: u32) -> Result<(beo_ipc::InstanceName, String), TransportError> {
    let instance = format!("{name}-{side}");
    let ours = beo_ipc::InstanceName::new(&instance)
        .map_err(|cause| TransportError::System { what: "name the channels", cause: std::io::Error::other(cause.to_string()) })?;
    Ok((ours, format!("beo-bench/{instance}")))
}

/// Where the socket lies: in Linux's abstract namespace, so that nothing is left in the file system.
pub(super) fn socket_address(name: &str) -> Result<SocketAddr, TransportError> {
    SocketAddr::from_abstract_name(format!("beo-bench-{name}")).map_err(system("name a socket"))
}

/// Receives everything that its plan says, from the sender that started this process.
///
/// # Errors
/// [`TransportError`].
pub fn receive(ReaderPlan { name, plan }: &ReaderPlan, stop: &AtomicBool) -> Result<(), TransportError> {
    let socket = UnixStream::connect_addr(&socket_address(name)?).map_err(system("connect to the sender"))?;
    let pipe = std::io::stdin().as_fd().try_clone_to_owned().map(File::from).map_err(system("read standard input"))?;
    let mut ends: Vec<[Box<dyn Incoming>; 5]> = Vec::new();
    let mut readers = Vec::new();
    for &side in &plan.sides {
        let (instance, plain) = names(name, side)?;
        let (socket, pipe) = (socket.try_clone(), pipe.try_clone());
        ends.push([
            Box::new(ours::Receiving::open(&instance, side)?),
            Box::new(raw::Receiving::<ipc_threadsafe::Service>::open(&plain, side)?),
            Box::new(raw::Receiving::<ipc::Service>::open(&format!("{plain}-local"), side)?),
            Box::new(stream::Receiving::new(socket.map_err(system("share a socket"))?, bytes(side))),
            Box::new(stream::Receiving::new(pipe.map_err(system("share a pipe"))?, bytes(side))),
        ]);
        let dims = Dims::cube(side as usize)
            .map_err(|cause| TransportError::System { what: "make a grid", cause: std::io::Error::other(cause.to_string()) })?;
        readers.push(Reader::new(dims, stop));
    }
    let mut out = std::io::stdout().lock();
    let mut say = |text: &[u8]| out.write_all(text).and_then(|()| out.flush()).map_err(system("answer the sender"));
    let mut measured: Vec<Percentiles> = Vec::new();
    for step in plan.steps() {
        say(b"r")?;
        let mut times_ns = Vec::with_capacity(step.messages);
        let work = step.exchange.work;
        for count in 0..step.warm_up + step.messages {
            let received = ends[step.grid][place(step.exchange.way)].receive(step.exchange.wake, work, &mut readers[step.grid])?;
            let bytes = bytes(plan.sides[step.grid]);
            let expected = expected(work, fill(work, count), bytes);
            if received.value != expected {
                return Err(TransportError::Damaged { bytes, found: received.value, expected });
            }
            if count >= step.warm_up {
                times_ns.push(received.done_ns.saturating_sub(received.sent_ns));
            }
            say(b".")?;
        }
        measured.push(Percentiles::of_times(times_ns));
    }
    let line = serde_json::to_string(&measured).map_err(|error| system("write the figures")(error.into()))?;
    say(format!("{line}\n").as_bytes())
}

/// The place of a way among the ends of one size.
pub(super) fn place(way: Way) -> usize {
    match way {
        Way::Ours => 0,
        Way::Raw => 1,
        Way::Local => 2,
        Way::Socket => 3,
        Way::Pipe => 4,
    }
}
