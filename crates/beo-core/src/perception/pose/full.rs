//! Class and pose by search over SO(3).
//!
//! Of a view from above: all classes and rotations of a grid of 15° steps are scored by the hull's features (`view_scores`); the
//! peaks, moved by a regression and averaged with what lies around them, are refined (`refine`) and ranked by that score and
//! the evidence. Of any other observation: the evidence of all rotations of a grid, then the same refinement.
//!
//! Its settings stand in `settings`. Of objects held out of ModelNet10, the right mode was among the first eight of the known class for
//! 95 % of the views; what is wrong after that is the ranking of look-alike sides.

use super::modes::{Candidate, FoundModes};
use super::refine::{RefineScratch, Refined, Refiner};
use crate::grid::{Dims, HeightMap, Observation, Rotation, Similarity};
use crate::perception::basis::known::Known;
use crate::perception::densities::log_sum::{log_sum_exp, softmax};
use crate::perception::evidence::lattice::Codes;
use crate::perception::evidence::placed::{Evidence, EvidenceScratch};
use crate::perception::pool::Pool;
use crate::perception::prepared::{Here, Prepared};
use crate::perception::scored::{ClassMask, Sample, Scored};
use crate::perception::search::grid::{count_for, rotations};
use crate::perception::settings::FULL;
use crate::perception::timings::Clock;
use crate::perception::views::view_scores::{CELLS, Screen, ViewScratch};
use crate::perception::{Method, PerceiveError, Query};
use rayon::prelude::*;

/// Prior knowledge.
struct Prior<'a> {
    /// Log density over rotations, relative to the uniform one.
    log_density: &'a (dyn Fn(&Rotation) -> f64 + Sync),
    /// Rotations to look at besides the grid.
    hints: &'a [Rotation],
    wanted: &'a ClassMask,
}

impl Prior<'_> {
    fn classes(&self) -> impl Iterator<Item = usize> + '_ {
        (0..self.wanted.len()).filter(|s| self.wanted[*s])
    }

    /// The share of all rotations that a hint stands for: no more than the peak of the prior around it holds.
    fn share(&self, hint: &Rotation, usual: f64) -> f64 {
        usual.min((-(self.log_density)(hint)).exp())
    }
}

/// How many modes of each class are refined.
#[derive(Default)]
struct RefinedModes {
    /// One per class.
    counts: Vec<usize>,
    order: Vec<usize>,
}

impl RefinedModes {
    /// Those of the most probable classes; `scores` are on the scale of log probabilities.
    fn choose(&mut self, prior: &Prior<'_>, scores: &[f64]) {
        let Self { counts, order } = self;
        order.clear();
        order.extend(prior.classes());
        order.sort_unstable_by(|a, b| scores[*b].total_cmp(&scores[*a]).then(a.cmp(b)));
        let most = if order.len() == 1 { FULL.modes_of_known_class } else { FULL.modes };
        counts.clear();
        counts.resize(scores.len(), 0);
        order.iter().take(FULL.classes).for_each(|s| counts[*s] = most);
    }
}

/// A class's candidates by falling score, and the modes among them. Empty of a class that is left out.
struct Peaks {
    candidates: Vec<Candidate>,
    /// Share of all rotations that each stands for.
    shares: Vec<f64>,
    found: FoundModes,
    /// The first of the modes, refined.
    refined: Vec<Refined>,
    /// Score over all rotations.
    total: f64,
    /// Log evidence of each candidate's mode.
    evidence: Vec<f64>,
    /// Scores of cells; candidates with their shares before they are sorted, and their order.
    cells: Vec<(f64, usize)>,
    looked: Vec<(Candidate, f64)>,
    order: Vec<usize>,
    view: ViewScratch,
}

impl Peaks {
    fn new(dims: Dims) -> Self {
        Self {
            candidates: Vec::new(),
            shares: Vec::new(),
            found: FoundModes::default(),
            refined: Vec::new(),
            total: f64::NEG_INFINITY,
            evidence: Vec::new(),
            cells: Vec::new(),
            looked: Vec::new(),
            order: Vec::new(),
            view: ViewScratch::new(dims),
        }
    }

    /// Forgets all candidates.
    fn clear(&mut self) {
        self.looked.clear();
        self.candidates.clear();
        self.shares.clear();
        self.refined.clear();
        self.total = f64::NEG_INFINITY;
    }

