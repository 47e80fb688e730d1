//! The varied quantity, and its sizes.

use super::error::ScaleError;
use super::growth::{Line, Series};
use super::models::Recipe;
use super::publishing::{self, Published};
use super::queries::{self, Asked};
use super::training;
use crate::benchmark::cores::usable;
use crate::benchmark::percentiles::median;
use beo_core::grid::{Dims, Observation, Occupancy};
use beo_core::model::Model;
use beo_core::perception::{PerceiveError, Perceiver};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::{ThreadPool, ThreadPoolBuilder};
use std::cell::OnceCell;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// The varied quantity.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Sweep {
    /// Number of classes
    Classes,
    /// Components of a class
    Basis,
    /// Voxels along the side of the grid
    Resolution,
    /// The same, for learning: time, and memory at a time
    Training,
    /// Shapes that are learned from: time, and memory at a time
    Shapes,
    /// Share of the voxels that is hidden, in stacks or scattered
    Unknown,
    /// Worker threads
    Threads,
    /// Subscribers of percepts and completions
    Subscribers,
    /// Number of classes, of what a camera sees: yaw, size and place unknown
    CameraClasses,
    /// Voxels along the side of the grid, of what a camera sees
    CameraResolution,
}

/// How thoroughly a series is measured.
struct Effort {
    /// Time for each series, at least; models are learned besides.
    time: Duration,
    /// The model that is asked where the queries are varied.
    recipe: Recipe,
    /// Of models with many classes or components, which take long to learn.
    resolution: usize,
}

const THOROUGH: Effort =
    Effort { time: Duration::from_secs(6), recipe: Recipe { resolution: 30, classes: 10, basis: 30, shapes: None }, resolution: 20 };
const QUICK: Effort =
    Effort { time: Duration::from_millis(100), recipe: Recipe { resolution: 12, classes: 3, basis: 5, shapes: None }, resolution: 12 };

/// Measures series.
pub struct Scale {
    quick: bool,
    effort: Effort,
    /// The result of the effort's recipe, once it was needed.
    perceiver: OnceCell<Arc<Perceiver>>,
}

/// Queries of one case before it is the next one's turn.
const BATCH: usize = 5;
/// Rounds in which every case has its turn, at least.
const FEWEST_ROUNDS: usize = 3;
/// Different observations of each case; fewer of large grids.
const OBSERVATIONS: usize = 40;
const FEW_OBSERVATIONS: usize = 5;

impl Scale {
    /// Thoroughly, or `quick`: at few small sizes, to see that it works.
    pub fn new(quick: bool) -> Self {
        Self { quick, effort: if quick { QUICK } else { THOROUGH }, perceiver: OnceCell::new() }
    }

    /// Measures one series.
    pub fn measure(&self, sweep: Sweep) -> Result<Series, ScaleError> {
        let quick = self.quick;
        match sweep {
            Sweep::Classes => self.classes(if quick { &[2, 4] } else { &[2, 5, 10, 20, 40] }),
            Sweep::Basis => self.basis(if quick { &[3, 6] } else { &[5, 10, 20, 40, 80] }),
            Sweep::Resolution => self.resolution(if quick { &[10, 14] } else { &[16, 32, 64, 128, 254] }),
            Sweep::Training => self.training(if quick { &[10, 14] } else { &[16, 32, 64, 128, 254] }),
            Sweep::Shapes => self.shapes(if quick { &[5, 8] } else { &[4, 20, 80, 200, 798] }),
            Sweep::Unknown => self.unknown(if quick { &[0.2, 0.6] } else { &[0.05, 0.1, 0.2, 0.4, 0.6] }),
            Sweep::Threads => self.threads(),
            Sweep::CameraClasses => self.camera_classes(if quick { &[2, 3] } else { &[7, 14, 28, 55] }),
            Sweep::CameraResolution => self.camera_resolution(if quick { &[10, 12] } else { &[30, 40, 50, 64] }),
            Sweep::Subscribers => self.subscribers(if quick { &[1, 2] } else { &[1, 2, 4, 8, 16] }),
        }
    }

