//! The ROS 2 messages that are read and written, field for field as their `.msg` files declare them, so that serde's order is that of CDR.
//!
//! They know nothing of a transport: [`Named`] says under which type name a transport announces them.

mod builtin;
mod diagnostic;
mod geometry;
mod sensor;
mod tf2;
mod vision;
mod visualization;

pub use builtin::{Duration, Header, Time};
pub use diagnostic::{DiagnosticArray, DiagnosticStatus, KeyValue};
pub use geometry::{Point, Pose, PoseWithCovariance, Transform, TransformStamped};
pub use sensor::{CameraInfo, CompressedImage, Image, PointCloud2, PointField};
pub use tf2::TFMessage;
pub use vision::{BoundingBox3D, Detection3D, Detection3DArray, LabelInfo, ObjectHypothesis, ObjectHypothesisWithPose, VisionClass};
pub use visualization::{ColorRGBA, Marker, MarkerArray};

/// A message that is the content of a topic: its package and its name in it.
pub trait Named: serde::Serialize + serde::de::DeserializeOwned {
    /// The package, as `vision_msgs`.
    const PACKAGE: &'static str;
    /// The name, as `Detection3DArray`.
    const NAME: &'static str;
}

/// Declares messages whose fields follow each other as written.
macro_rules! messages {
    ($($(#[$about:meta])* $name:ident { $($(#[$attribute:meta])* $field:ident : $type:ty),+ $(,)? })+) => { $(
        $(#[$about])*
        #[derive(Clone, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
        #[allow(missing_docs, reason = "the fields are those of the .msg file of the same name")]
        pub struct $name { $($(#[$attribute])* pub $field: $type),+ }
    )+ };
}

/// Names messages that are the content of topics.
macro_rules! topics {
    ($package:literal: $($name:ident),+ $(,)?) => { $(
        impl $crate::messages::Named for $name {
            const PACKAGE: &'static str = $package;
            const NAME: &'static str = stringify!($name);
        }
    )+ };
}

use {messages, topics};
