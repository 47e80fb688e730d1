//! Models made by hand for the tests of their file: small, and with everything that a model may have.

use super::{
    Basis, Blend, Calibration, CameraCalibration, CameraDensities, CameraSpread, ClassInfo, ClassModel, CompletionCalibration, Component,
    DIRECTIONS, FORMAT_VERSION, Footprint, Forest, HullDensity, LEAF, LONGEST_CLASS_NAME, MOST_COMPONENTS, Metadata, Model,
    NoneCalibration, OFFSETS, Searched, SizeDensity, TrainingSettings, ViewDensities, YAWS, camera_density,
};
use crate::grid::{Dims, Pooling, View};
use fixedbitset::FixedBitSet;
use half::f16;
use std::sync::Arc;

/// Of two classes, with everything that a model may have: cameras, components with true sizes, a forest.
pub fn metadata() -> Metadata {
    let blend = || Blend { offsets: vec![0.0; 2], ..Blend::default() };
    let class = |name: &str| ClassInfo {
        name: name.into(),
        shapes: 4,
        basis_size: MOST_COMPONENTS,
        explained: 0.5,
        noise_variance: 0.1,
        shrinkage: 0.5,
    };
    let with_forest = Blend { forest: 0.5, ..blend() };
    let camera = CameraCalibration {
        pose_weight: 0.2,
        size_weight: None,
        blend: Blend { hull: 0.1, ..blend() },
        with_forest: Some(with_forest.clone()),
        none: Some(NoneCalibration { constant: 0.0, weight: 1.0 }),
        together: Some(with_forest),
        spread: Some(CameraSpread::default()),
        views: 9,
        accuracy: 0.9,
        log_loss: 0.3,
    };
    let calibration = Calibration {
        degrees_of_freedom: 5.0,
        prior_strength: 20.0,
        auto: Blend { hull: 0.3, evidence: 0.2, ..blend() },
        hull: Blend { hull: 0.3, ..blend() },
        evidence: Blend { evidence: 0.2, ..blend() },
        mean: Blend { distance: 0.1, ..blend() },
        noise_inflation: 3.0,
        completion: CompletionCalibration { constant: 0.0, mean: 1.0, class_mean: 0.0, log_depth: 0.0, surface: 0.0 },
        camera: Some(camera),
        objects: 8,
        accuracy: 0.9,
        log_loss: 0.3,
    };
    let size = SizeDensity { mean: [-2.0; 3], covariance: [[0.02, 0.01, 0.0], [0.01, 0.02, 0.0], [0.0, 0.0, 0.02]] };
    Metadata {
        format_version: FORMAT_VERSION,
        beo_version: "0.1.0".into(),
        licence: String::new(),
        dims: Dims::cube(16).unwrap(),
        classes: vec![class("a"), class(&"b".repeat(LONGEST_CLASS_NAME))],
        noise_variance: 0.1,
        calibration,
        camera_components: vec![Component::upright(0), Component { probability: 0.4, size: Some(size), ..Component::upright(1) }],
        settings: TrainingSettings {
            splits: vec!["train".into()],
            views: vec![View::Top],
            camera_elevations_deg: vec![-90.0, 20.0, 90.0],
            poses: true,
            variance_share: 0.9,
            basis_range: [5, 20],
            longest_side: 14,
            seed: 0,
            folds: 4,
        },
    }
}

/// Numbers that all differ from their neighbours, in (0, 1), so that none may change places unnoticed.
fn numbers(seed: usize, count: usize) -> impl Iterator<Item = f64> {
    (1..=count).map(move |place| ((place * 7919 + seed * 104_729) % 1009 + 1) as f64 / 1011.0)
}

fn halves(seed: usize, count: usize) -> Vec<f16> {
    numbers(seed, count).map(f16::from_f64).collect()
}

fn floats(seed: usize, count: usize) -> Vec<f32> {
    numbers(seed, count).map(|v| v as f32).collect()
}

/// Symmetric, `size` × `size`.
fn symmetric(seed: usize, size: usize) -> Vec<f32> {
    let lower = floats(seed, size * size);
    (0..size * size).map(|v| (v / size, v % size)).map(|(i, j)| lower[i.max(j) * size + i.min(j)]).collect()
}

