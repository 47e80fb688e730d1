//! Opening and creating the services: limits, layout hash, and what iceoryx2's errors mean here.

use std::fmt::Debug;
use std::mem::MaybeUninit;
use std::time::{Duration, Instant};

use iceoryx2::port::listener::Listener;
use iceoryx2::port::notifier::Notifier;
use iceoryx2::port::publisher::{Publisher, PublisherCreateError};
use iceoryx2::port::subscriber::{Subscriber, SubscriberCreateError};
use iceoryx2::port::{DegradationAction, DegradationCause, DegradationInfo};
use iceoryx2::prelude::{
    AllocationStrategy, AttributeSet, AttributeSpecifier, IceoryxSend, MessagingPattern, Node, PortFactory as _, Service as _, ZeroCopySend,
};
use iceoryx2::service::builder::event::{EventCreateError, EventOpenError};
use iceoryx2::service::builder::publish_subscribe::{Builder, PublishSubscribeCreateError, PublishSubscribeOpenError};
use iceoryx2::service::port_factory::{event, publish_subscribe};

use crate::InstanceName;
use crate::error::{LoanError, OpenError, ReceiveError, SendError, WaitError};
use crate::layout::Layout;
use crate::messages::{ABI_VERSION, CompletionHeader, Hypothesis, ObservationHeader, Percept, PictureHeader, Status};
use crate::node::{Ipc, service_name};

pub(crate) type ObservationService = publish_subscribe::PortFactory<Ipc, [u8], ObservationHeader>;
pub(crate) type PerceptService = publish_subscribe::PortFactory<Ipc, Percept, ()>;
pub(crate) type CompletionService = publish_subscribe::PortFactory<Ipc, [u8], CompletionHeader>;
pub(crate) type PictureService = publish_subscribe::PortFactory<Ipc, [u8], PictureHeader>;
pub(crate) type StatusService = publish_subscribe::PortFactory<Ipc, Status, ()>;

/// The service attribute that carries the layout hash, 16 hexadecimal digits.
pub const LAYOUT_ATTRIBUTE: &str = "beo.layout";

/// Samples that a reader may hold at a time, per publisher.
pub const MAX_HELD_SAMPLES: usize = 2;

/// Readers of observations: the daemon, and one more (a recorder).
pub const OBSERVATION_READERS: usize = 2;

/// Observations that wait for the daemon, per producer, as long as they are small.
const OBSERVATION_BUFFER: usize = 16;

/// Bytes that the waiting observations of one producer may take before fewer are kept.
const OBSERVATION_BUDGET: usize = 16 << 20;

/// Loans of one producer or of the daemon that are possible whatever the readers hold.
pub(crate) const LOANS: usize = 2;

/// Observations of this many voxels that wait for the daemon, per producer.
pub const fn observation_buffer(voxels: usize) -> usize {
    match OBSERVATION_BUDGET / voxels {
        0..=2 => 2,
        fit if fit < OBSERVATION_BUFFER => fit,
        _ => OBSERVATION_BUFFER,
    }
}

/// Chunks of the segment of a producer of observations of this many voxels.
pub const fn observation_chunks(voxels: usize) -> usize {
    OBSERVATION_READERS * (observation_buffer(voxels) + MAX_HELD_SAMPLES) + LOANS
}

/// How long creating or removing a service by someone else is waited for.
pub(crate) const PATIENCE: Duration = Duration::from_secs(2);

/// The limits of a publish-subscribe service. Overflow is always on: a reader that does not read loses its oldest samples and delays
/// nobody.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Limits {
    pub publishers: usize,
    pub readers: usize,
    pub buffer: usize,
    pub history: usize,
    /// Nodes that can have the service open.
    pub nodes: usize,
}

impl Limits {
    /// Chunks with which a publisher never runs out, whatever the readers hold.
    pub fn chunks(&self) -> usize {
        self.readers * (self.buffer + MAX_HELD_SAMPLES) + self.history + LOANS
    }
}

/// The layout hashes of the channels, as text.
pub(crate) fn layout_text<Message: Layout>() -> String {
    format!("{:016x}", Message::LAYOUT_HASH)
}

/// The percept's hash covers its nested struct.
pub(crate) fn percept_layout_text() -> String {
    format!("{:016x}", Percept::LAYOUT_HASH ^ Hypothesis::LAYOUT_HASH.rotate_left(1))
}

