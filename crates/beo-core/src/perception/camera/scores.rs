//! Log densities of what a camera sees, for each class and step of yaw, and how the object would then lie.
//!
//! Features z of the shadow in the view's frame have a Gaussian for each class, step of yaw and learned elevation; how exactly the object lies (the
//! offsets δ) has a Gaussian given z. What is told of the pose, the size or the place is scored as an observation of δ:
//! log p(z, δ) = log N(z) + log N(δ | z). As z is the same data for all of them, this is a likelihood over class, yaw, size and place.
//!
//! A class is a mixture of components (kinds of size in resting poses), each with densities of its own. Where lengths are metric, the log
//! density of a component's true size at the lengths that a cell expects is a further term.

use super::view_frame::{CELLS, ShadowImage, ViewFrame};
use crate::grid::{Observation, Rotation, Similarity};
use crate::lanes::{Kernel, LANES, dispatch, dot_of_blocks, widen_halves};
use crate::model::{CameraDensities, Component, Forest, OFFSETS, SizeDensity, YAWS};
use crate::perception::densities::log_sum::log_sum_exp;
use crate::perception::densities::packed::{PackedGaussian, log_volume};
use half::f16;
use nalgebra::Vector3;
use std::f64::consts::{PI, TAU};
use std::sync::Arc;

/// A step of yaw is beside a yaw if it is within this many steps of it.
const REACH: f64 = 1.5;

/// Yaw, size and place as far as they are known, in the view's frame.
#[derive(Clone, Copy, Debug, Default)]
pub struct KnownPlacement {
    /// The object stands as it does canonically.
    pub upright: bool,
    /// The object's yaw, radians.
    pub yaw: Option<f64>,
    /// Units per voxel of the canonical grid.
    pub scale: Option<f64>,
    /// The centre of the canonical grid, units.
    pub place: Option<Vector3<f64>>,
}

/// One component of a class at one step of yaw.
#[derive(Clone, Copy, Debug)]
pub struct Cell {
    /// The class.
    pub class: usize,
    /// The component.
    pub component: usize,
    /// How it rests: object axes to axes with z up.
    pub resting: Rotation,
    /// Log probability of the component in its class, and what the true size adds to it.
    pub log_prior: f64,
    /// The step of yaw.
    pub step: usize,
    /// Log density, up to a constant.
    pub score: f64,
    /// Expected offsets given the view.
    pub offsets: [f64; OFFSETS],
    /// Their standard deviations.
    pub deviations: [f64; OFFSETS],
}

impl Cell {
    /// The expected yaw in the view's frame, radians.
    pub fn yaw(&self) -> f64 {
        CameraDensities::yaw(self.step) + self.offsets[0]
    }

    /// Whether its step of yaw is beside a yaw in the view's frame, radians.
    pub fn is_beside(&self, yaw: f64) -> bool {
        is_beside(self.step, yaw)
    }

    /// The expected scale: units per voxel of the canonical grid.
    pub fn scale(&self) -> f64 {
        self.offsets[1].exp()
    }

    /// How an object of this component lies in a grid when turned by `angle` in the view's frame: see [`ViewFrame::placed`].
    pub fn placed(&self, frame: &ViewFrame, angle: f64, scale: f64, place: &Vector3<f64>) -> Similarity {
        let upright = frame.placed(angle, scale, place);
        Similarity { rotation: upright.rotation * self.resting, ..upright }
    }

    /// Log weight in the posterior over class and pose, up to a constant: `pose_weight` times the score, and the prior.
    pub fn log_weight(&self, pose_weight: f64) -> f64 {
        pose_weight * self.score + self.log_prior
    }

    /// Log density of a true size at the lengths that are expected; a unit measures `unit_m` metres.
    pub fn log_size(&self, size: &SizeDensity, unit_m: f64) -> f64 {
        let units: [f64; 3] = std::array::from_fn(|axis| self.offsets[OFFSETS - 3 + axis].max(0.1));
        let relative = std::array::from_fn(|axis| (self.deviations[OFFSETS - 3 + axis] / units[axis]).min(1.0));
        size.log_density(units.map(|length| length * unit_m), relative)
    }