const RANK: usize = 3;
/// Components of each class's basis.
const COMPONENTS: usize = 2;

/// Everything of a model but the densities with which it is searched.
fn plain(dims: Dims) -> Model {
    let mut metadata = metadata();
    metadata.dims = dims;
    metadata.classes.iter_mut().for_each(|class| class.basis_size = COMPONENTS);
    let class = |s: usize| ClassModel {
        mean: floats(10 + s, RANK),
        covariance: symmetric(20 + s, RANK),
        directions: floats(30 + s, COMPONENTS * RANK),
        variances: numbers(40 + s, COMPONENTS).collect(),
        hulls: vec![HullDensity { mean: floats(50 + s, RANK), covariance: symmetric(60 + s, RANK) }],
    };
    let basis = Basis::new(RANK, halves(1, dims.voxels() * RANK));
    Model { id: 0, metadata, basis, classes: vec![class(0), class(1)], searched: Searched::KnownPoseOnly { footprint: None } }
}

fn views(dims: Dims, classes: usize) -> ViewDensities {
    let (size, blocks) = (2, DIRECTIONS * classes);
    ViewDensities {
        size,
        basis: halves(2, Pooling::new(dims).count() * size),
        means: halves(3, blocks * size),
        whitening: halves(4, blocks * 3),
        regression: halves(5, blocks * 3 * size),
    }
}

fn cameras(metadata: &Metadata) -> CameraDensities {
    let elevations: Vec<f64> = metadata.settings.camera_elevations_deg.iter().map(|e| e.to_radians()).collect();
    let (size, blocks) = (2, elevations.len() * YAWS * metadata.camera_components.len());
    let forest = Forest {
        inputs: camera_density::MEASURES,
        outcomes: metadata.classes.len() + 1,
        roots: vec![0, 3],
        asks: vec![1, LEAF, LEAF, LEAF],
        thresholds: vec![0.5, 0.0, 0.0, 0.0],
        next: vec![1, 0, 1, 2],
        scores: halves(6, 9),
    };
    CameraDensities {
        components: metadata.camera_components.clone(),
        size,
        basis: halves(7, camera_density::CELLS * size),
        means: halves(8, blocks * size),
        whitening: halves(9, blocks * 3),
        offsets: floats(11, blocks * OFFSETS),
        regression: halves(12, blocks * OFFSETS * size),
        deviations: floats(13, blocks * OFFSETS),
        forest: Some(forest),
        elevations,
    }
}

/// A model whose own grid is searched, before cameras too.
pub fn searched_here(dims: Dims) -> Model {
    let model = plain(dims);
    let cameras = Some(Arc::new(cameras(&model.metadata)));
    Model { searched: Searched::Here { views: Arc::new(views(dims, 2)), cameras }, ..model }
}

fn footprint(dims: Dims) -> Footprint {
    let mut voxels = FixedBitSet::with_capacity(dims.voxels());
    (0..dims.voxels()).filter(|voxel| voxel * 31 % 7 < 3).for_each(|voxel| voxels.insert(voxel));
    Footprint { voxels, gram: numbers(14, (RANK + 1) * (RANK + 2) / 2).collect() }
}

/// A model on a grid so large that smaller ones are searched in its place.
pub fn searched_on_levels(dims: Dims) -> Model {
    let levels = super::levels_of(dims).into_iter().map(searched_here).collect();
    Model { searched: Searched::OnLevels { footprint: footprint(dims), levels }, ..plain(dims) }
}

/// A model for known poses alone.
pub fn known_pose_only(dims: Dims) -> Model {
    let mut model = plain(dims);
    (model.metadata.settings.poses, model.metadata.settings.camera_elevations_deg) = (false, Vec::new());
    (model.metadata.calibration.camera, model.metadata.camera_components) = (None, Vec::new());
    let footprint = (!super::levels_of(dims).is_empty()).then(|| footprint(dims));
    Model { searched: Searched::KnownPoseOnly { footprint }, ..model }
}
