//! Class, yaw, size and place of an upright object, as a camera sees it from any elevation.
//!
//! The densities of the view (`camera::scores`) give class and yaw and where the object is to be expected; the evidence compares a few
//! sizes, places and angles about that, coarse to fine (`camera::search`). Without such densities, or by another method, the evidence
//! scores all steps of yaw at the size that what is visible suggests.
//!
//! The evidence of an object that is placed is that of the observation moved to its canonical grid. There a voxel stands for scale³ of
//! those that were observed, so that log evidence relative to the background, times scale³, speaks of the same data whatever the scale.

use super::blend::softmax;
use super::camera::{Cell, Told, ViewFrame, refine, start};
use super::known::Known;
use super::perceiver::{PerceiveError, Perceiver, Workspace, most_probable};
use super::percept::{Lay, ScaleSearch};
use super::pose::posterior::Sample;
use super::posing::{MODE_RADIUS, background};
use super::subspace::{ClassSubspace, Conditional};
use super::{Method, Percept, PoseSearch, Query};
use crate::grid::{Observation, Outside, Placed, Rotation, Turn, yaw};
use crate::linear::LinearError;
use crate::model::{CameraDensities, OFFSETS, YAWS};
use nalgebra::Vector3;
use rayon::prelude::*;
use std::f64::consts::TAU;

/// Modes of a class that are refined, at most; only those within so much of the best, in nats.
const MOST_MODES: usize = 2;
const HOPELESS: f64 = 3.0;
/// Classes whose modes are refined: at least so likely by the view's densities, and at most so many.
const LEAST_LIKELY: f64 = 0.05;
const MOST_LIKELY: usize = 3;
/// Deviations of size and place that are answered are those of the densities and of the search, times this: of made-up household things
/// that were not trained on, about 45 % of the errors were within one deviation without it.
const WIDER: f64 = 1.8;
/// What is visible is this share of the longest side, and the place of the centre that far from that of what is visible (units), where no
/// density says it.
const VISIBLE: f64 = 0.92;
const UNSURE: [f64; OFFSETS] = [0.1, 0.1, 1.5, 1.0, 1.0, 4.0, 4.0, 4.0];

/// A class as it lies best.
#[derive(Clone, Copy, Debug)]
struct Mode {
    cell: Cell,
    refined: super::camera::Refined,
    /// Log posterior of this mode, up to a constant.
    value: f64,
    /// Relative to the background.
    log_evidence: f64,
}

impl Perceiver {
    /// Whether a query is one about what a camera sees.
    pub(super) fn is_viewed(&self, query: &Query) -> bool {
        let by_density =
            query.camera.is_some() && self.model.camera_densities.is_some() && matches!(query.method, Method::Auto | Method::Hull);
        query.pose != PoseSearch::Full && (by_density || query.scale != ScaleSearch::Known) && query.method != Method::Paper
    }

