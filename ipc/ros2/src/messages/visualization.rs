//! `visualization_msgs`: what RViz draws.

use super::{CompressedImage, Duration, Header, Point, Pose};

super::messages! {
    ColorRGBA { r: f32, g: f32, b: f32, a: f32 }
    UVCoordinate { u: f32, v: f32 }
    MeshFile { filename: String, #[serde(with = "serde_bytes")] data: Vec<u8> }
    Marker {
        header: Header, ns: String, id: i32, r#type: i32, action: i32, pose: Pose, scale: Point, color: ColorRGBA, lifetime: Duration,
        frame_locked: bool, points: Vec<Point>, colors: Vec<ColorRGBA>, texture_resource: String, texture: CompressedImage,
        uv_coordinates: Vec<UVCoordinate>, text: String, mesh_resource: String, mesh_file: MeshFile, mesh_use_embedded_materials: bool,
    }
    MarkerArray { markers: Vec<Marker> }
}
super::topics!("visualization_msgs": MarkerArray);

impl Marker {
    /// `type`: an arrow along x.
    pub const ARROW: i32 = 0;
    /// `type`: lines between pairs of points.
    pub const LINE_LIST: i32 = 5;
    /// `type`: a cube at each point.
    pub const CUBE_LIST: i32 = 6;
    /// `type`: text that faces the viewer.
    pub const TEXT_VIEW_FACING: i32 = 9;
    /// `action`: add it, or change it.
    pub const ADD: i32 = 0;
    /// `action`: take it away.
    pub const DELETE: i32 = 2;
}
