//! Class, yaw, size and place of an upright object, as a camera sees it from any elevation.
//!
//! The densities of the view (`camera::scores`) give class and yaw and where the object is to be expected; the evidence compares a few
//! sizes, places and angles about that, coarse to fine (`camera::refinement`). Without such densities, or by another method, the evidence
//! scores all steps of yaw at the size that what is visible suggests.

use super::refinement::Parameters;
use super::{CameraScores, Cell, KnownPlacement, MeasureScratch, PlacementPrior, RefinedPlacement, SEEN, ViewFrame, ViewWork, measure};
use crate::grid::{Dims, Observation, Outside, Rotation, Similarity, yaw};
use crate::model::{Blend, CameraCalibration, CameraDensities, CameraSpread, OFFSETS, YAWS};
use crate::perception::densities::blend::ClassScores;
use crate::perception::densities::log_sum::{log_sum_exp, most_probable, softmax};
use crate::perception::evidence::lattice::Codes;
use crate::perception::evidence::placed::{EvidenceModel, EvidenceScratch};
use crate::perception::evidence::thinned::{Detail, ThinnedScratch};
use crate::perception::pool::Pool;
use crate::perception::scored::Sample;
use crate::perception::scored::{ClassMask, MODE_RADIUS, Scored};
use crate::perception::search::merging::Merging;
use crate::perception::settings::CAMERA;
use crate::perception::timings::Clock;
use crate::perception::{Method, PerceiveError, PoseSearch, Query};
use crate::perception::{ObjectBox, ScaleSearch};
use nalgebra::Vector3;
use rayon::prelude::*;
use std::f64::consts::TAU;

/// A class as it lies best.
#[derive(Clone, Copy, Debug)]
pub struct PlacedClass {
    /// Where the search began.
    pub cell: Cell,
    /// Where it ended, in the view's frame.
    pub refined: RefinedPlacement,
    /// Log evidence there, relative to the background.
    pub log_evidence: f64,
}

/// Scratch memory of this stage.
#[derive(Default)]
pub struct CameraScratch {
    view: ViewWork,
    evidence: Pool<EvidenceScratch>,
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

/// Logarithm of a class's share by the forest; the same for all where none was asked.
fn log_share(shares: &[f64], class: usize) -> f64 {
    shares.get(class).copied().unwrap_or(0.0)
}

/// Refines modes by the evidence: climbs on that of a coarse lattice of voxels, settles on that of a finer one, and weighs that of all.
pub struct ModeRefiner<'a> {
    /// The classes.
    pub evidence: &'a EvidenceModel,
    /// Weight of the log evidence against what the view's density expects.
    pub weight: f64,
    /// Content of the space beyond the grid.
    pub outside: Outside,
    /// The view's frame.
    pub frame: &'a ViewFrame,
    /// Knowledge of yaw, size and place.
    pub told: &'a KnownPlacement,
    /// The observation …
    pub seen: &'a Observation,
    /// … and the same for lattices.
    pub codes: &'a Codes,
}

/// Scratch memory of a [`ModeRefiner`].
pub struct ModeRefinerScratch {
    all: EvidenceScratch,
    thinned: ThinnedScratch,
}

impl ModeRefinerScratch {
    /// Room for observations of one size.
    pub fn new(dims: Dims) -> Self {
        Self { all: EvidenceScratch::new(dims), thinned: ThinnedScratch::default() }
    }
}

/// Where the climb of a cell ended.
#[derive(Clone, Copy, Debug)]
pub struct Climbed {
    cell: Cell,
    parameters: Parameters,
    value: f64,
}

