//! Markers for RViz: box, text, pose hypotheses and completed voxels of each object; those of objects that are gone are deleted.

use crate::answers::{Answer, best_pose, class_name, extent_m, ordered, pose};
use crate::covariance::rotation_object_to_frame;
use crate::messages::{ColorRGBA, Header, Marker, MarkerArray, Point};
use beo_ipc::{Percept, Status};
use nalgebra::{UnitQuaternion, Vector3};
use std::collections::BTreeSet;

/// Hypotheses less probable get no arrow.
const LEAST_DRAWN: f32 = 0.02;
/// Hypotheses of a percept, at most.
const HYPOTHESES: i32 = 8;

/// Draws frame after frame.
#[derive(Debug, Default)]
pub struct Drawing {
    /// The markers that are drawn: namespace and number.
    drawn: BTreeSet<(&'static str, i32)>,
}

impl Drawing {
    /// The markers of a frame, and the end of those of earlier frames that are not in it.
    pub fn frame(&mut self, header: &Header, answers: &[Answer], status: Option<&Status>) -> MarkerArray {
        let mut markers: Vec<Marker> = answers.iter().flat_map(|answer| object(header, answer, status)).collect();
        let now: BTreeSet<_> = markers.iter().map(|marker| (namespace(&marker.ns), marker.id)).collect();
        let gone = self.drawn.difference(&now);
        markers.extend(gone.map(|(ns, id)| Marker { action: Marker::DELETE, ..marker(header, ns, *id, Marker::CUBE_LIST) }));
        self.drawn = now;
        MarkerArray { markers }
    }
}

const NAMESPACES: [&str; 4] = ["box", "class", "pose", "completed"];

fn namespace(name: &str) -> &'static str {
    NAMESPACES.into_iter().find(|known| *known == name).unwrap_or(NAMESPACES[0])
}

fn marker(header: &Header, ns: &str, id: i32, kind: i32) -> Marker {
    let unturned = pose([0.0; 3], &UnitQuaternion::identity());
    Marker { header: header.clone(), ns: ns.to_owned(), id, r#type: kind, action: Marker::ADD, pose: unturned, ..Marker::default() }
}

fn object(header: &Header, answer: &Answer, status: Option<&Status>) -> Vec<Marker> {
    let percept = &answer.percept;
    // Numbers of objects have 64 bits, those of markers 32; each object takes as many as it may have hypotheses.
    let id = (percept.object_id as i32).wrapping_mul(HYPOTHESES);
    let mut markers = vec![wire_box(header, id, percept), text(header, id, percept, status)];
    markers.extend(arrows(header, id, percept));
    if !answer.voxels.is_empty() {
        markers.push(completed(header, id, answer));
    }
    markers
}

fn wire_box(header: &Header, id: i32, percept: &Percept) -> Marker {
    let (position_m, turned) = best_pose(percept);
    let extent = extent_m(percept);
    let corner = |bits: usize| Point::from([0, 1, 2].map(|axis| extent[axis] * if bits >> axis & 1 == 1 { 0.5 } else { -0.5 }));
    let edges = (0..8_usize).flat_map(|from| (0..3).map(move |axis| (from, from | 1 << axis))).filter(|(from, to)| from != to);
    Marker {
        pose: pose(position_m, &turned),
        scale: Point { x: 0.02 * extent.into_iter().fold(0.0, f64::max), ..Point::default() },
        color: ColorRGBA { r: 0.2, g: 0.8, b: 0.3, a: 1.0 },
        points: edges.flat_map(|(from, to)| [corner(from), corner(to)]).collect(),
        ..marker(header, "box", id, Marker::LINE_LIST)
    }
}

fn text(header: &Header, id: i32, percept: &Percept, status: Option<&Status>) -> Marker {
    let probability = percept.posterior.get(percept.class_index as usize).copied().unwrap_or(0.0);
    let longest = extent_m(percept).into_iter().fold(0.0, f64::max);
    // Above the object: the grid's z is up.
    let up = crate::covariance::rotation(percept.orientation) * Vector3::z() * 0.75 * longest;
    let [x, y, z] = percept.object_position_m;
    Marker {
        pose: pose([x + up.x, y + up.y, z + up.z], &UnitQuaternion::identity()),
        scale: Point { z: (0.25 * longest).max(0.01), ..Point::default() },
        color: ColorRGBA { r: 1.0, g: 1.0, b: 1.0, a: 1.0 },
        text: format!("{} {} {:.0} %", class_name(status, percept.class_index), percept.object_id, 100.0 * probability),
        ..marker(header, "class", id, Marker::TEXT_VIEW_FACING)
    }
}

/// The front of the training shapes, −y, by each hypothesis; the more probable, the more solid.
fn arrows(header: &Header, id: i32, percept: &Percept) -> Vec<Marker> {
    let longest = extent_m(percept).into_iter().fold(0.0, f64::max);
    let to_front = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), -std::f64::consts::FRAC_PI_2);
    let drawn = ordered(percept).into_iter().filter(|hypothesis| hypothesis.probability >= LEAST_DRAWN);
    let arrow = |(number, hypothesis): (i32, &beo_ipc::Hypothesis)| Marker {
        pose: pose(percept.object_position_m, &(rotation_object_to_frame(percept, hypothesis) * to_front)),
        scale: Point { x: 0.8 * longest, y: 0.06 * longest, z: 0.06 * longest },
        color: ColorRGBA { r: 1.0, g: 0.55, b: 0.1, a: 0.2 + 0.8 * hypothesis.probability.clamp(0.0, 1.0) },
        ..marker(header, "pose", id.wrapping_add(number), Marker::ARROW)
    };
    (0..HYPOTHESES).zip(drawn).map(arrow).collect()
}

