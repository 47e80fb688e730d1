//! The node in the graph: DDS by the crate `ros2-client`. Everything else of this program knows nothing of it.

use crate::arguments::{ArgumentError, Arguments, Masks};
use crate::health::{Count, Health};
use crate::messages::{CameraInfo, Detection3DArray, DiagnosticArray, Image, LabelInfo, MarkerArray, Named, PointCloud2, TFMessage};
use futures::StreamExt as _;
use ros2_client::qos::{Durability, History, WhenFull};
use ros2_client::{Context, Message, MessageTypeName, Name, Node, NodeName, NodeOptions, Publisher, QosProfile, Subscription};
use std::net::{IpAddr, Ipv4Addr};
use std::sync::Arc;
use std::thread::JoinHandle;

impl Message for Image {}
impl Message for CameraInfo {}

/// Messages that are kept for a reliable reader.
const KEPT: usize = 10;
/// Images that wait to be read.
const IMAGES: usize = 4;

/// The node cannot be made.
#[derive(Debug, thiserror::Error)]
pub enum TransportError {
    /// A name or number of the command line.
    #[error(transparent)]
    Argument(#[from] ArgumentError),
    /// A topic's name.
    #[error(transparent)]
    Name(#[from] crate::names::NameError),
    /// DDS could not make a participant, reader or writer.
    #[error("cannot make the {what} ({cause}): is there a network interface, and are the ports of domain {domain} free?")]
    Failed {
        /// The thing that was to be made.
        what: String,
        /// The domain.
        domain: u16,
        /// DDS's word for it.
        cause: String,
    },
}

/// A message that came from the graph.
pub enum Came {
    /// A depth image.
    Depth(Image),
    /// A segmentation.
    Labels(Image),
    /// A camera.
    Info(Box<CameraInfo>),
    /// Something that is not what its topic says.
    Broken(String),
}

/// Where messages go.
pub struct Outputs {
    detections: Publisher<Detection3DArray>,
    cloud: Publisher<PointCloud2>,
    markers: Publisher<MarkerArray>,
    label_info: Publisher<LabelInfo>,
    diagnostics: Publisher<DiagnosticArray>,
    transforms: Option<Publisher<TFMessage>>,
}

/// The node, until it is dropped.
pub struct Transport {
    /// Where messages go.
    pub outputs: Outputs,
    stop: Option<smol::channel::Sender<()>>,
    thread: Option<JoinHandle<()>>,
}

impl Transport {
    /// Joins the graph; what comes from it goes to `take`, on a thread of its own.
    ///
    /// # Errors
    /// [`TransportError`].
    pub fn open(arguments: &Arguments, take: impl Fn(Came) + Send + Sync + 'static) -> Result<Self, TransportError> {
        let (names, domain) = (arguments.names()?, arguments.domain()?);
        let failed =
            |what: &str, cause: &dyn std::fmt::Display| TransportError::Failed { what: what.to_owned(), domain, cause: cause.to_string() };
        let mut builder = ros2_client::dds::rustdds::DomainParticipantBuilder::new(domain);
        if arguments.is_local() {
            builder = builder.with_only_networks([IpAddr::V4(Ipv4Addr::LOCALHOST)]);
        }
        let participant = builder.build().map_err(|error| failed("DDS participant", &error))?;
        let context = Context::from_domain_participant(participant).map_err(|error| failed("ROS context", &error))?;
        let name = NodeName::new(names.namespace(), names.node()).map_err(|error| failed("node's name", &error))?;
        let mut node = context.new_node(name, NodeOptions::new().enable_rosout(false)).map_err(|error| failed("node", &error))?;

        let reliable = QosProfile::publisher_default()
            .reliability_reliable(WhenFull::DEFAULT)
            .durability(Durability::Volatile)
            .history(History::KeepLast { depth: KEPT });
        let latched = reliable.clone().durability(Durability::TransientLocal).history(History::KeepLast { depth: 1 });
        let sensor = QosProfile::subscription_default().durability(Durability::Volatile).history(History::KeepLast { depth: IMAGES });
        let sensor =
            if arguments.reliable_images { sensor.reliability_reliable(WhenFull::DEFAULT) } else { sensor.reliability_best_effort() };

        let mut ends = Ends { node: &mut node, names: &names, domain };
        let outputs = Outputs {
            detections: ends.publisher("~/detections", &reliable)?,
            cloud: ends.publisher("~/completed_points", &reliable)?,
            markers: ends.publisher("~/markers", &reliable)?,
            label_info: ends.publisher("~/label_info", &latched)?,
            diagnostics: ends.publisher("/diagnostics", &reliable)?,
            transforms: if arguments.tf { Some(ends.publisher("/tf", &reliable)?) } else { None },
        };
        let depth: Subscription<Image> = ends.subscription("depth/image", &sensor)?;
        let info: Subscription<CameraInfo> = ends.subscription("depth/camera_info", &sensor)?;
        let labels: Option<Subscription<Image>> = match arguments.segmentation {
            Masks::Own => None,
            Masks::Topic => Some(ends.subscription("segmentation", &sensor)?),
        };
        let spinner = node.spinner().map_err(|error| failed("node's spinner", &error))?;
        let (stop, stopped) = smol::channel::bounded::<()>(1);
        let take = Arc::new(take);
        let spin = move || {
            let executor = smol::LocalExecutor::new();
            executor.spawn(spinner.spin()).detach();
            executor.spawn(pass(depth, Came::Depth, take.clone())).detach();
            executor.spawn(pass(info, |info| Came::Info(Box::new(info)), take.clone())).detach();
            if let Some(labels) = labels {
                executor.spawn(pass(labels, Came::Labels, take)).detach();
            }
            // An error says that the sender is gone: the end as well.
            smol::block_on(executor.run(async { stopped.recv().await.unwrap_or(()) }));
            drop(node);
        };
        let thread = std::thread::Builder::new().name("graph".to_owned()).spawn(spin);
        let thread = thread.map_err(|error| failed("thread", &error))?;
        Ok(Self { outputs, stop: Some(stop), thread: Some(thread) })
    }
}

impl Drop for Transport {
    fn drop(&mut self) {
        self.stop = None;
        if let Some(thread) = self.thread.take() {
            // It panicked, and said so.
            let _ = thread.join();
        }
    }
}

/// Passes on what a subscription gives, as long as it gives something.
async fn pass<M: Message + 'static>(subscription: Subscription<M>, came: fn(M) -> Came, take: Arc<impl Fn(Came)>) {
    let mut stream = Box::pin(subscription.async_stream());
    while let Some(message) = stream.next().await {
        take(match message {
            Ok((message, _)) => came(message),
            Err(error) => Came::Broken(error.to_string()),
        });
    }
}

/// Makes a node's publishers and subscriptions.
struct Ends<'a> {
    node: &'a mut Node,
    names: &'a crate::names::Names,
    domain: u16,
}

