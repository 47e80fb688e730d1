//! Class, yaw, size and place of an upright object, as a camera sees it from any elevation.
//!
//! The densities of the view (`camera::scores`) give class and yaw and where the object is to be expected; the evidence compares a few
//! sizes, places and angles about that, coarse to fine (`camera::refinement`). Without such densities, or by another method, the evidence
//! scores all steps of yaw at the size that what is visible suggests.

use super::expectation::Expectation;
use super::mode_refiner::{Climbed, ModeRefiner, ModeRefinerScratch, PlacedClass};
use super::refinement::Parameters;
use super::{CameraScores, Cell, KnownPlacement, MeasureScratch, RefinedPlacement, SEEN, ViewFrame, ViewWork, measure};
use crate::grid::{Observation, Rotation, Similarity, yaw};
use crate::model::{Blend, CameraCalibration, CameraDensities, CameraSpread, OFFSETS, YAWS};
use crate::perception::cut;
use crate::perception::densities::blend::ClassScores;
use crate::perception::densities::log_sum::{log_sum_exp, most_probable, softmax};
use crate::perception::evidence::conditional::Conditional;
use crate::perception::evidence::lattice::Codes;
use crate::perception::evidence::placed::{EvidenceModel, EvidenceScratch, ObjectFrame};
use crate::perception::pool::Pool;
use crate::perception::scored::Sample;
use crate::perception::scored::{ClassMask, MODE_RADIUS, Scored};
use crate::perception::search::merging::Merging;
use crate::perception::settings::{CAMERA, FOLLOWED};
use crate::perception::timings::Clock;
use crate::perception::{ExpectedPlacement, Method, PerceiveError, PoseSearch, Query};
use crate::perception::{ObjectBox, ScaleSearch};
use nalgebra::Vector3;
use rayon::prelude::*;
use std::f64::consts::TAU;

/// Scratch memory of this stage.
#[derive(Default)]
pub struct CameraScratch {
    view: ViewWork,
    evidence: Pool<EvidenceScratch>,
    /// Log density of each cell, the prior's included.
    values: Vec<f64>,
    order: Vec<usize>,
    merging: Merging,
    likely: Vec<usize>,
    starts: Vec<Cell>,
    codes: Codes,
    refining: Option<ModeRefinerScratch>,
    climbed: Vec<Climbed>,
    modes: Vec<PlacedClass>,
    measuring: MeasureScratch,
    measures: Vec<f32>,
    /// Logarithms of the classes' shares by the forest; empty where none was asked.
    shares: Vec<f64>,
    weighed: Vec<f64>,
}

impl CameraScratch {
    /// Hands over the observation as the answered object of a class lies in it, and the class's posterior, if they were computed last. The frame is
    /// to be given back by [`Self::take_back`].
    pub fn lend(&mut self, class: usize, placed: &Similarity, frame: &mut ObjectFrame, conditional: &mut Conditional) -> bool {
        self.refining.as_mut().is_some_and(|scratch| scratch.lend(class, placed, frame, conditional))
    }

    /// Takes back a frame that was lent.
    pub fn take_back(&mut self, frame: &mut ObjectFrame) {
        if let Some(scratch) = &mut self.refining {
            scratch.take_back(frame);
        }
    }
}

/// Logarithm of a class's share by the forest; the same for all where none was asked.
fn log_share(shares: &[f64], class: usize) -> f64 {
    shares.get(class).copied().unwrap_or(0.0)
}

/// What is seen, in its frame, and what is known of the object.
struct SeenObject<'a> {
    seen: &'a Observation,
    frame: &'a ViewFrame,
    told: KnownPlacement,
}

impl SeenObject<'_> {
    fn known_voxels(&self) -> f64 {
        self.seen.known().count_ones(..).max(1) as f64
    }
}

/// How sure scores are: of the yaw, and in the posterior over classes.
struct Sureness<'a> {
    pose_weight: f64,
    /// Of the class.
    blend: &'a Blend,
    by_density: bool,
}

impl Sureness<'_> {
    fn of_class(&self, score: f64, log_share: f64) -> ClassScores {
        if self.by_density { ClassScores { forest: log_share, ..ClassScores::hull(score) } } else { ClassScores::evidence(score) }
    }
}

/// The search for class, yaw, size and place of what a camera sees.
pub struct CameraSearch<'a> {
    /// The classes.
    pub evidence: &'a EvidenceModel,
    /// Weight and offsets of the evidence alone.
    pub evidence_blend: &'a Blend,
    /// Longest side of the training shapes, in voxels of the canonical grid.
    pub longest_side: usize,
    /// Densities of what cameras see, and how sure they may be.
    pub cameras: Option<&'a (CameraScores, CameraCalibration)>,
    pub query: &'a Query,
    pub wanted: &'a ClassMask,
}

