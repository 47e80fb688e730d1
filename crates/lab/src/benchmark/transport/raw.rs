//! Plain iceoryx2: publish-subscribe of bytes and an event, with the limits of our channel and nothing else of ours. The header is
//! the sender's stamp. With thread-safe handles, as ours are, or with those that stay on one thread.

#![allow(unsafe_code)]

use super::ends::{Incoming, LONGEST_WAIT, Outgoing, PATIENCE, Reader, Received, TransportError, raw};
use super::plan::{Wake, Work, bytes};
use beo_ipc::channel::{MAX_HELD_SAMPLES, OBSERVATION_READERS, observation_buffer, observation_chunks};
use beo_ipc::clock::monotonic_ns;
use beo_ipc::limits::MAX_PRODUCERS;
use iceoryx2::port::listener::Listener;
use iceoryx2::port::notifier::Notifier;
use iceoryx2::port::publisher::Publisher;
use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::prelude::{AllocationStrategy, Node, NodeBuilder, ServiceName, SignalHandlingMode};
use iceoryx2::service::Service;
use iceoryx2::service::port_factory::{event, publish_subscribe};
use std::mem::MaybeUninit;
use std::time::Instant;

/// Both services; what both processes need alike.
struct Joined<S: Service> {
    publish: publish_subscribe::PortFactory<S, [u8], u64>,
    event: event::PortFactory<S>,
    node: Node<S>,
}

fn join<S: Service>(name: &str, side: u32) -> Result<Joined<S>, TransportError> {
    let node = NodeBuilder::new()
        .signal_handling_mode(SignalHandlingMode::Disabled)
        .config(&beo_ipc::node::config())
        .create::<S>()
        .map_err(raw("join"))?;
    let name: ServiceName = name.try_into().map_err(raw("name a service"))?;
    let start = Instant::now();
    loop {
        let publish = node
            .service_builder(&name)
            .publish_subscribe::<[u8]>()
            .user_header::<u64>()
            .max_publishers(MAX_PRODUCERS)
            .max_subscribers(OBSERVATION_READERS)
            .subscriber_max_buffer_size(observation_buffer(bytes(side)))
            .subscriber_max_borrowed_samples(MAX_HELD_SAMPLES)
            .history_size(0)
            .enable_safe_overflow(true)
            .open_or_create();
        let event = node.service_builder(&name).event().open_or_create();
        match (publish, event) {
            (Ok(publish), Ok(event)) => return Ok(Joined { publish, event, node }),
            // The other process may be creating the same services.
            (publish, event) if start.elapsed() > PATIENCE => {
                publish.map_err(raw("open a service"))?;
                event.map_err(raw("open an event"))?;
            }
            _ => std::thread::sleep(LONGEST_WAIT),
        }
    }
}

pub(super) struct Sending<S: Service> {
    publisher: Publisher<S, [u8], u64>,
    notifier: Notifier<S>,
    len: usize,
    // Dropped last.
    _node: Node<S>,
}

impl<S: Service> Sending<S> {
    /// A publisher with all its chunks touched.
    pub fn open(name: &str, side: u32) -> Result<Self, TransportError> {
        let Joined { publish, event, node } = join(name, side)?;
        let (len, chunks) = (bytes(side), observation_chunks(bytes(side)));
        beo_ipc::memory::require_shared_memory((chunks * (len + 512)) as u64)?;
        let publisher = publish
            .publisher_builder()
            .initial_max_slice_len(len)
            .allocation_strategy(AllocationStrategy::Static)
            .max_loaned_samples(chunks)
            .override_sample_preallocation(move |_| chunks)
            .create()
            .map_err(raw("make a publisher"))?;
        let mut touched = Vec::new();
        for _ in 0..chunks {
            let mut chunk = publisher.loan_slice_uninit(len).map_err(raw("loan a chunk"))?;
            chunk.payload_mut().fill(MaybeUninit::new(0));
            touched.push(chunk);
        }
        drop(touched);
        let notifier = event.notifier_builder().create().map_err(raw("make a notifier"))?;
        Ok(Self { publisher, notifier, len, _node: node })
    }
}

impl<S: Service> Outgoing for Sending<S> {
    fn send(&mut self, fill: Option<u8>) -> Result<(), TransportError> {
        let begin = monotonic_ns();
        let mut loan = self.publisher.loan_slice_uninit(self.len).map_err(raw("loan a chunk"))?;
        *loan.user_header_mut() = begin;
        if let Some(byte) = fill {
            loan.payload_mut().fill(MaybeUninit::new(byte));
        }
        // SAFETY: all bytes of all chunks were written at opening, and every value of a byte is a u8.
        let loan = unsafe { loan.assume_init() };
        loan.send().map_err(raw("send"))?;
        self.notifier.notify().map_err(raw("notify"))?;
        Ok(())
    }
}

pub(super) struct Receiving<S: Service> {
    subscriber: Subscriber<S, [u8], u64>,
    listener: Listener<S>,
    // Dropped last.
    _node: Node<S>,
}

impl<S: Service> Receiving<S> {
    /// A subscriber and a listener.
    pub fn open(name: &str, side: u32) -> Result<Self, TransportError> {
        let Joined { publish, event, node } = join(name, side)?;
        let listener = event.listener_builder().create().map_err(raw("make a listener"))?;
        let subscriber = publish.subscriber_builder().create().map_err(raw("make a subscriber"))?;
        Ok(Self { subscriber, listener, _node: node })
    }
}

impl<S: Service> Incoming for Receiving<S> {
    fn receive(&mut self, wake: Wake, work: Work, reader: &mut Reader) -> Result<Received, TransportError> {
        let sample = reader.wait_for(
            wake,
            || self.subscriber.receive().map_err(raw("receive")),
            |longest| {
                self.listener.timed_wait(|_| (), longest).map_err(raw("wait"))?;
                Ok(())
            },
        )?;
        let received = reader.work(work, *sample.user_header(), sample.payload());
        // The wake-up that nobody waited for: the next wait is not to end by it.
        self.listener.try_wait(|_| ()).map_err(raw("wait"))?;
        received
    }
}