pub(crate) fn failed(what: &str, cause: impl Debug) -> OpenError {
    OpenError::Failed { what: format!("`{what}`"), cause: format!("{cause:?}") }
}

fn pubsub_open_error(service: &str, error: PublishSubscribeOpenError) -> OpenError {
    use PublishSubscribeOpenError as E;
    let (service_text, cause) = (service.to_owned(), format!("{error:?}"));
    match error {
        E::IncompatibleTypes | E::IncompatibleMessagingPattern | E::VersionMismatch => {
            OpenError::OtherVersion { cause: other_version(service, &cause), service: service_text }
        }
        E::DoesNotSupportRequestedMinBufferSize
        | E::DoesNotSupportRequestedMinHistorySize
        | E::DoesNotSupportRequestedMinSubscriberBorrowedSamples
        | E::DoesNotSupportRequestedAmountOfPublishers
        | E::DoesNotSupportRequestedAmountOfSubscribers
        | E::DoesNotSupportRequestedAmountOfNodes
        | E::IncompatibleOverflowBehavior => OpenError::OtherSettings { service: service_text, cause },
        E::ExceedsMaxNumberOfNodes => OpenError::Full { service: service_text, role: "process" },
        _ => failed(service, error),
    }
}

/// Which messages the peers of a service speak, in words: its types' names tell their version.
fn other_version(service: &str, cause: &str) -> String {
    let types = service_name(service).ok().and_then(|name| {
        let found = Ipc::details(&name, &crate::node::config(), MessagingPattern::PublishSubscribe).ok()??;
        let types = found.static_details.publish_subscribe().message_type_details();
        Some([types.user_header.type_name().to_string(), types.payload.type_name().to_string()])
    });
    let of_beo = types.and_then(|types| types.into_iter().find(|name| name.starts_with("beo.v")));
    match of_beo.as_deref().map(|name| (name, name.trim_start_matches("beo.v").split('.').next().unwrap_or("?"))) {
        Some((name, version)) if version != ABI_VERSION.to_string() => {
            format!("version {version} of the messages, `{name}`; this program speaks version {ABI_VERSION}")
        }
        _ => format!("{cause}; this program speaks version {ABI_VERSION} of the messages"),
    }
}

/// Fails unless the service carries this layout hash.
pub(crate) fn check_layout(service: &str, attributes: &AttributeSet, expected: &str) -> Result<(), OpenError> {
    let found = LAYOUT_ATTRIBUTE
        .try_into()
        .ok()
        .and_then(|key| attributes.key_value(&key, 0).map(|value| value.to_string()))
        .unwrap_or_else(|| "none".to_owned());
    if found == expected {
        Ok(())
    } else {
        Err(OpenError::LayoutMismatch { service: service.to_owned(), expected: expected.to_owned(), found })
    }
}

fn layout_attribute(service: &str, layout: &str) -> Result<AttributeSpecifier, OpenError> {
    let key = LAYOUT_ATTRIBUTE.try_into().map_err(|error| failed(service, error))?;
    let value = layout.try_into().map_err(|error| failed(service, error))?;
    AttributeSpecifier::new().define(&key, &value).map_err(|error| failed(service, error))
}

fn with_limits<Payload, Header>(builder: Builder<Payload, Header, Ipc>, limits: &Limits) -> Builder<Payload, Header, Ipc>
where
    Payload: Debug + IceoryxSend + ?Sized,
    Header: Debug + ZeroCopySend,
{
    builder
        .max_publishers(limits.publishers)
        .max_subscribers(limits.readers)
        .max_nodes(limits.nodes)
        .subscriber_max_buffer_size(limits.buffer)
        .subscriber_max_borrowed_samples(MAX_HELD_SAMPLES)
        .history_size(limits.history)
        .enable_safe_overflow(true)
}

/// Opens a service that clients may have kept from an earlier daemon, or else creates it.
fn open_or_create<Service>(
    name: &str,
    open: impl Fn() -> Result<Service, PublishSubscribeOpenError>,
    create: impl Fn() -> Result<Service, PublishSubscribeCreateError>,
) -> Result<Service, OpenError> {
    let start = Instant::now();
    loop {
        let error = match open() {
            Ok(service) => return Ok(service),
            Err(PublishSubscribeOpenError::DoesNotExist) => match create() {
                Ok(service) => return Ok(service),
                Err(
                    error @ (PublishSubscribeCreateError::AlreadyExists
                    | PublishSubscribeCreateError::IsBeingCreatedByAnotherInstance
                    | PublishSubscribeCreateError::HangsInCreation),
                ) => failed(name, error),
                Err(error) => return Err(failed(name, error)),
            },
            Err(
                error @ (PublishSubscribeOpenError::IsMarkedForDestruction
                | PublishSubscribeOpenError::HangsInCreation
                | PublishSubscribeOpenError::ServiceInCorruptedState),
            ) => failed(name, error),
            Err(error) => return Err(pubsub_open_error(name, error)),
        };
        if start.elapsed() > PATIENCE {
            return Err(error);
        }
        std::thread::sleep(Duration::from_millis(10));
    }
}

