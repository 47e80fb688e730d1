//! Intrinsics as named numbers: librealsense's (`fx`, `fy`, `ppx`, `ppy`, `model`, `coeffs`) as JSON, the same with `cx`, `cy` as many
//! programs write them, and Open3D's `PinholeCameraIntrinsic` with its `intrinsic_matrix` in columns.

use super::description::Description;
use super::distortion;
use super::document::Node;
use super::error::wrong;
use super::matrix::camera_matrix;
use beo_shapes::FormatError;

/// librealsense's numbers of its models, `rs2_distortion`.
const MODELS: [&str; 6] = ["none", "modified_brown_conrady", "inverse_brown_conrady", "ftheta", "brown_conrady", "kannala_brandt4"];

/// Whether a mapping names a camera's numbers.
pub(super) fn is_camera(node: &Node) -> bool {
    node.has(&["fx"]) && node.has(&["fy"]) || node.has(&["intrinsic_matrix"])
}

fn size(node: &Node) -> Result<Option<[u32; 2]>, FormatError> {
    match (node.pixels(&["width", "image_width"])?, node.pixels(&["height", "image_height"])?) {
        (Some(width), Some(height)) => Ok(Some([width, height])),
        (None, None) => Ok(None),
        _ => Err(wrong("only one of width and height")),
    }
}

/// The camera of a mapping.
pub(super) fn parse(name: Option<&str>, node: &Node) -> Result<Description, FormatError> {
    let named = Description { name: name.map(str::to_owned), size: size(node)?, ..Description::default() };
    if let Some(numbers) = node.numbers(&["intrinsic_matrix"])? {
        return Ok(Description { matrix: matrix_in_columns(&numbers)?, ..named });
    }
    let number = |spellings: &[&str]| node.number(spellings)?.ok_or_else(|| wrong(format!("there is no {}", spellings.join(", and no "))));
    let matrix = [number(&["fx"])?, number(&["fy"])?, number(&["ppx", "cx"])?, number(&["ppy", "cy"])?];
    let coefficients = node.numbers(&["coeffs", "distortion_coefficients", "dist_coeffs", "D"])?.unwrap_or_default();
    let model = node.text(&["model", "distortion_model", "distortion"])?;
    let model = model.map(|text| text.parse::<usize>().ok().and_then(|number| MODELS.get(number).copied()).unwrap_or(text));
    Ok(Description { matrix, lens: distortion::lens(model, &coefficients).map_err(wrong)?, ..named })
}

/// fx, fy, cx, cy of [fx, 0, 0, 0, fy, 0, cx, cy, 1]. The same matrix in rows has its zeros elsewhere, so the two cannot be mistaken.
fn matrix_in_columns(numbers: &[f64]) -> Result<[f64; 4], FormatError> {
    match *numbers {
        [fx, 0.0, 0.0, skew, fy, 0.0, cx, cy, one] => camera_matrix("intrinsic_matrix", &[fx, skew, cx, 0.0, fy, cy, 0.0, 0.0, one]),
        _ => camera_matrix("intrinsic_matrix", numbers),
    }
}
