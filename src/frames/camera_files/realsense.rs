//! The output of librealsense: `rs-enumerate-devices -c`, a block for each stream and resolution, and the Python wrapper's one line.

use super::description::Description;
use super::distortion;
use super::error::wrong;
use beo_shapes::FormatError;

/// Whether a text is one of these.
pub(super) fn is_printed(text: &str) -> bool {
    text.contains("Intrinsic of \"") || (text.contains(" p[") && text.contains(" f["))
}

/// The cameras of a text; as many as it has streams and resolutions.
pub(super) fn parse(text: &str) -> Result<Vec<Description>, FormatError> {
    if text.contains("Intrinsic of \"") { blocks(text) } else { Ok(vec![line(text)?]) }
}

/// Blocks of `Name: value` lines after `Intrinsic of "Depth" / 640x480 / {Z16}`.
fn blocks(text: &str) -> Result<Vec<Description>, FormatError> {
    let mut cameras = Vec::new();
    for block in text.split("Intrinsic of \"").skip(1) {
        let name = block.split('"').next().unwrap_or_default();
        let lines: Vec<(&str, &str)> =
            block.lines().skip(1).take_while(|line| !line.trim().is_empty()).filter_map(|line| line.split_once(':')).collect();
        let value = |wanted: &str| {
            let found = lines.iter().find(|(key, _)| key.trim().eq_ignore_ascii_case(wanted)).map(|(_, value)| value.trim());
            found.ok_or_else(|| wrong(format!("the intrinsics of {name:.40} have no {wanted}")))
        };
        let number = |wanted: &str| {
            let text = value(wanted)?;
            text.parse::<f64>().map_err(|_| wrong(format!("the {wanted} of {name:.40} is `{text:.40}`: expected a number")))
        };
        let coefficients = value("Coeffs")?.split_whitespace().map(str::parse::<f64>).collect::<Result<Vec<_>, _>>();
        let coefficients = coefficients.map_err(|_| wrong(format!("the Coeffs of {name:.40} are not numbers")))?;
        cameras.push(Description {
            name: Some(name.to_owned()),
            size: Some([number("Width")? as u32, number("Height")? as u32]),
            matrix: [number("Fx")?, number("Fy")?, number("PPX")?, number("PPY")?],
            lens: distortion::lens(Some(value("Distortion")?), &coefficients).map_err(wrong)?,
            ..Description::default()
        });
    }
    Ok(cameras)
}

/// `[ 640x480  p[317.9 241.4]  f[387.5 387.5]  Brown Conrady [0 0 0 0 0] ]`, as Python prints `rs2.intrinsics`.
fn line(text: &str) -> Result<Description, FormatError> {
    let expected = || wrong("expected [ 640x480  p[cx cy]  f[fx fy]  model [coefficients] ], as librealsense prints intrinsics");
    let numbers =
        |text: &str| text.split([' ', ',']).filter(|word| !word.is_empty()).map(|word| word.parse().ok()).collect::<Option<Vec<f64>>>();
    let between = |text: &'_ str, open: &str| {
        let (_, rest) = text.split_once(open)?;
        let (inside, rest) = rest.split_once(']')?;
        Some((inside.to_owned(), rest.to_owned()))
    };
    let read = || {
        let (size, _) = text.split_once(" p[")?;
        let (width, height) = size.trim().trim_start_matches("width:").trim_start_matches(['[', ' ']).split_once('x')?;
        let (centre, rest) = between(text, " p[")?;
        let (focal, rest) = between(&rest, " f[")?;
        let (model, rest) = rest.split_once('[').map(|(model, rest)| (model.trim().to_owned(), rest.to_owned()))?;
        let (coefficients, _) = rest.split_once(']')?;
        let size = [width.trim().parse().ok()?, height.trim().parse().ok()?];
        let (&[cx, cy], &[fx, fy]) = (&numbers(&centre)?[..], &numbers(&focal)?[..]) else { return None };
        Some((size, [fx, fy, cx, cy], model, numbers(coefficients)?))
    };
    let (size, matrix, model, coefficients) = read().ok_or_else(expected)?;
    let lens = distortion::lens(Some(&model), &coefficients).map_err(wrong)?;
    Ok(Description { size: Some(size), matrix, lens, ..Description::default() })
}
