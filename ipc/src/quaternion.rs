//! The length of quaternions that arrive, x, y, z, w.

/// How far the norm of a unit quaternion may be from 1.
pub const QUATERNION_NORM_TOLERANCE: f64 = 1e-3;
/// The tolerance for a norm of 1 after rounding.
const ROUNDING: f64 = 1e-12;

/// A valid quaternion at length 1, so that rotating by it scales nothing. One that is 1 but for rounding stays as it is, bit by bit.
pub(crate) fn normalised(quaternion: [f64; 4]) -> [f64; 4] {
    let norm = norm(quaternion);
    let is_near = (ROUNDING..=QUATERNION_NORM_TOLERANCE).contains(&(norm - 1.0).abs());
    if is_near { quaternion.map(|value| value / norm) } else { quaternion }
}

/// Of finite parts the norm is finite or, by overflow, infinite; never NaN.
pub(crate) fn norm(quaternion: [f64; 4]) -> f64 {
    quaternion.iter().map(|value| value * value).sum::<f64>().sqrt()
}