    /// Class and lay of what `work` has read; leaves the observation moved to the object's canonical grid. Sets `percept.informed` to
    /// whether anything is seen.
    pub(super) fn view(&self, query: &Query, work: &mut Workspace, percept: &mut Percept) -> Result<(), PerceiveError> {
        let m = self.model.classes.len();
        work.wanted.iter_mut().enumerate().for_each(|(s, wanted)| *wanted = query.log_prior(s) > f64::NEG_INFINITY);
        // Seen from no stated place: as if from the front, well above.
        let camera = query.camera.unwrap_or(Vector3::new(-100.0, 0.0, 80.0));
        let Some(frame) = ViewFrame::new(&work.seen, &camera, &mut work.view.along) else {
            percept.informed = false;
            return Ok(());
        };
        let told = self.told(query, &frame);
        let (pose_weight, blend) = self.score_view(query, &frame, &told, work)?;
        percept.timings.projected = work.stopwatch.elapsed();

        let prior = query.rotation_prior.log_density(query.pose);
        let span = match query.pose {
            PoseSearch::Yaw { span } => span,
            _ => TAU,
        };
        work.samples.clear();
        work.samples.extend(work.view.cells.iter().filter_map(|cell| {
            let angle = (frame.azimuth + cell.yaw()).rem_euclid(TAU);
            let rotation = if query.pose == PoseSearch::Known { percept.rotation } else { yaw(angle) * cell.resting };
            let allowed = query.pose == PoseSearch::Known || span > TAU - 1e-9 || angle < span;
            let log_density = cell.log_weight(pose_weight) + prior(&rotation);
            allowed.then_some(Sample { rotation, class: cell.class, log_density, share: 1.0 / YAWS as f64 })
        }));
        percept.scores.clear();
        percept.posterior.clear();
        for s in 0..m {
            let of_class = || work.samples.iter().filter(|sample| sample.class == s).map(|sample| sample.log_density);
            let peak = of_class().fold(f64::NEG_INFINITY, f64::max);
            let score = if peak.is_finite() { (peak + of_class().map(|v| (v - peak).exp()).sum::<f64>().ln()) / pose_weight } else { peak };
            percept.scores.push(score);
            percept.posterior.push(blend.0 * score + blend.1.get(s).copied().unwrap_or(0.0) + query.log_prior(s));
        }
        softmax(&mut percept.posterior);
        let modes = self.refine_modes(query, &frame, &told, pose_weight, work, &percept.posterior)?;
        self.weigh_evidence(query, &modes, percept);
        percept.scores.iter_mut().filter(|score| !score.is_finite()).for_each(|score| *score = 0.0);
        percept.class = most_probable(&percept.posterior);
        percept.timings.classified = work.stopwatch.elapsed();
        percept.spread = work.merging.hypotheses(&work.samples, &percept.posterior, MODE_RADIUS, true, &mut percept.hypotheses);
        if let Some(mode) = modes.iter().find(|mode| mode.cell.class == percept.class) {
            self.lay(query, &frame, mode, percept);
        }
        percept.timings.posed = work.stopwatch.elapsed();
        work.turn.set_to_object(&percept.placed);
        work.turn.observation_into(&work.seen, query.outside, &mut work.turned);
        self.reading.take_apart(&work.turned, &mut work.known)?;
        work.forget();
        Ok(())
    }

    /// What the query tells, in the view's frame.
    fn told(&self, query: &Query, frame: &ViewFrame) -> Told {
        let (_, scale, place) = frame.seen(&Placed::default());
        let yaw = (query.pose == PoseSearch::Known).then_some(-frame.azimuth);
        let upright = !query.lying || yaw.is_some();
        match query.scale {
            ScaleSearch::Known => Told { upright, yaw, scale: Some(scale), place: Some(place) },
            ScaleSearch::Search { side } => {
                let longest = self.model.metadata.settings.longest_side as f64;
                Told { upright, yaw, scale: side.map(|side| side / (longest * frame.unit)), place: None }
            }
        }
    }

    /// Scores classes and steps of yaw into `work.view.cells`; gives the weight of scores in the posterior of the yaw, and weight and
    /// offsets in that of the class.
    fn score_view(
        &self,
        query: &Query,
        frame: &ViewFrame,
        told: &Told,
        work: &mut Workspace,
    ) -> Result<(f64, (f64, &[f64])), PerceiveError> {
        let calibration = &self.model.metadata.calibration;
        if let (Some(densities), Some(cameras), Some(camera), Method::Auto | Method::Hull) =
            (&self.model.camera_densities, &self.cameras, &calibration.camera, query.method)
            && query.camera.is_some()
        {
            cameras.score(densities, frame, &work.seen, told, &work.wanted, &mut work.view);
            if let (Some(weight), Some(voxel_m)) = (camera.size_weight, query.voxel_size_m) {
                for cell in &mut work.view.cells {
                    let size = densities.components[cell.component].size;
                    cell.log_prior += size.map_or(0.0, |size| weight * cell.log_size(&size, voxel_m * frame.unit));
                }
            }
            return Ok((camera.pose_weight, (camera.blend.hull, &camera.blend.offsets)));
        }
        let blend = &calibration.evidence;
        let (steps, seen, wanted): (Vec<f64>, _, _) = (steps(told), &work.seen, &work.wanted);
        let expected = self.expectation(told);
        let cells: Vec<Vec<Cell>> = steps
            .par_iter()
            .map(|angle| {
                let step = (angle.rem_euclid(TAU) / TAU * YAWS as f64).round() as usize % YAWS;
                let mut offsets = expected;
                offsets[0] = angle - CameraDensities::yaw(step);
                let mut evidence = PlacedEvidence::new(seen, query.outside, self.noise);
                let resting = Rotation::identity();
                let cell = Cell { class: 0, component: 0, resting, log_prior: 0.0, step, score: 0.0, offsets, deviations: UNSURE };
                let placed = frame.placed(*angle, cell.scale(), &cell.place());
                evidence.place(&placed);
                let mut cells = Vec::new();
                for class in (0..wanted.len()).filter(|class| wanted[*class]) {
                    let mut conditional = Conditional::new(self.subspaces[class].size());
                    let score = evidence.of(&self.subspaces[class], placed.scale, &mut conditional)?;
                    cells.push(Cell { class, score, ..cell });
                }
                Ok(cells)
            })
            .collect::<Result<_, LinearError>>()?;
        work.view.cells.clear();
        work.view.cells.extend(cells.into_iter().flatten());
        Ok((blend.evidence.max(1e-9), (blend.evidence, &blend.offsets)))
    }

