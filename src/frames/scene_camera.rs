//! `scene_camera.json` of BOP scenes: camera matrix, unit of depth and, where known, the camera's place, for each image.

use beo_camera::{Intrinsics, IntrinsicsError};
use beo_core::text::printable;
use beo_shapes::FormatError;
use nalgebra::{Isometry3, Matrix3, Rotation3, Translation3, UnitQuaternion, Vector3};
use serde::Deserialize;
use std::collections::BTreeMap;

/// The camera of one image. The image's size is the image's own.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SceneCamera {
    focal: [f64; 2],
    centre: [f64; 2],
    /// Metres per unit of the depth image.
    pub metres_per_unit: f64,
    /// Takes the camera's frame to the world's, metres, where it is known.
    pub camera_to_world: Option<Isometry3<f64>>,
}

impl SceneCamera {
    /// The camera, for images of `width` × `height` pixels.
    ///
    /// # Errors
    /// As [`Intrinsics::new`].
    pub fn intrinsics(&self, width: u32, height: u32) -> Result<Intrinsics, IntrinsicsError> {
        Intrinsics::new(width, height, self.focal, self.centre, [0.0; 5])
    }
}

/// As the file has it; other fields are passed over.
#[derive(Deserialize)]
#[allow(non_snake_case)] // the format's own names
struct Entry {
    cam_K: [f64; 9],
    depth_scale: f64,
    cam_R_w2c: Option<[f64; 9]>,
    cam_t_w2c: Option<[f64; 3]>,
}

/// How far the rows of a rotation matrix may be from orthonormal.
const ORTHONORMAL: f64 = 1e-3;

/// Reads a `scene_camera.json`: the camera of each image, by its number. `depth_scale` (millimetres) and `cam_t_w2c` (millimetres) become
/// metres.
///
/// # Errors
/// [`FormatError`]: what is no such JSON, or numbers that describe no camera or place; the image is named.
pub fn parse_scene_camera(bytes: &[u8]) -> Result<BTreeMap<u32, SceneCamera>, FormatError> {
    let entries: BTreeMap<String, Entry> = serde_json::from_slice(bytes).map_err(|error| wrong(error.to_string()))?;
    let mut cameras = BTreeMap::new();
    for (key, entry) in entries {
        // `1` and `000001` are the same image.
        let image: u32 = key.parse().map_err(|_| wrong(format!("the key `{key:.40}` is no image number")))?;
        let camera = camera(&entry).map_err(|problem| wrong(format!("image {image}: {problem}")))?;
        if cameras.insert(image, camera).is_some() {
            return Err(wrong(format!("image {image} is there twice")));
        }
    }
    Ok(cameras)
}

fn wrong(problem: String) -> FormatError {
    FormatError::File { format: "scene_camera", problem: printable(&problem) }
}

fn camera(entry: &Entry) -> Result<SceneCamera, String> {
    let [fx, skew, cx, a, fy, cy, b, c, one] = entry.cam_K;
    if [skew, a, b, c, one] != [0.0, 0.0, 0.0, 0.0, 1.0] {
        return Err("cam_K is not [fx 0 cx, 0 fy cy, 0 0 1]".into());
    }
    Intrinsics::new(1, 1, [fx, fy], [cx, cy], [0.0; 5]).map_err(|error| error.to_string())?;
    let metres_per_unit = entry.depth_scale * 1e-3;
    if !(metres_per_unit > 0.0 && metres_per_unit.is_finite()) {
        return Err(format!("depth_scale is {}: expected millimetres per unit", entry.depth_scale));
    }
    let camera_to_world = match (entry.cam_R_w2c, entry.cam_t_w2c) {
        (Some(rotation), Some(translation)) => Some(world_to_camera(rotation, translation)?.inverse()),
        (None, None) => None,
        _ => return Err("only one of cam_R_w2c and cam_t_w2c".into()),
    };
    Ok(SceneCamera { focal: [fx, fy], centre: [cx, cy], metres_per_unit, camera_to_world })
}

