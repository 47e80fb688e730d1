//! `cam_K.txt`: the camera matrix as nine numbers, as FoundationPose has it; also of 3 × 4 and 4 × 4 (ScanNet).

use super::description::Description;
use super::error::wrong;
use beo_shapes::FormatError;

/// The numbers of a text of nothing else; `None` of any other text.
pub(super) fn numbers(text: &str) -> Option<Vec<f64>> {
    let words =
        text.lines().filter(|line| !line.trim_start().starts_with('#')).flat_map(|line| line.split([' ', ',', ';', '\t', '\r', '[', ']']));
    words.filter(|word| !word.is_empty()).map(|word| word.parse().ok()).collect::<Option<Vec<f64>>>().filter(|numbers| !numbers.is_empty())
}

/// The camera of such a matrix, in rows.
pub(super) fn parse(numbers: &[f64]) -> Result<Vec<Description>, FormatError> {
    let matrix = match *numbers {
        [a, b, c, d, e, f, g, h, i] => [a, b, c, d, e, f, g, h, i],
        [a, b, c, 0.0, d, e, f, 0.0, g, h, i, 0.0] | [a, b, c, 0.0, d, e, f, 0.0, g, h, i, 0.0, 0.0, 0.0, 0.0, 1.0] => {
            [a, b, c, d, e, f, g, h, i]
        }
        _ => return Err(wrong(format!("{} numbers: expected the nine of a camera matrix, fx 0 cx, 0 fy cy, 0 0 1", numbers.len()))),
    };
    Ok(vec![Description { matrix: camera_matrix("the matrix", &matrix)?, ..Description::default() }])
}

/// fx, fy, cx, cy of [fx 0 cx, 0 fy cy, 0 0 1] in rows; all zeros, of a camera that is not calibrated, are kept.
pub(super) fn camera_matrix(what: &str, numbers: &[f64]) -> Result<[f64; 4], FormatError> {
    let &[fx, skew, cx, a, fy, cy, b, c, one] = numbers else {
        return Err(wrong(format!("{what} has {} numbers: expected 9", numbers.len())));
    };
    if numbers.iter().any(|number| *number != 0.0) && [skew, a, b, c, one] != [0.0, 0.0, 0.0, 0.0, 1.0] {
        return Err(wrong(format!("{what} is not [fx 0 cx, 0 fy cy, 0 0 1]")));
    }
    Ok([fx, fy, cx, cy])
}