/// Whether a query is one about what a camera sees, to a model that has densities of that or not.
pub fn is_viewed(query: &Query, has_densities: bool) -> bool {
    let by_density = query.camera.is_some() && has_densities && matches!(query.method, Method::Auto | Method::Hull);
    query.pose != PoseSearch::Full && (by_density || query.scale != ScaleSearch::Known) && query.method != Method::Paper
}

impl CameraSearch<'_> {
    /// Class posterior, weighted rotations, and how the object of the most probable class lies. Sets `out.informed` to whether enough is seen.
    pub fn score(&self, seen: &Observation, scratch: &mut CameraScratch, clock: &mut Clock, out: &mut Scored) -> Result<(), PerceiveError> {
        // Seen from no stated place: as if from the front, well above.
        let camera = self.query.camera.unwrap_or(Vector3::new(-100.0, 0.0, 80.0));
        let Some(frame) = ViewFrame::new(seen, &camera, &mut scratch.view.along) else {
            out.informed = false;
            return Ok(());
        };
        let view = SeenObject { seen, frame: &frame, told: self.told(&frame) };
        out.none_probability = self.ask_forest(seen, &frame, scratch);
        let expectation = self.expectation(&view);
        if let Some(expectation) = &expectation
            && self.follow(&view, expectation, scratch, clock, out)?
        {
            return Ok(());
        }
        let sure = self.score_view(&view, None, scratch)?;
        clock.projected();
        self.add_samples(&view, &sure, scratch, out);
        for class in 0..self.wanted.len() {
            let of_class = out.samples.iter().filter(|sample| sample.class == class).map(|sample| sample.log_density);
            out.scores.push(log_sum_exp(of_class) / sure.pose_weight);
        }
        self.add_posterior(&sure, |class| out.scores[class], &scratch.shares, &mut out.posterior);
        let of_size = expectation.map(Expectation::of_size);
        self.refine_modes(&view, &sure, of_size, scratch, &out.posterior)?;
        self.weigh_evidence(scratch, out);
        self.settle(&view, 0, scratch, clock, out);
        Ok(())
    }

    /// Answers an object where it is expected, if what is seen agrees: the forest names its class no less than others, it is turned as it was
    /// rather than otherwise, one of its modes is climbed, and the evidence there is as good as it was. Gives whether it does; else nothing is
    /// answered.
    ///
    /// The densities of the view are computed of the expected component alone. Of the other classes nothing is known then but what was known
    /// before and what the forest says, so their densities count as that of the expected class: they say nothing for or against any.
    fn follow(
        &self,
        view: &SeenObject<'_>,
        expectation: &Expectation,
        scratch: &mut CameraScratch,
        clock: &mut Clock,
        out: &mut Scored,
    ) -> Result<bool, PerceiveError> {
        let ExpectedPlacement { class, component, frames_since_search, log_evidence_per_voxel, .. } = expectation.answered;
        let best_share = scratch.shares.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let is_named = log_share(&scratch.shares, class) >= best_share - FOLLOWED.share_falls_nats;
        if frames_since_search >= FOLLOWED.most_frames || !is_named || self.query.pose == PoseSearch::Known {
            return Ok(false);
        }
        let sure = self.score_view(view, Some(component), scratch)?;
        clock.projected();
        if !keep_beside(expectation.parameters[0], sure.pose_weight, &mut scratch.view.cells) {
            return Ok(false);
        }
        self.add_samples(view, &sure, scratch, out);
        let score = log_sum_exp(out.samples.iter().map(|sample| sample.log_density)) / sure.pose_weight;
        self.add_posterior(&sure, |_| score, &scratch.shares, &mut out.posterior);
        let is_answered = most_probable(&out.posterior) == class && score.is_finite();
        if is_answered {
            self.refine_modes(view, &sure, Some(*expectation), scratch, &out.posterior)?;
        }
        let agrees = is_answered
            && scratch.modes.first().is_some_and(|mode| {
                let falls = log_evidence_per_voxel * view.known_voxels() - mode.log_evidence;
                self.evidence_blend.evidence * falls <= FOLLOWED.fit_falls_nats
            });
        if !agrees {
            out.samples.clear();
            out.posterior.clear();
            return Ok(false);
        }
        out.scores.extend((0..self.wanted.len()).map(|other| if other == class { score } else { f64::NEG_INFINITY }));
        self.settle(view, frames_since_search + 1, scratch, clock, out);
        Ok(true)
    }

    /// What is expected of an object that was answered before, in the view's frame.
    fn expectation(&self, view: &SeenObject<'_>) -> Option<Expectation> {
        let answered = self.query.expected.as_ref().filter(|expected| self.wanted.get(expected.class) == Some(&true))?;
        let (scores, _) = self.cameras.filter(|_| self.is_by_density())?;
        let component = scores.components().get(answered.component)?;
        let is_possible = component.class == answered.class && (!view.told.upright || component.is_upright());
        is_possible.then(|| Expectation::new(answered, view.frame, &component.rotation())).flatten()
    }

    /// Weighted rotations of the cells, whose values are set.
    fn add_samples(&self, view: &SeenObject<'_>, sure: &Sureness<'_>, scratch: &mut CameraScratch, out: &mut Scored) {
        let query = self.query;
        let prior = query.rotation_prior.log_density(query.pose);
        let span = match query.pose {
            PoseSearch::Yaw { span } => span,
            _ => TAU,
        };
        let CameraScratch { view: ViewWork { cells, .. }, values, .. } = scratch;
        values.clear();
        for cell in cells.iter() {
            let angle = (view.frame.azimuth + cell.yaw()).rem_euclid(TAU);
            let rotation = if query.pose == PoseSearch::Known { Rotation::identity() } else { yaw(angle) * cell.resting };
            let allowed = query.pose == PoseSearch::Known || span > TAU - 1e-9 || angle < span;
            let log_density = cell.log_weight(sure.pose_weight) + prior(&rotation);
            values.push(log_density);
            if allowed {
                out.samples.push(Sample { rotation, class: cell.class, log_density, share: 1.0 / YAWS as f64 });
            }
        }
    }

    /// P(s) of each class by its score, the forest and the prior.
    fn add_posterior(&self, sure: &Sureness<'_>, score: impl Fn(usize) -> f64, shares: &[f64], posterior: &mut Vec<f64>) {
        posterior.extend((0..self.wanted.len()).map(|class| {
            let scores = sure.of_class(score(class), log_share(shares, class));
            sure.blend.log_posterior(class, scores, self.query.log_prior(class))
        }));
        softmax(posterior);
    }

    /// The answer: how the object of the most probable class lies, and how it is to be expected in the next frame.
    fn settle(&self, view: &SeenObject<'_>, frames_since_search: u32, scratch: &CameraScratch, clock: &mut Clock, out: &mut Scored) {
        if self.query.is_cut {
            cut::temper(&mut out.posterior, |class| self.query.log_prior(class));
        }
        clock.classified();
        let class = most_probable(&out.posterior);
        let Some(answered) = scratch.modes.iter().find(|mode| mode.cell.class == class) else { return };
        let (placed, object_box) = self.placement(view.frame, answered);
        out.placement = Some((placed, object_box));
        out.resting_pose = (!view.told.upright).then_some(answered.cell.component);
        let searched = self.query.pose != PoseSearch::Known && self.query.scale != ScaleSearch::Known && self.is_by_density();
        out.expected = searched.then(|| {
            let deviations = &answered.refined.deviations;
            let place = (deviations[2..].iter().map(|deviation| deviation.powi(2)).sum::<f64>() / 3.0).sqrt();
            ExpectedPlacement {
                class,
                component: answered.cell.component,
                placed,
                log_scale_deviation: deviations[1],
                place_deviation_voxels: place * view.frame.unit,
                seen_side_voxels: SEEN * view.frame.unit,
                log_evidence_per_voxel: answered.log_evidence / view.known_voxels(),
                frames_since_search,
            }
        });
    }

    /// Whether classes are scored by densities of what cameras see.
    fn is_by_density(&self) -> bool {
        self.cameras.is_some() && self.query.camera.is_some() && matches!(self.query.method, Method::Auto | Method::Hull)
    }

    /// Whether the forest has a say: it names what cameras see, by the default method.
    fn asks_forest(&self) -> bool {
        let has_forest = self.cameras.is_some_and(|(scores, _)| scores.forest().is_some());
        has_forest && self.query.method == Method::Auto && self.query.camera.is_some()
    }

    /// Asks the forest: the classes' shares into `scratch.shares`, and the probability that the thing is of none of them.
    fn ask_forest(&self, seen: &Observation, frame: &ViewFrame, scratch: &mut CameraScratch) -> Option<f64> {
        let CameraScratch { measuring, measures, shares, .. } = scratch;
        shares.clear();
        let (scores, calibration) = self.cameras.filter(|_| self.asks_forest())?;
        measure(frame, seen, self.query.voxel_size_m, measuring, measures);
        let none = scores.ask_forest(measures, shares)?;
        Some(calibration.none?.probability(none))
    }

    /// Yaw, size and place as far as the query says them, in the view's frame.
    fn told(&self, frame: &ViewFrame) -> KnownPlacement {
        let (_, scale, place) = frame.seen(&Similarity::default());
        let yaw = (self.query.pose == PoseSearch::Known).then_some(-frame.azimuth);
        let upright = !self.query.lying || yaw.is_some();
        match self.query.scale {
            ScaleSearch::Known => KnownPlacement { upright, yaw, scale: Some(scale), place: Some(place) },
            ScaleSearch::Search { side } => {
                let longest = self.longest_side as f64;
                KnownPlacement { upright, yaw, scale: side.map(|side| side / (longest * frame.unit)), place: None }
            }
        }
    }

    /// Scores classes and steps of yaw into `scratch.view.cells`; by densities, of `only` one component if it is given.
    fn score_view(&self, view: &SeenObject<'_>, only: Option<usize>, scratch: &mut CameraScratch) -> Result<Sureness<'_>, PerceiveError> {
        let SeenObject { seen, frame, told } = view;
        if let Some((scores, calibration)) = self.cameras.filter(|_| self.is_by_density()) {
            scores.score(frame, seen, told, self.wanted, only, &mut scratch.view);
            if let (Some(weight), Some(voxel_m)) = (calibration.size_weight, self.query.voxel_size_m) {
                for cell in &mut scratch.view.cells {
                    let size = scores.components()[cell.component].size;
                    cell.log_prior += size.map_or(0.0, |size| weight * cell.log_size(&size, voxel_m * frame.unit));
                }
            }
            let blend = calibration.with_forest.as_ref().filter(|_| self.asks_forest()).unwrap_or(&calibration.blend);
            return Ok(Sureness { pose_weight: calibration.pose_weight, blend, by_density: true });
        }
        let blend = self.evidence_blend;
        let (evidence, pool) = (self.evidence, &scratch.evidence);
        let (angles, count) = steps(told);
        let expected = self.expected_offsets(told);
        let classes = || (0..self.wanted.len()).filter(|class| self.wanted[*class]);
        let cells = &mut scratch.view.cells;
        cells.clear();
        for angle in &angles[..count] {
            let step = (angle.rem_euclid(TAU) / TAU * YAWS as f64).round() as usize % YAWS;
            let mut offsets = expected;
            offsets[0] = angle - CameraDensities::yaw(step);
            let resting = Rotation::identity();
            let cell =
                |class| Cell { class, component: class, resting, log_prior: 0.0, step, score: 0.0, offsets, deviations: CAMERA.unsure };
            cells.extend(classes().map(cell));
        }
        cells.par_chunks_mut(classes().count().max(1)).zip(&angles[..count]).try_for_each(|(cells, angle)| {
            pool.with(
                || EvidenceScratch::new(evidence.dims()),
                |scratch| {
                    let placed = frame.placed(*angle, cells[0].scale(), &cells[0].place());
                    evidence.place(seen, &placed, self.query.outside, scratch)?;
                    for cell in cells {
                        cell.score = evidence.of_class(cell.class, scratch)?.log_ratio;
                    }
                    Ok::<_, PerceiveError>(())
                },
            )
        })?;
        Ok(Sureness { pose_weight: blend.evidence.max(1e-9), blend, by_density: false })
    }

    /// Weighs the evidence of the likely classes, each as it lies best, into the posterior. Together they stay as likely as the view's
    /// densities made them, and so does each of the others.
    fn weigh_evidence(&self, scratch: &mut CameraScratch, out: &mut Scored) {
        let CameraScratch { modes, weighed, shares, .. } = scratch;
        let Some(together) = self.cameras.and_then(|(_, calibration)| calibration.together.as_ref()) else { return };
        if self.query.method != Method::Auto || self.query.camera.is_none() || modes.is_empty() {
            return;
        }
        let likely: f64 = modes.iter().map(|mode| out.posterior[mode.cell.class]).sum();
        weighed.clear();
        weighed.extend(modes.iter().map(|mode| {
            let class = mode.cell.class;
            let forest = log_share(shares, class);
            let scores = ClassScores { hull: out.scores[class], evidence: mode.log_evidence, forest, ..ClassScores::default() };
            together.log_posterior(class, scores, self.query.log_prior(class))
        }));
        softmax(weighed);
        for (mode, p) in modes.iter().zip(weighed) {
            out.posterior[mode.cell.class] = likely * *p;
        }
    }

    /// Offsets that are expected where no density says them.
    fn expected_offsets(&self, told: &KnownPlacement) -> [f64; OFFSETS] {
        let longest = self.longest_side as f64;
        let scale = told.scale.unwrap_or(SEEN / (CAMERA.visible_share * longest));
        // The hidden part is behind what is seen.
        let place = told.place.unwrap_or(Vector3::new(1.0, 0.0, 0.0));
        let side = SEEN / CAMERA.visible_share;
        [0.0, scale.ln(), place.x, place.y, place.z, side, side, side]
    }

    /// Refines the likely modes of the likely classes; leaves the best of each class in `scratch.modes`, the most probable class
    /// first.
    fn refine_modes(
        &self,
        view: &SeenObject<'_>,
        sure: &Sureness<'_>,
        expectation: Option<Expectation>,
        scratch: &mut CameraScratch,
        posterior: &[f64],
    ) -> Result<(), PerceiveError> {
        let SeenObject { seen, frame, told } = view;
        let prior = self.query.rotation_prior.log_density(self.query.pose);
        let log_prior = |angle: f64, resting: &Rotation| match self.query.pose {
            PoseSearch::Known => 0.0,
            _ => prior(&(yaw(frame.azimuth + angle) * resting)),
        };
        let CameraScratch { view: work, values, refining, codes, order, merging, likely, starts, climbed, modes, .. } = scratch;
        // Where all is told there is nothing to refine, and a class costs no more than its evidence.
        let (least, most) = match told {
            KnownPlacement { yaw: Some(_), scale: Some(_), place: Some(_), .. } => (CAMERA.least_likely_of_known, posterior.len()),
            _ => (CAMERA.least_likely, CAMERA.most_likely),
        };
        likely.clear();
        likely.extend((0..posterior.len()).filter(|class| posterior[*class] >= least));
        likely.sort_unstable_by(|a, b| posterior[*b].total_cmp(&posterior[*a]).then(a.cmp(b)));
        likely.truncate(most);
        starts.clear();
        for (place, class) in likely.iter().enumerate() {
            // The most probable class is looked at more closely.
            let most = if place == 0 { CAMERA.most_modes } else { 1 };
            best_cells(*class, &work.cells, values, most, order, merging, starts);
        }
        let weight = self.evidence_blend.evidence.max(1e-9);
        let evidence = self.evidence;
        codes.set(seen, self.query.outside);
        let refiner = ModeRefiner { evidence, weight, outside: self.query.outside, frame, told, expectation, seen, codes };
        let prior_of = |cell: &Cell, at: &Parameters| cell.log_weight(sure.pose_weight) + log_prior(at[0], &cell.resting);
        modes.clear();
        let scratch = refining.get_or_insert_with(|| ModeRefinerScratch::new(evidence.dims()));
        scratch.start();
        climbed.clear();
        for cell in &*starts {
            climbed.push(refiner.climb(cell, scratch)?);
        }
        // The most probable class last: what is computed of it there serves its completion.
        for class in likely.iter().rev() {
            let value = |of: &Climbed| of.value + prior_of(&of.cell, &of.parameters);
            let of_class = climbed.iter().filter(|climbed| climbed.cell.class == *class);
            let best = of_class.reduce(|best, next| if value(next) > value(best) { next } else { best });
            if let Some(best) = best {
                modes.push(refiner.settle(best, scratch)?);
            }
        }
        modes.reverse();
        Ok(())
    }

    /// How an object lies: its similarity to the canonical one, and its box.
    fn placement(&self, frame: &ViewFrame, mode: &PlacedClass) -> (Similarity, ObjectBox) {
        let PlacedClass { cell, refined: best, .. } = mode;
        let [angle, log_scale, x, y, z] = best.parameters;
        let found = cell.placed(frame, angle, log_scale.exp(), &Vector3::new(x, y, z));
        let rotation = if self.query.pose == PoseSearch::Known { Rotation::identity() } else { found.rotation };
        let placed = match self.query.scale {
            ScaleSearch::Known => Similarity::turned(rotation),
            ScaleSearch::Search { .. } => Similarity { rotation, ..found },
        };
        let spread = self.cameras.and_then(|(_, calibration)| calibration.spread).unwrap_or_default();
        let grew = (log_scale - cell.offsets[1]).exp() * frame.unit;
        let searched = self.query.scale != ScaleSearch::Known;
        let object_box = ObjectBox {
            extent_voxels: std::array::from_fn(|axis| (cell.offsets[5 + axis] * grew).max(0.0)),
            extent_deviation_voxels: std::array::from_fn(|axis| spread.extent[axis] * cell.deviations[5 + axis] * frame.unit),
            position_deviation_voxels: if searched { position_deviation(frame, best, &spread) } else { [0.0; 3] },
        };
        (placed, if self.query.is_cut { cut::widen(object_box) } else { object_box })
    }
}