    /// The expected place of the canonical grid's centre, units.
    pub fn place(&self) -> Vector3<f64> {
        Vector3::new(self.offsets[2], self.offsets[3], self.offsets[4])
    }
}

/// The linear map from what is seen in a view's frame to features.
pub struct CameraFeatures {
    /// B, widened.
    basis: Vec<f32>,
    size: usize,
}

/// A model's densities, ready for queries.
pub struct CameraScores {
    features: CameraFeatures,
    densities: Arc<CameraDensities>,
    /// Of each density of features.
    log_volumes: Vec<f64>,
}

/// The shadow of the visible part in a frame, and the image to find it.
#[derive(Default)]
pub struct Shadow {
    image: ShadowImage,
    /// Averages over the cells.
    pub cells: Vec<f32>,
}

/// Scratch memory.
#[derive(Default)]
pub struct ViewWork {
    /// For sorting.
    pub along: Vec<f64>,
    shadow: Shadow,
    features: Vec<f32>,
    gaussian: PackedGaussian,
    centred: Vec<f32>,
    regression: Vec<f32>,
    /// The outcome.
    pub cells: Vec<Cell>,
}

impl CameraFeatures {
    /// Prepares B, one row of `size` values per cell.
    pub fn new(rows: &[f16], size: usize) -> Self {
        debug_assert_eq!(rows.len(), CELLS * size);
        let mut basis = vec![0.0; rows.len()];
        widen_halves(rows, &mut basis);
        Self { basis, size }
    }

    /// Features of what is seen in a frame, into `out`.
    pub fn of(&self, frame: &ViewFrame, observation: &Observation, scratch: &mut Shadow, out: &mut Vec<f32>) {
        let Shadow { image, cells } = scratch;
        frame.shadow(observation, image, cells);
        out.clear();
        out.resize(self.size, 0.0);
        for (share, row) in cells.iter().zip(self.basis.chunks_exact(self.size)).filter(|(share, _)| **share != 0.0) {
            out.iter_mut().zip(row).for_each(|(sum, v)| *sum += share * v);
        }
    }
}

impl CameraScores {
    /// Prepares densities.
    pub fn new(densities: Arc<CameraDensities>) -> Self {
        let (p, features) = (densities.size, CameraFeatures::new(&densities.basis, densities.size));
        let log_volumes = densities.whitening.chunks_exact(p * (p + 1) / 2).map(|root| log_volume(p, root)).collect();
        Self { features, densities, log_volumes }
    }

    /// The model's forest, if it has one.
    pub fn forest(&self) -> Option<&Forest> {
        self.densities.forest.as_ref()
    }

    /// Asks the forest about what a view measures: logarithms of the classes' shares into `out`, and the share of none of them. Without a
    /// forest `out` is empty.
    pub fn ask_forest(&self, measures: &[f32], out: &mut Vec<f64>) -> Option<f64> {
        out.clear();
        self.forest()?.shares(measures, out);
        let none = out.pop();
        // A class that the forest rules out counts as one in a thousand: it has seen made-up views alone.
        out.iter_mut().for_each(|share| *share = (*share + 1e-3).ln());
        none
    }

    /// The components of which the classes are mixtures.
    pub fn components(&self) -> &[Component] {
        &self.densities.components
    }

    /// Bytes that [`Self::new`] takes for `size` features.
    pub fn bytes(size: usize) -> usize {
        4 * CELLS * size
    }

