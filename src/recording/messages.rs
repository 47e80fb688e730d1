//! Observations and answers as Foxglove's messages.
//!
//! All geometry lies in the frame that the observation named; where it named none, in [`NO_FRAME`].

use super::Clock;
use crate::export::{GridPlacement, Surface};
use beo_core::grid::{Dims, Observation, Rotation, from_xyzw};
use beo_ipc::text::from_field;
use beo_ipc::{Hypothesis, Percept};
use beo_picture::{Colour, MOST_UNSURE};
use foxglove::messages::packed_element_field::NumericType;
use foxglove::messages::{
    ArrowPrimitive, Color, CompressedImage, CubePrimitive, FrameTransform, LinePrimitive, PackedElementField, Point3, PointCloud, Pose,
    PoseInFrame, Quaternion, SceneEntity, SceneUpdate, TextPrimitive, TriangleListPrimitive, Vector3, line_primitive,
};
use nalgebra as na;
use std::time::Duration;

/// The frame of observations that name none.
pub const NO_FRAME: &str = "world";

/// Hypotheses less probable get no arrow.
const LEAST_DRAWN: f32 = 0.02;
/// Classes that have a bar, at most, and the least probability of one.
const MOST_BARS: usize = 5;
const LEAST_BAR: f32 = 0.005;

/// The part that all messages about one object at one time have in common.
#[derive(Clone, Debug)]
pub struct About {
    /// Name of the object in the recording: that of its frame and its entities.
    pub object: String,
    /// The frame that everything lies in.
    pub frame: String,
    /// When the sensor data was taken, CLOCK_MONOTONIC.
    pub capture_ns: u64,
    /// Makes time of day of it.
    pub clock: Clock,
    /// How long after its capture what is drawn of it disappears, if ever.
    pub lifetime: Option<Duration>,
}

impl About {
    fn entity(&self, what: &str) -> SceneEntity {
        SceneEntity {
            timestamp: Some(self.clock.timestamp(self.capture_ns)),
            frame_id: self.frame.clone(),
            id: format!("{} {what}", self.object),
            lifetime: self.lifetime.and_then(|lifetime| lifetime.try_into().ok()),
            frame_locked: true,
            ..SceneEntity::default()
        }
    }
}

/// The name of the frame in a message's field.
pub fn frame_of(field: &[u8; 32]) -> String {
    match from_field(field) {
        "" => NO_FRAME.into(),
        name => name.into(),
    }
}

fn colour(colour: Colour, alpha: f64) -> Color {
    let [r, g, b] = colour.rgb.map(|channel| f64::from(channel) / 255.0);
    Color { r, g, b, a: alpha }
}

fn pose(position: na::Point3<f64>, rotation: &Rotation) -> Pose {
    let [x, y, z, w] = rotation.coords.into();
    Pose { position: Some(Vector3 { x: position.x, y: position.y, z: position.z }), orientation: Some(Quaternion { x, y, z, w }) }
}

fn unturned(position: na::Point3<f64>) -> Pose {
    pose(position, &Rotation::identity())
}

/// The voxels that were seen to be filled, in the grid's frame, with the grid's place as their pose.
pub fn observed_points(about: &About, observation: &Observation, placement: &GridPlacement) -> PointCloud {
    let seen = observation.filled().ones().map(|voxel| (voxel, Colour::KNOWN, [1.0, 0.0]));
    point_cloud(about, observation.dims(), placement, seen)
}

/// The voxels of a completion that count as filled, for viewers that draw no surfaces: seen ones, and predicted ones, the paler the less
/// sure.
pub fn completed_points(about: &About, dims: Dims, occupancy: &[f32], deviation: &[f32], placement: &GridPlacement) -> PointCloud {
    let filled = occupancy.iter().zip(deviation).enumerate().filter(|(_, (p, _))| **p >= 0.5).map(|(voxel, (p, sd))| {
        let colour = if *sd == 0.0 { Colour::KNOWN } else { Colour::predicted(*sd) };
        (voxel, colour, [*p, *sd])
    });
    point_cloud(about, dims, placement, filled)
}

