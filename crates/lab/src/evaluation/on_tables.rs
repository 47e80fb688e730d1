//! Shapes on tables: each at rest in one of its own stable poses, seen by a depth sensor with its faults, everything unknown.

use super::metrics::{CalibrationFigures, calibration, percentile};
use beo_core::grid::{Occupancy, Rotation};
use beo_core::learning::{AtRest, ShapeSet, ViewSample, draw_by, stable_poses};
use beo_core::perception::{PerceiveError, Perceiver, Percept};
use beo_core::simulation::Sensing;
use nalgebra::{Unit, Vector3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde::Serialize;
use std::collections::BTreeMap;
use std::f64::consts::{FRAC_PI_4, TAU};
use std::fmt::Write;

/// Attempts at a view in which enough of a shape is seen.
const ATTEMPTS: usize = 5;
/// An axis within this is found, degrees.
const FOUND_DEG: f64 = 10.0;
/// How many times as long as the others the longest side of a slender shape is.
const SLENDER: f64 = 1.15;

/// In which poses shapes rest.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Resting {
    /// As they stand canonically.
    Upright,
    /// In stable poses in which their canonical vertical is more than 45° from the vertical, by their probability.
    Lying,
}

/// How shapes are seen.
#[derive(Clone, Copy, Debug)]
pub struct TableProtocol {
    /// In which poses they rest.
    pub resting: Resting,
    /// Faults of sensors and masks.
    pub sensing: Sensing,
    /// Lowest and highest elevation of the camera, radians.
    pub elevations_rad: [f64; 2],
    /// Views of each shape.
    pub views: usize,
    /// Seed.
    pub seed: u64,
}

/// Figures of one class.
#[derive(Clone, Copy, Debug, Default, Serialize)]
pub struct TableClass {
    /// Number of queries.
    pub queries: usize,
    /// Share named rightly.
    pub accuracy: f64,
    /// Share whose axis is within ten degrees of the true one.
    pub axis_found: f64,
}

/// The outcome.
#[derive(Clone, Debug, Serialize)]
pub struct TableFigures {
    /// Number of queries.
    pub queries: usize,
    /// Views that were not asked about, because too little was seen or the shape does not rest so.
    pub unseen: usize,
    /// Share named rightly.
    pub accuracy: f64,
    /// Calibration of the posteriors.
    pub calibration: CalibrationFigures,
    /// Share of the queries with `none_probability` above a half.
    pub called_none: f64,
    /// Share of the queries whose axis is within ten degrees of the true one.
    pub axis_found: f64,
    /// Median angle between the axes, degrees.
    pub axis_median_deg: f64,
    /// Median error of the longest side, as a share of it, of those named rightly.
    pub longest_side: f64,
    /// Median error of the centre, as a share of the longest side, of those named rightly.
    pub centre: f64,
    /// By true class.
    pub per_class: BTreeMap<String, TableClass>,
    /// Counts by true class, then answer.
    pub confusion: BTreeMap<String, BTreeMap<String, usize>>,
}

