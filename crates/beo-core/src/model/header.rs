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

#[cfg(test)]
mod tests {
    use super::super::test_models::metadata as good;
    use super::super::{CameraCalibration, CameraSpread};
    use super::*;

    fn camera(metadata: &mut Metadata) -> &mut CameraCalibration {
        metadata.calibration.camera.as_mut().unwrap()
    }

    type Change = fn(&mut Metadata);

    #[track_caller]
    fn refuses(changes: &[Change], part: &str) {
        for (place, change) in changes.iter().enumerate() {
            let mut metadata = good();
            change(&mut metadata);
            let reason = check_metadata(&metadata).expect_err(&format!("change {place} was taken: {part}"));
            assert!(reason.contains(part), "change {place}: {reason}");
        }
    }

    #[test]
    fn what_training_writes_is_taken_and_so_are_the_limits() {
        let changes: [Change; 8] = [
            |_| {},
            |m| m.camera_components = vec![],
            |m| m.settings.camera_elevations_deg = (0..32).map(f64::from).collect(),
            |m| (m.settings.poses, m.settings.camera_elevations_deg, m.calibration.camera) = (false, vec![], None),
            |m| (m.settings.camera_elevations_deg, m.calibration.camera) = (vec![], None),
            // Of models that have neither a forest nor deviations of their own.
            |m| {
                let camera = camera(m);
                (camera.with_forest, camera.none, camera.together, camera.spread) = (None, None, None, None);
            },
            |m| camera(m).spread = Some(CameraSpread { place: [999.0; 3], extent: [1e-9; 3] }),
            |m| {
                let mut all = vec![Component { probability: 0.004, ..Component::upright(0) }; MOST_COMPONENTS - 1];
                all.push(Component::upright(1));
                m.camera_components = all;
            },
        ];
        for (place, change) in changes.iter().enumerate() {
            let mut metadata = good();
            change(&mut metadata);
            assert_eq!(check_metadata(&metadata), Ok(()), "{place}");
        }
        let many = |count: usize| {
            let mut metadata = good();
            metadata.classes = vec![metadata.classes[0].clone(); count];
            metadata.camera_components = vec![];
            let calibration = &mut metadata.calibration;
            let camera = calibration.camera.as_mut().unwrap();
            let blends =
                [&mut calibration.auto, &mut calibration.hull, &mut calibration.evidence, &mut calibration.mean, &mut camera.blend];
            blends.into_iter().chain(&mut camera.with_forest).chain(&mut camera.together).for_each(|b| b.offsets = vec![0.0; count]);
            check_metadata(&metadata)
        };
        assert_eq!(many(MOST_CLASSES), Ok(()));
        assert!(many(MOST_CLASSES + 1).unwrap_err().contains("more than the 64"));
    }

    #[test]
    fn blends_weigh_what_their_method_computes_for_each_class() {
        refuses(
            &[
                |m| m.calibration.auto.offsets.push(0.0),
                |m| m.calibration.hull.offsets.truncate(1),
                |m| m.calibration.evidence.offsets.push(0.0),
                |m| m.calibration.mean.offsets.push(0.0),
            ],
            "another number of classes",
        );
        refuses(
            &[
                |m| m.calibration.auto.distance = 1.0,
                |m| m.calibration.hull.evidence = -1.0,
                |m| m.calibration.hull.distance = 1.0,
                |m| m.calibration.evidence.hull = 1.0,
                |m| m.calibration.evidence.distance = 1.0,
                |m| m.calibration.mean.hull = 1.0,
                |m| m.calibration.mean.evidence = f64::NAN,
            ],
            "does not compute",
        );
    }

    #[test]
    fn elevations_ascend_within_the_half_circle_and_need_a_search() {
        refuses(
            &[
                |m| m.settings.camera_elevations_deg = vec![20.0, 20.0],
                |m| m.settings.camera_elevations_deg = vec![30.0, 20.0],
                |m| m.settings.camera_elevations_deg = vec![20.0, 90.1],
                |m| m.settings.camera_elevations_deg = vec![-90.1, 20.0],
                |m| m.settings.camera_elevations_deg = vec![f64::NAN],
                |m| m.settings.camera_elevations_deg = (0..33).map(f64::from).collect(),
            ],
            "ascending angles",
        );
        refuses(&[|m| m.settings.poses = false], "known poses alone");
    }