    /// Sorts what was looked at; of equals, what was looked at first comes first.
    fn sort(&mut self) {
        let Self { candidates, shares, looked, order, .. } = self;
        order.clear();
        order.extend(0..looked.len());
        order.sort_unstable_by(|a, b| looked[*b].0.score.total_cmp(&looked[*a].0.score).then(a.cmp(b)));
        candidates.extend(order.iter().map(|i| looked[*i].0));
        shares.extend(order.iter().map(|i| looked[*i].1));
    }
}

/// A mode that is refined.
struct Task {
    class: usize,
    start: Rotation,
    refined: Option<Refined>,
}

/// Scratch memory of this stage.
pub struct FullScratch {
    refine: Pool<RefineScratch>,
    evidence: Pool<EvidenceScratch>,
    view: Pool<ViewScratch>,
    map: HeightMap,
    screen: Screen,
    hints: Vec<Rotation>,
    codes: Codes,
    /// Rotations of the grid with their shares, and the scores of all classes at each.
    grid: Vec<(Rotation, f64)>,
    grid_scores: Vec<f64>,
    /// One per class.
    peaks: Vec<Peaks>,
    /// Scores of the classes on the scale of log probabilities.
    totals: Vec<f64>,
    refined_modes: RefinedModes,
    tasks: Vec<Task>,
}

impl FullScratch {
    /// Room for observations of one size.
    pub fn new(dims: Dims) -> Self {
        Self {
            refine: Pool::default(),
            evidence: Pool::default(),
            view: Pool::default(),
            map: HeightMap::new(dims),
            screen: Screen::default(),
            hints: Vec::new(),
            codes: Codes::default(),
            grid: Vec::new(),
            grid_scores: Vec::new(),
            peaks: Vec::new(),
            totals: Vec::new(),
            refined_modes: RefinedModes::default(),
            tasks: Vec::new(),
        }
    }
}

/// The search over SO(3).
pub struct FullSearch<'a> {
    pub prepared: &'a Prepared,
    pub here: &'a Here,
    pub query: &'a Query,
    pub wanted: &'a ClassMask,
    /// Which view of the model's the observation was taken from, if one.
    pub view: Option<usize>,
}