    /// All wanted classes at all steps of yaw that agree with what is told, into `work.cells`; `only` one component, if it is given.
    pub fn score(
        &self,
        frame: &ViewFrame,
        observation: &Observation,
        told: &KnownPlacement,
        wanted: &[bool],
        only: Option<usize>,
        work: &mut ViewWork,
    ) {
        let ViewWork { shadow, features, gaussian, centred, regression, cells, .. } = work;
        self.features.of(frame, observation, shadow, features);
        let (densities, p, m) = (&self.densities, self.densities.size, self.densities.components.len());
        let triangle = p * (p + 1) / 2;
        let blocks = p.div_ceil(LANES);
        centred.clear();
        centred.resize(blocks * LANES, 0.0);
        regression.resize(OFFSETS * p + LANES, 0.0);
        cells.clear();
        let elevations = densities.beside(frame.elevation);
        for step in 0..YAWS {
            if told.yaw.is_some_and(|yaw| !is_beside(step, yaw)) {
                continue;
            }
            let rest = told.yaw.map(|yaw| wrapped(yaw - CameraDensities::yaw(step)));
            let is_wanted = |place: usize, component: &Component| {
                let is_asked = only.is_none_or(|only| only == place);
                is_asked && wanted[component.class] && (!told.upright || component.is_upright())
            };
            for (component, of) in densities.components.iter().enumerate().filter(|(place, of)| is_wanted(*place, of)) {
                let mut cell = Cell {
                    class: of.class,
                    component,
                    resting: of.rotation(),
                    log_prior: of.probability.ln(),
                    step,
                    score: f64::NEG_INFINITY,
                    offsets: [0.0; OFFSETS],
                    deviations: [0.0; OFFSETS],
                };
                for (elevation, share) in elevations.into_iter().filter(|(_, share)| *share > 0.0) {
                    let place = densities.place(elevation, step, component, m);
                    let (mean, root) = (&densities.means[place * p..][..p], &densities.whitening[place * triangle..][..triangle]);
                    gaussian.load(mean, root, self.log_volumes[place]);
                    widen_halves(&densities.regression[place * OFFSETS * p..][..OFFSETS * p], regression);
                    gaussian.centre(features, centred);
                    let regressed = dispatch(Regressed { rows: regression, stride: p, centred });
                    let offset = |j: usize| f64::from(densities.offsets[place * OFFSETS + j]) + f64::from(regressed[j]);
                    let offsets: [f64; OFFSETS] = std::array::from_fn(offset);
                    let deviations: [f64; OFFSETS] = std::array::from_fn(|j| f64::from(densities.deviations[place * OFFSETS + j]));
                    let log_told = told.log_density(rest, &offsets, &deviations);
                    cell.add(share.ln() + gaussian.log_density(centred) + log_told, &offsets, &deviations);
                }
                cells.push(cell);
            }
        }
    }
}

/// Offsets that a centred point adds to their means: a row of a regression for each.
struct Regressed<'a> {
    /// Rows, and room for a block of lanes.
    rows: &'a [f32],
    /// Values of a row.
    stride: usize,
    /// Whole blocks of lanes, with zeros beyond the point's own values.
    centred: &'a [f32],
}

impl Kernel for Regressed<'_> {
    type Output = [f32; OFFSETS];

    #[inline(always)]
    fn run<const FUSED: bool>(self) -> [f32; OFFSETS] {
        let Self { rows, stride, centred } = self;
        let mut out = [0.0; OFFSETS];
        for (j, out) in out.iter_mut().enumerate() {
            *out = dot_of_blocks::<FUSED>(&rows[j * stride..], centred, centred.len() / LANES);
        }
        out
    }
}

impl Cell {
    /// Adds a part of the mixture; its moments are those of the mixture, by the law of total variance: Σ w m and Σ w (s² + (m − mean)²).
    fn add(&mut self, score: f64, offsets: &[f64; OFFSETS], deviations: &[f64; OFFSETS]) {
        let together = log_sum_exp([self.score, score].into_iter());
        let share = (score - together).exp();
        for j in 0..OFFSETS {
            let apart = offsets[j] - self.offsets[j];
            self.offsets[j] += share * apart;
            let within = (1.0 - share) * self.deviations[j].powi(2) + share * deviations[j].powi(2);
            self.deviations[j] = (within + share * (1.0 - share) * apart.powi(2)).sqrt();
        }
        self.score = together;
    }
}