    fn classes(&self, sizes: &[usize]) -> Result<Series, ScaleError> {
        let recipe = Recipe { resolution: self.effort.resolution, basis: 5, ..self.effort.recipe };
        let setting = format!("{} components of each class, {}", recipe.basis, recipe.dims());
        let why = "the shared basis has a column for every component and mean: a hull is whitened by a triangle of a² / 2 for every \
                   class, in the search over yaw at the best angle of every class; at most three classes complete";
        let cases = sizes.iter().map(|&classes| Recipe { classes, ..recipe }.asked(|_| classes as f64));
        self.queries("classes", setting, why, [3.0, 0.0, 4.0], cases)
    }

    fn basis(&self, sizes: &[usize]) -> Result<Series, ScaleError> {
        let recipe = Recipe { resolution: self.effort.resolution, classes: 5, ..self.effort.recipe };
        let setting = format!("{} classes, {}", recipe.classes, recipe.dims());
        let why = "Gram matrices, whitening and variances take squares of it";
        let mean_size =
            |model: &Model| model.metadata.classes.iter().map(|c| c.basis_size as f64).sum::<f64>() / model.classes.len() as f64;
        let cases = sizes.iter().map(|&basis| Recipe { basis, ..recipe }.asked(mean_size));
        self.queries("components of a class", setting, why, [2.0; 3], cases)
    }

    fn resolution(&self, sizes: &[usize]) -> Result<Series, ScaleError> {
        let recipe = Recipe { classes: 2, basis: 8, ..self.effort.recipe };
        let setting = format!("{} classes, {} components of each", recipe.classes, recipe.basis);
        let why = "hidden voxels grow with its cube, what is taken column by column with its square; above 64 the basis is read in place, by \
                   all threads, and poses are searched on 32³ and refined on the larger";
        let cases = sizes.iter().map(|&resolution| Recipe { resolution, ..recipe }.asked(|_| resolution as f64));
        self.queries("voxels along a side", setting, why, [3.0; 3], cases)
    }

    fn camera_classes(&self, sizes: &[usize]) -> Result<Series, ScaleError> {
        let recipe = Recipe { basis: if self.quick { 3 } else { 10 }, ..self.effort.recipe };
        let why =
            "densities of the view are computed for every class and step of yaw; of at most three classes modes are refined, and completed";
        let cases = sizes.iter().map(|&classes| Recipe { classes, ..recipe }.asked_by_camera(classes as f64));
        self.camera_queries(
            "classes before a camera",
            format!("{} components of each class, {}", recipe.basis, recipe.dims()),
            why,
            [1.0, 0.0],
            cases,
        )
    }

    fn camera_resolution(&self, sizes: &[usize]) -> Result<Series, ScaleError> {
        let recipe = Recipe { classes: if self.quick { 2 } else { 7 }, basis: if self.quick { 3 } else { 10 }, ..self.effort.recipe };
        let why = "the view's frame and the lattices on which modes are refined keep their sizes; reading, the last evidence of a mode and the \
                   completion take all voxels";
        let cases = sizes.iter().map(|&resolution| Recipe { resolution, ..recipe }.asked_by_camera(resolution as f64));
        let setting = format!("{} classes, {} components of each", recipe.classes, recipe.basis);
        self.camera_queries("voxels along a side before a camera", setting, why, [3.0; 2], cases)
    }

    fn training(&self, sizes: &[usize]) -> Result<Series, ScaleError> {
        let recipe = Recipe { classes: 2, basis: 8, ..self.effort.recipe };
        let cases = sizes.iter().map(|&resolution| (resolution as f64, Recipe { resolution, ..recipe }));
        let setting = format!("2 classes, {} components and {} shapes of each", recipe.basis, recipe.shapes().shapes.len() / 2);
        let why = "the basis has a row for every voxel, and is written once; shapes have a bit for each. Up to 64 most of the time goes into \
                   densities of turned objects, whose number does not grow, and tables take several times the basis";
        Self::trained("voxels along a side, learning", setting, why, [3.0; 5], cases)
    }

