//! What a camera sees: class, yaw, size and place.
//!
//! - Features z of the view's shadow have a Gaussian for each component, step of yaw and elevation, and the offsets δ (rest of the yaw, log size,
//!   place, lengths) a Gaussian given z; elevations are mixed. A cell is one component at one step of yaw.
//! - F(s) = (1 / w) log Σ exp(w · score + log prior) over the cells of class s, and log P(s) = blend · F(s) + offset + log prior; by default with
//!   the logarithm of the forest's share.
//! - The evidence of an object that lies in a given way: the grid is turned to the object, the class conditioned on its known voxels, relative to
//!   noise about zero, times scale³.
//! - The density of size, place and yaw given a class: what the cell expects, times the evidence.

use crate::camera_forest::Asked;
use crate::camera_view::{Frame, Placed};
use crate::class::Reference;
use crate::known_pose::softmax;
use beo_core::grid::{EMPTY, FILLED, Observation, Outside, UNKNOWN};
use beo_core::model::{CAMERA_CELLS, CameraCalibration, CameraDensities, Component, OFFSETS, YAWS};
use half::f16;
use nalgebra::{DMatrix, DVector, Matrix3, Vector3};
use std::f64::consts::{PI, TAU};

/// Classes that are so probable by the view alone have their evidence weighed, and at most `MOST`; where nothing is searched, those that are
/// at least `KNOWN_SHARE`.
const LEAST_SHARE: f64 = 0.05;
const MOST: usize = 3;
const KNOWN_SHARE: f64 = 1e-4;
/// Steps of the climb, in expected deviations, and of the parabola at its end.
const STEPS: [f64; 2] = [1.0, 0.5];
const LAST: f64 = 0.35;

/// Yaw (radians), log size (units per voxel) and place (units) in the view's frame.
pub type Parameters = [f64; 5];

/// The parameters that the query states.
pub type Told = [Option<f64>; 5];

/// One component at one step of yaw, given the view.
pub struct Cell {
    pub class: usize,
    pub resting: [f64; 4],
    pub step: usize,
    /// Log density of the view, and of what is told.
    pub score: f64,
    /// Log probability of the component, and what its true size adds.
    pub log_prior: f64,
    /// Of the offsets.
    pub mean: [f64; OFFSETS],
    pub variance: [f64; OFFSETS],
}

/// A query about a camera's view.
pub struct CameraQuery<'a> {
    pub seen: &'a Observation,
    pub camera: Vector3<f64>,
    pub outside: Outside,
    /// Whether the object may rest in any pose of its class.
    pub lying: bool,
    pub voxel_size_m: Option<f64>,
}

/// A view as the equations read it.
pub struct View<'a> {
    pub reference: &'a Reference,
    pub query: &'a CameraQuery<'a>,
    pub frame: Frame,
    pub told: Told,
    pub cells: Vec<Cell>,
}

/// An angle from −π to π.
fn wrapped(angle: f64) -> f64 {
    (angle + PI).rem_euclid(TAU) - PI
}

fn log_sum(values: impl Iterator<Item = f64>) -> f64 {
    let values: Vec<f64> = values.collect();
    let peak = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    peak + values.iter().map(|v| (v - peak).exp()).sum::<f64>().ln()
}

fn widened(rows: usize, columns: usize, values: &[f16]) -> DMatrix<f64> {
    DMatrix::from_row_iterator(rows, columns, values.iter().map(|v| v.to_f64()))
}

impl Reference {
    fn cameras(&self) -> (&CameraDensities, &CameraCalibration) {
        let calibration = self.model.metadata.calibration.camera.as_ref();
        (self.model.camera_densities().expect("learned from cameras"), calibration.expect("calibrated for cameras"))
    }

    /// Log evidence relative to noise about zero of an object that lies so, nats, in voxels of the grid that was observed.
    pub fn evidence_of_placed(&self, query: &CameraQuery, placed: &Placed, class: usize) -> f64 {
        let moved = moved(query.seen, query.outside, placed);
        let known: Vec<usize> = (0..moved.len()).filter(|v| moved[*v] != UNKNOWN).collect();
        let values = DVector::from_iterator(known.len(), known.iter().map(|v| f64::from(u8::from(moved[*v] == FILLED))));
        let noise_alone = -0.5 * (known.len() as f64 * (TAU * self.noise).ln() + values.norm_squared() / self.noise);
        placed.scale.powi(3) * (self.classes[class].condition(&known, &values, self.noise).log_evidence - noise_alone)
    }