    /// Weighs the evidence of the likely classes, each as it lies best, into the posterior. Together they stay as likely as the view's
    /// densities made them, and so does each of the others.
    fn weigh_evidence(&self, query: &Query, modes: &[Mode], percept: &mut Percept) {
        let Some(together) = self.model.metadata.calibration.camera.as_ref().and_then(|camera| camera.together.as_ref()) else { return };
        if query.method != Method::Auto || query.camera.is_none() || modes.is_empty() {
            return;
        }
        let likely: f64 = modes.iter().map(|mode| percept.posterior[mode.cell.class]).sum();
        let mut weighed: Vec<f64> = modes
            .iter()
            .map(|mode| {
                let s = mode.cell.class;
                together.hull * percept.scores[s] + together.evidence * mode.log_evidence + together.offsets[s] + query.log_prior(s)
            })
            .collect();
        softmax(&mut weighed);
        for (mode, p) in modes.iter().zip(weighed) {
            percept.posterior[mode.cell.class] = likely * p;
        }
    }

    /// Offsets that are expected where no density says them.
    fn expectation(&self, told: &Told) -> [f64; OFFSETS] {
        let longest = self.model.metadata.settings.longest_side as f64;
        let scale = told.scale.unwrap_or(super::camera::SEEN / (VISIBLE * longest));
        // The hidden part is behind what is seen.
        let place = told.place.unwrap_or(Vector3::new(1.0, 0.0, 0.0));
        let side = super::camera::SEEN / VISIBLE;
        [0.0, scale.ln(), place.x, place.y, place.z, side, side, side]
    }