impl FullSearch<'_> {
    /// Class posterior and weighted rotations of an observation, `known` as it came.
    pub fn score(
        &self,
        seen: &Observation,
        known: &Known,
        scratch: &mut FullScratch,
        clock: &mut Clock,
        out: &mut Scored,
    ) -> Result<(), PerceiveError> {
        let log_density = self.query.rotation_prior.log_density(self.query.pose);
        scratch.codes.set(seen, self.query.outside);
        let mut hints = std::mem::take(&mut scratch.hints);
        hints.clear();
        hints.extend(self.query.rotation_prior.centres().copied());
        let prior = Prior { log_density: &log_density, hints: &hints, wanted: self.wanted };
        let outcome = match (self.query.method, self.view) {
            _ if !out.informed => {
                self.by_prior(&prior, out);
                Ok(())
            }
            (Method::Auto | Method::Hull, Some(_)) => self.by_views(&prior, seen, known, scratch, clock, out),
            _ => self.by_evidence(&prior, seen, known, scratch, clock, out),
        };
        scratch.hints = hints;
        outcome
    }

    /// Nothing was seen: the prior.
    fn by_prior(&self, prior: &Prior<'_>, out: &mut Scored) {
        let usual = 1.0 / count_for(FULL.coarse_rad) as f64;
        let grid = rotations(count_for(FULL.coarse_rad)).map(|rotation| (rotation, usual));
        for (rotation, share) in grid.chain(prior.hints.iter().map(|hint| (*hint, prior.share(hint, usual)))) {
            let log_density = (prior.log_density)(&rotation);
            out.samples.extend(prior.classes().map(|class| Sample { rotation, class, log_density, share }));
        }
    }

    fn refiner<'b>(
        &'b self,
        seen: &'b Observation,
        known: &'b Known,
        prior: &'b (dyn Fn(&Rotation) -> f64 + Sync),
        codes: &'b Codes,
        pool: &'b Pool<RefineScratch>,
    ) -> Refiner<'b> {
        Refiner { evidence: &self.prepared.evidence, seen, known, codes, outside: self.query.outside, prior, pool }
    }

    /// By the densities of views from above, and the evidence.
    fn by_views(
        &self,
        prior: &Prior<'_>,
        seen: &Observation,
        known: &Known,
        scratch: &mut FullScratch,
        clock: &mut Clock,
        out: &mut Scored,
    ) -> Result<(), PerceiveError> {
        let m = self.prepared.classes();
        let by_evidence = self.query.method == Method::Auto;
        let temperature = if by_evidence { FULL.temperature } else { FULL.hull_temperature };
        let weight = FULL.evidence_weight * self.prepared.model.metadata.calibration.noise_inflation;
        let FullScratch { refine, codes, view, map, screen, peaks, totals, refined_modes, tasks, .. } = scratch;
        map.read(seen);
        self.here.views.screen(map, prior.wanted, view, screen);
        peaks.resize_with(m, || Peaks::new(seen.dims()));
        let (map, screen) = (&*map, &*screen);
        peaks.par_iter_mut().enumerate().for_each(|(class, peaks)| {
            peaks.clear();
            if prior.wanted[class] {
                self.look_at_views(class, screen, map, prior, temperature, peaks);
            }
        });
        clock.projected();
        totals.clear();
        totals.extend(peaks.iter().enumerate().map(|(class, peaks)| peaks.total / temperature + self.query.log_prior(class)));
        refined_modes.choose(prior, totals);
        for class in prior.classes() {
            let Peaks { candidates, found, .. } = &mut peaks[class];
            // The others need a mode as well: what it is, not how well it fits.
            found.find(candidates, FULL.averaging_nats, refined_modes.counts[class].max(1));
        }
        if by_evidence {
            let scaled = |rotation: &Rotation| (prior.log_density)(rotation) * temperature / weight;
            let refiner = self.refiner(seen, known, &scaled, codes, refine);
            refine_all(&refiner, prior, peaks, &refined_modes.counts, &FULL.fine_rad, tasks)?;
        }
        // Where no evidence was computed it says as little as where it was least.
        let best = |p: &Peaks| p.refined.iter().map(|r| weight * r.evidence.log_ratio).fold(f64::NEG_INFINITY, f64::max);
        let least = peaks.iter().filter(|p| !p.refined.is_empty()).map(best).fold(f64::INFINITY, f64::min);
        let least = if least.is_finite() { least } else { 0.0 };

        out.scores.resize(m, f64::NEG_INFINITY);
        out.posterior.resize(m, f64::NEG_INFINITY);
        for class in prior.classes() {
            let peaks = &mut peaks[class];
            let evidence = if peaks.refined.is_empty() { least } else { best(peaks) };
            out.scores[class] = peaks.total + evidence;
            out.posterior[class] = out.scores[class] / temperature + self.query.log_prior(class);
            add_samples(peaks, class, weight, temperature, prior, &mut out.samples);
        }
        softmax(&mut out.posterior);
        Ok(())
    }

    /// Looks for the best rotations of a class. Scores include the prior, as many times as the temperature divides them later.
    fn look_at_views(&self, class: usize, screen: &Screen, map: &HeightMap, prior: &Prior<'_>, temperature: f64, peaks: &mut Peaks) {
        let views = &self.here.views;
        let log_prior = |rotation: &Rotation| temperature * (prior.log_density)(rotation);
        let usual = 1.0 / CELLS as f64;
        let Peaks { cells, looked, view, .. } = peaks;
        cells.clear();
        cells.extend((0..CELLS).map(|cell| (screen.score(class, cell) + log_prior(views.rotation(cell)), cell)));
        looked.extend(prior.hints.iter().map(|hint| {
            let score = views.score_at(map, hint, class, view) + log_prior(hint);
            (Candidate { cell: *hint, rotation: *hint, score }, prior.share(hint, usual))
        }));
        let all = cells.iter().map(|cell| cell.0).chain(looked.iter().map(|(hint, _)| hint.score));
        peaks.total = FULL.soft_maximum_nats * log_sum_exp(all.map(|score| score / FULL.soft_maximum_nats));
        let falling = |a: &(f64, usize), b: &(f64, usize)| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1));
        cells.select_nth_unstable_by(FULL.candidates, falling);
        cells.truncate(FULL.candidates);
        cells.sort_unstable_by(falling);
        looked.extend(cells.iter().map(|&(_, cell)| {
            let rotation = views.regressed(screen, class, cell, view);
            let score = screen.score(class, cell) + log_prior(&rotation);
            (Candidate { cell: *views.rotation(cell), rotation, score }, usual)
        }));
        peaks.sort();
    }

    /// By the evidence, or the distance to the class means.
    fn by_evidence(
        &self,
        prior: &Prior<'_>,
        seen: &Observation,
        known: &Known,
        scratch: &mut FullScratch,
        clock: &mut Clock,
        out: &mut Scored,
    ) -> Result<(), PerceiveError> {
        let calibration = &self.prepared.model.metadata.calibration;
        let by_distance = self.query.method == Method::Mean;
        let (blend, weight) = if by_distance {
            (&calibration.mean, calibration.mean.distance.max(1e-9))
        } else {
            (&calibration.evidence, calibration.evidence.evidence.max(1e-9))
        };
        let m = self.prepared.classes();
        let raw = |evidence: &Evidence| if by_distance { -evidence.squared_distance } else { evidence.log_ratio };
        let usual = 1.0 / count_for(FULL.coarse_rad) as f64;
        let FullScratch { refine, codes, evidence: pool, grid, grid_scores, peaks, totals, refined_modes, tasks, .. } = scratch;
        grid.clear();
        grid.extend(prior.hints.iter().map(|hint| (*hint, prior.share(hint, usual))));
        grid.extend(rotations(count_for(FULL.coarse_rad)).map(|rotation| (rotation, usual)));
        grid_scores.clear();
        grid_scores.resize(grid.len() * m, f64::NEG_INFINITY);
        grid_scores.par_chunks_exact_mut(m).zip(&*grid).try_for_each(|(scores, (rotation, _))| {
            let evidence = &self.prepared.evidence;
            pool.with(
                || EvidenceScratch::new(evidence.dims()),
                |scratch| {
                    evidence.place(seen, &Similarity::turned(*rotation), self.query.outside, scratch)?;
                    prior.classes().try_for_each(|class| {
                        scores[class] = raw(&evidence.of_class(class, scratch)?);
                        Ok::<_, PerceiveError>(())
                    })
                },
            )
        })?;
        clock.projected();
        // Scores are log densities from here on.
        peaks.resize_with(m, || Peaks::new(seen.dims()));
        peaks.iter_mut().for_each(Peaks::clear);
        for class in prior.classes() {
            let peaks = &mut peaks[class];
            peaks.looked.extend(grid.iter().zip(grid_scores.chunks_exact(m)).map(|((rotation, share), scores)| {
                let score = weight * scores[class] + (prior.log_density)(rotation);
                (Candidate { cell: *rotation, rotation: *rotation, score }, *share)
            }));
            peaks.total = peaks.looked.iter().map(|(candidate, _)| candidate.score).fold(f64::NEG_INFINITY, f64::max);
            peaks.sort();
        }
        totals.clear();
        totals.extend(peaks.iter().enumerate().map(|(class, p)| p.total + blend.offsets[class] + self.query.log_prior(class)));
        refined_modes.choose(prior, totals);
        for class in prior.classes() {
            let Peaks { candidates, found, .. } = &mut peaks[class];
            // A grid this coarse has no two rotations on one peak to be averaged.
            found.find(candidates, f64::MIN_POSITIVE, refined_modes.counts[class]);
        }
        let scaled = |rotation: &Rotation| (prior.log_density)(rotation) / weight;
        let refiner = self.refiner(seen, known, &scaled, codes, refine);
        refine_all(&refiner, prior, peaks, &refined_modes.counts, &FULL.fine_from_coarse_rad, tasks)?;

        out.scores.resize(m, f64::NEG_INFINITY);
        out.posterior.resize(m, f64::NEG_INFINITY);
        for class in prior.classes() {
            let peaks = &peaks[class];
            let density = |r: &Refined| weight * raw(&r.evidence) + (prior.log_density)(&r.rotation);
            let best = peaks.refined.iter().map(density).fold(peaks.total, f64::max);
            out.scores[class] = best / weight;
            out.posterior[class] = best + blend.offsets[class] + self.query.log_prior(class);
            let sample = |rotation: Rotation, log_density: f64, share: f64| Sample { rotation, class, log_density, share };
            out.samples.extend(peaks.refined.iter().map(|r| sample(r.rotation, density(r), usual)));
            out.samples.extend(peaks.candidates.iter().zip(&peaks.shares).map(|(c, share)| sample(c.rotation, c.score, *share)));
        }
        softmax(&mut out.posterior);
        Ok(())
    }
}

