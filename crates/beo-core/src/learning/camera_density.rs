//! Densities of what cameras see of objects on tables, by elevation and yaw.
//!
//! A class is a mixture of components: kinds of true size (`sizes`), each in its resting poses (`resting`). Of each component and learned
//! elevation, many shapes are seen by a simulated camera near that elevation, turned by all steps of yaw, each a little off, with what
//! sensors and masks get wrong (`simulation`). The features of the shadow of what is carved, in the view's frame, get a Gaussian, and how
//! exactly the object lies a regression on them. How sure the densities may be of class and pose is fitted on shapes that are left out at
//! first (`camera_calibration`).

use super::camera_calibration::{LeftOut, calibrate};
use super::camera_forest::Measured;
use super::camera_views::{ClassShapes, ComponentShapes, Views, are_plain, around, parts, stream};
use super::components::principal_components;
use super::regressed::{Moments, regressed};
use crate::linear::LinearError;
use crate::model::{CameraCalibration, CameraDensities, OFFSETS, YAWS};
use crate::perception::PerceiveError;
use crate::perception::camera::{CELLS, CameraFeatures, Shadow, ShadowImage};
use faer::Mat;
use half::f16;
use rand::RngExt;
use rayon::prelude::*;
use std::f64::consts::TAU;

/// Most features: of few components, and of many, so that the model does not grow.
const FEATURES: [usize; 2] = [64, 36];
const FEW_COMPONENTS: usize = 12;
/// Views from which the features are learned.
const FEATURE_VIEWS: (usize, usize) = (300, 2000);
/// Views per component, elevation and step of yaw: about one per shape, within the bounds. The calibration's densities have as many: of fewer
/// they would be less exact than those that it is for, and the deviations too wide.
const VIEW_BOUNDS: [(usize, usize); 2] = [(50, 90), (32, 40)];
/// As many times as many of what looks the same from all sides, for all steps of yaw at once.
const ROUND_VIEWS: usize = 3;
/// The yaw of a view is uniform within so many steps about its own, and its elevation within so much of the distance to the next.
const WINDOW: f64 = 0.75;
/// Least variance of a feature, as a share of the mean variance: see `view_density`.
const LEAST_VARIANCE: f64 = 1e-3;

/// Outcome of the learning.
pub struct Learned {
    /// The densities, from all shapes.
    pub densities: CameraDensities,
    /// How sure they may be, from shapes that were left out.
    pub calibration: CameraCalibration,
}