    #[test]
    fn the_calibration_for_cameras_fits_them_and_its_forest() {
        refuses(
            &[
                |m| m.calibration.camera = None,
                |m| m.settings.camera_elevations_deg = vec![],
                |m| camera(m).pose_weight = 0.0,
                |m| camera(m).pose_weight = f64::NAN,
                |m| camera(m).blend.offsets.push(0.0),
                |m| camera(m).blend.distance = 0.1,
                |m| camera(m).blend.forest = 0.1,
                |m| camera(m).together.as_mut().unwrap().offsets.truncate(1),
                |m| camera(m).together.as_mut().unwrap().distance = 0.1,
                |m| camera(m).with_forest.as_mut().unwrap().offsets.truncate(1),
                |m| camera(m).with_forest.as_mut().unwrap().distance = 0.1,
                // The blend of all scores weighs a forest that is not there.
                |m| (camera(m).with_forest, camera(m).none) = (None, None),
                |m| camera(m).none = None,
                |m| (camera(m).with_forest, camera(m).together) = (None, None),
                |m| camera(m).none.as_mut().unwrap().constant = f64::INFINITY,
                |m| camera(m).none.as_mut().unwrap().weight = f64::NAN,
                |m| camera(m).spread.as_mut().unwrap().place[1] = 0.0,
                |m| camera(m).spread.as_mut().unwrap().place[2] = 1e3,
                |m| camera(m).spread.as_mut().unwrap().extent[0] = -1.0,
                |m| camera(m).spread.as_mut().unwrap().extent[2] = f64::NAN,
            ],
            "does not fit its cameras",
        );
    }

    #[test]
    fn components_are_of_classes_that_there_are_and_every_class_has_one() {
        refuses(
            &[
                |m| m.camera_components[0].class = 2,
                |m| m.camera_components[0].probability = 0.0,
                |m| m.camera_components[0].probability = 1.001,
                |m| m.camera_components[0].probability = f64::NAN,
                |m| m.camera_components[0].resting_rotation = [0.0, 0.0, 0.0, 1.001],
                |m| m.camera_components[0].resting_rotation = [0.0, 0.0, 0.6, 0.7],
                |m| m.camera_components[0].resting_rotation = [0.0; 4],
                // Not positive definite: a correlation above one.
                |m| m.camera_components[1].size.as_mut().unwrap().covariance[1][0] = 0.03,
                |m| m.camera_components[1].size.as_mut().unwrap().mean[2] = f64::NAN,
                |m| m.camera_components = vec![m.camera_components[1].clone(); MOST_COMPONENTS + 1],
            ],
            "is not sound",
        );
        refuses(&[|m| m.camera_components.truncate(1)], "has no component");
        refuses(&[|m| m.camera_components[1].class = 0], "class `bbb");
    }

    #[test]
    fn names_sizes_views_and_variances_are_within_their_limits() {
        refuses(&[|m| m.classes[1].name.push('b'), |m| m.classes[0].basis_size = MOST_COMPONENTS + 1], "too long a name or more than 250");
        refuses(&[|m| m.settings.views.clear()], "for no view");
        refuses(
            &[
                |m| m.noise_variance = 0.0,
                |m| m.noise_variance = f64::INFINITY,
                |m| m.calibration.noise_inflation = -1.0,
                |m| m.calibration.noise_inflation = f64::NAN,
                |m| m.calibration.degrees_of_freedom = 0.0,
            ],
            "is not a positive number",
        );
    }

    #[test]
    fn levels_are_named_by_their_longest_side() {
        assert_eq!(level_name(Dims::new(20, 32, 8).unwrap()), "level_32");
        assert_eq!(level_name(Dims::new(64, 8, 9).unwrap()), "level_64");
    }

    /// Against the checksum of the text as written out here.
    #[test]
    fn the_checksum_covers_description_checksums_and_table() {
        let (metadata, checksums) = (good(), BTreeMap::from([("basis".to_owned(), 7)]));
        let table: Table = BTreeMap::from([("basis".to_owned(), ("F16".to_owned(), vec![2, 3], 12))]);
        let text = format!("[{},{{\"basis\":7}},{{\"basis\":[\"F16\",[2,3],12]}}]", serde_json::to_string(&metadata).unwrap());
        assert_eq!(header_checksum(&metadata, &checksums, &table), crc32fast::hash(text.as_bytes()));
    }
}