    fn shapes(&self, per_class: &[usize]) -> Result<Series, ScaleError> {
        let recipe = Recipe { classes: 5, ..self.effort.recipe };
        let cases = per_class.iter().map(|&shapes| {
            let basis = recipe.basis.min(shapes - 1);
            ((recipe.classes * shapes) as f64, Recipe { shapes: Some(shapes), basis, ..recipe })
        });
        let setting = format!("{} classes, {} components of each if it has the shapes, {}", recipe.classes, recipe.basis, recipe.dims());
        let why = "inner products of all pairs of a class take its square, eigenvectors of n × n its cube; objects that are held out, and the \
                   views that are rendered, grow with the shapes up to a bound; the model does not grow once it has its components";
        Self::trained("shapes", setting, why, [2.0, 1.0, 0.0, 0.0, 0.0], cases)
    }

    /// A series with the lines of [`training::MEASURES`].
    fn trained(
        name: &str,
        setting: String,
        why: &str,
        expected: [f64; 5],
        cases: impl Iterator<Item = (f64, Recipe)>,
    ) -> Result<Series, ScaleError> {
        let measured: Vec<(f64, Vec<f64>)> =
            cases.map(|(size, recipe)| Ok((size, training::measure(recipe)?))).collect::<Result<_, ScaleError>>()?;
        let (sizes, values): (Vec<f64>, Vec<Vec<f64>>) = measured.into_iter().unzip();
        let lines = training::MEASURES.iter().zip(expected).enumerate();
        let lines = lines.map(|(m, ((name, unit), expected))| Line::of(name, unit, expected, points(&sizes, &values, m))).collect();
        Ok(Series { name: name.into(), setting, why: why.into(), lines })
    }

    fn threads(&self) -> Result<Series, ScaleError> {
        let (recipe, perceiver) = (self.effort.recipe, self.perceiver()?);
        let cores = usable().len().max(1);
        // All of them up to four, then twice as many each time.
        let sizes = (1..=cores).filter(|n| *n <= 4 || n.is_power_of_two() || *n == cores);
        let cases = sizes.map(|threads| {
            let pool: ThreadPool = ThreadPoolBuilder::new().num_threads(threads).build()?;
            Ok((threads as f64, Asked::new(perceiver.clone(), recipe.observations(OBSERVATIONS), Some(pool))))
        });
        self.queries(
            "threads",
            recipe.to_string(),
            "in known pose, and in a search about the vertical by the hull, a query stays on its thread",
            [0.0, 0.0, 0.0],
            cases,
        )
    }

    fn unknown(&self, shares: &[f64]) -> Result<Series, ScaleError> {
        let (recipe, perceiver) = (self.effort.recipe, self.perceiver()?);
        let shapes: Vec<Occupancy> = recipe.observations(OBSERVATIONS).iter().map(Observation::hull).collect();
        let asked = |hide: Hide, share: f64| Asked::new(perceiver.clone(), shapes.iter().map(|shape| hide(shape, share)).collect(), None);
        let hidings: [(&str, Hide); 2] = [("stacks", below_a_level), ("scattered", scattered)];
        let mut cases: Vec<Asked> = hidings.iter().flat_map(|(_, hide)| shares.iter().map(|share| asked(*hide, *share))).collect();
        let medians = in_turns(&mut cases, Asked::once, self.effort.time)?;
        let mut lines = Vec::new();
        for ((hiding, _), medians) in hidings.iter().zip(medians.chunks(shares.len())) {
            for (stage, name) in queries::STAGES.iter().enumerate().take(2) {
                lines.push(Line::new(&format!("{name}, {hiding}"), 1.0, points(shares, medians, stage)));
            }
        }
        let why = "hidden voxels are summed and completed one by one, but for whole levels of stacks, whose sums are kept; known filled \
                   voxels, of which the more are hidden the fewer there are, are summed too";
        Ok(Series { name: "share of voxels hidden".into(), setting: format!("{recipe}, all scored by evidence"), why: why.into(), lines })
    }