impl ModeRefiner<'_> {
    /// Climbs from where a cell expects yaw, size and place.
    pub fn climb(&self, cell: &Cell, scratch: &mut ModeRefinerScratch) -> Result<Climbed, PerceiveError> {
        let start = start(cell, self.told);
        if start.is_known() {
            return Ok(Climbed { cell: *cell, parameters: start.expected, value: 0.0 });
        }
        let (parameters, value) = start.climb(|at| self.log_likelihood(Detail::Coarse, cell, at, scratch))?;
        Ok(Climbed { cell: *cell, parameters, value })
    }

    /// Ends a climb.
    pub fn settle(&self, climbed: &Climbed, scratch: &mut ModeRefinerScratch) -> Result<PlacedClass, PerceiveError> {
        let Climbed { cell, parameters, .. } = climbed;
        let start = start(cell, self.told);
        let mut refined = match start.is_known() {
            true => RefinedPlacement { parameters: *parameters, deviations: [0.0; 5], value: 0.0 },
            false => start.settle(parameters, |at| self.log_likelihood(Detail::Fine, cell, at, scratch))?,
        };
        let log_evidence = self.of_all(cell, &refined.parameters, scratch)?;
        refined.value = self.weight * log_evidence + start.log_density(&refined.parameters);
        Ok(PlacedClass { cell: *cell, refined, log_evidence })
    }

    /// Both.
    pub fn refine(&self, cell: &Cell, scratch: &mut ModeRefinerScratch) -> Result<PlacedClass, PerceiveError> {
        let climbed = self.climb(cell, scratch)?;
        self.settle(&climbed, scratch)
    }

    fn placed(&self, cell: &Cell, at: &Parameters) -> Similarity {
        cell.placed(self.frame, at[0], at[1].exp(), &Vector3::new(at[2], at[3], at[4]))
    }

    fn of_all(&self, cell: &Cell, at: &Parameters, scratch: &mut ModeRefinerScratch) -> Result<f64, PerceiveError> {
        Ok(self.evidence.of_placed(self.seen, &self.placed(cell, at), self.outside, cell.class, &mut scratch.all)?.log_ratio)
    }

    fn log_likelihood(&self, detail: Detail, cell: &Cell, at: &Parameters, scratch: &mut ModeRefinerScratch) -> Result<f64, PerceiveError> {
        let log_evidence = match &self.evidence.thinned {
            Some(thinned) => {
                let (placed, noise) = (self.placed(cell, at), self.evidence.noise_variance);
                thinned.log_evidence(detail, self.codes, &placed, cell.class, noise, &mut scratch.thinned)?
            }
            None => self.of_all(cell, at, scratch)?,
        };
        Ok(self.weight * log_evidence)
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

/// Log density over the yaw of a class: of the view, and the prior's.
pub struct PoseDensity<'a> {
    weight: f64,
    /// At a yaw in the view's frame, radians, of what rests so.
    log_prior: &'a dyn Fn(f64, &Rotation) -> f64,
}

impl PoseDensity<'_> {
    fn of(&self, cell: &Cell) -> f64 {
        cell.log_weight(self.weight) + (self.log_prior)(cell.yaw(), &cell.resting)
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
        let query = self.query;
        // Seen from no stated place: as if from the front, well above.
        let camera = query.camera.unwrap_or(Vector3::new(-100.0, 0.0, 80.0));
        let Some(frame) = ViewFrame::new(seen, &camera, &mut scratch.view.along) else {
            out.informed = false;
            return Ok(());
        };
        let told = self.told(&frame);
        let sure = self.score_view(seen, &frame, &told, scratch)?;
        out.none_probability = self.ask_forest(seen, &frame, scratch);
        clock.projected();

        let prior = query.rotation_prior.log_density(query.pose);
        let span = match query.pose {
            PoseSearch::Yaw { span } => span,
            _ => TAU,
        };
        out.samples.extend(scratch.view.cells.iter().filter_map(|cell| {
            let angle = (frame.azimuth + cell.yaw()).rem_euclid(TAU);
            let rotation = if query.pose == PoseSearch::Known { Rotation::identity() } else { yaw(angle) * cell.resting };
            let allowed = query.pose == PoseSearch::Known || span > TAU - 1e-9 || angle < span;
            let log_density = cell.log_weight(sure.pose_weight) + prior(&rotation);
            allowed.then_some(Sample { rotation, class: cell.class, log_density, share: 1.0 / YAWS as f64 })
        }));
        for class in 0..self.wanted.len() {
            let of_class = out.samples.iter().filter(|sample| sample.class == class).map(|sample| sample.log_density);
            let score = log_sum_exp(of_class) / sure.pose_weight;
            out.scores.push(score);
            out.posterior.push(sure.blend.log_posterior(
                class,
                sure.of_class(score, log_share(&scratch.shares, class)),
                query.log_prior(class),
            ));
        }
        softmax(&mut out.posterior);
        let log_prior = |angle: f64, resting: &Rotation| match query.pose {
            PoseSearch::Known => 0.0,
            _ => prior(&(yaw(frame.azimuth + angle) * resting)),
        };
        let poses = PoseDensity { weight: sure.pose_weight, log_prior: &log_prior };
        self.refine_modes(seen, &frame, &told, &poses, scratch, &out.posterior)?;
        self.weigh_evidence(scratch, out);
        clock.classified();
        let class = most_probable(&out.posterior);
        let answered = scratch.modes.iter().find(|mode| mode.cell.class == class);
        out.placement = answered.map(|mode| self.placement(&frame, mode));
        out.resting_pose = answered.filter(|_| !told.upright).map(|mode| mode.cell.component);
        Ok(())
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

    /// Scores classes and steps of yaw into `scratch.view.cells`.
    fn score_view(
        &self,
        seen: &Observation,
        frame: &ViewFrame,
        told: &KnownPlacement,
        scratch: &mut CameraScratch,
    ) -> Result<Sureness<'_>, PerceiveError> {
        if let (Some((scores, calibration)), Method::Auto | Method::Hull, Some(_)) = (self.cameras, self.query.method, self.query.camera) {
            scores.score(frame, seen, told, self.wanted, &mut scratch.view);
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
        let expected = self.expectation(told);
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
    fn expectation(&self, told: &KnownPlacement) -> [f64; OFFSETS] {
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
        seen: &Observation,
        frame: &ViewFrame,
        told: &KnownPlacement,
        poses: &PoseDensity<'_>,
        scratch: &mut CameraScratch,
        posterior: &[f64],
    ) -> Result<(), PerceiveError> {
        let CameraScratch { view, refining, codes, order, merging, likely, starts, climbed, modes, .. } = scratch;
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
            best_cells(*class, poses, &view.cells, most, order, merging, starts);
        }
        let weight = self.evidence_blend.evidence.max(1e-9);
        let evidence = self.evidence;
        codes.set(seen, self.query.outside);
        let refiner = ModeRefiner { evidence, weight, outside: self.query.outside, frame, told, seen, codes };
        let prior_of = |cell: &Cell, at: &Parameters| cell.log_weight(poses.weight) + (poses.log_prior)(at[0], &cell.resting);
        modes.clear();
        let scratch = refining.get_or_insert_with(|| ModeRefinerScratch::new(evidence.dims()));
        climbed.clear();
        for cell in &*starts {
            climbed.push(refiner.climb(cell, scratch)?);
        }
        for class in &*likely {
            let value = |of: &Climbed| of.value + prior_of(&of.cell, &of.parameters);
            let of_class = climbed.iter().filter(|climbed| climbed.cell.class == *class);
            let best = of_class.reduce(|best, next| if value(next) > value(best) { next } else { best });
            if let Some(best) = best {
                modes.push(refiner.settle(best, scratch)?);
            }
        }
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
        (placed, object_box)
    }
}