/// For clients: a service that is not there, or just going, means that no daemon runs.
fn open_existing<Service>(
    instance: &InstanceName,
    name: &str,
    result: Result<Service, PublishSubscribeOpenError>,
) -> Result<Service, OpenError> {
    result.map_err(|error| match error {
        PublishSubscribeOpenError::DoesNotExist
        | PublishSubscribeOpenError::IsMarkedForDestruction
        | PublishSubscribeOpenError::HangsInCreation
        | PublishSubscribeOpenError::ServiceInCorruptedState => OpenError::NotRunning { instance: instance.clone() },
        error => pubsub_open_error(name, error),
    })
}

/// Makes the pair of functions that create (daemon) and open (client) one publish-subscribe channel. A macro, because iceoryx2's builders
/// for slices and for fixed sizes share no trait.
macro_rules! channel {
    ($create:ident, $open:ident, $name:ident, $payload:ty, $header:ty, $service:ty, $layout:expr) => {
        pub(crate) fn $create(node: &Node<Ipc>, instance: &InstanceName, limits: &Limits) -> Result<$service, OpenError> {
            let name = instance.$name();
            let layout = $layout;
            let attributes = layout_attribute(&name, &layout)?;
            let builder =
                with_limits(node.service_builder(&service_name(&name)?).publish_subscribe::<$payload>().user_header::<$header>(), limits);
            let service = open_or_create(&name, || builder.clone().open(), || builder.clone().create_with_attributes(&attributes))?;
            check_layout(&name, service.attributes(), &layout)?;
            Ok(service)
        }

        pub(crate) fn $open(node: &Node<Ipc>, instance: &InstanceName) -> Result<$service, OpenError> {
            let name = instance.$name();
            let builder = node.service_builder(&service_name(&name)?).publish_subscribe::<$payload>().user_header::<$header>();
            let service = open_existing(instance, &name, builder.open())?;
            check_layout(&name, service.attributes(), &$layout)?;
            Ok(service)
        }
    };
}
channel!(
    create_observation,
    open_observation,
    observation,
    [u8],
    ObservationHeader,
    ObservationService,
    layout_text::<ObservationHeader>()
);
channel!(create_percept, open_percept, percept, Percept, (), PerceptService, percept_layout_text());
channel!(create_completion, open_completion, completion, [u8], CompletionHeader, CompletionService, layout_text::<CompletionHeader>());
channel!(create_picture, open_picture, picture, [u8], PictureHeader, PictureService, layout_text::<PictureHeader>());
channel!(create_status, open_status, status, Status, (), StatusService, layout_text::<Status>());

/// Creates an event service, or opens the one that clients kept.
pub(crate) fn create_event(
    node: &Node<Ipc>,
    name: &str,
    notifiers: usize,
    listeners: usize,
    nodes: usize,
) -> Result<event::PortFactory<Ipc>, OpenError> {
    let start = Instant::now();
    let builder = || -> Result<_, OpenError> {
        Ok(node
            .service_builder(&service_name(name)?)
            .event()
            .max_notifiers(notifiers)
            .max_listeners(listeners)
            .max_nodes(nodes)
            .event_id_max_value(0)
            .disable_deadline()
            .disable_notifier_created_event()
            .disable_notifier_dropped_event()
            .disable_notifier_dead_event())
    };
    loop {
        let error = match builder()?.open() {
            Ok(service) => return Ok(service),
            Err(EventOpenError::DoesNotExist) => match builder()?.create() {
                Ok(service) => return Ok(service),
                Err(error @ (EventCreateError::AlreadyExists | EventCreateError::IsBeingCreatedByAnotherInstance)) => failed(name, error),
                Err(error) => return Err(failed(name, error)),
            },
            Err(
                error
                @ (EventOpenError::IsMarkedForDestruction | EventOpenError::HangsInCreation | EventOpenError::ServiceInCorruptedState),
            ) => failed(name, error),
            Err(
                error @ (EventOpenError::DoesNotSupportRequestedAmountOfListeners
                | EventOpenError::DoesNotSupportRequestedAmountOfNodes
                | EventOpenError::DoesNotSupportRequestedAmountOfNotifiers),
            ) => return Err(OpenError::OtherSettings { service: name.to_owned(), cause: format!("{error:?}") }),
            Err(error) => return Err(failed(name, error)),
        };
        if start.elapsed() > PATIENCE {
            return Err(error);
        }
        std::thread::sleep(Duration::from_millis(10));
    }
}

