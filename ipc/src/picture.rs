//! Pictures of frames for people who look on: a channel beside those of the daemon, which does not know of it.
//!
//! Whoever looks makes the channel. A camera's process sees that it is there, and draws only while it is: nobody pays for pictures that nobody
//! sees. Of those that come faster than they are read the newest is kept.

use std::time::{Duration, Instant};

use iceoryx2::port::publisher::Publisher;
use iceoryx2::port::subscriber::Subscriber as Reader;
use iceoryx2::prelude::{Node, PayloadHeader as _, PortFactory as _};
use iceoryx2::sample::Sample;

use crate::InstanceName;
use crate::channel::{self, Limits, PictureService};
use crate::clock::monotonic_ns;
use crate::error::{OpenError, ReceiveError, SendError};
use crate::joining;
use crate::memory::{publisher_bytes, require_shared_memory};
use crate::messages::{ABI_VERSION, PictureHeader};
use crate::node::{self, Ipc};
use crate::peers::Peers;
use crate::segments::Segments;
use crate::shared::{copy_of, with_old_content};

/// Cameras that draw at a time, those who look, and the one picture that waits for each.
const LIMITS: Limits = Limits { publishers: 8, readers: 4, buffer: 1, history: 0, nodes: 24 };

/// A sender without a channel looks for one again after this long.
const LOOK: Duration = Duration::from_millis(250);

/// The camera's end.
#[derive(Debug)]
pub struct PictureSender {
    instance: InstanceName,
    looked: Option<Instant>,
    outlet: Option<Outlet>,
}

/// A sender's place in the channel.
#[derive(Debug)]
struct Outlet {
    /// Made by the first picture, for pictures of its size.
    segment: Option<Segment>,
    service: PictureService,
    readers: Peers,
    // Dropped last.
    _node: Node<Ipc>,
}

/// Shared memory for pictures of at most so many bytes.
#[derive(Debug)]
struct Segment {
    most_bytes: usize,
    publisher: Publisher<Ipc, [u8], PictureHeader>,
}

impl PictureSender {
    /// A sender of pictures of an instance, whose channel need not be there yet.
    pub fn new(instance: &InstanceName) -> Self {
        Self { instance: instance.clone(), looked: None, outlet: None }
    }

    /// Whether somebody looks: where not, nothing needs to be drawn. To be asked before each picture; it looks for a channel four times a
    /// second at most, and lets go of one that nobody reads. A reader that was killed counts until the daemon has cleaned up after it.
    ///
    /// # Errors
    /// [`OpenError`] if there is a channel that cannot be joined. The next call tries again.
    pub fn is_watched(&mut self) -> Result<bool, OpenError> {
        if let Some(outlet) = &self.outlet {
            if outlet.service.dynamic_config().number_of_subscribers() > 0 {
                return Ok(true);
            }
            self.outlet = None;
        }
        if self.looked.is_some_and(|looked| looked.elapsed() < LOOK) {
            return Ok(false);
        }
        self.looked = Some(Instant::now());
        if !channel::service_exists(&self.instance.picture())? {
            return Ok(false);
        }
        let node = node::create("picture-sender", &self.instance)?;
        // The place of a camera that was killed is needed now.
        node::clean_up_and_wait(&node);
        let service = match channel::open_picture(&node, &self.instance) {
            Ok(service) => service,
            // Whoever looked has just gone.
            Err(OpenError::NotRunning { .. }) => return Ok(false),
            Err(error) => return Err(error),
        };
        if service.dynamic_config().number_of_subscribers() == 0 {
            return Ok(false);
        }
        self.outlet = Some(Outlet { segment: None, service, readers: Peers::default(), _node: node });
        Ok(true)
    }

    /// Sends a picture; how many it reached, 0 where nobody looks. `pixels` are [`PictureHeader::bytes`] of the header's.
    ///
    /// # Errors
    /// [`SendError`]; there being no room for a picture of this size is [`SendError::Failed`] with [`OpenError`]'s words.
    ///
    /// # Panics
    /// If `pixels` has another length than the header says.
    pub fn send(&mut self, header: &PictureHeader, pixels: &[u8]) -> Result<usize, SendError> {
        assert_eq!(pixels.len(), header.bytes(), "a picture has as many bytes as its header says");
        let Some(outlet) = &mut self.outlet else { return Ok(0) };
        let publisher = outlet.publisher(pixels.len()).map_err(|error| SendError::Failed(error.to_string()))?;
        let sample = publisher.loan_slice_uninit(pixels.len());
        let mut sample = with_old_content(sample.map_err(|error| channel::loan_error(error, pixels.len(), pixels.len()))?);
        *sample.user_header_mut() = *header;
        sample.payload_mut().copy_from_slice(pixels);
        if !outlet.readers.ready_to_send(&outlet.service, monotonic_ns()) {
            return Err(SendError::PeerInTheWay);
        }
        sample.send().map_err(channel::send_error)
    }
}