/// The outer voxels: those that were seen in one colour, those that are predicted in another, the paler the less sure.
fn completed(header: &Header, id: i32, answer: &Answer) -> Marker {
    let colour = |deviation: f32| {
        let pale = (2.0 * deviation).clamp(0.0, 1.0);
        if deviation == 0.0 {
            ColorRGBA { r: 0.25, g: 0.45, b: 0.75, a: 1.0 }
        } else {
            ColorRGBA { r: 1.0, g: 0.6 + 0.3 * pale, b: 0.2 + 0.6 * pale, a: 1.0 - 0.6 * pale }
        }
    };
    let outer = || answer.voxels.iter().filter(|voxel| voxel.is_outer);
    let edge = f64::from(answer.percept.voxel_size_m);
    Marker {
        scale: Point { x: edge, y: edge, z: edge },
        color: ColorRGBA { a: 1.0, ..ColorRGBA::default() },
        points: outer().map(|voxel| voxel.position_m.into()).collect(),
        colors: outer().map(|voxel| colour(voxel.deviation)).collect(),
        ..marker(header, "completed", id, Marker::CUBE_LIST)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::completed::Voxel;
    use beo_ipc::Hypothesis;

    fn answer(object_id: u64) -> Answer {
        let mut percept = Percept { object_id, class_index: 0, orientation: [0.0, 0.0, 0.0, 1.0], dims: [10; 3], ..Percept::EMPTY };
        percept.voxel_size_m = 0.01;
        let turned = |probability| Hypothesis { rotation_object_to_grid: [0.0, 0.0, 0.0, 1.0], class_index: 0, probability };
        (percept.hypotheses[0], percept.hypotheses[1], percept.hypothesis_count) = (turned(0.9), turned(0.01), 2);
        let voxel = |is_outer| Voxel { position_m: [0.0; 3], occupancy: 1.0, deviation: 0.0, is_outer };
        Answer { percept, voxels: vec![voxel(true), voxel(false)] }
    }

    #[test]
    fn an_object_has_box_class_pose_and_outer_voxels_and_leaves_with_all_of_them() {
        let (mut drawing, header) = (Drawing::default(), Header { frame_id: "optical".into(), ..Header::default() });
        let first = drawing.frame(&header, &[answer(1), answer(2)], None).markers;
        let of_one: Vec<_> = first.iter().filter(|marker| marker.id == HYPOTHESES).map(|marker| marker.ns.as_str()).collect();
        assert_eq!(of_one, NAMESPACES);
        assert_eq!((first.len(), first[0].points.len(), first[3].points.len()), (8, 24, 1));
        assert!(first.iter().all(|marker| marker.action == Marker::ADD && marker.header == header));
        let second = drawing.frame(&header, &[answer(2)], None).markers;
        let gone: Vec<_> =
            second.iter().filter(|marker| marker.action == Marker::DELETE).map(|marker| (marker.ns.as_str(), marker.id)).collect();
        assert_eq!((second.len(), gone), (8, vec![("box", 8), ("class", 8), ("completed", 8), ("pose", 8)]));
        assert_eq!(drawing.frame(&header, &[answer(2)], None).markers.len(), 4);
    }

    #[test]
    fn the_arrow_points_to_the_front() {
        let front = &arrows(&Header::default(), 0, &answer(1).percept)[0].pose.orientation;
        let along = crate::covariance::rotation([front.x, front.y, front.z, front.w]) * Vector3::x();
        assert!((along + Vector3::y()).norm() < 1e-9, "{along}");
    }
}