/// For clients: opens an event service of a daemon.
pub(crate) fn open_event(node: &Node<Ipc>, instance: &InstanceName, name: &str) -> Result<event::PortFactory<Ipc>, OpenError> {
    node.service_builder(&service_name(name)?).event().open().map_err(|error| match error {
        EventOpenError::DoesNotExist
        | EventOpenError::IsMarkedForDestruction
        | EventOpenError::HangsInCreation
        | EventOpenError::ServiceInCorruptedState => OpenError::NotRunning { instance: instance.clone() },
        EventOpenError::ExceedsMaxNumberOfNodes => OpenError::Full { service: name.to_owned(), role: "process" },
        error => failed(name, error),
    })
}

pub(crate) fn create_notifier(service: &event::PortFactory<Ipc>) -> Result<Notifier<Ipc>, OpenError> {
    let name = service.name().as_str();
    service.notifier_builder().create().map_err(|error| match error {
        iceoryx2::port::notifier::NotifierCreateError::ExceedsMaxSupportedNotifiers => {
            OpenError::Full { service: name.to_owned(), role: "notifier" }
        }
        error => failed(name, error),
    })
}

pub(crate) fn create_listener(service: &event::PortFactory<Ipc>) -> Result<Listener<Ipc>, OpenError> {
    let name = service.name().as_str();
    service.listener_builder().create().map_err(|error| match error {
        iceoryx2::port::listener::ListenerCreateError::ExceedsMaxSupportedListeners => {
            OpenError::Full { service: name.to_owned(), role: "listener" }
        }
        error => failed(name, error),
    })
}

/// Says that a peer's memory cannot be mapped, as where an address limit is reached: it is out of reach until it joins anew, all others are
/// not.
fn warn_of_unconnected(_: DegradationCause, _: &DegradationInfo) -> DegradationAction {
    tracing::warn!("a peer cannot be connected, and is out of reach until it joins anew: is there memory left, and are there descriptors?");
    DegradationAction::Warn
}

/// A reader with the whole buffer and the whole history of the service.
pub(crate) fn create_reader<Payload, Header>(
    service: &publish_subscribe::PortFactory<Ipc, Payload, Header>,
) -> Result<Subscriber<Ipc, Payload, Header>, OpenError>
where
    Payload: Debug + IceoryxSend + ?Sized,
    Header: Debug + ZeroCopySend,
{
    let name = service.name().as_str();
    service.subscriber_builder().set_degradation_handler(warn_of_unconnected).create().map_err(|error| match error {
        SubscriberCreateError::ExceedsMaxSupportedSubscribers => OpenError::Full { service: name.to_owned(), role: "reader" },
        error => failed(name, error),
    })
}

fn publisher_error(name: &str, error: PublisherCreateError) -> OpenError {
    match error {
        PublisherCreateError::ExceedsMaxSupportedPublishers => OpenError::Full { service: name.to_owned(), role: "writer" },
        error => failed(name, error),
    }
}

/// A publisher of slices with exactly `chunks` chunks of `len` bytes, all touched: no page fault and no bus error later.
///
/// The room in shared memory must have been checked before.
pub(crate) fn create_slice_publisher<Header>(
    service: &publish_subscribe::PortFactory<Ipc, [u8], Header>,
    chunks: usize,
    len: usize,
) -> Result<Publisher<Ipc, [u8], Header>, OpenError>
where
    Header: Default + Debug + ZeroCopySend,
{
    let name = service.name().as_str();
    let publisher = service
        .publisher_builder()
        .initial_max_slice_len(len)
        .allocation_strategy(AllocationStrategy::Static)
        // All chunks can be loaned at once, to touch them.
        .max_loaned_samples(chunks)
        .override_sample_preallocation(move |_| chunks)
        .set_degradation_handler(warn_of_unconnected)
        .create()
        .map_err(|error| publisher_error(name, error))?;
    let mut touched = Vec::with_capacity(chunks);
    for _ in 0..chunks {
        let mut chunk = publisher.loan_slice_uninit(len).map_err(|error| failed(name, error))?;
        chunk.payload_mut().fill(MaybeUninit::new(0));
        touched.push(chunk);
    }
    drop(touched);
    Ok(publisher)
}

