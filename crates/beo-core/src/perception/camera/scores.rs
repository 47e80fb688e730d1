//! Log densities of what a camera sees, for each class and step of yaw, and how the object would then lie.
//!
//! Features z of the shadow in the view's frame have a Gaussian for each class, step of yaw and learned elevation; how exactly the object lies (the
//! offsets δ) has a Gaussian given z. What is told of the pose, the size or the place is scored as an observation of δ:
//! log p(z, δ) = log N(z) + log N(δ | z). As z is the same data for all of them, this is a likelihood over class, yaw, size and place.
//!
//! A class is a mixture of components (kinds of size in resting poses), each with densities of its own. Where lengths are metric, the log
//! density of a component's true size at the lengths that a cell expects is a further term.

use super::view_frame::{CELLS, ShadowImage, ViewFrame};
use crate::grid::{Observation, Placed, Rotation};
use crate::model::{CameraDensities, Component, OFFSETS, SizeDensity, YAWS};
use crate::perception::densities::log_sum::log_sum_exp;
use crate::perception::densities::packed::PackedGaussian;
use crate::perception::kernels::lanes::dot;
use half::f16;
use half::slice::HalfFloatSliceExt;
use nalgebra::Vector3;
use std::f64::consts::{PI, TAU};
use std::sync::Arc;

/// A step of yaw is looked at if it is within this many steps of a yaw that is told.
const REACH: f64 = 1.5;

/// What is known already, in the view's frame.
#[derive(Clone, Copy, Debug, Default)]
pub struct Told {
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

    /// The expected scale: units per voxel of the canonical grid.
    pub fn scale(&self) -> f64 {
        self.offsets[1].exp()
    }

    /// How an object of this component lies in a grid when turned by `angle` in the view's frame: see [`ViewFrame::placed`].
    pub fn placed(&self, frame: &ViewFrame, angle: f64, scale: f64, place: &Vector3<f64>) -> Placed {
        let upright = frame.placed(angle, scale, place);
        Placed { rotation: upright.rotation * self.resting, ..upright }
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
}

/// What is seen and hidden in a frame, and the image to find it.
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
        rows.convert_to_f32_slice(&mut basis);
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
        Self { features: CameraFeatures::new(&densities.basis, densities.size), densities }
    }

    /// What the classes are mixtures of.
    pub fn components(&self) -> &[Component] {
        &self.densities.components
    }

    /// Bytes that [`Self::new`] takes for `size` features.
    pub fn bytes(size: usize) -> usize {
        4 * CELLS * size
    }

    /// All wanted classes at all steps of yaw that agree with what is told, into `work.cells`.
    pub fn score(&self, frame: &ViewFrame, observation: &Observation, told: &Told, wanted: &[bool], work: &mut ViewWork) {
        let ViewWork { shadow, features, gaussian, centred, regression, cells, .. } = work;
        self.features.of(frame, observation, shadow, features);
        let (densities, p, m) = (&self.densities, self.densities.size, self.densities.components.len());
        let triangle = p * (p + 1) / 2;
        centred.resize(p, 0.0);
        regression.resize(OFFSETS * p, 0.0);
        cells.clear();
        let elevations = densities.beside(frame.elevation);
        for step in 0..YAWS {
            let rest = told.yaw.map(|yaw| wrapped(yaw - CameraDensities::yaw(step)));
            if rest.is_some_and(|rest| rest.abs() > REACH * TAU / YAWS as f64) {
                continue;
            }
            let is_wanted = |component: &Component| wanted[component.class] && (!told.upright || component.is_upright());
            for (component, of) in densities.components.iter().enumerate().filter(|(_, of)| is_wanted(of)) {
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
                    gaussian.load(&densities.means[place * p..][..p], &densities.whitening[place * triangle..][..triangle]);
                    densities.regression[place * OFFSETS * p..][..OFFSETS * p].convert_to_f32_slice(regression);
                    gaussian.centre(features, centred);
                    let offset = |j: usize| {
                        f64::from(densities.offsets[place * OFFSETS + j]) + f64::from(dot(&regression[j * p..(j + 1) * p], centred))
                    };
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

impl Cell {
    /// Adds a part of the mixture.
    fn add(&mut self, score: f64, offsets: &[f64; OFFSETS], deviations: &[f64; OFFSETS]) {
        let together = log_sum_exp([self.score, score].into_iter());
        let share = (score - together).exp();
        for j in 0..OFFSETS {
            self.offsets[j] += share * (offsets[j] - self.offsets[j]);
            self.deviations[j] += share * (deviations[j] - self.deviations[j]);
        }
        self.score = together;
    }
}

impl Told {
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

/// An angle in [−π, π).
pub fn wrapped(angle: f64) -> f64 {
    (angle + PI).rem_euclid(TAU) - PI
}
