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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn there_is_a_pose_for_each_frame_or_an_error_with_both_numbers() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("poses.txt");
        std::fs::write(&path, "1 0 0 0 0 0 0 1\n2 0 0 1 0 0 0 1\n").unwrap();
        assert_eq!(read_trajectory(&path, 2).unwrap()[1].camera_to_world.translation.z, 1.0);
        let error = read_trajectory(&path, 3).unwrap_err().to_string();
        assert!(error.contains("poses.txt: 2 poses for 3 frames"), "{error}");
    }
}