    fn subscribers(&self, sizes: &[usize]) -> Result<Series, ScaleError> {
        let dims: Dims = self.effort.recipe.dims();
        let sides = <[usize; 3]>::from(dims).map(|side| side as u32);
        let mut cases = sizes.iter().map(|count| Published::open(*count, sides)).collect::<Result<Vec<_>, _>>()?;
        let medians = in_turns(&mut cases, Published::once, self.effort.time / 3)?;
        let sizes: Vec<f64> = sizes.iter().map(|count| *count as f64).collect();
        let stages = publishing::STAGES.iter().enumerate();
        let lines = stages.map(|(stage, name)| Line::new(name, 1.0, points(&sizes, &medians, stage))).collect();
        let setting = format!("percept and completion of {dims}, all in one process");
        let why = "every subscriber has its own queue and wake-up; the grids are written once";
        Ok(Series { name: "subscribers".into(), setting, why: why.into(), lines })
    }

    /// A series with the lines of [`queries::STAGES`].
    fn queries(
        &self,
        name: &str,
        setting: String,
        why: &str,
        expected: [f64; 3],
        cases: impl Iterator<Item = Result<(f64, Asked), ScaleError>>,
    ) -> Result<Series, ScaleError> {
        self.timed(name, setting, why, (queries::STAGES, expected), Asked::once, cases)
    }

    /// A series with the lines of [`queries::CAMERA_STAGES`].
    fn camera_queries(
        &self,
        name: &str,
        setting: String,
        why: &str,
        expected: [f64; 2],
        cases: impl Iterator<Item = Result<(f64, Asked), ScaleError>>,
    ) -> Result<Series, ScaleError> {
        self.timed(name, setting, why, (queries::CAMERA_STAGES, expected), Asked::once_by_camera, cases)
    }

    /// A series with a line for each stage, with its expected exponent, of what `once` times.
    fn timed<const N: usize>(
        &self,
        name: &str,
        setting: String,
        why: &str,
        (stages, expected): ([&str; N], [f64; N]),
        once: impl Fn(&mut Asked) -> Result<Vec<f64>, PerceiveError>,
        cases: impl Iterator<Item = Result<(f64, Asked), ScaleError>>,
    ) -> Result<Series, ScaleError> {
        let (sizes, mut cases): (Vec<f64>, Vec<Asked>) = cases.collect::<Result<Vec<_>, _>>()?.into_iter().unzip();
        let medians = in_turns(&mut cases, once, self.effort.time)?;
        let lines = stages.iter().zip(expected).enumerate();
        let lines = lines.map(|(stage, (name, expected))| Line::new(name, expected, points(&sizes, &medians, stage))).collect();
        Ok(Series { name: name.into(), setting, why: why.into(), lines })
    }

    fn perceiver(&self) -> Result<Arc<Perceiver>, ScaleError> {
        if self.perceiver.get().is_none() {
            let made = Perceiver::new(Arc::new(self.effort.recipe.learn()?))?;
            let _ = self.perceiver.set(Arc::new(made));
        }
        Ok(self.perceiver.get().expect("just made").clone())
    }
}

impl Recipe {
    /// A case of this model, whose size is found in it.
    fn asked(self, size: impl Fn(&Model) -> f64) -> Result<(f64, Asked), ScaleError> {
        let model = self.learn()?;
        let size = size(&model);
        let perceiver = Perceiver::new(Arc::new(model))?;
        let count = if perceiver.model().levels().is_empty() { OBSERVATIONS } else { FEW_OBSERVATIONS };
        Ok((size, Asked::new(Arc::new(perceiver), self.observations(count), None)))
    }
}

impl Recipe {
    /// A case of this model with cameras, of this size.
    fn asked_by_camera(self, size: f64) -> Result<(f64, Asked), ScaleError> {
        let perceiver = Perceiver::new(Arc::new(self.learn_cameras()?))?;
        let (observations, eye) = self.camera_observations(OBSERVATIONS);
        Ok((size, Asked::new(Arc::new(perceiver), observations, None).seen_from(eye)))
    }
}