/// Learns from the shapes of each class. The same shapes and seed give the same densities, whatever the number of threads.
pub fn camera_densities(classes: &[ClassShapes<'_>], left_out: &LeftOut<'_>, views: &Views<'_>) -> Result<Learned, PerceiveError> {
    let parts = parts(classes, views.lying);
    let features = feature_basis(&parts, views)?;
    let is_kept = |class: usize, shape: usize| !left_out.held[class].contains(&shape);
    let densities = fit(&parts, views, &features, &is_kept)?;
    let m = classes.len();
    let measured = Measured::draw(&parts, m, &is_kept, views, 0);
    let held = Measured::draw(&parts, m, &|class, shape| !is_kept(class, shape), views, 1 << 40);
    let forest = measured.forest(m, views.seed);
    let none = held.none_calibration(&forest)?;
    let densities = CameraDensities { forest: Some(forest), ..densities };
    let calibration = CameraCalibration { none: Some(none), ..calibrate(densities, &parts, left_out, m, views)? };
    let forest = Some(measured.with(&held).forest(m, views.seed));
    Ok(Learned { densities: CameraDensities { forest, ..fit(&parts, views, &features, &|_, _| true)? }, calibration })
}

/// B and the mean variance along its columns.
struct Features {
    basis: Vec<f16>,
    size: usize,
    variance: f64,
}

/// How far an elevation of the list is from its neighbours, radians.
fn reach(elevations: &[f64], e: usize) -> f64 {
    let beside = [e.checked_sub(1), Some(e + 1)].into_iter().flatten().filter_map(|other| elevations.get(other));
    beside.map(|other| (other - elevations[e]).abs()).reduce(f64::min).unwrap_or(10_f64.to_radians())
}

/// Whether there are so many components that each gets fewer features and views; classes alone never are.
fn are_many(parts: &[ComponentShapes]) -> bool {
    parts.len() > FEW_COMPONENTS && !are_plain(parts)
}

fn feature_basis(parts: &[ComponentShapes], views: &Views<'_>) -> Result<Features, LinearError> {
    let all: Vec<_> = parts.iter().flat_map(|part| &part.shapes).collect();
    let (shapes, plain) = (all.len(), are_plain(parts));
    let count = (2 * shapes).clamp(FEATURE_VIEWS.0, FEATURE_VIEWS.1);
    let hulls: Vec<Vec<f32>> = (0..count)
        .into_par_iter()
        .map(|view| {
            let mut rng = stream(views.seed, 1 << 20, view as u64);
            let e = rng.random_range(0..views.elevations.len());
            let elevation = views.elevations[e] + around(WINDOW * reach(views.elevations, e), &mut rng);
            let mut hull = vec![0.0; CELLS];
            let chosen = match plain {
                true => all.get(view * shapes / count).copied(),
                // All components alike.
                false => {
                    let of = &parts[view % parts.len()].shapes;
                    of.get((view / parts.len() * 7) % of.len().max(1))
                }
            };
            let Some(shape) = chosen else { return hull };
            if let Some(sample) = shape.see(rng.random_range(0.0..TAU), elevation, views.sensing, &mut rng) {
                sample.frame.shadow(&sample.observation, &mut ShadowImage::default(), &mut hull);
            }
            hull
        })
        .collect();
    let most = FEATURES[usize::from(are_many(parts))];
    let size = most.min(count / 2);
    let components = principal_components(hulls, size, &mut stream(views.seed, 1 << 21, 0))?;
    Ok(Features { basis: components.rows(), size, variance: components.variance })
}

/// Densities from views of the shapes that `is_kept` (class, shape).
fn fit(
    parts: &[ComponentShapes],
    views: &Views<'_>,
    features: &Features,
    is_kept: &(dyn Fn(usize, usize) -> bool + Sync),
) -> Result<CameraDensities, LinearError> {
    let size = features.size;
    let mut densities = CameraDensities {
        elevations: views.elevations.to_vec(),
        components: parts.iter().map(|part| part.component.clone()).collect(),
        size,
        basis: features.basis.clone(),
        means: Vec::new(),
        whitening: Vec::new(),
        offsets: Vec::new(),
        regression: Vec::new(),
        deviations: Vec::new(),
        forest: None,
    };
    let scores = CameraFeatures::new(&densities.basis, size);
    let ridge = (LEAST_VARIANCE * features.variance).max(1e-4);
    let bounds = VIEW_BOUNDS[usize::from(are_many(parts))];
    for e in 0..views.elevations.len() {
        let moments_of = |step: usize, round: bool| -> Vec<Option<Moments>> {
            let (mut shadow, mut z) = (Shadow::default(), Vec::new());
            let of_part = |(s, part): (usize, &ComponentShapes)| {
                if part.is_round != round {
                    return None;
                }
                let shapes: Vec<_> = part.shapes.iter().filter(|shape| is_kept(part.component.class, shape.shape)).collect();
                let count = shapes.len().clamp(bounds.0, bounds.1) * if round { ROUND_VIEWS } else { 1 };
                let mut rng = stream(views.seed, s as u64, ((e * YAWS + step) as u64 + 1) << 8);
                let (mut rows, mut offsets) = (Vec::new(), Vec::new());
                let first = rng.random_range(0..shapes.len().max(1));
                let angle = CameraDensities::yaw(step);
                for view in 0..if shapes.is_empty() { 0 } else { count } {
                    // Spread over the shapes, or each more than once.
                    let next = if count < shapes.len() { view * shapes.len() / count } else { view };
                    let shape = shapes[(first + next) % shapes.len()];
                    let turned = angle + around(WINDOW * TAU / YAWS as f64, &mut rng);
                    let elevation = views.elevations[e] + around(WINDOW * reach(views.elevations, e), &mut rng);
                    if let Some(sample) = shape.see(turned, elevation, views.sensing, &mut rng) {
                        scores.of(&sample.frame, &sample.observation, &mut shadow, &mut z);
                        rows.extend_from_slice(&z);
                        offsets.push(sample.offsets(&part.component.rotation(), angle));
                    }
                }
                if offsets.is_empty() {
                    // Shapes of which nothing can be seen: a density that fits nothing.
                    rows.resize(size, 0.0);
                    offsets.push([0.0; OFFSETS]);
                }
                let rows = Mat::<f32>::from_fn(offsets.len(), size, |i, j| rows[i * size + j]);
                let offsets = Mat::<f64>::from_fn(offsets.len(), OFFSETS, |i, j| offsets[i][j]);
                Some(Moments::new(rows.as_ref(), offsets, ridge))
            };
            parts.iter().enumerate().map(of_part).collect()
        };
        let by_step: Vec<Vec<Option<Moments>>> = (0..=YAWS).into_par_iter().map(|n| moments_of(n % YAWS, n == YAWS)).collect();
        let (round, by_step) = by_step.split_last().expect("there are steps");
        for step in by_step {
            // What looks the same from all sides has one Gaussian for all steps.
            let all: Vec<&Moments> = step.iter().zip(round).filter_map(|(own, round)| own.as_ref().or(round.as_ref())).collect();
            for gaussian in regressed(&all)? {
                densities.means.extend(gaussian.mean.iter().map(|v| f16::from_f64(*v)));
                densities.whitening.extend(gaussian.packed_whitening());
                densities.regression.extend(gaussian.regression_rows());
                densities.offsets.extend(gaussian.offset_mean.iter().map(|v| *v as f32));
                densities.deviations.extend(gaussian.remaining.iter().map(|v| v.sqrt().max(1e-3) as f32));
            }
        }
    }
    Ok(densities)
}
