//! Densities of what cameras see of upright objects, by elevation and yaw.
//!
//! Per class and learned elevation, many shapes are seen by a simulated camera near that elevation, turned by all steps of yaw, each a
//! little off; from varied distances, with noise, with and without a table, a strip without readings, something in front. The
//! features of the shadow of what is carved, in the view's frame, get a Gaussian, and how exactly the object lies a regression on them. How sure the
//! densities may be of class and yaw is fitted on shapes that are left out at first.

use super::calibration::fit_blend;
use super::components::principal_components;
use super::regressed::{Moments, regressed};
use crate::grid::{Dims, Observation, Occupancy, Outside, Placed, Rotation, yaw};
use crate::linear::LinearError;
use crate::model::{Blend, CameraCalibration, CameraDensities, OFFSETS, YAWS};
use crate::perception::camera::{CELLS, CameraScores, Shadow, ShadowImage, Told, ViewFrame, ViewWork};
use crate::perception::{ClassSubspace, Conditional, PlacedEvidence};
use crate::simulation::{Conditions, Eye, View};
use faer::Mat;
use half::f16;
use nalgebra::Vector3;
use rand::seq::SliceRandom;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use std::f64::consts::{PI, TAU};

/// Most features.
const FEATURES: usize = 64;
/// Views from which the features are learned.
const FEATURE_VIEWS: (usize, usize) = (300, 2000);
/// Views per class, elevation and step of yaw: about one per shape, within the bounds; half as many for the calibration.
const VIEW_BOUNDS: (usize, usize) = (50, 90);
/// The yaw of a view is uniform within so many steps about its own, and its elevation within so much of the distance to the next.
const WINDOW: f64 = 0.75;
/// Least variance of a feature, as a share of the mean variance: see `view_density`.
const LEAST_VARIANCE: f64 = 1e-3;
/// Distances of the camera, in longest sides of the object.
const DISTANCES: [f64; 2] = [2.5, 6.0];
/// Views for the calibration: so many per shape that is left out, but no more in all.
const SEEN: usize = 4;
const MOST_SEEN: usize = 2400;
/// Most voxels of grids that are carved for training; of bigger shapes the grids are smaller, and the evidence is not weighed.
const MOST_VOXELS: usize = 64 * 64 * 64;
/// Factors on the log density among which left-out shapes choose for the yaw.
const WEIGHTS: [f64; 8] = [0.05, 0.1, 0.15, 0.2, 0.3, 0.45, 0.7, 1.0];

/// What was learned.
pub struct Learned {
    /// The densities, from all shapes.
    pub densities: CameraDensities,
    /// How sure they may be, from shapes that were left out.
    pub calibration: CameraCalibration,
}

/// Shapes that are left out at first, and what was learned without them.
pub struct LeftOut<'a> {
    /// Shapes of each class that are not left out.
    pub kept: Vec<Vec<&'a Occupancy>>,
    /// Those that are.
    pub held: Vec<Vec<&'a Occupancy>>,
    /// Class subspaces learned from `kept`.
    pub subspaces: Vec<ClassSubspace>,
    /// Variance of a voxel about them, inflated.
    pub noise: f64,
}

/// Learns from the shapes of each class, for cameras at these `elevations` (radians, ascending). The same shapes and seed give the same
/// densities, whatever the number of threads.
pub fn camera_densities(
    classes: &[Vec<&Occupancy>],
    left_out: &LeftOut<'_>,
    elevations: &[f64],
    seed: u64,
) -> Result<Learned, LinearError> {
    let components = feature_basis(classes, elevations, seed)?;
    let densities = fit(&left_out.kept, elevations, &components, seed, 2)?;
    let calibration = calibrate(&densities, left_out, seed)?;
    Ok(Learned { densities: fit(classes, elevations, &components, seed, 1)?, calibration })
}

/// B and the mean variance along its columns.
struct Features {
    basis: Vec<f16>,
    size: usize,
    variance: f64,
}

/// Random numbers for one view.
fn stream(seed: u64, class: u64, view: u64) -> ChaCha8Rng {
    let mut rng = ChaCha8Rng::seed_from_u64(seed ^ 0x6361_6d65_7261);
    rng.set_stream((class << 40) ^ view);
    rng
}

/// A view of a shape, and how the shape lies in it.
struct Sample {
    frame: ViewFrame,
    observation: Observation,
    placed: Placed,
}

