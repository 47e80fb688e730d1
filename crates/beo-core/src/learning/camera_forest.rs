//! The forest that names classes, or none of them, from what views of cameras measure (`perception::camera::measures`).
//!
//! It is grown on views of training shapes, each class alike, in their resting poses, and of things of no class (`distractors`). Gaussian
//! densities of the shadow say how an object lies and are one witness of its class; the forest is another, which sees true lengths, widths
//! by height and how surfaces bend. How much either counts is fitted on shapes that were left out (`camera_calibration`).

use super::boosting::{Growth, Samples, grow};
use super::calibration::fit_blend;
use super::camera_views::{AtRest, ComponentShapes, ViewSample, Views, stream};
use super::distractors::distractor;
use super::drawing::draw_by;
use crate::linear::LinearError;
use crate::model::{Forest, NoneCalibration};
use crate::perception::camera::{MEASURES, MeasureScratch, measure};
use rand::RngExt;
use rayon::prelude::*;
use std::f64::consts::TAU;

/// Views per shape, and most views of all classes together.
const PER_SHAPE: usize = 14;
const MOST_VIEWS: usize = 24_000;
/// Of so many of the views the size of voxels is not told, so that the forest answers without it too.
const WITHOUT_SIZE: f64 = 0.15;
/// How the trees grow, but for the seed.
const GROWTH: Growth = Growth { trees: 400, rate: 0.08, leaves: 31, least_leaf: 40, ridge: 10.0, inputs: 0.15, seed: 0 };
/// Highest camera, radians.
const HIGHEST: f64 = 1.5;
/// Attempts at a view in which enough is seen.
const ATTEMPTS: usize = 5;

/// The measures of some views, one row each, and the class that each shows; the number of classes stands for none of them.
#[derive(Default)]
pub struct Measured {
    inputs: Vec<f32>,
    outcomes: Vec<usize>,
}

impl Measured {
    /// Views of the shapes that are allowed (class, shape), and of as many things of no class as of one class on average.
    pub fn draw(
        parts: &[ComponentShapes],
        classes: usize,
        is_allowed: &(dyn Fn(usize, usize) -> bool + Sync),
        views: &Views<'_>,
        salt: u64,
    ) -> Self {
        let of_class = |class: usize| -> Vec<(f64, Vec<&AtRest>)> {
            let own = parts.iter().filter(|part| part.component.class == class);
            own.map(|part| {
                let shapes = part.shapes.iter().filter(|shape| is_allowed(class, shape.shape)).collect::<Vec<_>>();
                // The root: things seldom lie on their sides, and are to be known all the same.
                (part.component.probability.sqrt(), shapes)
            })
            .filter(|(_, shapes)| !shapes.is_empty())
            .collect()
        };
        let by_class: Vec<_> = (0..classes).map(of_class).collect();
        let mut counts: Vec<usize> = by_class
            .iter()
            .map(|ways| {
                let shapes = ways.iter().flat_map(|(_, shapes)| shapes.iter().map(|s| s.shape)).collect::<std::collections::BTreeSet<_>>();
                (PER_SHAPE * shapes.len()).min(MOST_VIEWS / (classes + 1))
            })
            .collect();
        counts.push(counts.iter().sum::<usize>() / classes.max(1));
        let jobs: Vec<(usize, usize)> =
            counts.iter().enumerate().flat_map(|(outcome, n)| (0..*n).map(move |view| (outcome, view))).collect();
        let see = |&(outcome, view): &(usize, usize)| -> Option<(usize, Vec<f32>)> {
            let mut rng = stream(views.seed ^ salt, 1 << 24 | outcome as u64, view as u64);
            let [lowest, highest] = [views.elevations[0], views.elevations[views.elevations.len() - 1]];
            let beyond = 0.12;
            (0..ATTEMPTS).find_map(|_| {
                let made;
                let shape = match by_class.get(outcome) {
                    Some(ways) => {
                        let (_, shapes) = draw_by(ways, |(weight, _)| *weight, &mut rng)?;
                        shapes[rng.random_range(0..shapes.len())]
                    }
                    None => {
                        made = distractor(parts, &|class, shape| is_allowed(class, shape), &mut rng)?;
                        &made
                    }
                };
                let elevation = rng.random_range(lowest - beyond..(highest + beyond).min(HIGHEST).max(lowest));
                let mut sample = shape.see_finely(rng.random_range(0.0..TAU), elevation, views.sensing, &mut rng)?;
                if rng.random_range(0.0..1.0) < WITHOUT_SIZE {
                    sample.voxel_m = None;
                }
                Some((outcome, measured(&sample)))
            })
        };
        let rows: Vec<(usize, Vec<f32>)> = jobs.par_iter().filter_map(see).collect();
        let (outcomes, inputs): (Vec<usize>, Vec<Vec<f32>>) = rows.into_iter().unzip();
        Self { inputs: inputs.concat(), outcomes }
    }

    /// These and others.
    pub fn with(mut self, other: &Self) -> Self {
        self.inputs.extend(&other.inputs);
        self.outcomes.extend(&other.outcomes);
        self
    }

    /// A forest of them.
    pub fn forest(&self, classes: usize, seed: u64) -> Forest {
        let samples = Samples { inputs: &self.inputs, width: MEASURES, outcomes: &self.outcomes, count: classes + 1 };
        grow(&samples, &Growth { seed, ..GROWTH })
    }

    /// How a forest's share of none becomes a probability on these views, which it must not have seen: logistic regression.
    pub fn none_calibration(&self, forest: &Forest) -> Result<NoneCalibration, LinearError> {
        let classes = forest.outcomes - 1;
        let mut shares = Vec::new();
        let logits = self.inputs.chunks_exact(MEASURES).map(|row| {
            forest.shares(row, &mut shares);
            vec![0.0, NoneCalibration::logit(shares[classes])]
        });
        let scores = vec![logits.collect::<Vec<_>>()];
        let labels: Vec<usize> = self.outcomes.iter().map(|outcome| usize::from(*outcome == classes)).collect();
        let fitted = fit_blend(&scores, &labels, 2, true)?;
        // Fitted as if either were as probable; none is as probable beforehand as each class.
        let prior = -(classes as f64).ln();
        Ok(NoneCalibration { constant: fitted.offsets[1] - fitted.offsets[0] + prior, weight: fitted.weights[0] })
    }
}

/// The measures of a view.
pub fn measured(sample: &ViewSample) -> Vec<f32> {
    let mut out = Vec::with_capacity(MEASURES);
    measure(&sample.frame, &sample.observation, sample.voxel_m, &mut MeasureScratch::default(), &mut out);
    out
}