    /// The likely modes of a class: its best cells, apart from each other, the best first.
    fn modes<'w>(&self, class: usize, pose_weight: f64, cells: &'w [Cell], most: usize) -> Vec<&'w Cell> {
        let mut order: Vec<&Cell> = cells.iter().filter(|cell| cell.class == class && cell.score.is_finite()).collect();
        let weight = |cell: &Cell| cell.log_weight(pose_weight);
        order.sort_by(|a, b| weight(b).total_cmp(&weight(a)).then((a.component, a.step).cmp(&(b.component, b.step))));
        let mut modes: Vec<&Cell> = Vec::new();
        for cell in order {
            let turned = |cell: &Cell| yaw(cell.yaw()) * cell.resting;
            let apart = modes.iter().all(|mode| turned(mode).angle_to(&turned(cell)) > 2.0 * MODE_RADIUS);
            let hopeless = modes.first().is_some_and(|best| weight(best) - weight(cell) > HOPELESS);
            if modes.len() < most && apart && !hopeless {
                modes.push(cell);
            }
        }
        modes
    }

    /// Refines the likely modes of the likely classes, on all threads; gives the best of each class.
    fn refine_modes(
        &self,
        query: &Query,
        frame: &ViewFrame,
        told: &Told,
        pose_weight: f64,
        work: &Workspace,
        posterior: &[f64],
    ) -> Result<Vec<Mode>, LinearError> {
        // Where all is told there is nothing to refine, and a class costs no more than its evidence.
        let (least, most) = match told {
            Told { yaw: Some(_), scale: Some(_), place: Some(_), .. } => (1e-4, posterior.len()),
            _ => (LEAST_LIKELY, MOST_LIKELY),
        };
        let mut likely: Vec<usize> = (0..posterior.len()).filter(|class| posterior[*class] >= least).collect();
        likely.sort_by(|a, b| posterior[*b].total_cmp(&posterior[*a]).then(a.cmp(b)));
        likely.truncate(most);
        // The most probable class is looked at more closely.
        let modes =
            |(place, class): (usize, &usize)| self.modes(*class, pose_weight, &work.view.cells, if place == 0 { MOST_MODES } else { 1 });
        let cells: Vec<&Cell> = likely.iter().enumerate().flat_map(modes).collect();
        let weight = self.model.metadata.calibration.evidence.evidence.max(1e-9);
        let refined: Vec<Mode> = cells
            .par_iter()
            .map(|cell| {
                let mut evidence = PlacedEvidence::new(&work.seen, query.outside, self.noise);
                let class = &self.subspaces[cell.class];
                let mut conditional = Conditional::new(class.size());
                let start = start(cell, told);
                let refined = refine(&start, |at| {
                    let placed = cell.placed(frame, at[0], at[1].exp(), &Vector3::new(at[2], at[3], at[4]));
                    evidence.place(&placed);
                    Ok::<_, LinearError>(weight * evidence.of(class, placed.scale, &mut conditional)?)
                })?;
                let log_evidence = (refined.value - start.log_density(&refined.parameters)) / weight;
                Ok(Mode { cell: **cell, value: refined.value + cell.log_weight(pose_weight), refined, log_evidence })
            })
            .collect::<Result<_, LinearError>>()?;
        let best_of = |class: &usize| {
            let of_class = refined.iter().filter(|mode| mode.cell.class == *class);
            of_class.reduce(|best, next| if next.value > best.value { next } else { best }).copied()
        };
        Ok(likely.iter().filter_map(best_of).collect())
    }

    /// Says how the object lies.
    fn lay(&self, query: &Query, frame: &ViewFrame, mode: &Mode, percept: &mut Percept) {
        let Mode { cell, refined: best, .. } = mode;
        let class = cell.class;
        let [angle, log_scale, x, y, z] = best.parameters;
        percept.placed = match query.scale {
            ScaleSearch::Known => {
                Placed::turned(if query.pose == PoseSearch::Known { percept.rotation } else { yaw(frame.azimuth + angle) * cell.resting })
            }
            ScaleSearch::Search { .. } => {
                let placed = cell.placed(frame, angle, log_scale.exp(), &Vector3::new(x, y, z));
                if query.pose == PoseSearch::Known { Placed { rotation: percept.rotation, ..placed } } else { placed }
            }
        };
        percept.rotation = percept.placed.rotation;
        percept.resting_pose = query.lying.then_some(cell.component);
        // The hypothesis that was refined says so.
        let near = percept.hypotheses.iter_mut().filter(|h| h.class == class);
        if let Some(nearest) = near.min_by(|a, b| a.rotation.angle_to(&percept.rotation).total_cmp(&b.rotation.angle_to(&percept.rotation)))
        {
            nearest.rotation = percept.rotation;
        }
        let grew = (log_scale - cell.offsets[1]).exp() * frame.unit;
        // Deviations along the frame's axes, along the grid's.
        let (sin, cos) = frame.azimuth.sin_cos();
        let [dx, dy, dz] = [best.deviations[2], best.deviations[3], best.deviations[4]].map(|d| WIDER * d * frame.unit);
        let mixed = |a: f64, b: f64| ((a * dx).powi(2) + (b * dy).powi(2)).sqrt();
        let searched = query.scale != ScaleSearch::Known;
        percept.lay = Some(Lay {
            extent: std::array::from_fn(|axis| (cell.offsets[5 + axis] * grew).max(0.0)),
            extent_deviation: std::array::from_fn(|axis| WIDER * cell.deviations[5 + axis] * frame.unit),
            position_deviation: if searched { [mixed(cos, sin), mixed(sin, cos), dz] } else { [0.0; 3] },
        });
    }
}

/// The evidence of objects that are placed in a grid, and memory for it.
pub(crate) struct PlacedEvidence<'a> {
    seen: &'a Observation,
    outside: Outside,
    noise: f64,
    turn: Turn,
    moved: Observation,
    known: Known,
}

impl<'a> PlacedEvidence<'a> {
    /// For an observation, whose dims are those of the canonical grid too; `outside` says what lies beyond it.
    pub(crate) fn new(seen: &'a Observation, outside: Outside, noise: f64) -> Self {
        let dims = seen.dims();
        Self { seen, outside, noise, turn: Turn::new(dims, &yaw(0.0)), moved: Observation::unknown(dims), known: Known::new(dims) }
    }

    /// Moves the observation to the canonical grid of an object that lies so.
    pub(crate) fn place(&mut self, placed: &Placed) {
        self.turn.set_to_object(placed);
        self.turn.observation_into(self.seen, self.outside, &mut self.moved);
        self.known.read(&self.moved);
    }

