//! `vision_msgs`: detections and the names of classes.

use super::{Header, Point, Pose, PoseWithCovariance};

super::messages! {
    ObjectHypothesis { class_id: String, score: f64 }
    ObjectHypothesisWithPose { hypothesis: ObjectHypothesis, pose: PoseWithCovariance }
    BoundingBox3D { center: Pose, size: Point }
    Detection3D { header: Header, results: Vec<ObjectHypothesisWithPose>, bbox: BoundingBox3D, id: String }
    Detection3DArray { header: Header, detections: Vec<Detection3D> }
    VisionClass { class_id: u16, class_name: String }
    LabelInfo { header: Header, class_map: Vec<VisionClass>, threshold: f32 }
}
super::topics!("vision_msgs": Detection3DArray, LabelInfo);