    /// The view with the densities of all cells; `told` in its frame.
    pub fn view<'a>(&'a self, query: &'a CameraQuery<'a>, told: impl FnOnce(&Frame) -> Told) -> View<'a> {
        let frame = Frame::new(query.seen, &query.camera);
        let told = told(&frame);
        let (densities, calibration) = self.cameras();
        let p = densities.size;
        let z = widened(CAMERA_CELLS, p, &densities.basis).tr_mul(&DVector::from_vec(frame.shadow()));
        // Shares of the learned elevations: linear between two, the last one beyond the ends.
        let last = densities.elevations.len() - 1;
        let elevation = frame.elevation.clamp(densities.elevations[0], densities.elevations[last]);
        let share = |e: usize| {
            let hat = |other: usize| 1.0 - (elevation - densities.elevations[e]) / (densities.elevations[other] - densities.elevations[e]);
            let beside = if elevation < densities.elevations[e] { e.checked_sub(1) } else { (e < last).then_some(e + 1) };
            beside.map_or(1.0, hat).clamp(0.0, 1.0)
        };
        let elevations: Vec<(usize, f64)> = (0..=last).map(|e| (e, share(e))).filter(|(_, share)| *share > 0.0).collect();
        let is_asked = |c: &Component| (query.lying && told[0].is_none()) || c.resting_rotation[3].abs() > 1.0 - 1e-12;
        let mut cells = Vec::new();
        for (component, of) in densities.components.iter().enumerate().filter(|(_, of)| is_asked(of)) {
            for step in 0..YAWS {
                let angle = step as f64 * TAU / YAWS as f64;
                let told = [told[0].map(|yaw| wrapped(yaw - angle)), told[1], told[2], told[3], told[4]];
                let parts = elevations.iter().map(|(e, share)| {
                    let place = (e * YAWS + step) * densities.components.len() + component;
                    let centred = &z - DVector::from_iterator(p, densities.means[place * p..][..p].iter().map(|v| v.to_f64()));
                    let packed = &densities.whitening[place * p * (p + 1) / 2..][..p * (p + 1) / 2];
                    let root = DMatrix::from_fn(p, p, |i, j| if j <= i { packed[i * (i + 1) / 2 + j].to_f64() } else { 0.0 });
                    let slope = widened(OFFSETS, p, &densities.regression[place * OFFSETS * p..][..OFFSETS * p]);
                    let of_offset = |values: &[f32]| DVector::from_fn(OFFSETS, |j, _| f64::from(values[place * OFFSETS + j]));
                    let (mean, deviation) = (of_offset(&densities.offsets) + slope * &centred, of_offset(&densities.deviations));
                    let of_told: f64 =
                        (0..5).filter_map(|j| told[j].map(|v| -0.5 * ((v - mean[j]) / deviation[j]).powi(2) - deviation[j].ln())).sum();
                    let log_volume: f64 = root.diagonal().iter().map(|v| v.ln()).sum();
                    (share.ln() + log_volume - 0.5 * (root * centred).norm_squared() + of_told, mean, deviation)
                });
                let parts: Vec<(f64, DVector<f64>, DVector<f64>)> = parts.collect();
                let score = log_sum(parts.iter().map(|part| part.0));
                let mixed = |of: &dyn Fn(&DVector<f64>, &DVector<f64>) -> f64| -> f64 {
                    parts.iter().map(|(log, mean, deviation)| (log - score).exp() * of(mean, deviation)).sum()
                };
                let mean: [f64; OFFSETS] = std::array::from_fn(|j| mixed(&|mean, _| mean[j]));
                let variance: [f64; OFFSETS] =
                    std::array::from_fn(|j| mixed(&|m, deviation| deviation[j].powi(2) + (m[j] - mean[j]).powi(2)));
                let log_size = calibration.size_weight.zip(query.voxel_size_m).zip(of.size);
                let log_size = log_size.map_or(0.0, |((weight, edge), size)| {
                    let lengths: [f64; 3] = std::array::from_fn(|axis| mean[5 + axis].max(0.1));
                    let relative: [f64; 3] = std::array::from_fn(|axis| (variance[5 + axis].sqrt() / lengths[axis]).min(1.0));
                    let covariance = Matrix3::from(size.covariance) + Matrix3::from_diagonal(&Vector3::from(relative.map(|v| v * v)));
                    let apart = Vector3::from_fn(|axis, _| (lengths[axis] * edge * frame.unit).ln() - size.mean[axis]);
                    let inverse = covariance.try_inverse().expect("a covariance");
                    weight * -0.5 * (3.0 * TAU.ln() + covariance.determinant().ln() + apart.dot(&(inverse * apart)))
                });
                let (class, resting, log_prior) = (of.class, of.resting_rotation, of.probability.ln() + log_size);
                cells.push(Cell { class, resting, step, score, log_prior, mean, variance });
            }
        }
        View { reference: self, query, frame, told, cells }
    }

    /// Class posterior by the evidence alone, an object of this size lying at this place turned by each of these angles in the view's frame.
    pub fn posterior_of_angles(&self, query: &CameraQuery, scale: f64, place: &Vector3<f64>, angles: &[f64]) -> (Vec<f64>, Vec<f64>) {
        let frame = Frame::new(query.seen, &query.camera);
        let blend = &self.model.metadata.calibration.evidence;
        let score = |class: usize| {
            let of = |angle: &f64| {
                let placed = frame.placed([0.0, 0.0, 0.0, 1.0], *angle, scale, place);
                blend.evidence * self.evidence_of_placed(query, &placed, class)
            };
            log_sum(angles.iter().map(of)) / blend.evidence
        };
        let scores: Vec<f64> = (0..self.classes.len()).map(score).collect();
        let posterior = softmax(scores.iter().zip(&blend.offsets).map(|(score, offset)| blend.evidence * score + offset));
        (posterior, scores)
    }
}

