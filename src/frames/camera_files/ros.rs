//! ROS's `camera_info`: as `camera_calibration` writes it (`camera_matrix: {data: [...]}`), and as `rostopic echo` and `ros2 topic echo`
//! print it (`K: [...]`, `k: ...`), with binning and region of interest as sensor_msgs/CameraInfo defines them.

use super::description::Description;
use super::distortion;
use super::document::Node;
use super::error::wrong;
use super::matrix::camera_matrix;
use beo_shapes::FormatError;

/// The camera of a document.
pub(super) fn parse(root: &Node) -> Result<Description, FormatError> {
    let side = |name: &str, short: &str| {
        root.pixels(&[name, short])?.ok_or_else(|| {
            wrong(format!("there is no {name}, and no {short}: expected a camera_info, or intrinsics of Kalibr, Open3D or RealSense"))
        })
    };
    let size = [side("image_width", "width")?, side("image_height", "height")?];
    let matrix = root.numbers(&["camera_matrix", "K"])?.ok_or_else(|| wrong("there is no camera_matrix with data, and no K"))?;
    let coefficients = root.numbers(&["distortion_coefficients", "D"])?.unwrap_or_default();
    let projection = root.numbers(&["projection_matrix", "P"])?;
    let header = root.get(&["header"])?;
    let frame_id = header.map(|header| header.text(&["frame_id"])).transpose()?.flatten();
    Ok(Description {
        name: root.text(&["camera_name"])?.map(str::to_owned),
        size: Some(size),
        matrix: camera_matrix("the camera matrix", &matrix)?,
        lens: distortion::lens(root.text(&["distortion_model"])?, &coefficients).map_err(wrong)?,
        projection: projection.map(|numbers| projection_matrix(&numbers)),
        // 0 is as 1.
        binning: [root.pixels(&["binning_x"])?.unwrap_or(0), root.pixels(&["binning_y"])?.unwrap_or(0)],
        region: root.get(&["roi"])?.map(|roi| region(roi, size)).transpose()?.flatten(),
        frame_id: frame_id.map(str::to_owned),
    })
}

/// fx, fy, cx, cy of [fx' 0 cx' Tx, 0 fy' cy' Ty, 0 0 1 0]; what moves the second of two cameras does not matter for one.
fn projection_matrix(numbers: &[f64]) -> Result<[f64; 4], FormatError> {
    match *numbers {
        [a, b, c, _, d, e, f, _, g, h, i, _] => camera_matrix("the projection matrix", &[a, b, c, d, e, f, g, h, i]),
        _ => Err(wrong(format!("the projection matrix has {} numbers: expected 12", numbers.len()))),
    }
}

/// In pixels of the calibrated image; all zeros is all of it.
fn region(roi: &Node, [width, height]: [u32; 2]) -> Result<Option<[u32; 4]>, FormatError> {
    let number = |name: &str| Ok::<u32, FormatError>(roi.pixels(&[name])?.unwrap_or(0));
    match [number("x_offset")?, number("y_offset")?, number("width")?, number("height")?] {
        [0, 0, 0, 0] => Ok(None),
        [x, y, 0, 0] => Ok(Some([x, y, width.saturating_sub(x), height.saturating_sub(y)])),
        region => Ok(Some(region)),
    }
}
