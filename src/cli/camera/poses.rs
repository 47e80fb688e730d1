//! Where the camera was in each frame, from a file.

use crate::cli::failure::Failure;
use crate::frames::{StampedPose, parse_trajectory};
use beo_shapes::read_bytes;
use std::path::Path;

/// Poses of that many frames, in the order of their names.
pub(super) fn read_trajectory(path: &Path, frames: usize) -> Result<Vec<StampedPose>, Failure> {
    let failed = |error: &dyn std::fmt::Display| Failure::Failed(format!("{}: {error}", path.display()));
    let poses = parse_trajectory(&read_bytes(path)?).map_err(|error| failed(&error))?;
    if poses.len() < frames {
        return Err(failed(&format!(
            "{} poses for {frames} frames: one line is needed for each, in the order of their names",
            poses.len()
        )));
    }
    Ok(poses)
}
