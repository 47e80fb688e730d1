//! `geometry_msgs`. `Vector3` has the fields of [`Point`], which stands for both.

super::messages! {
    Point { x: f64, y: f64, z: f64 }
    Quaternion { x: f64, y: f64, z: f64, w: f64 }
    Pose { position: Point, orientation: Quaternion }
    Transform { translation: Point, rotation: Quaternion }
    TransformStamped { header: super::Header, child_frame_id: String, transform: Transform }
}

/// A pose and the covariance of x, y, z and the rotations about the fixed axes X, Y, Z, row by row.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[allow(missing_docs, reason = "the fields are those of the .msg file of the same name")]
pub struct PoseWithCovariance {
    pub pose: Pose,
    #[serde(with = "serde_big_array::BigArray")]
    pub covariance: [f64; 36],
}

impl Default for PoseWithCovariance {
    fn default() -> Self {
        Self { pose: Pose::default(), covariance: [0.0; 36] }
    }
}

impl From<[f64; 3]> for Point {
    fn from([x, y, z]: [f64; 3]) -> Self {
        Self { x, y, z }
    }
}

impl From<[f64; 4]> for Quaternion {
    /// Of x, y, z, w.
    fn from([x, y, z, w]: [f64; 4]) -> Self {
        Self { x, y, z, w }
    }
}
