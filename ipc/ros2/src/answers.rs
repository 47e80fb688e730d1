//! A frame's answers as ROS messages: detections, the cloud of completed voxels, transforms, the names of the classes.

use crate::completed::Voxel;
use crate::covariance::{covariance, hypotheses, rotation, rotation_object_to_frame};
use crate::messages::{
    BoundingBox3D, Detection3D, Detection3DArray, Header, LabelInfo, ObjectHypothesis, ObjectHypothesisWithPose, Point, PointCloud2,
    PointField, Pose, PoseWithCovariance, TFMessage, Transform, TransformStamped, VisionClass,
};
use beo_ipc::{Hypothesis, NOT_COMPUTED, Percept, Status};
use nalgebra::UnitQuaternion;

/// Bytes of a point of the cloud.
const POINT: usize = 24;

/// An object's answer.
#[derive(Clone, Debug, PartialEq)]
pub struct Answer {
    /// Class, poses, place.
    pub percept: Percept,
    /// Its filled voxels; none where they could not be had.
    pub voxels: Vec<Voxel>,
}

/// The name of a class; its number where the model named none.
pub fn class_name(status: Option<&Status>, index: u32) -> String {
    status.and_then(|status| status.class_names().nth(index as usize)).map_or_else(|| index.to_string(), str::to_owned)
}

/// The hypotheses, the best of the answered class first, then the most probable.
pub fn ordered(percept: &Percept) -> Vec<&Hypothesis> {
    let mut ordered: Vec<_> = hypotheses(percept).iter().collect();
    if let Some(best) = ordered.iter().position(|hypothesis| hypothesis.class_index == percept.class_index) {
        ordered[..=best].rotate_right(1);
    }
    ordered
}

/// Where the object is, and how it is turned: as its best hypothesis says, or as its grid where there is none.
pub fn best_pose(percept: &Percept) -> ([f64; 3], UnitQuaternion<f64>) {
    let turned = ordered(percept).first().map_or_else(|| rotation(percept.orientation), |best| rotation_object_to_frame(percept, best));
    (percept.object_position_m, turned)
}

/// The lengths of the object's box; four fifths of the grid where they were not estimated, as training shapes take them.
pub fn extent_m(percept: &Percept) -> [f64; 3] {
    let found = percept.object_extent_m.map(f64::from);
    if found.iter().all(|side| *side > 0.0) {
        found
    } else {
        percept.dims.map(|side| 0.8 * f64::from(side) * f64::from(percept.voxel_size_m))
    }
}

/// A pose of a place and a rotation.
pub fn pose(position_m: [f64; 3], turned: &UnitQuaternion<f64>) -> Pose {
    Pose { position: position_m.into(), orientation: <[f64; 4]>::from(turned.coords).into() }
}

/// An object as a detection.
fn detection(header: &Header, percept: &Percept, status: Option<&Status>) -> Detection3D {
    // The hypotheses are those given that the object is of one of the classes.
    let known = if percept.none_probability == NOT_COMPUTED { 1.0 } else { 1.0 - f64::from(percept.none_probability) };
    let result = |class, probability: f32, turned: &UnitQuaternion<f64>, about| ObjectHypothesisWithPose {
        hypothesis: ObjectHypothesis { class_id: class_name(status, class), score: known * f64::from(probability) },
        pose: PoseWithCovariance { pose: pose(percept.object_position_m, turned), covariance: covariance(percept, about) },
    };
    let mut results: Vec<_> = ordered(percept)
        .into_iter()
        .map(|h| result(h.class_index, h.probability, &rotation_object_to_frame(percept, h), Some(h)))
        .collect();
    let (position_m, turned) = best_pose(percept);
    if results.is_empty() {
        let probability = percept.posterior.get(percept.class_index as usize).copied().unwrap_or(0.0);
        results.push(result(percept.class_index, probability, &turned, None));
    }
    Detection3D {
        header: header.clone(),
        results,
        bbox: BoundingBox3D { center: pose(position_m, &turned), size: extent_m(percept).into() },
        id: percept.object_id.to_string(),
    }
}

/// All objects of a frame, under the header of its image.
pub fn detections(header: &Header, answers: &[Answer], status: Option<&Status>) -> Detection3DArray {
    let detections = answers.iter().map(|answer| detection(header, &answer.percept, status)).collect();
    Detection3DArray { header: header.clone(), detections }
}

/// The filled voxels of all objects of a frame.
pub fn cloud(header: &Header, answers: &[Answer]) -> PointCloud2 {
    let mut data = Vec::with_capacity(POINT * answers.iter().map(|answer| answer.voxels.len()).sum::<usize>());
    for answer in answers {
        // Numbers of objects have 64 bits, fields of a cloud 32.
        let object = answer.percept.object_id as u32;
        for voxel in &answer.voxels {
            voxel.position_m.iter().for_each(|side| data.extend((*side as f32).to_le_bytes()));
            data.extend(voxel.occupancy.to_le_bytes());
            data.extend(voxel.deviation.to_le_bytes());
            data.extend(object.to_le_bytes());
        }
    }
    let names = ["x", "y", "z", "occupancy", "deviation", "object"].into_iter().zip((0..).step_by(4));
    let datatype = |name| if name == "object" { PointField::UINT32 } else { PointField::FLOAT32 };
    PointCloud2 {
        header: header.clone(),
        height: 1,
        width: (data.len() / POINT) as u32,
        fields: names.map(|(name, offset)| PointField { name: name.into(), offset, datatype: datatype(name), count: 1 }).collect(),
        is_bigendian: false,
        point_step: POINT as u32,
        row_step: data.len() as u32,
        data,
        is_dense: true,
    }
}

