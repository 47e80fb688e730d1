//! The description in the header of a model file, and the conditions that it satisfies.

use super::{Component, LONGEST_CLASS_NAME, MOST_CLASSES, MOST_COMPONENTS, Metadata};
use crate::grid::Dims;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// The key of our description in the header of the file.
pub(super) const KEY: &str = "beo";

/// The description in the header, with what is needed to detect damage.
#[derive(Serialize, Deserialize)]
pub(super) struct Header {
    pub metadata: Metadata,
    /// CRC-32 of each tensor's bytes.
    pub checksums: BTreeMap<String, u32>,
    /// CRC-32 of `metadata`, `checksums` and the table of tensors.
    pub checksum: u32,
}

/// Names, shapes and lengths, written out: damage to the table of tensors changes this text.
pub(super) type Table = BTreeMap<String, (String, Vec<usize>, usize)>;

pub(super) fn header_checksum(metadata: &Metadata, checksums: &BTreeMap<String, u32>, table: &Table) -> u32 {
    let text = serde_json::to_string(&(metadata, checksums, table)).expect("plain data");
    crc32fast::hash(text.as_bytes())
}

/// Name of the tensor that holds the model of a smaller grid.
pub(super) fn level_name(dims: Dims) -> String {
    format!("level_{}", <[usize; 3]>::from(dims).into_iter().fold(0, usize::max))
}

/// Checks conditions that every file written by `save` satisfies, and a hand-made one may not.
pub(super) fn check_metadata(metadata: &Metadata) -> Result<(), String> {
    let m = metadata.classes.len();
    let calibration = &metadata.calibration;
    let blends = [&calibration.auto, &calibration.hull, &calibration.evidence, &calibration.mean];
    if blends.iter().any(|blend| blend.offsets.len() != m) {
        return Err("its calibration is for another number of classes".into());
    }
    // What a method does not compute has no weight in its blend.
    let [auto, hull, evidence, mean] = blends;
    let foreign =
        [auto.distance, hull.evidence, hull.distance, evidence.hull, evidence.distance, mean.hull, mean.evidence].iter().any(|w| *w != 0.0);
    if foreign {
        return Err("its calibration weighs scores that the method does not compute".into());
    }
    let elevations = &metadata.settings.camera_elevations_deg;
    let ascending = elevations.windows(2).all(|pair| pair[0] < pair[1]);
    if !ascending || elevations.len() > 32 || !elevations.iter().all(|e| (-90.0..=90.0).contains(e)) {
        return Err("its cameras' elevations are not at most 32 ascending angles from -90 to 90".into());
    }
    if !metadata.settings.poses && !elevations.is_empty() {
        return Err("it was learned for known poses alone, but names elevations of cameras".into());
    }
    match (&calibration.camera, elevations.is_empty()) {
        (None, true) => (),
        (Some(camera), false)
            if camera.pose_weight > 0.0
                && std::iter::once(&camera.blend)
                    .chain(&camera.together)
                    .chain(&camera.with_forest)
                    .all(|blend| blend.offsets.len() == m && blend.distance == 0.0 && (blend.forest == 0.0 || camera.has_forest()))
                && camera.blend.forest == 0.0
                && camera.none.is_none_or(|none| none.constant.is_finite() && none.weight.is_finite())
                && camera.with_forest.is_some() == camera.none.is_some()
                && camera.spread.is_none_or(|spread| spread.place.iter().chain(&spread.extent).all(|v| *v > 0.0 && *v < 1e3)) => {}
        _ => return Err("its calibration does not fit its cameras".into()),
    }
    check_components(metadata)?;
    if m > MOST_CLASSES {
        return Err(format!("it has {m} classes, more than the {MOST_CLASSES} that a percept can name"));
    }
    if let Some(class) = metadata.classes.iter().find(|c| c.name.len() > LONGEST_CLASS_NAME || c.basis_size > MOST_COMPONENTS) {
        return Err(format!("class `{}` has too long a name or more than {MOST_COMPONENTS} components", class.name));
    }
    if metadata.settings.views.is_empty() {
        return Err("it was trained for no view".into());
    }
    let positive = [metadata.noise_variance, calibration.noise_inflation, calibration.degrees_of_freedom];
    if !positive.iter().all(|v| *v > 0.0 && v.is_finite()) {
        return Err("its noise variance, noise inflation or degrees of freedom is not a positive number".into());
    }
    Ok(())
}

/// Components are of classes that there are, each class has one, and their numbers make sense.
fn check_components(metadata: &Metadata) -> Result<(), String> {
    let (components, m) = (&metadata.camera_components, metadata.classes.len());
    if components.is_empty() {
        return Ok(());
    }
    let sound = |component: &Component| {
        let norm: f64 = component.resting_rotation.iter().map(|v| v * v).sum();
        let sized = component.size.is_none_or(|size| size.log_density(size.mean.map(f64::exp), [0.0; 3]).is_finite());
        component.class < m && component.probability > 0.0 && component.probability <= 1.0 && (norm - 1.0).abs() < 1e-6 && sized
    };
    if !components.iter().all(sound) || components.len() > MOST_COMPONENTS {
        return Err("a component of what its cameras see is not sound".into());
    }
    match (0..m).find(|class| !components.iter().any(|component| component.class == *class)) {
        Some(class) => Err(format!("class `{}` has no component of what cameras see", metadata.classes[class].name)),
        None => Ok(()),
    }
}