/// Codes of the voxels of the canonical grid: those of the nearest voxels of the grid in which the object lies.
fn moved(seen: &Observation, outside: Outside, placed: &Placed) -> Vec<u8> {
    let dims = seen.dims();
    let sides = [dims.x(), dims.y(), dims.z()];
    let middle = Vector3::from(sides.map(|side| (side as f64 - 1.0) / 2.0));
    let source = |voxel: usize| {
        let at = Vector3::from(dims.coordinates(voxel).map(|c| c as f64)) - middle;
        let from = placed.rotation * at * placed.scale + placed.shift + middle;
        let from = from.map(f64::round_ties_even);
        let is_inside = (0..3).all(|axis| from[axis] >= 0.0 && from[axis] < sides[axis] as f64);
        is_inside.then(|| seen.code(dims.index(from.x as usize, from.y as usize, from.z as usize)))
    };
    let beyond = if outside == Outside::Empty { EMPTY } else { UNKNOWN };
    (0..dims.voxels()).map(|voxel| source(voxel).unwrap_or(beyond)).collect()
}

impl View<'_> {
    /// F(s) of every class.
    pub fn scores(&self) -> Vec<f64> {
        let weight = self.reference.cameras().1.pose_weight;
        let of = |class: usize| self.cells.iter().filter(move |cell| cell.class == class);
        let classes = 0..self.reference.classes.len();
        classes.map(|class| log_sum(of(class).map(|cell| weight * cell.score + cell.log_prior)) / weight).collect()
    }

    /// Class posterior by the densities of the view alone.
    pub fn posterior(&self) -> Vec<f64> {
        let blend = &self.reference.cameras().1.blend;
        softmax(self.scores().iter().zip(&blend.offsets).map(|(score, offset)| blend.hull * score + offset))
    }

    /// Class posterior by these densities and the forest.
    pub fn with_forest(&self, asked: &Asked) -> Vec<f64> {
        let blend = self.reference.cameras().1.with_forest.as_ref().expect("fitted with the forest");
        let scores = self.scores();
        let log_weight = |s: usize| blend.hull * scores[s] + blend.forest * asked.log_shares[s] + blend.offsets[s];
        softmax((0..scores.len()).map(log_weight))
    }

    /// Class posterior with the evidence of the likely classes, given how an object of each class lies. They stay together as likely as before.
    pub fn with_evidence(&self, asked: &Asked, lies: impl Fn(usize) -> Placed) -> Vec<f64> {
        let mut posterior = self.with_forest(asked);
        let mut likely: Vec<usize> = (0..posterior.len()).collect();
        likely.sort_by(|a, b| posterior[*b].total_cmp(&posterior[*a]));
        let all_is_told = self.told.iter().all(Option::is_some);
        let (least, most) = if all_is_told { (KNOWN_SHARE, posterior.len()) } else { (LEAST_SHARE, MOST) };
        likely.retain(|class| posterior[*class] >= least);
        likely.truncate(most);
        let blend = self.reference.cameras().1.together.as_ref().expect("fitted with evidence");
        let scores = self.scores();
        let log_weight = |class: &usize| {
            let evidence = self.reference.evidence_of_placed(self.query, &lies(*class), *class);
            blend.hull * scores[*class] + blend.evidence * evidence + blend.forest * asked.log_shares[*class] + blend.offsets[*class]
        };
        let together: f64 = likely.iter().map(|class| posterior[*class]).sum();
        let shares = softmax(likely.iter().map(log_weight));
        likely.iter().zip(shares).for_each(|(class, share)| posterior[*class] = together * share);
        posterior
    }

    /// The cells of a class, the likeliest first.
    pub fn likeliest(&self, class: usize) -> Vec<&Cell> {
        let weight = self.reference.cameras().1.pose_weight;
        let value = |cell: &Cell| weight * cell.score + cell.log_prior;
        let mut cells: Vec<&Cell> = self.cells.iter().filter(|cell| cell.class == class).collect();
        cells.sort_by(|a, b| value(b).total_cmp(&value(a)));
        cells
    }

    /// How an object lies that has these parameters.
    pub fn placed(&self, cell: &Cell, at: &Parameters) -> Placed {
        self.frame.placed(cell.resting, at[0], at[1].exp(), &Vector3::new(at[2], at[3], at[4]))
    }

    /// Expected parameters, and their deviations: none of what is told.
    fn expected(&self, cell: &Cell) -> (Parameters, Parameters) {
        let turned = |j: usize| cell.mean[j] + if j == 0 { cell.step as f64 * TAU / YAWS as f64 } else { 0.0 };
        let mean = std::array::from_fn(|j| self.told[j].unwrap_or_else(|| turned(j)));
        (mean, std::array::from_fn(|j| if self.told[j].is_some() { 0.0 } else { cell.variance[j].sqrt() }))
    }

    /// Log density of parameters given the class, up to a constant: of the cell and by what it expects, and by the evidence.
    pub fn log_density(&self, cell: &Cell, at: &Parameters) -> f64 {
        let weight = self.reference.model.metadata.calibration.evidence.evidence;
        let evidence = self.reference.evidence_of_placed(self.query, &self.placed(cell, at), cell.class);
        weight * evidence + self.log_expectation(cell, at)
    }

    /// The same without the evidence.
    pub fn log_expectation(&self, cell: &Cell, at: &Parameters) -> f64 {
        let (mean, deviation) = self.expected(cell);
        let apart = |j: usize| if j == 0 { wrapped(at[0] - mean[0]) } else { at[j] - mean[j] };
        let expected: f64 = (0..5).filter(|j| deviation[*j] > 0.0).map(|j| -0.5 * (apart(j) / deviation[j]).powi(2)).sum();
        expected + self.reference.cameras().1.pose_weight * cell.score + cell.log_prior
    }

    /// Climbs from where a cell expects the object, on all voxels: whole steps, half steps, then the top of a parabola along each axis.
    pub fn climb(&self, cell: &Cell) -> (Parameters, f64) {
        let (mean, deviation) = self.expected(cell);
        let (mut at, mut value) = (mean, self.log_density(cell, &mean));
        let beside = |at: &Parameters, axis: usize, by: f64| {
            let mut next = *at;
            next[axis] += by * deviation[axis];
            (next, self.log_density(cell, &next))
        };
        let free: Vec<usize> = (0..5).filter(|axis| deviation[*axis] > 0.0).collect();
        for (step, axis) in STEPS.iter().flat_map(|step| free.iter().map(move |axis| (*step, *axis))) {
            for next in [beside(&at, axis, step), beside(&at, axis, -step)] {
                if next.1 > value {
                    (at, value) = next;
                }
            }
        }
        for axis in free {
            let [low, high] = [-LAST, LAST].map(|step| beside(&at, axis, step));
            let bend = low.1 - 2.0 * value + high.1;
            let top = (bend < 0.0).then(|| beside(&at, axis, LAST * (0.5 * (low.1 - high.1) / bend).clamp(-1.0, 1.0)));
            for next in [Some(low), Some(high), top].into_iter().flatten() {
                if next.1 > value {
                    (at, value) = next;
                }
            }
        }
        (at, value)
    }
}