/// Refines the first `counts[class]` modes of each class.
fn refine_all(
    refiner: &Refiner<'_>,
    prior: &Prior<'_>,
    peaks: &mut [Peaks],
    counts: &[usize],
    steps: &[f64],
    tasks: &mut Vec<Task>,
) -> Result<(), PerceiveError> {
    tasks.clear();
    for class in prior.classes() {
        let starts = peaks[class].found.modes.iter().take(counts[class]);
        tasks.extend(starts.map(|mode| Task { class, start: mode.rotation, refined: None }));
    }
    tasks.par_iter_mut().try_for_each(|task| {
        task.refined = Some(refiner.refine(task.class, &task.start, steps)?);
        Ok::<_, PerceiveError>(())
    })?;
    tasks.iter().for_each(|task| peaks[task.class].refined.extend(task.refined));
    Ok(())
}

/// The samples of a class: the candidates, each with the evidence of its mode, and on top of each mode its refined rotation.
fn add_samples(peaks: &mut Peaks, class: usize, weight: f64, temperature: f64, prior: &Prior<'_>, samples: &mut Vec<Sample>) {
    let Peaks { candidates, shares, found, refined, evidence, .. } = peaks;
    let least = refined.iter().map(|r| weight * r.evidence.log_ratio).fold(f64::INFINITY, f64::min);
    evidence.clear();
    evidence.resize(candidates.len(), if least.is_finite() { least } else { 0.0 });
    let usual = 1.0 / CELLS as f64;
    for (place, mode) in found.modes.iter().enumerate() {
        let (members, refined) = (found.members(mode), refined.get(place));
        if let Some(refined) = refined {
            members.iter().for_each(|i| evidence[*i] = weight * refined.evidence.log_ratio);
        }
        let rotation = refined.map_or(mode.rotation, |r| r.rotation);
        let raw = members.first().map_or(mode.score, |i| mode.score - temperature * (prior.log_density)(&candidates[*i].rotation));
        let own =
            (raw + temperature * (prior.log_density)(&rotation) + refined.map_or(0.0, |r| weight * r.evidence.log_ratio)) / temperature;
        // It stands for the mode, so it is not below what lies around it.
        let around = members.iter().map(|i| (candidates[*i].score + evidence[*i]) / temperature);
        samples.push(Sample { rotation, class, log_density: around.fold(own, f64::max), share: usual });
    }
    samples.extend(candidates.iter().zip(&*shares).zip(&*evidence).map(|((candidate, share), evidence)| Sample {
        rotation: candidate.rotation,
        class,
        log_density: (candidate.score + evidence) / temperature,
        share: *share,
    }));
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::{Turn, View};
    use crate::perception::pose::small::{model, perceiver, unseen};

    /// Against the same score at every rotation of a grid of 8° steps.
    #[test]
    fn the_best_of_exhaustive_scoring_is_among_the_modes() {
        let prepared = &perceiver().grid.prepared;
        let here = perceiver().grid.here.as_ref().expect("a model that is searched itself");
        let query = Query::default();
        let search = FullSearch { prepared, here, query: &query, wanted: &[true; 3], view: Some(0) };
        let prior = Prior { log_density: &|_| 0.0, hints: &[], wanted: &[true; 3] };
        let grid: Vec<Rotation> = rotations(count_for(8_f64.to_radians())).collect();
        let (mut near, mut count) = (0, 0);
        for seed in 0..8 {
            let truth = grid[seed as usize * 3001 % grid.len()];
            let view = View::Top.of(&Turn::new(model().dims(), &truth).occupancy(&unseen("chair", seed)));
            let map = HeightMap::of(&view);
            let (mut screen, pool) = (Screen::default(), Pool::default());
            here.views.screen(&map, prior.wanted, &pool, &mut screen);
            for class in 0..3 {
                let mut peaks = Peaks::new(map.dims());
                search.look_at_views(class, &screen, &map, &prior, 1.0, &mut peaks);
                assert!(peaks.candidates.is_sorted_by(|a, b| a.score >= b.score));
                peaks.found.find(&peaks.candidates, FULL.averaging_nats, FULL.modes_of_known_class);
                let look = |r: &Rotation| here.views.score_at(&map, r, class, &mut ViewScratch::new(map.dims()));
                let scores: Vec<f64> = grid.par_iter().map(look).collect();
                let best = (0..grid.len()).fold(0, |best, i| if scores[i] > scores[best] { i } else { best });
                // What the finer grid finds beyond the coarse one is a fraction of what sets modes apart.
                near += usize::from(peaks.found.modes.iter().any(|mode| mode.rotation.angle_to(&grid[best]) < 20_f64.to_radians()));
                count += 1;
            }
        }
        assert!(near * 10 >= count * 9, "{near} of {count}");
    }
}