/// Asks about all shapes. `classes` maps a shape's class to the model's; `seen` is called after each view.
pub fn on_tables(
    perceiver: &Perceiver,
    shapes: &ShapeSet,
    classes: &[usize],
    protocol: &TableProtocol,
    mut seen: impl FnMut(),
) -> Result<TableFigures, PerceiveError> {
    let names: Vec<&str> = perceiver.model().class_names().collect();
    let (mut work, mut percept) = (perceiver.workspace(), Percept::default());
    let mut asked: Vec<Asked> = Vec::new();
    let (mut posteriors, mut truths, mut none, mut unseen) = (Vec::new(), Vec::new(), 0, 0);
    for (n, shape) in shapes.shapes.iter().enumerate() {
        let side_m = shapes.lengths_m.as_ref().map(|lengths| lengths[n].into_iter().fold(0.0, f64::max));
        let fine = shapes.fine.as_ref().map(|fine| &fine[n]);
        for view in 0..protocol.views {
            let mut rng = ChaCha8Rng::seed_from_u64(protocol.seed);
            rng.set_stream((n * protocol.views + view) as u64);
            let sample = protocol.see(&shape.object, fine, side_m, &mut rng);
            seen();
            let Some(sample) = sample else {
                unseen += 1;
                continue;
            };
            perceiver.classify(&sample.observation, &sample.query(true), &mut work, &mut percept)?;
            let truth = classes[shape.class];
            asked.push(Asked::new(truth, &sample, &percept));
            posteriors.push(percept.posterior.clone());
            truths.push(truth);
            none += usize::from(percept.none_probability.is_some_and(|p| p > 0.5));
        }
    }
    let share =
        |of: &[&Asked], is_one: &dyn Fn(&Asked) -> bool| of.iter().filter(|asked| is_one(asked)).count() as f64 / of.len().max(1) as f64;
    let (is_right, is_found) = (|asked: &Asked| asked.class == asked.truth, |asked: &Asked| asked.axis_deg <= FOUND_DEG);
    let all: Vec<&Asked> = asked.iter().collect();
    let mut per_class = BTreeMap::new();
    let mut confusion: BTreeMap<String, BTreeMap<String, usize>> = BTreeMap::new();
    for (class, name) in names.iter().enumerate() {
        let of: Vec<&Asked> = asked.iter().filter(|asked| asked.truth == class).collect();
        if !of.is_empty() {
            let figures = TableClass { queries: of.len(), accuracy: share(&of, &is_right), axis_found: share(&of, &is_found) };
            per_class.insert((*name).to_owned(), figures);
        }
        for asked in of {
            *confusion.entry((*name).to_owned()).or_default().entry(names[asked.class].to_owned()).or_default() += 1;
        }
    }
    let of_right = |value: fn(&Asked) -> f64| asked.iter().filter(|asked| is_right(asked)).map(value).collect::<Vec<_>>();
    let axes: Vec<f64> = asked.iter().map(|asked| asked.axis_deg).collect();
    Ok(TableFigures {
        queries: asked.len(),
        unseen,
        accuracy: share(&all, &is_right),
        calibration: calibration(&posteriors, &truths),
        called_none: none as f64 / asked.len().max(1) as f64,
        axis_found: share(&all, &is_found),
        axis_median_deg: percentile(&axes, 50.0),
        longest_side: percentile(&of_right(|asked| asked.longest_side), 50.0),
        centre: percentile(&of_right(|asked| asked.centre), 50.0),
        per_class,
        confusion,
    })
}

impl TableProtocol {
    fn see(&self, object: &Occupancy, fine: Option<&Occupancy>, side_m: Option<f64>, rng: &mut ChaCha8Rng) -> Option<ViewSample> {
        let up = match self.resting {
            Resting::Upright => Vector3::z_axis(),
            Resting::Lying => lying(object, rng)?,
        };
        let rotation = Rotation::rotation_between(&up, &Vector3::z_axis())?;
        let at_rest = AtRest::new(object, fine, rotation, side_m)?;
        let [lowest, highest] = self.elevations_rad;
        (0..ATTEMPTS).find_map(|_| {
            let elevation = lowest + (highest - lowest) * rng.random_range(0.0..1.0);
            at_rest.see_finely(rng.random_range(0.0..TAU), elevation, self.sensing, rng)
        })
    }
}

/// A direction that points up when the shape lies, drawn by its probability.
fn lying(object: &Occupancy, rng: &mut ChaCha8Rng) -> Option<Unit<Vector3<f64>>> {
    let is_lying = |up: &Unit<Vector3<f64>>| up.z.abs() < FRAC_PI_4.cos();
    let ways: Vec<_> = stable_poses(object).into_iter().filter(|way| is_lying(&way.up)).collect();
    draw_by(&ways, |way| way.probability, rng).map(|way| way.up)
}

/// The angle between the axes of a shape, whichever way they point, degrees: that between its canonical verticals, or, where its longest side is
/// longer than the others by [`SLENDER`] in truth and as found, that between these sides if it is smaller, since of a box any side may be upright.
fn axis_error_deg(placed: [&Rotation; 2], lengths: [&[f64; 3]; 2]) -> f64 {
    let between = |axes: [Vector3<f64>; 2]| {
        let [a, b] = std::array::from_fn(|n| placed[n] * axes[n]);
        a.dot(&b).abs().min(1.0).acos().to_degrees()
    };
    let vertical = between([Vector3::z(), Vector3::z()]);
    match lengths.map(longest_axis) {
        [Some(a), Some(b)] => vertical.min(between([a, b])),
        _ => vertical,
    }
}

/// The direction of the longest of three sides, if it is longer than the others by [`SLENDER`].
fn longest_axis(lengths: &[f64; 3]) -> Option<Vector3<f64>> {
    let longest = (0..3).max_by(|a, b| lengths[*a].total_cmp(&lengths[*b]))?;
    let is_slender = (0..3).all(|axis| axis == longest || lengths[longest] > SLENDER * lengths[axis]);
    is_slender.then(|| Vector3::from_fn(|axis, _| f64::from(u8::from(axis == longest))))
}