/// A publisher of fixed-size messages with exactly `chunks` chunks, all touched.
pub(crate) fn create_publisher<Message>(
    service: &publish_subscribe::PortFactory<Ipc, Message, ()>,
    chunks: usize,
) -> Result<Publisher<Ipc, Message, ()>, OpenError>
where
    Message: Debug + IceoryxSend + ZeroCopySend,
{
    let name = service.name().as_str();
    let publisher = service
        .publisher_builder()
        .max_loaned_samples(chunks)
        .override_sample_preallocation(move |_| chunks)
        .set_degradation_handler(warn_of_unconnected)
        .create()
        .map_err(|error| publisher_error(name, error))?;
    let mut touched = Vec::with_capacity(chunks);
    for _ in 0..chunks {
        let mut chunk = publisher.loan_uninit().map_err(|error| failed(name, error))?;
        *chunk.payload_mut() = MaybeUninit::zeroed();
        touched.push(chunk);
    }
    drop(touched);
    Ok(publisher)
}

/// Whether the services of an instance exist: cheaper than trying to open them.
pub(crate) fn exists(instance: &InstanceName) -> Result<bool, OpenError> {
    service_exists(&instance.percept())
}

/// Whether there is a service of this name.
pub(crate) fn service_exists(name: &str) -> Result<bool, OpenError> {
    Ipc::does_exist(&service_name(name)?, &crate::node::config(), MessagingPattern::PublishSubscribe).map_err(|error| failed(name, error))
}

pub(crate) fn loan_error(error: iceoryx2::port::LoanError, asked: usize, possible: usize) -> LoanError {
    use iceoryx2::port::LoanError as E;
    match error {
        E::OutOfMemory | E::ExceedsMaxLoans => LoanError::NoFreeChunk,
        E::ExceedsMaxLoanSize => LoanError::TooLarge { asked, possible },
        error => LoanError::Failed(format!("{error:?}")),
    }
}

pub(crate) fn send_error(error: iceoryx2::port::SendError) -> SendError {
    match error {
        iceoryx2::port::SendError::ConnectionBrokenSinceSenderNoLongerExists => SendError::ProducerGone,
        error => SendError::Failed(format!("{error:?}")),
    }
}

pub(crate) fn receive_error(error: iceoryx2::port::ReceiveError) -> ReceiveError {
    match error {
        iceoryx2::port::ReceiveError::ExceedsMaxBorrows => ReceiveError::TooManyHeld,
        error => ReceiveError::Failed(format!("{error:?}")),
    }
}

/// How a wait for a wake-up ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Woken {
    Notified,
    TimedOut,
    Interrupted,
}

/// Waits for a wake-up, at most `timeout`.
pub(crate) fn wait(listener: &Listener<Ipc>, timeout: Duration) -> Result<Woken, WaitError> {
    // The system takes the timeout in microseconds, and 0 of them for "without end".
    let result = if timeout < Duration::from_micros(1) { listener.try_wait(|_| ()) } else { listener.timed_wait(|_| (), timeout) };
    match result {
        Ok(0) => Ok(Woken::TimedOut),
        Ok(_) => Ok(Woken::Notified),
        Err(iceoryx2::port::listener::ListenerWaitError::InterruptSignal) => Ok(Woken::Interrupted),
        Err(error) => Err(WaitError(format!("{error:?}"))),
    }
}

/// Wakes all listeners. That a listener is gone or does not listen is its own affair.
pub(crate) fn wake(notifier: &Notifier<Ipc>) {
    if let Err(error) = notifier.notify() {
        tracing::debug!(?error, "a wake-up was not delivered to everyone");
    }
}

/// Connects to peers that came since. A peer that cannot be reached is left for the next time.
pub(crate) fn update_connections(port: &impl iceoryx2::port::update_connections::UpdateConnections) {
    if let Err(error) = port.update_connections() {
        tracing::debug!(?error, "a peer could not be connected");
    }
}