/// Standard deviations of the place along the frame's axes, along the grid's: lengths in voxels.
fn position_deviation(frame: &ViewFrame, refined: &RefinedPlacement, spread: &CameraSpread) -> [f64; 3] {
    let (sin, cos) = frame.azimuth.sin_cos();
    let [dx, dy, dz] = std::array::from_fn(|axis| spread.place[axis] * refined.deviations[2 + axis] * frame.unit);
    let mixed = |a: f64, b: f64| ((a * dx).powi(2) + (b * dy).powi(2)).sqrt();
    [mixed(cos, sin), mixed(sin, cos), dz]
}

/// The likely modes of a class among its cells, which have these log densities, apart from each other, the best first; they are added to `starts`.
fn best_cells(
    class: usize,
    cells: &[Cell],
    values: &[f64],
    most: usize,
    order: &mut Vec<usize>,
    merging: &mut Merging,
    starts: &mut Vec<Cell>,
) {
    order.clear();
    order.extend((0..cells.len()).filter(|i| cells[*i].class == class && cells[*i].score.is_finite()));
    let value = |i: usize| values[i];
    let place = |i: usize| (cells[i].component, cells[i].step);
    order.sort_unstable_by(|a, b| value(*b).total_cmp(&value(*a)).then(place(*a).cmp(&place(*b))));
    merging.start(order.len());
    let turned = |i: usize| yaw(cells[order[i]].yaw()) * cells[order[i]].resting;
    let near = |a: usize, b: usize| turned(a).angle_to(&turned(b)) <= 2.0 * MODE_RADIUS;
    for _ in 0..most {
        let Some(place) = merging.next(near, |_| ()) else { break };
        if value(order[0]) - value(order[place]) > CAMERA.hopeless_nats {
            break;
        }
        starts.push(cells[order[place]]);
    }
}