/// Sees a shape that is turned by `turned` radians relative to the direction of looking, from an elevation; `None` if too little is seen.
fn see(object: &Occupancy, turned: f64, elevation: f64, rng: &mut ChaCha8Rng) -> Option<Sample> {
    let [low, high] = object.bounds()?;
    let size = (0..3).map(|a| high[a] - low[a]).max()? as f64;
    let conditions = Conditions::draw(rng);
    // The camera looks along +x of the frame; in the object's frame that direction is turned back.
    let eye = Eye { azimuth: PI - turned, elevation, distance: size * rng.random_range(DISTANCES[0]..DISTANCES[1]) };
    let view = View::new(object, &eye, &conditions, rng)?;
    // The grid is laid about what is seen, as a producer does; the observation's frame then is that of the view but for details.
    let axes = yaw(-turned);
    let points: Vec<Vector3<f64>> = view.points().iter().map(|p| axes.inverse() * p.coords).collect();
    let first = points.first()?;
    let (low, high) = points.iter().fold((*first, *first), |(low, high), p| (low.inf(p), high.sup(p)));
    let dims = if object.dims().voxels() <= MOST_VOXELS { object.dims() } else { Dims::cube(30).ok()? };
    let shortest = dims.x().min(dims.y()).min(dims.z()) as f64;
    let edge = ((high - low).max() / (beo_camera::Placement::default().share * shortest)).max(1e-3);
    let centre = axes * ((low + high) / 2.0);
    let (mut bytes, mut observation) = (Vec::new(), Observation::unknown(dims));
    view.carve(dims, &axes, &centre, edge, &mut bytes, &mut observation);
    let grid_from_object = |point: Vector3<f64>| axes.inverse() * (point - centre) / edge;
    let placed = Placed { rotation: yaw(turned), scale: 1.0 / edge, shift: grid_from_object(Vector3::zeros()) };
    let frame = ViewFrame::new(&observation, &grid_from_object(eye.position()), &mut Vec::new())?;
    Some(Sample { frame, observation, placed })
}

impl Sample {
    /// The offsets from a step of yaw.
    fn offsets(&self, object: &Occupancy, step: usize) -> [f64; OFFSETS] {
        let (rotation, scale, place) = self.frame.seen(&self.placed);
        let rest = rest_of(&rotation, step);
        let [low, high] = object.bounds().unwrap_or([[0; 3], [1; 3]]);
        let length = |axis: usize| (high[axis] - low[axis]) as f64 * scale;
        [rest, scale.ln(), place.x, place.y, place.z, length(0), length(1), length(2)]
    }
}

fn rest_of(rotation: &Rotation, step: usize) -> f64 {
    (crate::grid::yaw_of(rotation) - CameraDensities::yaw(step) + PI).rem_euclid(TAU) - PI
}

/// Uniform in ±`half`.
fn around(half: f64, rng: &mut ChaCha8Rng) -> f64 {
    half * rng.random_range(-1.0..1.0)
}

/// How far an elevation of the list is from its neighbours, radians.
fn reach(elevations: &[f64], e: usize) -> f64 {
    let beside = [e.checked_sub(1), Some(e + 1)].into_iter().flatten().filter_map(|other| elevations.get(other));
    beside.map(|other| (other - elevations[e]).abs()).reduce(f64::min).unwrap_or(10_f64.to_radians())
}

fn feature_basis(classes: &[Vec<&Occupancy>], elevations: &[f64], seed: u64) -> Result<Features, LinearError> {
    let shapes: Vec<&Occupancy> = classes.iter().flatten().copied().collect();
    let count = (2 * shapes.len()).clamp(FEATURE_VIEWS.0, FEATURE_VIEWS.1);
    let hulls: Vec<Vec<f32>> = (0..count)
        .into_par_iter()
        .map(|view| {
            let mut rng = stream(seed, 1 << 20, view as u64);
            let e = rng.random_range(0..elevations.len());
            let elevation = elevations[e] + around(WINDOW * reach(elevations, e), &mut rng);
            let mut hull = vec![0.0; CELLS];
            if let Some(sample) = see(shapes[view * shapes.len() / count], rng.random_range(0.0..TAU), elevation, &mut rng) {
                sample.frame.shadow(&sample.observation, &mut ShadowImage::default(), &mut hull);
            }
            hull
        })
        .collect();
    let size = FEATURES.min(count / 2);
    let components = principal_components(hulls, size, &mut stream(seed, 1 << 21, 0))?;
    Ok(Features { basis: components.rows(), size, variance: components.variance })
}

