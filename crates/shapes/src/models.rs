//! Folders of models as data sets lay them out: a folder for each model, the mesh in a place of its own within.
//!
//! ShapeNet: `SYNSET/MODEL/models/model_normalized.obj` (version 2), `SYNSET/MODEL/model.obj` (version 1). YCB:
//! `OBJECT/google_16k/nontextured.ply` and other scans of the same object.

use std::path::{Path, PathBuf};

/// Where the mesh of a model lies in its folder; of several the first.
const PLACES: [&str; 13] = [
    "models/model_normalized.obj",
    "models/model_normalized.glb",
    "model.obj",
    "google_16k/nontextured.ply",
    "google_16k/nontextured.stl",
    "google_16k/textured.obj",
    "google_64k/nontextured.ply",
    "google_64k/textured.obj",
    "google_512k/nontextured.ply",
    "google_512k/textured.obj",
    "poisson/nontextured.ply",
    "tsdf/nontextured.ply",
    "tsdf/textured.obj",
];

/// The mesh of a folder that holds one model: its path, and that from the folder.
pub(super) fn model_of(folder: &Path) -> Option<(PathBuf, &'static str)> {
    PLACES.iter().map(|place| (folder.join(place), *place)).find(|(path, _)| path.is_file())
}

/// Whether a folder is laid out as an object of YCB is.
pub(super) fn is_ycb(folder: &Path) -> bool {
    model_of(folder).is_some_and(|(_, place)| !place.starts_with("model"))
}