/// Centres of voxels with their colours, occupancy probability and its standard deviation.
fn point_cloud(
    about: &About,
    dims: Dims,
    placement: &GridPlacement,
    voxels: impl Iterator<Item = (usize, Colour, [f32; 2])>,
) -> PointCloud {
    let own = GridPlacement { voxel_size_m: placement.voxel_size_m, ..GridPlacement::default() };
    let mut data = Vec::new();
    for (voxel, colour, values) in voxels {
        let centre = own.place(dims, dims.coordinates(voxel).map(|side| side as f64 + 0.5));
        centre.iter().for_each(|side| data.extend((*side as f32).to_le_bytes()));
        data.extend(colour.rgb);
        data.push(u8::MAX);
        values.iter().for_each(|value| data.extend(value.to_le_bytes()));
    }
    let field = |name: &str, offset, kind: NumericType| PackedElementField { name: name.into(), offset, r#type: kind.into() };
    let coordinates = ["x", "y", "z"].into_iter().zip((0..).step_by(4)).map(|(name, at)| field(name, at, NumericType::Float32));
    let colours = ["red", "green", "blue", "alpha"].into_iter().zip(12..).map(|(name, at)| field(name, at, NumericType::Uint8));
    let values = ["probability", "deviation"].into_iter().zip([16, 20]).map(|(name, at)| field(name, at, NumericType::Float32));
    PointCloud {
        timestamp: Some(about.clock.timestamp(about.capture_ns)),
        frame_id: about.frame.clone(),
        pose: Some(pose(placement.position_m.into(), &placement.orientation)),
        point_stride: 24,
        fields: coordinates.chain(colours).chain(values).collect(),
        data: data.into(),
    }
}

/// A completion's surface, the more transparent the less sure.
pub fn completion(about: &About, surface: &Surface) -> SceneUpdate {
    let triangles = TriangleListPrimitive {
        pose: Some(unturned(na::Point3::origin())),
        points: surface.vertices.iter().map(|v| v.position_m).map(|[x, y, z]| Point3 { x, y, z }).collect(),
        colors: surface
            .vertices
            .iter()
            // A quarter of the solid is left in any case, so that it is seen at all.
            .map(|v| colour(Colour::rgb(v.rgb[0], v.rgb[1], v.rgb[2]), 1.0 - 0.75 * f64::from((v.deviation / MOST_UNSURE).clamp(0.0, 1.0))))
            .collect(),
        indices: surface.triangles.as_flattened().to_vec(),
        ..TriangleListPrimitive::default()
    };
    SceneUpdate { entities: vec![SceneEntity { triangles: vec![triangles], ..about.entity("completion") }], ..SceneUpdate::default() }
}

/// A picture as PNG, under the frame that its camera names.
pub fn image(about: &About, png: Vec<u8>) -> CompressedImage {
    CompressedImage {
        timestamp: Some(about.clock.timestamp(about.capture_ns)),
        frame_id: about.frame.clone(),
        data: png.into(),
        format: "png".into(),
    }
}

/// The most probable pose, from object axes to the frame: of the class that was answered, where a hypothesis is of it.
fn best(percept: &Percept) -> Option<Hypothesis> {
    let hypotheses = hypotheses(percept);
    hypotheses.iter().find(|h| h.class_index == percept.class_index).or(hypotheses.first()).copied()
}

fn hypotheses(percept: &Percept) -> &[Hypothesis] {
    &percept.hypotheses[..(percept.hypothesis_count as usize).min(percept.hypotheses.len())]
}

fn in_frame(percept: &Percept, hypothesis: &Hypothesis) -> Rotation {
    from_xyzw(percept.orientation) * from_xyzw(hypothesis.rotation_object_to_grid.map(f64::from))
}

/// The object's frame in that of the observation: x, y, z of the training shapes about the middle of the object's box.
pub fn transform(about: &About, percept: &Percept) -> Option<FrameTransform> {
    let rotation = in_frame(percept, &best(percept)?);
    let pose = pose(percept.object_position_m.into(), &rotation);
    Some(FrameTransform {
        timestamp: Some(about.clock.timestamp(about.capture_ns)),
        parent_frame_id: about.frame.clone(),
        child_frame_id: about.object.clone(),
        translation: pose.position,
        rotation: pose.orientation,
    })
}

/// The same as a pose.
pub fn pose_in_frame(about: &About, percept: &Percept) -> Option<PoseInFrame> {
    let rotation = in_frame(percept, &best(percept)?);
    Some(PoseInFrame {
        timestamp: Some(about.clock.timestamp(about.capture_ns)),
        frame_id: about.frame.clone(),
        pose: Some(pose(percept.object_position_m.into(), &rotation)),
    })
}

/// An answer's class as text, its pose hypotheses as arrows and its box.
pub fn object(about: &About, percept: &Percept, text: String) -> SceneUpdate {
    let middle = na::Point3::from(percept.object_position_m);
    let half_m = half_longest_side_m(percept);
    let mut entity = about.entity("object");
    let best = best(percept).map(|hypothesis| in_frame(percept, &hypothesis));
    // The front of the training shapes is −y: an arrow there for each hypothesis, the more probable the more solid.
    for hypothesis in hypotheses(percept).iter().filter(|h| h.probability >= LEAST_DRAWN) {
        let front = in_frame(percept, hypothesis) * -na::Vector3::y();
        let alpha = f64::from(hypothesis.probability.clamp(0.0, 1.0));
        entity.arrows.push(arrow(middle, front, 1.3 * half_m, 0.08 * half_m, colour(Colour::PREDICTED, 0.2 + 0.8 * alpha)));
    }
    if let Some(rotation) = best {
        let axes = [(na::Vector3::x(), Colour::X_AXIS), (na::Vector3::y(), Colour::Y_AXIS), (na::Vector3::z(), Colour::Z_AXIS)];
        for (axis, shade) in axes {
            entity.arrows.push(arrow(middle, rotation * axis, half_m, 0.04 * half_m, colour(shade, 1.0)));
        }
        if has_box(percept) {
            entity.lines.push(wire_box(middle, &rotation, percept.object_extent_m.map(f64::from)));
        }
    }
    let up = from_xyzw(percept.orientation) * na::Vector3::z();
    entity.texts.push(label(middle + up * 1.25 * half_m, 16.0, text));
    SceneUpdate { entities: vec![entity], ..SceneUpdate::default() }
}

fn has_box(percept: &Percept) -> bool {
    percept.object_extent_m.iter().all(|side| *side > 0.0)
}

/// Half the longest side of an answer's box. Where there is none, of the training shapes, which take four fifths of their grid.
fn half_longest_side_m(percept: &Percept) -> f64 {
    match has_box(percept) {
        true => 0.5 * percept.object_extent_m.map(f64::from).into_iter().fold(0.0, f64::max),
        false => 0.4 * f64::from(percept.voxel_size_m) * f64::from(percept.dims.into_iter().max().unwrap_or(0)),
    }
}

/// Text that always faces the viewer, of a height in pixels.
fn label(place: na::Point3<f64>, height: f64, text: String) -> TextPrimitive {
    TextPrimitive {
        pose: Some(unturned(place)),
        billboard: true,
        font_size: height,
        scale_invariant: true,
        color: Some(colour(Colour::rgb(255, 255, 255), 1.0)),
        text,
    }
}

/// The probabilities of the most probable classes as bars above the object, one above the other, across the line of sight of a camera
/// before which the grid was laid (its x axis leads away from the camera, z is up).
pub fn classes(about: &About, percept: &Percept, ranking: &[(&str, f32)]) -> SceneUpdate {
    let (middle, half_m) = (na::Point3::from(percept.object_position_m), half_longest_side_m(percept));
    let grid = from_xyzw(percept.orientation);
    let shown: Vec<_> = ranking.iter().take(MOST_BARS).filter(|(_, probability)| *probability >= LEAST_BAR).collect();
    let mut entity = about.entity("classes");
    for (place, (name, probability)) in shown.iter().enumerate() {
        let length_m = 2.0 * half_m * f64::from(*probability);
        let height_m = (1.6 + 0.28 * (shown.len() - 1 - place) as f64) * half_m;
        // All begin at the left, as the camera sees it.
        let at = |left_m: f64| middle + grid * na::Vector3::new(0.0, left_m, height_m);
        entity.cubes.push(CubePrimitive {
            pose: Some(pose(at(half_m - 0.5 * length_m), &grid)),
            size: Some(Vector3 { x: 0.05 * half_m, y: length_m, z: 0.2 * half_m }),
            color: Some(colour(if place == 0 { Colour::PREDICTED } else { Colour::KNOWN }, 0.9)),
        });
        entity.texts.push(label(at(1.5 * half_m), 12.0, format!("{name} {:.0} %", 100.0 * probability)));
    }
    SceneUpdate { entities: vec![entity], ..SceneUpdate::default() }
}

/// An arrow of a length and a shaft's width; Foxglove's point along +x of their pose.
fn arrow(from: na::Point3<f64>, towards: na::Vector3<f64>, length_m: f64, width_m: f64, color: Color) -> ArrowPrimitive {
    let half_turn = Rotation::from_axis_angle(&na::Vector3::z_axis(), std::f64::consts::PI);
    let rotation = Rotation::rotation_between(&na::Vector3::x(), &towards).unwrap_or(half_turn);
    ArrowPrimitive {
        pose: Some(pose(from, &rotation)),
        shaft_length: 0.8 * length_m,
        shaft_diameter: width_m,
        head_length: 0.2 * length_m,
        head_diameter: 2.5 * width_m,
        color: Some(color),
    }
}

/// The edges of a box about its middle, in pairs of ends.
fn wire_box(middle: na::Point3<f64>, rotation: &Rotation, extent_m: [f64; 3]) -> LinePrimitive {
    let corner = |bits: usize| {
        let [x, y, z] = [0, 1, 2].map(|axis| extent_m[axis] * if bits >> axis & 1 == 1 { 0.5 } else { -0.5 });
        Point3 { x, y, z }
    };
    let edges = (0..8_usize).flat_map(|from| (0..3).map(move |axis| (from, from | 1 << axis))).filter(|(from, to)| from != to);
    LinePrimitive {
        r#type: line_primitive::Type::LineList.into(),
        pose: Some(pose(middle, rotation)),
        thickness: 2.0,
        scale_invariant: true,
        points: edges.flat_map(|(from, to)| [corner(from), corner(to)]).collect(),
        color: Some(colour(Colour::SERIES[2], 1.0)),
        ..LinePrimitive::default()
    }
}