/// Densities from one in `share` of the views.
fn fit(
    classes: &[Vec<&Occupancy>],
    elevations: &[f64],
    features: &Features,
    seed: u64,
    share: usize,
) -> Result<CameraDensities, LinearError> {
    let size = features.size;
    let mut densities = CameraDensities {
        elevations: elevations.to_vec(),
        size,
        basis: features.basis.clone(),
        means: Vec::new(),
        whitening: Vec::new(),
        offsets: Vec::new(),
        regression: Vec::new(),
        deviations: Vec::new(),
    };
    let scores = CameraScores::new(&densities);
    let ridge = (LEAST_VARIANCE * features.variance).max(1e-4);
    for e in 0..elevations.len() {
        let moments: Vec<Vec<Moments>> = (0..YAWS)
            .into_par_iter()
            .map(|step| {
                let (mut shadow, mut z) = (Shadow::default(), Vec::new());
                let of_class = |(s, shapes): (usize, &Vec<&Occupancy>)| {
                    let count = shapes.len().clamp(VIEW_BOUNDS.0, VIEW_BOUNDS.1) / share;
                    let mut rng = stream(seed, s as u64, ((e * YAWS + step) as u64 + 1) << 8);
                    let (mut rows, mut offsets) = (Vec::new(), Vec::new());
                    let first = rng.random_range(0..shapes.len());
                    for view in 0..count {
                        // Spread over the shapes, or each more than once.
                        let next = if count < shapes.len() { view * shapes.len() / count } else { view };
                        let object = shapes[(first + next) % shapes.len()];
                        let turned = CameraDensities::yaw(step) + around(WINDOW * TAU / YAWS as f64, &mut rng);
                        let elevation = elevations[e] + around(WINDOW * reach(elevations, e), &mut rng);
                        if let Some(sample) = see(object, turned, elevation, &mut rng) {
                            scores.features(&sample.frame, &sample.observation, &mut shadow, &mut z);
                            rows.extend_from_slice(&z);
                            offsets.push(sample.offsets(object, step));
                        }
                    }
                    if offsets.is_empty() {
                        // Shapes of which nothing can be seen: a density that fits nothing.
                        rows.resize(size, 0.0);
                        offsets.push([0.0; OFFSETS]);
                    }
                    let rows = Mat::<f32>::from_fn(offsets.len(), size, |i, j| rows[i * size + j]);
                    let offsets = Mat::<f64>::from_fn(offsets.len(), OFFSETS, |i, j| offsets[i][j]);
                    Moments::new(rows.as_ref(), offsets, ridge)
                };
                classes.iter().enumerate().map(of_class).collect()
            })
            .collect();
        for step in &moments {
            for gaussian in regressed(&step.iter().collect::<Vec<_>>())? {
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

/// What one view of a shape that was left out says.
struct Scored {
    class: usize,
    /// The step of its yaw.
    truth: usize,
    /// Scores by `[class][step]`.
    table: Vec<f64>,
    /// The same where yaw, size and place are told, and the evidence then, by class.
    told: Vec<f64>,
    evidence: Vec<f64>,
}

/// How sure the densities may be, on shapes that they have not seen.
fn calibrate(densities: &CameraDensities, left_out: &LeftOut<'_>, seed: u64) -> Result<CameraCalibration, LinearError> {
    let scores = CameraScores::new(densities);
    let m = left_out.held.len();
    let of_class = |(s, shapes): (usize, &Vec<&'_ Occupancy>)| -> Vec<(usize, usize, usize)> {
        (0..shapes.len()).flat_map(|i| (0..SEEN).map(move |n| (s, i, i * SEEN + n))).collect()
    };
    let mut views: Vec<(usize, usize, usize)> = left_out.held.iter().enumerate().flat_map(of_class).collect();
    views.shuffle(&mut stream(seed, 1 << 23, 0));
    views.truncate(MOST_SEEN);
    let [lowest, highest] = [densities.elevations[0], densities.elevations[densities.elevations.len() - 1]];
    let score = |(class, shape, view): &(usize, usize, usize)| -> Option<Result<Scored, LinearError>> {
        let mut rng = stream(seed, 1 << 22 | *class as u64, *view as u64);
        let elevation = lowest + (highest - lowest) * rng.random_range(0.0..1.0);
        let turned: f64 = rng.random_range(0.0..TAU);
        let sample = see(left_out.held[*class][*shape], turned, elevation, &mut rng)?;
        let mut work = ViewWork::default();
        let mut scored = |told: &Told| {
            scores.score(densities, &sample.frame, &sample.observation, told, &vec![true; m], &mut work);
            let mut table = vec![f64::NEG_INFINITY; m * YAWS];
            work.cells.iter().for_each(|cell| table[cell.class * YAWS + cell.step] = cell.score);
            table
        };
        let (rotation, scale, place) = sample.frame.seen(&sample.placed);
        let table = scored(&Told::default());
        let told = scored(&Told { yaw: Some(crate::grid::yaw_of(&rotation)), scale: Some(scale), place: Some(place) });
        let truth = (0..YAWS).min_by(|a, b| rest_of(&rotation, *a).abs().total_cmp(&rest_of(&rotation, *b).abs()))?;
        let evidence = left_out.evidence(&sample);
        Some(evidence.map(|evidence| Scored { class: *class, truth, table, told, evidence }))
    };
    let scored: Vec<Scored> = views.par_iter().filter_map(score).collect::<Result<_, _>>()?;
    let yaw_loss = |weight: f64| -> f64 {
        let loss = |view: &Scored| {
            let of_class = &view.table[view.class * YAWS..(view.class + 1) * YAWS];
            log_sum(of_class, weight) - weight * of_class[view.truth]
        };
        scored.iter().map(loss).sum::<f64>() / scored.len().max(1) as f64
    };
    let losses = WEIGHTS.map(yaw_loss);
    let best = (0..WEIGHTS.len()).min_by(|a, b| losses[*a].total_cmp(&losses[*b])).unwrap_or(0);
    let pose_weight = WEIGHTS[best];
    let labels: Vec<usize> = scored.iter().map(|view| view.class).collect();
    let marginal = |of: fn(&Scored) -> &Vec<f64>| -> Vec<Vec<f64>> {
        scored.iter().map(|view| of(view).chunks_exact(YAWS).map(|row| log_sum(row, pose_weight) / pose_weight).collect()).collect()
    };
    let fitted = fit_blend(&[marginal(|view| &view.table)], &labels, m, true)?;
    tracing::debug!(
        pose_weight,
        yaw_loss = losses[best],
        log_loss = fitted.log_loss,
        accuracy = fitted.accuracy,
        weight = fitted.weights[0],
        views = labels.len(),
        "camera densities on shapes that were left out"
    );
    let together = if scored.iter().all(|view| view.evidence.len() == m) && !scored.is_empty() {
        let evidence = scored.iter().map(|view| view.evidence.clone()).collect();
        let both = fit_blend(&[marginal(|view| &view.told), evidence], &labels, m, true)?;
        tracing::debug!(log_loss = both.log_loss, accuracy = both.accuracy, weights = ?both.weights, "with the evidence, as they truly lie");
        Some(Blend { hull: both.weights[0], evidence: both.weights[1], distance: 0.0, offsets: both.offsets })
    } else {
        None
    };
    Ok(CameraCalibration {
        pose_weight,
        blend: Blend { hull: fitted.weights[0], offsets: fitted.offsets, ..Blend::default() },
        together,
        views: labels.len(),
        accuracy: fitted.accuracy,
        log_loss: fitted.log_loss,
    })
}

impl LeftOut<'_> {
    /// Log evidence of each class for a shape that lies as it truly does; none where the grids differ in size.
    fn evidence(&self, sample: &Sample) -> Result<Vec<f64>, LinearError> {
        let same = self.held.iter().flatten().next().is_some_and(|shape| shape.dims() == sample.observation.dims());
        if !same {
            return Ok(Vec::new());
        }
        let mut evidence = PlacedEvidence::new(&sample.observation, Outside::Unknown, self.noise);
        evidence.place(&sample.placed);
        let of = |class: &ClassSubspace| evidence.of(class, sample.placed.scale, &mut Conditional::new(class.size()));
        self.subspaces.iter().map(of).collect()
    }
}

/// log Σ exp(weight · value).
fn log_sum(values: &[f64], weight: f64) -> f64 {
    let peak = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    weight * peak + values.iter().map(|v| (weight * (v - peak)).exp()).sum::<f64>().ln()
}