/// Keeps the cells beside a yaw; gives whether what is seen has the object turned that way rather than otherwise.
fn keep_beside(yaw: f64, pose_weight: f64, cells: &mut Vec<Cell>) -> bool {
    let best = |is_beside: bool| {
        let those = cells.iter().filter(|cell| cell.is_beside(yaw) == is_beside);
        those.map(|cell| cell.log_weight(pose_weight)).fold(f64::NEG_INFINITY, f64::max)
    };
    let agrees = best(true) >= best(false) - FOLLOWED.turn_falls_nats;
    cells.retain(|cell| cell.is_beside(yaw));
    agrees
}

/// Angles at which the evidence is computed, and how many of them count.
fn steps(told: &KnownPlacement) -> ([f64; YAWS], usize) {
    match told.yaw {
        Some(yaw) => ([yaw; YAWS], 1),
        None => (std::array::from_fn(CameraDensities::yaw), YAWS),
    }
}

#[cfg(test)]
pub(super) mod tests_support {
    use crate::grid::Observation;
    use crate::perception::pose::small::unseen;
    use crate::simulation::{self, Eye};
    use nalgebra::Vector3;

    /// A chair between two learned elevations, and where the camera was.
    pub fn seen_chair() -> (Observation, Vector3<f64>) {
        let eye = Eye { azimuth: 0.4, elevation: 35_f64.to_radians(), distance: 50.0 };
        (simulation::observe(&unseen("chair", 2), &eye), eye.position())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::{Outside, Turn, yaw_of};
    use crate::perception::Percept;
    use crate::perception::pose::small::{seeing_perceiver, unseen};
    use crate::simulation::{self, Eye};
    use std::f64::consts::FRAC_PI_2;

    fn eye(azimuth: f64) -> Eye {
        Eye { azimuth, elevation: 35_f64.to_radians(), distance: 50.0 }
    }

    fn ask(observation: &Observation, query: &Query) -> Percept {
        let perceiver = seeing_perceiver();
        let (mut work, mut percept) = (perceiver.workspace(), Percept::default());
        perceiver.classify(observation, query, &mut work, &mut percept).unwrap().complete().unwrap();
        percept
    }

    fn query(azimuth: f64, pose: PoseSearch, scale: ScaleSearch) -> Query {
        let camera = Some(eye(azimuth).position());
        Query { camera, pose, scale, outside: Outside::Unknown, completion: true, ..Query::default() }
    }

    const SEARCH: ScaleSearch = ScaleSearch::Search { side: None };

    /// A quarter turn is a permutation of the voxels: an object that is turned with its camera is the same but for the turn.
    #[test]
    fn what_turns_with_its_camera_is_answered_as_before_but_turned() {
        let object = unseen("chair", 2);
        let seen = simulation::observe(&object, &eye(0.4));
        let turned = Turn::new(object.dims(), &yaw(FRAC_PI_2)).observation(&seen, Outside::Unknown);
        for scale in [ScaleSearch::Known, SEARCH] {
            let before = ask(&seen, &query(0.4, PoseSearch::YAW, scale));
            let after = ask(&turned, &query(0.4 + FRAC_PI_2, PoseSearch::YAW, scale));
            assert_eq!(before.class, after.class);
            let apart = (yaw(FRAC_PI_2) * before.rotation_object_to_grid).angle_to(&after.rotation_object_to_grid);
            assert!(apart < 2_f64.to_radians(), "{}", apart.to_degrees());
            assert!((yaw(FRAC_PI_2) * before.placed.translation_voxels - after.placed.translation_voxels).norm() < 0.5);
            for (a, b) in before.posterior.iter().zip(&after.posterior) {
                assert!((a - b).abs() < 1e-3, "{a} {b}");
            }
        }
    }

    #[test]
    fn class_yaw_size_and_place_are_found_and_what_is_known_is_kept() {
        let (mut right, mut near, mut sized) = (0, 0, 0);
        for (class, name) in seeing_perceiver().model().class_names().enumerate() {
            for seed in 0..4 {
                let azimuth = 1.3 * seed as f64;
                let seen = simulation::observe(&unseen(name, seed), &eye(azimuth));
                let found = ask(&seen, &query(azimuth, PoseSearch::YAW, SEARCH));
                right += usize::from(found.class == class);
                near += usize::from(found.rotation_object_to_grid.angle().to_degrees() < 15.0);
                sized += usize::from(found.placed.scale.ln().abs() < 0.1 && found.placed.translation_voxels.norm() < 1.5);
                assert!(found.occupancy.iter().chain(&found.deviation).all(|v| (0.0..=1.0).contains(v)));
                let found_box = found.object_box.expect("a box");
                assert!(
                    found_box
                        .extent_voxels
                        .iter()
                        .chain(&found_box.extent_deviation_voxels)
                        .chain(&found_box.position_deviation_voxels)
                        .all(|v| v.is_finite() && *v >= 0.0)
                );

                let known = ask(&seen, &query(azimuth, PoseSearch::Known, ScaleSearch::Known));
                assert_eq!(known.placed, Similarity::default());
                let told = ask(&seen, &query(azimuth, PoseSearch::YAW, ScaleSearch::Search { side: Some(13.0) }));
                let longest = seeing_perceiver().model().metadata.settings.longest_side as f64;
                assert!((told.placed.scale - 13.0 / longest).abs() < 1e-9);
            }
        }
        assert!(right >= 10 && near >= 7 && sized >= 7, "of 12: {right} named, {near} turned, {sized} placed rightly");
    }

    #[test]
    fn of_what_is_cut_off_class_size_and_place_are_less_sure_and_the_same() {
        let seen = simulation::observe(&unseen("chair", 2), &eye(0.4));
        let whole = ask(&seen, &query(0.4, PoseSearch::YAW, SEARCH));
        let part = ask(&seen, &Query { is_cut: true, ..query(0.4, PoseSearch::YAW, SEARCH) });
        assert_eq!((part.class, part.placed), (whole.class, whole.placed));
        let odds = |percept: &Percept| percept.posterior.iter().map(|p| (p / percept.posterior[whole.class]).ln()).collect::<Vec<_>>();
        assert!(odds(&part).iter().zip(odds(&whole)).all(|(part, whole)| (part - 0.5 * whole).abs() < 1e-9));
        let [part, whole] = [part, whole].map(|percept| percept.object_box.unwrap());
        let deviations = |of: &ObjectBox| [of.extent_deviation_voxels, of.position_deviation_voxels].concat();
        assert!(deviations(&part).iter().zip(deviations(&whole)).all(|(part, whole)| *part > whole + 1e-3));
    }

    #[test]
    fn only_poses_within_a_stated_span_are_hypotheses() {
        for seed in 0..4 {
            let seen = simulation::observe(&unseen("chair", seed), &eye(0.4));
            let part = ask(&seen, &query(0.4, PoseSearch::Yaw { span: FRAC_PI_2 }, SEARCH));
            assert!(!part.hypotheses.is_empty());
            for hypothesis in &part.hypotheses {
                let angle = yaw_of(&hypothesis.rotation).rem_euclid(TAU);
                assert!(angle < FRAC_PI_2, "{seed}: {}", angle.to_degrees());
            }
            let all = ask(&seen, &query(0.4, PoseSearch::YAW, SEARCH));
            assert!(all.hypotheses.iter().any(|hypothesis| yaw_of(&hypothesis.rotation).rem_euclid(TAU) > FRAC_PI_2));
        }
    }

    /// As a daemon asks about the next frame of an object that was answered so.
    fn next(query: &Query, answered: &Percept) -> Query {
        let rotation_prior = crate::perception::RotationPrior::continuing(answered);
        let mut next = Query { rotation_prior, expected: answered.expected, ..query.clone() };
        crate::perception::ClassBelief::first(&answered.posterior).log_prior(&mut next.log_prior);
        next
    }

    #[test]
    fn an_object_is_followed_where_it_is_expected_and_searched_everywhere_after_some_frames() {
        let mut followed = 0;
        for (seed, name) in ["chair", "sofa", "table"].into_iter().cycle().take(12).enumerate() {
            let (seed, azimuth) = (seed as u64, 0.7 * seed as f64);
            let alone = query(azimuth, PoseSearch::YAW, SEARCH);
            let first = ask(&simulation::observe(&unseen(name, seed), &eye(azimuth)), &alone);
            assert_eq!(first.expected.unwrap().frames_since_search, 0);
            // The object turns by three degrees a frame.
            let mut before = first.clone();
            for frame in 1..=FOLLOWED.most_frames + 1 {
                let turned = Turn::new(unseen(name, seed).dims(), &yaw(0.05 * f64::from(frame))).occupancy(&unseen(name, seed));
                let now = ask(&simulation::observe(&turned, &eye(azimuth)), &next(&alone, &before));
                let expected = now.expected.unwrap();
                assert!(expected.frames_since_search <= FOLLOWED.most_frames);
                assert_eq!(now.class, first.class, "{name} {seed}, frame {frame}");
                assert!((now.posterior.iter().sum::<f64>() - 1.0).abs() < 1e-9);
                if expected.frames_since_search > 0 {
                    followed += 1;
                    let apart = now.rotation_object_to_grid.angle_to(&before.rotation_object_to_grid).to_degrees();
                    // On the branch of a symmetric shape on which it was.
                    assert!(apart < 45.0, "{name} {seed}, frame {frame}: {apart} degrees");
                }
                before = now;
            }
        }
        assert!(followed > 80, "{followed} of 120 frames");
    }

    /// Behind a hand, for a second, it was turned by a third of a turn.
    #[test]
    fn an_object_that_was_turned_out_of_sight_is_found_as_it_is_turned_now() {
        let (mut alone_right, mut turned_right) = (0, 0);
        for (seed, name) in ["chair", "sofa", "table"].into_iter().cycle().take(24).enumerate() {
            let (seed, azimuth) = (seed as u64, 0.7 * seed as f64);
            let alone = query(azimuth, PoseSearch::YAW, SEARCH);
            let object = unseen(name, seed);
            let before = ask(&simulation::observe(&object, &eye(azimuth)), &alone);
            let turned = simulation::observe(&Turn::new(object.dims(), &yaw(TAU / 3.0)).occupancy(&object), &eye(azimuth));
            let mut continued = next(&alone, &before);
            continued.rotation_prior = continued.rotation_prior.after(1.0);
            let is_right = |percept: &Percept| percept.rotation_object_to_grid.angle_to(&yaw(TAU / 3.0)).to_degrees() < 20.0;
            alone_right += usize::from(is_right(&ask(&turned, &alone)));
            turned_right += usize::from(is_right(&ask(&turned, &continued)));
        }
        assert!(alone_right >= 14 && turned_right + 2 >= alone_right, "of 24 {turned_right} right, {alone_right} alone");
    }

    #[test]
    fn an_object_that_is_exchanged_is_searched_everywhere() {
        let alone = query(0.4, PoseSearch::YAW, SEARCH);
        let seen = |name: &str, seed: u64| simulation::observe(&unseen(name, seed), &eye(0.4));
        let (mut noticed, mut right) = (0, 0);
        for (class, name) in seeing_perceiver().model().class_names().enumerate() {
            for (other, next_name) in seeing_perceiver().model().class_names().enumerate().filter(|(other, _)| *other != class) {
                for seed in 0..4 {
                    let before = ask(&seen(name, seed), &alone);
                    let now = ask(&seen(next_name, seed), &Query { log_prior: Vec::new(), ..next(&alone, &before) });
                    noticed += usize::from(now.expected.is_none_or(|expected| expected.frames_since_search == 0));
                    right += usize::from(now.class == other);
                }
            }
        }
        assert!(noticed >= 20 && right >= 18, "of 24 {noticed} noticed, {right} named");
    }

    /// What was conditioned in the search is what completion would compute anew.
    #[test]
    fn the_completion_of_a_followed_object_is_that_of_its_class_conditioned_anew() {
        let perceiver = seeing_perceiver();
        let seen = simulation::observe(&unseen("sofa", 3), &eye(0.4));
        let asked = query(0.4, PoseSearch::YAW, SEARCH);
        let answer = ask(&seen, &asked);
        let mut frame = ObjectFrame::new(seen.dims());
        let (evidence, mut conditional) = (perceiver.evidence(), Conditional::new(0));
        frame.take_moved(&evidence.rows, &seen, &answer.placed, Outside::Unknown).unwrap();
        evidence.subspaces[answer.class].condition(frame.known(), evidence.noise_variance, &mut conditional).unwrap();
        assert_eq!(answer.log_evidence[answer.class], conditional.log_evidence);
    }

    #[test]
    fn where_nothing_is_seen_all_is_as_likely_as_before() {
        let nothing = Observation::unknown(seeing_perceiver().model().dims());
        let found = ask(&nothing, &query(0.0, PoseSearch::YAW, SEARCH));
        assert!(!found.informed && found.posterior.iter().all(|p| (p - 1.0 / 3.0).abs() < 1e-9));
        assert!(found.hypotheses.iter().all(|h| h.probability < 0.09));
        assert_eq!((found.object_box, found.placed.scale), (None, 1.0));
    }

    /// Without densities of cameras, or without knowing where the camera was, the evidence alone finds size and place.
    #[test]
    fn the_evidence_alone_finds_size_and_place() {
        let seen = simulation::observe(&unseen("sofa", 1), &eye(0.3));
        let without = Query { method: Method::Evidence, ..query(0.3, PoseSearch::YAW, SEARCH) };
        let found = ask(&seen, &without);
        assert!(found.placed.scale.ln().abs() < 0.25 && found.placed.translation_voxels.norm() < 3.0, "{:?}", found.placed);
    }

    #[test]
    fn a_known_yaw_is_the_only_step() {
        let (angles, count) = steps(&KnownPlacement { yaw: Some(0.7), ..KnownPlacement::default() });
        assert_eq!((angles[0], count), (0.7, 1));
        let (angles, count) = steps(&KnownPlacement::default());
        assert_eq!(count, YAWS);
        assert!((yaw_of(&yaw(angles[7])) - CameraDensities::yaw(7)).abs() < 1e-12);
    }
}