    /// Log evidence of a class, relative to the background, of the object that was placed with this scale; in voxels of the grid that was
    /// observed.
    pub(crate) fn of(&self, class: &ClassSubspace, scale: f64, conditional: &mut Conditional) -> Result<f64, LinearError> {
        class.condition(&self.known, self.noise, conditional)?;
        Ok(scale.powi(3) * (conditional.log_evidence - background(self.noise, &self.moved, &self.known)))
    }
}

/// Angles at which the evidence is computed.
fn steps(told: &Told) -> Vec<f64> {
    match told.yaw {
        Some(yaw) => vec![yaw],
        None => (0..YAWS).map(CameraDensities::yaw).collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::yaw_of;
    use crate::perception::pose::small::{seeing_perceiver, unseen};
    use crate::simulation::{self, Eye};
    use std::f64::consts::FRAC_PI_2;

    fn eye(azimuth: f64) -> Eye {
        Eye { azimuth, elevation: 35_f64.to_radians(), distance: 50.0 }
    }

    fn ask(observation: &Observation, query: &Query) -> Percept {
        let perceiver = seeing_perceiver();
        let (mut work, mut percept) = (perceiver.workspace(), Percept::default());
        perceiver.classify(observation, query, &mut work, &mut percept).unwrap();
        perceiver.complete(query, &mut work, &mut percept).unwrap();
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
            let apart = (yaw(FRAC_PI_2) * before.rotation).angle_to(&after.rotation);
            assert!(apart < 2_f64.to_radians(), "{}", apart.to_degrees());
            assert!((yaw(FRAC_PI_2) * before.placed.shift - after.placed.shift).norm() < 0.5);
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
                near += usize::from(found.rotation.angle().to_degrees() < 15.0);
                sized += usize::from(found.placed.scale.ln().abs() < 0.1 && found.placed.shift.norm() < 1.5);
                assert!(found.occupancy.iter().chain(&found.deviation).all(|v| (0.0..=1.0).contains(v)));
                let lay = found.lay.expect("a box");
                assert!(lay.extent.iter().chain(&lay.extent_deviation).chain(&lay.position_deviation).all(|v| v.is_finite() && *v >= 0.0));

                let known = ask(&seen, &query(azimuth, PoseSearch::Known, ScaleSearch::Known));
                assert_eq!(known.placed, Placed::default());
                let told = ask(&seen, &query(azimuth, PoseSearch::YAW, ScaleSearch::Search { side: Some(13.0) }));
                let longest = seeing_perceiver().model().metadata.settings.longest_side as f64;
                assert!((told.placed.scale - 13.0 / longest).abs() < 1e-9);
            }
        }
        assert!(right >= 10 && near >= 7 && sized >= 7, "of 12: {right} named, {near} turned, {sized} placed rightly");
    }

    #[test]
    fn where_nothing_is_seen_all_is_as_likely_as_before() {
        let nothing = Observation::unknown(seeing_perceiver().model().dims());
        let found = ask(&nothing, &query(0.0, PoseSearch::YAW, SEARCH));
        assert!(!found.informed && found.posterior.iter().all(|p| (p - 1.0 / 3.0).abs() < 1e-9));
        assert!(found.hypotheses.iter().all(|h| h.probability < 0.09));
        assert_eq!((found.lay, found.placed.scale), (None, 1.0));
    }

    /// Without densities of cameras, or without knowing where the camera was, the evidence alone finds size and place.
    #[test]
    fn the_evidence_alone_finds_size_and_place() {
        let seen = simulation::observe(&unseen("sofa", 1), &eye(0.3));
        let without = Query { method: Method::Evidence, ..query(0.3, PoseSearch::YAW, SEARCH) };
        let found = ask(&seen, &without);
        assert!(found.placed.scale.ln().abs() < 0.25 && found.placed.shift.norm() < 3.0, "{:?}", found.placed);
    }

    #[test]
    fn a_known_yaw_is_the_only_step() {
        assert_eq!(steps(&Told { yaw: Some(0.7), ..Told::default() }), [0.7]);
        assert_eq!(steps(&Told::default()).len(), YAWS);
        assert!((yaw_of(&yaw(steps(&Told::default())[7])) - CameraDensities::yaw(7)).abs() < 1e-12);
    }
}