fn world_to_camera(rotation: [f64; 9], translation_mm: [f64; 3]) -> Result<Isometry3<f64>, String> {
    let matrix = Matrix3::from_row_slice(&rotation);
    let off = (matrix * matrix.transpose() - Matrix3::identity()).abs().max();
    // Written so that NaN is refused too.
    if !(off <= ORTHONORMAL && matrix.determinant() > 0.0) {
        return Err("cam_R_w2c is no rotation matrix".into());
    }
    if !translation_mm.iter().all(|t| t.is_finite()) {
        return Err("cam_t_w2c is not finite".into());
    }
    let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(matrix));
    let rotation = UnitQuaternion::new_normalize(rotation.into_inner());
    Ok(Isometry3::from_parts(Translation3::from(Vector3::from(translation_mm) * 1e-3), rotation))
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Point3;

    #[test]
    fn cameras_are_read_with_millimetres_as_metres() {
        // Keys may be padded as the images' names are; the second turns by 90° about z: x of the world is y of the camera.
        let text = r#"{"0": {"cam_K": [572.4, 0.0, 325.3, 0.0, 573.6, 242.0, 0.0, 0.0, 1.0], "depth_scale": 0.1, "view_level": 3},
            "000012": {"cam_K": [500, 0, 320, 0, 500, 240, 0, 0, 1], "depth_scale": 1.0,
                   "cam_R_w2c": [0, -1, 0, 1, 0, 0, 0, 0, 1], "cam_t_w2c": [10, 0, 500]}}"#;
        let cameras = parse_scene_camera(text.as_bytes()).unwrap();
        assert_eq!(cameras.keys().copied().collect::<Vec<_>>(), [0, 12]);
        assert_eq!(cameras[&0].intrinsics(640, 480).unwrap().focal(), [572.4, 573.6]);
        assert!((cameras[&0].metres_per_unit - 1e-4).abs() < 1e-12 && cameras[&0].camera_to_world.is_none());
        let place = cameras[&12].camera_to_world.unwrap();
        // World (1, 0, 0) is seen at (0, 1, 0) + (0.01, 0, 0.5).
        assert!((place * Point3::new(0.01, 1.0, 0.5) - Point3::new(1.0, 0.0, 0.0)).norm() < 1e-12);
    }

    #[test]
    fn numbers_that_describe_no_camera_are_refused_with_the_image() {
        let message = |entry: &str| {
            let text = format!("{{\"3\": {{\"cam_K\": [5, 0, 3, 0, 5, 2, 0, 0, 1], \"depth_scale\": 1{entry}}}}}");
            parse_scene_camera(text.as_bytes()).unwrap_err().to_string()
        };
        assert!(message(", \"cam_R_w2c\": [1, 0, 0, 0, 1, 0, 0, 0, 1]").contains("image 3: only one of"));
        assert!(message(", \"cam_R_w2c\": [1, 0, 0, 0, 1, 0, 0, 0, 2], \"cam_t_w2c\": [0, 0, 0]").contains("no rotation"));
        assert!(message(", \"cam_R_w2c\": [1, 0, 0, 0, 1, 0, 0, 0, -1], \"cam_t_w2c\": [0, 0, 0]").contains("no rotation"));
        assert!(message(", \"cam_R_w2c\": [1, 0, 0], \"cam_t_w2c\": [0, 0, 0]").contains("length 9"));
        let message = |text: &str| parse_scene_camera(text.as_bytes()).unwrap_err().to_string();
        let one = "{\"cam_K\": [5, 0, 3, 0, 5, 2, 0, 0, 1], \"depth_scale\": 1}";
        assert!(message(&format!("{{\"1\": {one}, \"01\": {one}}}")).contains("image 1 is there twice"));
        assert!(message(&format!("{{\"-1\": {one}}}")).contains("`-1` is no image number"));
        assert!(message("[]").contains("expected a map") && message("{\"x\": 1}").contains("scene_camera"));
        assert!(message("{\"0\": {\"cam_K\": [0, 0, 3, 0, 5, 2, 0, 0, 1], \"depth_scale\": 1}}").contains("focal"));
        assert!(message("{\"0\": {\"cam_K\": [5, 0, 3, 0, 5, 2, 0, 0, 1], \"depth_scale\": -1}}").contains("depth_scale is -1"));
        assert!(message("{\"0\": {\"depth_scale\": 1}}").contains("cam_K"));
    }
}