/// Standard deviations of the place along the frame's axes, along the grid's: lengths in voxels.
fn position_deviation(frame: &ViewFrame, refined: &RefinedPlacement, spread: &CameraSpread) -> [f64; 3] {
    let (sin, cos) = frame.azimuth.sin_cos();
    let [dx, dy, dz] = std::array::from_fn(|axis| spread.place[axis] * refined.deviations[2 + axis] * frame.unit);
    let mixed = |a: f64, b: f64| ((a * dx).powi(2) + (b * dy).powi(2)).sqrt();
    [mixed(cos, sin), mixed(sin, cos), dz]
}

/// The likely modes of a class among its cells, apart from each other, the best first; they are added to `starts`.
fn best_cells(
    class: usize,
    poses: &PoseDensity<'_>,
    cells: &[Cell],
    most: usize,
    order: &mut Vec<usize>,
    merging: &mut Merging,
    starts: &mut Vec<Cell>,
) {
    order.clear();
    order.extend((0..cells.len()).filter(|i| cells[*i].class == class && cells[*i].score.is_finite()));
    let value = |i: usize| poses.of(&cells[i]);
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

/// Angles at which the evidence is computed, and how many of them count.
fn steps(told: &KnownPlacement) -> ([f64; YAWS], usize) {
    match told.yaw {
        Some(yaw) => ([yaw; YAWS], 1),
        None => (std::array::from_fn(CameraDensities::yaw), YAWS),
    }
}

/// Where the search of a cell begins: what is told has no deviation.
fn start(cell: &Cell, told: &KnownPlacement) -> PlacementPrior {
    let (place, scale) = (cell.place(), cell.scale());
    let mut start = PlacementPrior {
        expected: [cell.yaw(), scale.ln(), place.x, place.y, place.z],
        deviations: std::array::from_fn(|axis| cell.deviations[axis]),
    };
    let told = [told.yaw, told.scale.map(f64::ln), told.place.map(|p| p.x), told.place.map(|p| p.y), told.place.map(|p| p.z)];
    for (axis, value) in told.into_iter().enumerate() {
        if let Some(value) = value {
            (start.expected[axis], start.deviations[axis]) = (value, 0.0);
        }
    }
    start
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
    use crate::grid::{Turn, yaw_of};
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
    fn what_is_told_is_not_searched() {
        let cell = Cell {
            class: 0,
            component: 0,
            resting: Rotation::identity(),
            log_prior: 0.0,
            step: 6,
            score: 0.0,
            offsets: [0.1, -0.2, 1.0, 2.0, 3.0, 9.0, 9.0, 9.0],
            deviations: [0.5; OFFSETS],
        };
        let free = start(&cell, &KnownPlacement::default());
        assert!((free.expected[0] - (CameraDensities::yaw(6) + 0.1)).abs() < 1e-12);
        let same = |a: &[f64], b: &[f64]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-12);
        assert!(same(&free.expected[1..], &[-0.2, 1.0, 2.0, 3.0]) && free.deviations == [0.5; 5]);
        let told = KnownPlacement { yaw: Some(1.0), scale: Some(1.0), ..KnownPlacement::default() };
        let some = start(&cell, &told);
        assert_eq!((some.expected, some.deviations), ([1.0, 0.0, 1.0, 2.0, 3.0], [0.0, 0.0, 0.5, 0.5, 0.5]));
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