/// One answer beside the truth.
struct Asked {
    truth: usize,
    class: usize,
    /// Angle between the axes, whichever way they point, degrees.
    axis_deg: f64,
    /// Errors as shares of the true longest side.
    longest_side: f64,
    centre: f64,
}

impl Asked {
    fn new(truth: usize, sample: &ViewSample, percept: &Percept) -> Self {
        let lengths = sample.lengths.map(|length| length * sample.placed.scale);
        let longest = lengths.into_iter().fold(0.0, f64::max);
        let found = percept.object_box.map_or(lengths, |found| found.extent_voxels);
        Self {
            truth,
            class: percept.class,
            axis_deg: axis_error_deg([&sample.placed.rotation, &percept.rotation_object_to_grid], [&lengths, &found]),
            longest_side: (found.into_iter().fold(0.0, f64::max) - longest).abs() / longest,
            centre: (percept.placed.translation_voxels - sample.placed.translation_voxels).norm() / longest,
        }
    }
}

impl TableFigures {
    /// As text: a line of figures, then one for each class.
    pub fn table(&self) -> String {
        let percent = |share: f64| 100.0 * share;
        let mut text = String::new();
        let _ = writeln!(
            text,
            "named rightly {:.1} % of {} (ECE {:.3}, log loss {:.3}); called none {:.1} %; {} not seen",
            percent(self.accuracy),
            self.queries,
            self.calibration.ece,
            self.calibration.log_loss,
            percent(self.called_none),
            self.unseen
        );
        let _ = writeln!(
            text,
            "axis within 10° {:.1} %, median {:.1}°; of those named rightly, medians: longest side {:.1} %, centre {:.1} % of it",
            percent(self.axis_found),
            self.axis_median_deg,
            percent(self.longest_side),
            percent(self.centre)
        );
        let width = self.per_class.keys().map(String::len).max().unwrap_or(0);
        for (class, figures) in &self.per_class {
            let others = self.confusion[class].iter().filter(|(other, _)| *other != class);
            let others: Vec<String> = others.map(|(other, count)| format!("{other} {count}")).collect();
            let _ = writeln!(
                text,
                "  {class:width$} {:5.1} % of {:4}, axis {:5.1} %  {}",
                percent(figures.accuracy),
                figures.queries,
                percent(figures.axis_found),
                others.join(", ")
            );
        }
        text
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use beo_core::grid::Dims;

    fn solid(is_inside: impl Fn(f64, f64, f64) -> bool) -> Occupancy {
        Occupancy::from_fn(Dims::cube(30).unwrap(), |i, j, k| is_inside(i as f64 - 14.5, j as f64 - 14.5, k as f64 - 14.5))
    }

    #[test]
    fn a_can_lies_on_its_side() {
        let can = solid(|x, y, z| x.hypot(y) < 6.0 && z.abs() < 10.0);
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        for _ in 0..20 {
            assert!(lying(&can, &mut rng).unwrap().z.abs() < 0.1);
        }
    }

    /// A box of 20 × 8 × 14 that lies on its largest side may as well be one of 8 × 14 × 20 that stands on its smallest and was turned over.
    #[test]
    fn the_axis_of_a_box_is_that_of_its_longest_side() {
        let quarter = |axis: Unit<Vector3<f64>>| Rotation::from_axis_angle(&axis, std::f64::consts::FRAC_PI_2);
        let (here, over) = (Rotation::identity(), quarter(Vector3::y_axis()));
        assert!(axis_error_deg([&here, &over], [&[20.0, 8.0, 14.0], &[14.0, 8.0, 20.0]]) < 1e-6);
        assert!((axis_error_deg([&here, &over], [&[20.0, 8.0, 14.0], &[20.0, 8.0, 14.0]]) - 90.0).abs() < 1e-6);
        // Of what is not slender it is the vertical, whichever way it points.
        assert!((axis_error_deg([&here, &over], [&[20.0, 19.0, 14.0], &[14.0, 19.0, 20.0]]) - 90.0).abs() < 1e-6);
        let upside_down = over * over;
        assert!(axis_error_deg([&here, &upside_down], [&[9.0, 9.0, 4.0]; 2]) < 1e-6);
    }
}
