//! Densities of turned objects seen from above, for the search over SO(3).
//!
//! The direction of the object that points up falls into one of [`DIRECTIONS`] bins. Per class and bin, many shapes are rendered,
//! each turned by R = E F_d with its own small E: uniform over the bin's disc of tilts, and over half a turn's step in the plane.
//! Their hull features z get a Gaussian, and the rotation vector δ of E a linear regression on z.
//!
//! - Features: principal components of pooled hulls of uniformly turned shapes.
//! - Covariance and regression: those of the class in the bin, shrunk, with a share of the mean over the bin's classes.

use super::components::{Components, principal_components};
use super::regressed::{Moments, regressed};
use crate::grid::{HeightMap, Occupancy, Pooling, Rotation, uniform_rotation, yaw};
use crate::learning::render::Renderer;
use crate::linear::LinearError;
use crate::model::{DIRECTIONS, ViewDensities};
use crate::perception::views::hull_features::HullFeatures;
use crate::perception::views::viewpoint::{TURNS, frame};
use faer::Mat;
use half::f16;
use nalgebra::Vector3;
use rand::seq::SliceRandom;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use std::f64::consts::{PI, TAU};

/// Most features. Held-out objects are found as well with 64 and 96; the size of the model goes with the square.
const FEATURES: usize = 56;
/// Views from which the features are learned: this many per shape, within the bounds.
const FEATURE_VIEWS: usize = 10;
const FEATURE_BOUNDS: (usize, usize) = (300, 2000);
/// Views per class and direction: this many per shape, within the bounds. Held-out objects were found as well with 400.
const VIEWS: usize = 8;
const VIEW_BOUNDS: (usize, usize) = (64, 250);
/// Least variance of a feature, as a share of the mean variance over all turned shapes: without it, few or equal shapes would
/// make densities that are too narrow for half precision.
const LEAST_VARIANCE: f64 = 1e-3;

/// Learns the densities from the shapes of each class. The same shapes and seed give the same densities, whatever the number of
/// threads.
pub fn view_densities(classes: &[Vec<&Occupancy>], seed: u64) -> Result<ViewDensities, LinearError> {
    let components = feature_basis(classes, seed)?;
    let (size, variance) = (components.basis.ncols(), components.variance);
    let dims = classes[0][0].dims();
    let basis = components.rows();
    let features = HullFeatures::new(dims, size, &basis);
    let ridge = (LEAST_VARIANCE * variance).max(1e-4);
    let moments: Vec<Vec<Moments>> = classes
        .iter()
        .enumerate()
        .map(|(s, shapes)| {
            let views = render_views(shapes, &features, seed, s as u64);
            (0..DIRECTIONS).into_par_iter().map(|d| moments(&views, d, size, ridge)).collect()
        })
        .collect();
    let blocks: Vec<Block> = (0..DIRECTIONS)
        .into_par_iter()
        .map(|d| Block::new(&moments.iter().map(|class| &class[d]).collect::<Vec<_>>(), size))
        .collect::<Result<_, _>>()?;
    let join = |part: fn(&Block) -> &[f16]| blocks.iter().flat_map(|b| part(b).iter().copied()).collect();
    Ok(ViewDensities { size, basis, means: join(|b| &b.means), whitening: join(|b| &b.whitening), regression: join(|b| &b.regression) })
}

/// Principal components of the pooled hulls of uniformly turned shapes.
fn feature_basis(classes: &[Vec<&Occupancy>], seed: u64) -> Result<Components, LinearError> {
    let shapes: Vec<&Occupancy> = classes.iter().flatten().copied().collect();
    let dims = shapes[0].dims();
    let pooling = Pooling::new(dims);
    let cells = pooling.count();
    let count = (FEATURE_VIEWS * shapes.len()).clamp(FEATURE_BOUNDS.0, FEATURE_BOUNDS.1);
    let size = FEATURES.min(cells).min(count / 2);
    // A view of every n-th shape, so that every class gives its share; views of one shape follow each other.
    let hulls: Vec<Vec<f32>> = (0..count)
        .into_par_iter()
        .map(|view| {
            let mut rng = stream(seed, u64::MAX, view);
            let renderer = Renderer::new(shapes[view * shapes.len() / count]);
            let mut map = HeightMap::new(dims);
            let turned = uniform_rotation(std::array::from_fn(|_| rng.random_range(0.0..1.0)));
            renderer.render(&turned, pooling.columns().map(|(column, _)| column), &mut map);
            let mut pooled = vec![0.0; cells];
            pooling.pool(&map, &mut pooled);
            pooled
        })
        .collect();
    principal_components(hulls, size, &mut stream(seed, u64::MAX, count))
}

