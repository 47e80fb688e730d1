//! Kalibr's `camchain.yaml`: `cam0`, `cam1`, … with `intrinsics: [fx, fy, cx, cy]`, `distortion_model` radtan, equidistant or none.

use super::description::Description;
use super::distortion;
use super::document::Node;
use super::error::wrong;
use beo_shapes::FormatError;

/// Whether a mapping is a camera of Kalibr's.
pub(super) fn is_camera(node: &Node) -> bool {
    node.has(&["intrinsics"]) && node.has(&["camera_model", "resolution", "distortion_coeffs"])
}

/// The camera of a mapping.
pub(super) fn parse(name: &str, node: &Node) -> Result<Description, FormatError> {
    let model = node.text(&["camera_model"])?.unwrap_or("pinhole");
    if model != "pinhole" {
        return Err(wrong(format!(
            "{name:.40}: the camera_model `{model:.40}` is not supported: calibrate with pinhole-radtan or pinhole-equi"
        )));
    }
    let intrinsics = node.numbers(&["intrinsics"])?.unwrap_or_default();
    let &[fx, fy, cx, cy] = &intrinsics[..] else {
        return Err(wrong(format!("{name:.40}: intrinsics has {} numbers: expected fx, fy, cx, cy", intrinsics.len())));
    };
    let size = match node.numbers(&["resolution"])?.as_deref() {
        None => None,
        Some(&[width, height]) => Some([width as u32, height as u32]),
        Some(numbers) => return Err(wrong(format!("{name:.40}: resolution has {} numbers: expected width and height", numbers.len()))),
    };
    let coefficients = node.numbers(&["distortion_coeffs"])?.unwrap_or_default();
    Ok(Description {
        name: Some(name.into()),
        size,
        matrix: [fx, fy, cx, cy],
        lens: distortion::lens(node.text(&["distortion_model"])?, &coefficients)
            .map_err(|problem| wrong(format!("{name:.40}: {problem}")))?,
        ..Description::default()
    })
}
