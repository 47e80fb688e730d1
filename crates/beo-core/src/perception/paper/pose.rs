//! Pose as in the paper: every candidate rotation is undone, the observation projected onto W', and the outcome scored.
//!
//! The query in pose r is the observation turned back by r. What it is compared with, ô, is its back-projection W' o' onto
//! the same voxels: eq. 11 as printed is minimised by the identity.

use super::PaperModel;
use super::projection;
use crate::grid::{Observation, Rotation, Similarity, distance_transform, yaw};
use crate::lanes::dot;
use crate::perception::PerceiveError;
use crate::perception::basis::reading::BasisRows;
use crate::perception::densities::gaussian::Gaussian;
use crate::perception::densities::log_sum::{log_sum_exp, softmax};
use crate::perception::evidence::placed::ObjectFrame;
use crate::perception::pool::Pool;
use crate::perception::query::{PaperPose, PoseSearch, Query};
use crate::perception::scored::{ClassMask, Sample, Scored};
use crate::perception::search::grid::{count_for, rotations};
use crate::perception::settings::PAPER;
use crate::perception::timings::Clock;
use fixedbitset::FixedBitSet;
use rayon::prelude::*;
use std::f64::consts::TAU;

/// A candidate and its scores.
struct ScoredRotation {
    rotation: Rotation,
    /// The estimator's score, larger is better.
    score: f64,
    /// log P(r) D(o'|s) per class (eq. 10).
    densities: Vec<f64>,
}

/// The paper's search over poses.
pub struct PaperSearch<'a> {
    pub model: &'a PaperModel,
    pub rows: &'a BasisRows,
    pub query: &'a Query,
    pub wanted: &'a ClassMask,
    pub pool: &'a Pool<ObjectFrame>,
}

