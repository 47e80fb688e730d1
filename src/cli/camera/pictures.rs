//! A picture of each frame with what was found in it, in a folder.

use crate::cli::failure::{Failure, cannot_write};
use beo_picture::Image;
use std::path::{Path, PathBuf};

/// Where the images of frames lie in the layouts that are read, and often colour images of the same names beside them.
const INPUTS: [&str; 10] = ["depth", "label", "mask", "masks", "mask_visib", "rgb", "gray", "color", "colour", "images"];

/// Pictures into a folder.
pub(super) struct Pictures {
    folder: PathBuf,
}

impl Pictures {
    /// Pictures of the frames in `frames`, into `folder`, which is made if it is not there.
    pub(super) fn new(folder: &Path, frames: &Path) -> Result<Self, Failure> {
        std::fs::create_dir_all(folder).map_err(cannot_write(folder))?;
        let place = |path: &Path| path.canonicalize().ok();
        if INPUTS.iter().map(|name| frames.join(name)).chain([frames.into()]).any(|input| place(&input) == place(folder)) {
            return Err(Failure::Usage(format!(
                "--png {}: pictures could replace images of the frames there: give a folder of their own",
                folder.display()
            )));
        }
        Ok(Self { folder: folder.into() })
    }

    /// Writes the picture of a frame: it appears under its name only when it is complete.
    pub(super) fn save(&self, frame: &str, picture: &Image) -> Result<(), Failure> {
        Ok(picture.save(&self.folder.join(format!("{frame}.png")))?)
    }
}