/// Hides a share of a shape's voxels.
type Hide = fn(&Occupancy, f64) -> Observation;

/// The observation of a shape of which all below a level is hidden.
fn below_a_level(shape: &Occupancy, share: f64) -> Observation {
    let z = shape.dims().z();
    let hidden = (share * z as f64).round() as usize;
    observe(shape, |voxel| voxel % z >= hidden)
}

/// The observation of a shape of which voxels are hidden at random.
fn scattered(shape: &Occupancy, share: f64) -> Observation {
    let mut rng = ChaCha8Rng::seed_from_u64(0);
    observe(shape, |_| rng.random_range(0.0..1.0) >= share)
}

fn observe(shape: &Occupancy, mut is_known: impl FnMut(usize) -> bool) -> Observation {
    let mut seen = Observation::unknown(shape.dims());
    (0..shape.dims().voxels()).filter(|voxel| is_known(*voxel)).for_each(|voxel| seen.set(voxel, shape.bits().contains(voxel)));
    seen
}

fn points(sizes: &[f64], medians: &[Vec<f64>], stage: usize) -> Vec<(f64, f64)> {
    sizes.iter().zip(medians).map(|(size, medians)| (*size, medians[stage])).collect()
}

/// Medians of each case's stages, the cases measured in turns.
fn in_turns<C, E>(cases: &mut [C], once: impl Fn(&mut C) -> Result<Vec<f64>, E>, time: Duration) -> Result<Vec<Vec<f64>>, E> {
    let mut measured: Vec<Vec<Vec<f64>>> = Vec::new();
    for case in cases.iter_mut() {
        // Not counted: it warms up.
        measured.push(once(case)?.iter().map(|_| Vec::new()).collect());
    }
    let (start, mut rounds) = (Instant::now(), 0);
    while rounds < FEWEST_ROUNDS || start.elapsed() < time {
        for (case, stages) in cases.iter_mut().zip(&mut measured) {
            for _ in 0..BATCH {
                stages.iter_mut().zip(once(case)?).for_each(|(stage, value)| stage.push(value));
            }
        }
        rounds += 1;
    }
    Ok(measured.into_iter().map(|stages| stages.into_iter().map(|stage| median(stage.into_iter())).collect()).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::convert::Infallible;

    #[test]
    fn cases_have_their_turns_and_each_stage_its_median() {
        // Each case answers with itself plus how often it was asked: 0 when warming up, then 1 to 15.
        let mut cases = [(10.0, 0.0), (20.0, 0.0)];
        let once = |case: &mut (f64, f64)| {
            case.1 += 1.0;
            Ok::<_, Infallible>(vec![case.0 + case.1 - 1.0, 1.0])
        };
        let medians = in_turns(&mut cases, once, Duration::ZERO).unwrap();
        assert_eq!(medians, [[18.0, 1.0], [28.0, 1.0]]);
    }

    #[test]
    fn as_much_is_hidden_as_asked() {
        let shape = QUICK.recipe.observations(1)[0].hull();
        for share in [0.25, 0.5] {
            for hide in [below_a_level, scattered] {
                let seen = hide(&shape, share);
                let hidden = 1.0 - seen.known().count_ones(..) as f64 / shape.dims().voxels() as f64;
                assert!((hidden - share).abs() < 0.05, "{hidden} {share}");
                assert!(seen.filled().is_subset(shape.bits()));
            }
        }
    }

    #[test]
    fn models_are_as_large_as_the_recipe_says() {
        let recipe = Recipe { resolution: 12, classes: 3, basis: 6, shapes: None };
        let model = recipe.learn().unwrap();
        assert_eq!(model.dims(), Dims::cube(12).unwrap());
        assert_eq!(model.metadata.classes.iter().map(|c| c.basis_size).collect::<Vec<_>>(), [6; 3]);
        assert_eq!(model.basis.values(), recipe.learn().unwrap().basis.values());
    }
}