impl PaperSearch<'_> {
    /// Class posterior and weighted rotations by the paper's estimators.
    pub fn score(&self, seen: &Observation, clock: &mut Clock, out: &mut Scored) -> Result<(), PerceiveError> {
        let query = self.query;
        let m = self.wanted.len();
        let wanted = self.wanted.iter().filter(|wanted| **wanted).count();
        let estimator = match query.paper_pose {
            PaperPose::Edt if wanted == 1 => PaperPose::Density,
            other => other,
        };
        let prior = query.rotation_prior.log_density(query.pose);
        let look = |candidates: &[Rotation], estimator: PaperPose| -> Result<Vec<ScoredRotation>, PerceiveError> {
            candidates.par_iter().map(|r| self.look(*r, estimator, prior(r), seen)).collect()
        };
        let best = |looked: &[ScoredRotation]| {
            let better = |best: usize, i: usize| if looked[i].score > looked[best].score { i } else { best };
            (0..looked.len()).fold(0, better)
        };
        let looked = match query.pose {
            PoseSearch::Yaw { span } => {
                let count = (span / PAPER.coarse_rad - 1e-9).ceil().max(1.0) as usize;
                let coarse: Vec<Rotation> = (0..count).map(|i| yaw(i as f64 * span / count as f64)).collect();
                let found = look(&coarse, estimator)?;
                let centre = best(&found) as f64 * span / count as f64;
                let reach = (PAPER.coarse_rad / PAPER.fine_rad).round() as i32;
                let inside = |angle: &f64| span > TAU - 1e-9 || (0.0..span).contains(angle);
                let fine: Vec<Rotation> =
                    (-reach..=reach).map(|i| centre + f64::from(i) * PAPER.fine_rad).filter(inside).map(yaw).collect();
                // Eq. 21 in the neighbourhood of the coarse estimate.
                look(&fine, if estimator == PaperPose::Edt { PaperPose::Density } else { estimator })?
            }
            _ => {
                let candidates: Vec<Rotation> = rotations(count_for(PAPER.step_rad)).collect();
                let mut found = look(&candidates, estimator)?;
                if estimator == PaperPose::Edt {
                    found.sort_by(|a, b| b.score.total_cmp(&a.score));
                    let finalists: Vec<Rotation> = found.iter().take(PAPER.finalists).map(|l| l.rotation).collect();
                    found = look(&finalists, PaperPose::Density)?;
                }
                found
            }
        };
        clock.projected();
        // By density, class and pose are marginalised over each other; the other estimators choose the pose first.
        let by_density = matches!(estimator, PaperPose::Density | PaperPose::Edt);
        let looked = if by_density { &looked[..] } else { std::slice::from_ref(&looked[best(&looked)]) };
        for l in looked {
            let of_class = |(class, density): (usize, &f64)| Sample {
                rotation: l.rotation,
                class,
                log_density: *density,
                share: 1.0 / looked.len() as f64,
            };
            out.samples.extend(l.densities.iter().enumerate().filter(|(_, d)| d.is_finite()).map(of_class));
        }
        for s in 0..m {
            let densities = looked.iter().map(|l| l.densities[s]);
            out.scores.push(densities.clone().fold(f64::NEG_INFINITY, f64::max));
            out.posterior.push(log_sum_exp(densities) + query.log_prior(s));
        }
        softmax(&mut out.posterior);
        Ok(())
    }

    fn look(&self, rotation: Rotation, estimator: PaperPose, prior: f64, seen: &Observation) -> Result<ScoredRotation, PerceiveError> {
        let rows = self.rows;
        self.pool.with(
            || ObjectFrame::new(rows.dims()),
            |frame| {
                frame.take_moved(rows, seen, &Similarity::turned(rotation), self.query.outside)?;
                self.look_moved(rotation, estimator, prior, self.model, frame)
            },
        )
    }

    fn look_moved(
        &self,
        rotation: Rotation,
        estimator: PaperPose,
        prior: f64,
        paper: &PaperModel,
        frame: &ObjectFrame,
    ) -> Result<ScoredRotation, PerceiveError> {
        let (query, known) = (self.query, frame.known());
        let (gram, b) = paper.normal_equations(known);
        let projected = projection::solve(&gram, &b, query.projection)?;
        let single: Vec<f32> = projected.iter().map(|v| *v as f32).collect();
        let mut centred = vec![0.0; single.len()];
        let density = |(s, d): (usize, &Gaussian)| match query.log_prior(s) {
            f64::NEG_INFINITY => f64::NEG_INFINITY,
            _ => prior + d.log_gaussian(&single, &mut centred),
        };
        let densities: Vec<f64> = paper.densities()?.iter().enumerate().map(density).collect();
        let score = match estimator {
            PaperPose::Density => (densities.iter().enumerate()).map(|(s, d)| d + query.log_prior(s)).fold(f64::NEG_INFINITY, f64::max),
            PaperPose::Distance | PaperPose::Reprojection => {
                // ‖w − V W' o'‖² = ‖w‖² − 2 bᵀo' + o'ᵀA o'
                let n = projected.len();
                let through = |i: usize| (0..n).map(|j| gram[(i.max(j), i.min(j))] * projected[j]).sum::<f64>();
                let filled = known.filled.len() as f64;
                let distance2 = filled + (0..n).map(|i| projected[i] * (through(i) - 2.0 * b[i])).sum::<f64>();
                let distance = distance2.max(0.0).sqrt();
                if estimator == PaperPose::Distance { -distance } else { 1.0 - distance / filled.max(1.0).sqrt() }
            }
            PaperPose::Edt => -self.distance_error(frame.observation(), &single),
        };
        Ok(ScoredRotation { rotation, score, densities })
    }

    /// Eq. 20 on the known voxels: ‖D − D̂‖, D of the filled voxels, D̂ of the back-projection's voxels of at least ½.
    fn distance_error(&self, turned: &Observation, projected: &[f32]) -> f64 {
        let (dims, basis) = (self.rows.dims(), self.model.basis());
        let mut row = vec![0.0; basis.rank()];
        let mut predicted = FixedBitSet::with_capacity(dims.voxels());
        for voxel in 0..dims.voxels() {
            basis.widen(voxel..voxel + 1, &mut row);
            predicted.set(voxel, dot(&row, projected) >= 0.5);
        }
        let (mut seen, mut expected) = (Vec::new(), Vec::new());
        predicted.intersect_with(turned.known());
        distance_transform(dims, turned.filled(), &mut seen);
        distance_transform(dims, &predicted, &mut expected);
        // A transform without a filled voxel is infinite: no further than across the grid.
        let most = <[usize; 3]>::from(dims).map(|side| (side * side) as f32).iter().sum::<f32>().sqrt();
        let difference = |voxel: usize| f64::from(seen[voxel].min(most) - expected[voxel].min(most));
        turned.known().ones().map(|voxel| difference(voxel).powi(2)).sum::<f64>().sqrt()
    }
}