/// Random numbers for one view of one class.
fn stream(seed: u64, class: u64, view: usize) -> ChaCha8Rng {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    rng.set_stream((class << 32) ^ (view as u64 + 1));
    rng
}

/// E: a tilt uniform over the disc that has the area of a bin, then a turn about z uniform over the step of the turns.
fn jitter(rng: &mut ChaCha8Rng) -> Rotation {
    let [u, v, w]: [f64; 3] = std::array::from_fn(|_| rng.random_range(0.0..1.0));
    let tilt = (4.0 / DIRECTIONS as f64).sqrt() * u.sqrt();
    let (sin, cos) = (TAU * v).sin_cos();
    let turn = (2.0 * w - 1.0) * PI / TURNS as f64;
    yaw(turn) * Rotation::from_scaled_axis(Vector3::new(tilt * cos, tilt * sin, 0.0))
}

/// One shape from all directions: features, `[direction]` p values each, and the rotation vectors of E.
struct Views {
    features: Vec<f32>,
    offsets: Vec<[f64; 3]>,
}

/// Views of the shapes of a class, each shape as often as the others (within one), in a random order.
fn render_views(shapes: &[&Occupancy], features: &HullFeatures, seed: u64, class: u64) -> Vec<Views> {
    let count = (VIEWS * shapes.len()).clamp(VIEW_BOUNDS.0, VIEW_BOUNDS.1);
    let mut order: Vec<usize> = (0..shapes.len()).collect();
    order.shuffle(&mut stream(seed, class, usize::MAX >> 32));
    let frames: Vec<Rotation> = (0..DIRECTIONS).map(frame).collect();
    let view = |view: usize| {
        let object = shapes[order[view % order.len()]];
        let renderer = Renderer::new(object);
        let mut rng = stream(seed, class, view);
        let mut map = HeightMap::new(object.dims());
        let mut views = Views { features: vec![0.0; DIRECTIONS * features.size()], offsets: Vec::with_capacity(DIRECTIONS) };
        for (frame, z) in frames.iter().zip(views.features.chunks_exact_mut(features.size())) {
            let offset = jitter(&mut rng);
            renderer.render(&(offset * frame), features.columns(), &mut map);
            features.project(&map, z);
            views.offsets.push(offset.scaled_axis().into());
        }
        views
    };
    (0..count).into_par_iter().map(view).collect()
}

/// Moments of one class in one bin.
fn moments(views: &[Views], direction: usize, size: usize, ridge: f64) -> Moments {
    let rows = Mat::<f32>::from_fn(views.len(), size, |i, j| views[i].features[direction * size + j]);
    let offsets = Mat::<f64>::from_fn(views.len(), 3, |i, axis| views[i].offsets[direction][axis]);
    Moments::new(rows.as_ref(), offsets, ridge)
}

/// Stored values of one direction.
struct Block {
    means: Vec<f16>,
    whitening: Vec<f16>,
    regression: Vec<f16>,
}

impl Block {
    fn new(classes: &[&Moments], size: usize) -> Result<Self, LinearError> {
        let mut block = Self { means: Vec::new(), whitening: Vec::new(), regression: Vec::new() };
        for gaussian in regressed(classes)? {
            block.means.extend(gaussian.mean.iter().map(|v| f16::from_f64(*v)));
            block.whitening.extend(gaussian.packed_whitening());
            block.regression.extend(gaussian.regression_rows());
        }
        debug_assert_eq!(block.means.len(), classes.len() * size);
        Ok(block)
    }
}