impl KnownPlacement {
    /// Log density of what is told as an observation of offsets with this mean and these deviations.
    fn log_density(&self, rest: Option<f64>, mean: &[f64; OFFSETS], deviations: &[f64; OFFSETS]) -> f64 {
        let told = self.offsets(rest);
        let of_axis = |j: usize| told[j].map(|v| -0.5 * ((v - mean[j]) / deviations[j]).powi(2) - deviations[j].ln());
        (0..OFFSETS).filter_map(of_axis).sum()
    }

    /// As offsets, `rest` being what is left of the yaw.
    fn offsets(&self, rest: Option<f64>) -> [Option<f64>; OFFSETS] {
        let place = |axis: usize| self.place.map(|place| place[axis]);
        [rest, self.scale.map(f64::ln), place(0), place(1), place(2), None, None, None]
    }
}

/// Whether a step of yaw is beside a yaw, radians.
fn is_beside(step: usize, yaw: f64) -> bool {
    wrapped(yaw - CameraDensities::yaw(step)).abs() <= REACH * TAU / YAWS as f64
}

/// An angle in [−π, π).
pub fn wrapped(angle: f64) -> f64 {
    (angle + PI).rem_euclid(TAU) - PI
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::yaw;
    use crate::perception::camera::camera_search::tests_support::seen_chair;
    use crate::perception::pose::small::seeing_perceiver;

    /// One class at one step of yaw by the textbook, in double precision: the precision matrix S⁻¹ = WᵀW is formed, every learned elevation gives a
    /// Gaussian of the features and of the offsets given them, and the moments of their mixture are Σ w m and Σ w (s² + (m − mean)²).
    fn dense(
        densities: &CameraDensities,
        shadow: &[f32],
        elevation: f64,
        told: &[Option<f64>; OFFSETS],
        step: usize,
        class: usize,
        classes: usize,
    ) -> (f64, [f64; OFFSETS], [f64; OFFSETS]) {
        let p = densities.size;
        let wide = |v: &f16| f64::from(v.to_f32());
        let z: Vec<f64> = (0..p).map(|h| (0..CELLS).map(|c| f64::from(shadow[c]) * wide(&densities.basis[c * p + h])).sum()).collect();
        let mut parts: Vec<(f64, [f64; OFFSETS], [f64; OFFSETS])> = Vec::new();
        for (e, share) in densities.beside(elevation).into_iter().filter(|(_, share)| *share > 0.0) {
            let place = densities.place(e, step, class, classes);
            let centred: Vec<f64> = (0..p).map(|i| z[i] - wide(&densities.means[place * p + i])).collect();
            let root = |i: usize, j: usize| {
                if j > i { 0.0 } else { wide(&densities.whitening[place * p * (p + 1) / 2 + i * (i + 1) / 2 + j]) }
            };
            let precision = |a: usize, b: usize| (0..p).map(|i| root(i, a) * root(i, b)).sum::<f64>();
            let quadratic: f64 =
                (0..p).flat_map(|a| (0..p).map(move |b| (a, b))).map(|(a, b)| centred[a] * precision(a, b) * centred[b]).sum();
            let log_volume: f64 = (0..p).map(|i| root(i, i).ln()).sum();
            let mean: [f64; OFFSETS] = std::array::from_fn(|j| {
                let row = place * OFFSETS * p + j * p;
                f64::from(densities.offsets[place * OFFSETS + j])
                    + (0..p).map(|i| wide(&densities.regression[row + i]) * centred[i]).sum::<f64>()
            });
            let deviation: [f64; OFFSETS] = std::array::from_fn(|j| f64::from(densities.deviations[place * OFFSETS + j]));
            let of_told: f64 =
                (0..OFFSETS).filter_map(|j| told[j].map(|v| -0.5 * ((v - mean[j]) / deviation[j]).powi(2) - deviation[j].ln())).sum();
            parts.push((share.ln() + log_volume - 0.5 * quadratic + of_told, mean, deviation));
        }
        let peak = parts.iter().map(|part| part.0).fold(f64::NEG_INFINITY, f64::max);
        let total: f64 = parts.iter().map(|part| (part.0 - peak).exp()).sum();
        let weights: Vec<f64> = parts.iter().map(|part| (part.0 - peak).exp() / total).collect();
        let mean: [f64; OFFSETS] = std::array::from_fn(|j| parts.iter().zip(&weights).map(|(part, w)| w * part.1[j]).sum());
        let variance =
            |j: usize| parts.iter().zip(&weights).map(|(part, w)| w * (part.2[j].powi(2) + (part.1[j] - mean[j]).powi(2))).sum::<f64>();
        (peak + total.ln(), mean, std::array::from_fn(|j| variance(j).sqrt()))
    }

    #[test]
    fn scores_and_moments_are_those_of_the_dense_mixture() {
        let densities = seeing_perceiver().model().camera_densities().expect("learned");
        let scores = CameraScores::new(Arc::new(densities.clone()));
        let m = seeing_perceiver().model().classes.len();
        let (observation, camera) = seen_chair();
        let frame = ViewFrame::new(&observation, &camera, &mut Vec::new()).expect("enough is seen");
        let mut shadow = Vec::new();
        frame.shadow(&observation, &mut ShadowImage::default(), &mut shadow);
        let (_, scale, place) = frame.seen(&crate::grid::Similarity { rotation: yaw(0.2), ..crate::grid::Similarity::default() });
        let all = KnownPlacement { upright: false, yaw: Some(1.4), scale: Some(scale), place: Some(place) };
        for told in [KnownPlacement::default(), KnownPlacement { scale: Some(scale), ..KnownPlacement::default() }, all] {
            let mut work = ViewWork::default();
            scores.score(&frame, &observation, &told, &vec![true; m], None, &mut work);
            assert!(!work.cells.is_empty() && (told.yaw.is_some() || work.cells.len() == m * YAWS));
            for cell in &work.cells {
                let rest = told.yaw.map(|yaw| wrapped(yaw - CameraDensities::yaw(cell.step)));
                let place = |axis: usize| told.place.map(|place| place[axis]);
                let known = [rest, told.scale.map(f64::ln), place(0), place(1), place(2), None, None, None];
                let (score, mean, deviation) = dense(densities, &shadow, frame.elevation, &known, cell.step, cell.class, m);
                assert!((cell.score - score).abs() < 1e-3 * (1.0 + score.abs()), "{} {score}", cell.score);
                for j in 0..OFFSETS {
                    assert!((cell.offsets[j] - mean[j]).abs() < 1e-3 * (1.0 + mean[j].abs()), "{j}: {} {}", cell.offsets[j], mean[j]);
                    assert!((cell.deviations[j] - deviation[j]).abs() < 2e-3 * (1.0 + deviation[j]), "{j}");
                }
            }
        }
    }

    /// N(0, 1) and N(4, 1) alike: mean 2, variance 1 + 4. The mean of the deviations would be 1.
    #[test]
    fn a_mixture_is_as_wide_as_its_parts_and_what_lies_between_them() {
        let mut cell = Cell {
            class: 0,
            component: 0,
            resting: Rotation::identity(),
            log_prior: 0.0,
            step: 0,
            score: f64::NEG_INFINITY,
            offsets: [0.0; OFFSETS],
            deviations: [0.0; OFFSETS],
        };
        cell.add(0.5_f64.ln(), &[0.0; OFFSETS], &[1.0; OFFSETS]);
        cell.add(0.5_f64.ln(), &[4.0; OFFSETS], &[1.0; OFFSETS]);
        assert!(cell.score.abs() < 1e-12 && (cell.offsets[3] - 2.0).abs() < 1e-12);
        assert!((cell.deviations[3] - 5.0_f64.sqrt()).abs() < 1e-12, "{}", cell.deviations[3]);
    }
}
