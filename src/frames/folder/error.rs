//! Errors of folders of frames.

use crate::frames::SizeError;
use beo_camera::IntrinsicsError;
use beo_shapes::ReadError;
use std::path::PathBuf;

/// A folder or a frame of it cannot be read. One line, with the name of what is wrong.
#[derive(Debug, thiserror::Error)]
pub enum FolderError {
    /// The folder cannot be listed.
    #[error("cannot list {}: {source}", path.display())]
    List {
        /// The folder.
        path: PathBuf,
        /// The error of the operating system.
        source: std::io::Error,
    },
    /// There is no frame in it.
    #[error(
        "no frames in {}: expected NAME_depth.png with NAME_label.png or NAME_mask.png, or folders depth and label, mask or masks, or a BOP scene",
        path.display()
    )]
    NoFrames {
        /// The folder.
        path: PathBuf,
    },
    /// A frame lacks something.
    #[error("there is no {}", expected.display())]
    Missing {
        /// The file that was looked for.
        expected: PathBuf,
    },
    /// There is no camera.
    #[error(
        "there is no camera in {}: expected camera_info.yaml, cam_K.txt, camera_intrinsic.json, intrinsics.json or camchain.yaml, or give --camera-info",
        folder.display()
    )]
    Uncalibrated {
        /// The folder.
        folder: PathBuf,
    },
    /// A scene has no rectified images.
    #[error("--rectified takes the projection matrix of a camera_info, and {} has none: leave it out, or give --camera-info", path.display())]
    NotRectified {
        /// The scene's file or folder.
        path: PathBuf,
    },
    /// The scene does not describe the camera of an image.
    #[error("there is no camera for image {image} in {}", path.display())]
    NoCamera {
        /// The scene's file.
        path: PathBuf,
        /// The image's number.
        image: u32,
    },
    /// A file of the frame cannot be read.
    #[error(transparent)]
    Read(#[from] ReadError),
    /// Images and camera do not fit together.
    #[error(transparent)]
    Size(#[from] SizeError),
    /// The camera is none for these images.
    #[error(transparent)]
    Camera(#[from] IntrinsicsError),
}