/// The frames of the objects, `beo/CLASS_ID`, in that of the image.
pub fn transforms(header: &Header, answers: &[Answer], status: Option<&Status>) -> TFMessage {
    let transform = |answer: &Answer| {
        let ([x, y, z], turned) = best_pose(&answer.percept);
        TransformStamped {
            header: header.clone(),
            child_frame_id: format!("beo/{}_{}", class_name(status, answer.percept.class_index), answer.percept.object_id),
            transform: Transform { translation: Point { x, y, z }, rotation: <[f64; 4]>::from(turned.coords).into() },
        }
    };
    TFMessage { transforms: answers.iter().map(transform).collect() }
}

/// The names of the classes.
pub fn label_info(header: Header, status: &Status) -> LabelInfo {
    let class_map = status.class_names().zip(0..).map(|(name, class_id)| VisionClass { class_id, class_name: name.to_owned() }).collect();
    LabelInfo { header, class_map, threshold: 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use beo_ipc::text::to_field;

    fn answer() -> (Answer, Status) {
        let mut percept =
            Percept { object_id: 7, class_index: 1, none_probability: 0.5, object_position_m: [0.1, 0.2, 0.9], ..Percept::EMPTY };
        percept.orientation = [0.0, 0.0, 0.0, 1.0];
        (percept.dims, percept.voxel_size_m) = ([10; 3], 0.01);
        let turned = |class_index, probability| Hypothesis { rotation_object_to_grid: [0.0, 0.0, 0.0, 1.0], class_index, probability };
        (percept.hypotheses[0], percept.hypotheses[1], percept.hypothesis_count) = (turned(0, 0.5), turned(1, 0.4), 2);
        let mut status = Status { class_count: 2, ..Status::EMPTY };
        (status.class_names[0], status.class_names[1]) = (to_field("can"), to_field("mug"));
        let voxel = Voxel { position_m: [1.0, 2.0, 3.0], occupancy: 0.75, deviation: 0.25, is_outer: true };
        (Answer { percept, voxels: vec![voxel; 2] }, status)
    }

    #[test]
    fn the_answered_class_comes_first_and_its_score_is_less_by_what_is_of_no_class() {
        let (answer, status) = answer();
        let header = Header { frame_id: "optical".into(), ..Header::default() };
        let found = detections(&header, &[answer], Some(&status));
        let results = &found.detections[0].results;
        let classes: Vec<_> = results.iter().map(|r| (r.hypothesis.class_id.as_str(), r.hypothesis.score as f32)).collect();
        assert_eq!(classes, [("mug", 0.2), ("can", 0.25)]);
        assert_eq!((found.detections[0].id.as_str(), &found.detections[0].header), ("7", &header));
        assert_eq!(found.detections[0].bbox.center.position, Point { x: 0.1, y: 0.2, z: 0.9 });
        assert!((found.detections[0].bbox.size.x - 0.08).abs() < 1e-6);
    }

    #[test]
    fn a_class_without_a_pose_is_a_result_all_the_same() {
        let (mut answer, status) = answer();
        answer.percept.hypothesis_count = 0;
        answer.percept.posterior[1] = 0.9;
        let found = detections(&Header::default(), &[answer], Some(&status));
        let result = &found.detections[0].results[0];
        assert_eq!(result.hypothesis.class_id, "mug");
        assert!((result.hypothesis.score - 0.45).abs() < 1e-6 && result.pose.covariance[35] > 3.0);
        assert_eq!(class_name(None, 5), "5");
    }

    #[test]
    fn the_cloud_has_a_point_for_each_voxel() {
        let cloud = cloud(&Header::default(), &[answer().0]);
        assert_eq!((cloud.width, cloud.point_step, cloud.row_step, cloud.data.len()), (2, 24, 48, 48));
        let value = |at: usize| f32::from_le_bytes(cloud.data[24 + at..28 + at].try_into().unwrap());
        assert_eq!([value(0), value(4), value(8), value(12), value(16)], [1.0, 2.0, 3.0, 0.75, 0.25]);
        assert_eq!((cloud.fields[5].name.as_str(), cloud.fields[5].offset, cloud.data[44]), ("object", 20, 7));
    }

    #[test]
    fn an_object_has_a_frame_of_its_own() {
        let (answer, status) = answer();
        assert_eq!(transforms(&Header::default(), &[answer], Some(&status)).transforms[0].child_frame_id, "beo/mug_7");
        assert_eq!(label_info(Header::default(), &status).class_map[1], VisionClass { class_id: 1, class_name: "mug".into() });
    }
}