impl Ends<'_> {
    fn topic<M: Named>(&mut self, name: &str, qos: &QosProfile) -> Result<(ros2_client::dds::rustdds::Topic, String), TransportError> {
        let full = self.names.topic(name)?;
        let parsed = Name::parse(&full).map_err(|error| self.failed(&full, &error))?;
        let topic = self.node.create_topic(&parsed, MessageTypeName::new(M::PACKAGE, M::NAME), qos);
        Ok((topic.map_err(|error| self.failed(&full, &error))?, full))
    }

    fn publisher<M: Named>(&mut self, name: &str, qos: &QosProfile) -> Result<Publisher<M>, TransportError> {
        let (topic, full) = self.topic::<M>(name, qos)?;
        let publisher = self.node.create_publisher(&topic, None);
        publisher.map_err(|error| self.failed(&full, &error))
    }

    fn subscription<M: Named + 'static>(&mut self, name: &str, qos: &QosProfile) -> Result<Subscription<M>, TransportError> {
        let (topic, full) = self.topic::<M>(name, qos)?;
        let subscription = self.node.create_subscription(&topic, None);
        subscription.map_err(|error| self.failed(&full, &error))
    }

    fn failed(&self, topic: &str, cause: &dyn std::fmt::Display) -> TransportError {
        TransportError::Failed { what: format!("topic {topic}"), domain: self.domain, cause: cause.to_string() }
    }
}

impl Outputs {
    /// Publishes on `~/detections`.
    pub fn detections(&self, message: Detection3DArray, health: &Health) {
        publish(&self.detections, message, health);
    }

    /// Publishes on `~/completed_points`.
    pub fn cloud(&self, message: PointCloud2, health: &Health) {
        publish(&self.cloud, message, health);
    }

    /// Publishes on `~/markers`.
    pub fn markers(&self, message: MarkerArray, health: &Health) {
        publish(&self.markers, message, health);
    }

    /// Publishes on `~/label_info`, for those who come later as well.
    pub fn label_info(&self, message: LabelInfo, health: &Health) {
        publish(&self.label_info, message, health);
    }

    /// Publishes on `/diagnostics`.
    pub fn diagnostics(&self, message: DiagnosticArray, health: &Health) {
        publish(&self.diagnostics, message, health);
    }

    /// Publishes on `/tf`, where that was asked for.
    pub fn transforms(&self, message: impl FnOnce() -> TFMessage, health: &Health) {
        if let Some(transforms) = &self.transforms {
            publish(transforms, message(), health);
        }
    }
}

fn publish<M: Named>(publisher: &Publisher<M>, message: M, health: &Health) {
    if let Err(error) = publisher.publish(message) {
        health.count(Count::Unpublished);
        health.trouble(M::NAME, &error);
    }
}
