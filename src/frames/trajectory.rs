//! Trajectories in the format of the TUM RGB-D benchmark: a line `stamp tx ty tz qx qy qz qw` for each pose of the camera in the world.

use beo_core::text::printable;
use beo_shapes::FormatError;
use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion};

/// Where the camera was, and when.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StampedPose {
    /// When, of whatever clock, nanoseconds.
    pub stamp_ns: u64,
    /// Takes the camera's frame to the world's, metres.
    pub camera_to_world: Isometry3<f64>,
}

/// How far a quaternion's length may be from 1.
const UNIT: f64 = 0.01;
/// No camera is farther from the origin, metres.
const FARTHEST_M: f64 = 1e6;

/// Reads the poses in order. Lines that start with # are comments.
///
/// # Errors
/// [`FormatError`] names the first line that is no pose.
pub fn parse_trajectory(bytes: &[u8]) -> Result<Vec<StampedPose>, FormatError> {
    let text = std::str::from_utf8(bytes).map_err(|_| FormatError::File { format: FORMAT, problem: "not text in UTF-8".into() })?;
    let mut poses = Vec::new();
    for (index, line) in text.lines().enumerate() {
        if line.trim().is_empty() || line.trim_start().starts_with('#') {
            continue;
        }
        poses.push(pose(line).map_err(|problem| FormatError::Line { format: FORMAT, line: index + 1, problem: printable(&problem) })?);
    }
    Ok(poses)
}

const FORMAT: &str = "trajectory";

fn pose(line: &str) -> Result<StampedPose, String> {
    let mut words = line.split_whitespace();
    let stamp = words.next().unwrap_or_default();
    let mut numbers = [0.0_f64; 7];
    for number in &mut numbers {
        let word = words.next().ok_or("fewer than 8 numbers: expected stamp tx ty tz qx qy qz qw")?;
        *number = word.parse().map_err(|_| format!("`{word:.40}` is not a number"))?;
    }
    if words.next().is_some() {
        return Err("more than 8 numbers: expected stamp tx ty tz qx qy qz qw".into());
    }
    let [x, y, z, i, j, k, w] = numbers;
    if !numbers[..3].iter().all(|t| t.abs() <= FARTHEST_M) {
        return Err(format!("the place {x} {y} {z} is out of range: expected metres"));
    }
    let quaternion = Quaternion::new(w, i, j, k);
    // Written so that NaN is refused too.
    if f64::abs(quaternion.norm() - 1.0) <= UNIT {
        let camera_to_world = Isometry3::from_parts(Translation3::new(x, y, z), UnitQuaternion::new_normalize(quaternion));
        Ok(StampedPose { stamp_ns: stamp_ns(stamp).ok_or_else(|| format!("`{stamp:.40}` is no time in seconds"))?, camera_to_world })
    } else {
        Err(format!("the quaternion {i} {j} {k} {w} has not length 1"))
    }
}

/// Seconds as nanoseconds; exact where they are written as digits with up to nine decimals.
fn stamp_ns(text: &str) -> Option<u64> {
    let (whole, part) = text.split_once('.').unwrap_or((text, ""));
    let digits = |s: &str| s.bytes().all(|b| b.is_ascii_digit());
    if !whole.is_empty() && digits(whole) && digits(part) && part.len() <= 9 {
        let seconds: u64 = whole.parse().ok()?;
        return seconds.checked_mul(1_000_000_000)?.checked_add(format!("{part:0<9}").parse().ok()?);
    }
    let ns = (text.parse::<f64>().ok()? * 1e9).round();
    (ns >= 0.0 && ns < u64::MAX as f64).then_some(ns as u64)
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Point3;

    #[test]
    fn poses_are_read_in_order_with_exact_stamps() {
        let text = "# timestamp tx ty tz qx qy qz qw\n1305031102.160407001 1 2 3 0 0 0.70710678 0.70710678\n\n  2e1 0 0 0 0 0 0 -1\r\n7 0 0 0 1 0 0 0";
        let poses = parse_trajectory(text.as_bytes()).unwrap();
        assert_eq!(poses.iter().map(|pose| pose.stamp_ns).collect::<Vec<_>>(), [1_305_031_102_160_407_001, 20_000_000_000, 7_000_000_000]);
        // A quarter turn about z, then the shift.
        assert!((poses[0].camera_to_world * Point3::new(1.0, 0.0, 0.0) - Point3::new(1.0, 3.0, 3.0)).norm() < 1e-9);
        assert!((poses[1].camera_to_world * Point3::new(1.0, 2.0, 0.0) - Point3::new(1.0, 2.0, 0.0)).norm() < 1e-9);
    }

    #[test]
    fn what_is_no_pose_is_refused_with_its_line() {
        let message = |line: &str| parse_trajectory(format!("# x\n{line}\n").as_bytes()).unwrap_err().to_string();
        for (line, part) in [
            ("1 2 3", "line 2: fewer than 8"),
            ("1 2 3 4 0 0 0 1 9", "more than 8"),
            ("1 a 3 4 0 0 0 1", "`a` is not a number"),
            ("1 nan 3 4 0 0 0 1", "out of range"),
            ("1 1e300 3 4 0 0 0 1", "out of range"),
            ("1 2 3 4 0 0 0 0", "has not length 1"),
            ("1 2 3 4 0 0 0 nan", "has not length 1"),
            ("-1 2 3 4 0 0 0 1", "`-1` is no time"),
            ("99999999999999999999 2 3 4 0 0 0 1", "is no time"),
            ("nan 2 3 4 0 0 0 1", "is no time"),
        ] {
            assert!(message(line).contains(part), "{line}: {}", message(line));
        }
        assert!(parse_trajectory(b"\xff").unwrap_err().to_string().contains("UTF-8"));
    }
}