impl Outlet {
    /// The publisher of pictures of so many bytes; another one where those before were smaller.
    fn publisher(&mut self, bytes: usize) -> Result<&Publisher<Ipc, [u8], PictureHeader>, OpenError> {
        if self.segment.as_ref().is_none_or(|segment| segment.most_bytes < bytes) {
            self.segment = None;
            let chunks = LIMITS.chunks();
            require_shared_memory(publisher_bytes(chunks, bytes))?;
            let publisher = channel::create_slice_publisher(&self.service, chunks, bytes)?;
            self.segment = Some(Segment { most_bytes: bytes, publisher });
        }
        Ok(&self.segment.as_ref().expect("it was made where it was missing").publisher)
    }
}

/// The end of whoever looks.
#[derive(Debug)]
pub struct PictureReader {
    pictures: Reader<Ipc, [u8], PictureHeader>,
    service: PictureService,
    producers: Peers,
    segments: Segments,
    // Dropped last.
    node: Node<Ipc>,
}

impl PictureReader {
    /// Looks at the pictures of an instance; from now on its cameras draw.
    ///
    /// # Errors
    /// [`OpenError::Full`] if four look already; see [`OpenError`] for the rest.
    pub fn open(instance: &InstanceName) -> Result<Self, OpenError> {
        const ROLE: &str = "picture-reader";
        joining::open_with_room(ROLE, instance, || {
            let node = node::create(ROLE, instance)?;
            let service = channel::create_picture(&node, instance, &LIMITS)?;
            let pictures = channel::create_reader(&service)?;
            Ok(Self { pictures, service, producers: Peers::default(), segments: Segments::default(), node })
        })
    }

    /// The next picture of any camera.
    ///
    /// # Errors
    /// [`ReceiveError::TooManyHeld`] until a picture taken earlier is dropped.
    pub fn take(&self) -> Result<Option<Picture>, ReceiveError> {
        if !self.producers.ready_to_receive(&self.service) {
            return Ok(None);
        }
        while let Some(sample) = self.pictures.receive().map_err(channel::receive_error)? {
            if let Some(possible) = self.segments.bytes(&self.service, &sample) {
                let header = copy_of(sample.user_header());
                let elements = usize::try_from(sample.header().number_of_elements()).unwrap_or(usize::MAX);
                return Ok(Some(Picture { header, payload_len: elements.min(possible), sample }));
            }
        }
        Ok(None)
    }

    /// Housekeeping, about once a second: cleans up after processes that died, and connects to cameras that came since.
    pub fn maintain(&self) {
        if node::clean_up(&self.node) {
            channel::update_connections(&self.pictures);
        }
    }
}

/// A picture. It lies in shared memory, which is free again when this is dropped.
#[derive(Debug)]
pub struct Picture {
    header: PictureHeader,
    payload_len: usize,
    sample: Sample<Ipc, [u8], PictureHeader>,
}

impl Picture {
    /// The header, copied once.
    pub fn header(&self) -> &PictureHeader {
        &self.header
    }

    /// The pixels: three bytes each (red, green, blue), row by row from the top left.
    ///
    /// # Errors
    /// [`ReceiveError::Broken`] if there are not as many as the header says, or none; [`ReceiveError::Failed`] if it is of another version.
    pub fn pixels(&self) -> Result<&[u8], ReceiveError> {
        if self.header.abi_version != ABI_VERSION {
            let found = self.header.abi_version;
            return Err(ReceiveError::Failed(format!("a picture of version {found} of the messages; this program speaks {ABI_VERSION}")));
        }
        let expected = self.header.bytes();
        let broken = |found| ReceiveError::Broken { expected, found };
        if expected == 0 || self.payload_len != expected {
            return Err(broken(self.payload_len));
        }
        // iceoryx2 reads the length from shared memory anew: a sender could have changed it since.
        let payload = self.sample.payload();
        payload.get(..expected).ok_or_else(|| broken(payload.len()))
    }
}
