//! Pictures of an evaluation: counterparts of the paper's Figs. 3 to 6, accuracy by class (Table I) and reliability.

use super::curves::{by_elevation, by_views};
use super::table::{MODELNET10, icp_name, paper_rows};
use super::{Evaluation, IcpEvaluation, table};
use beo_core::grid::{Observation, Occupancy};
use beo_core::perception::Percept;
use beo_picture::{
    Chart, Colour, Image, MOST_UNSURE, SaveError, draw_completion, draw_deviation, draw_observation, draw_poses, draw_shape, sheet,
};
use std::path::Path;

/// How many completions are shown.
pub const EXAMPLES: usize = 10;
/// Bins of the confidence, as for the expected calibration error.
const BINS: usize = 15;
/// Queries below which a bin is not drawn: one or two say nothing of a share.
const FEWEST: f64 = 3.0;
/// Side of one picture of voxels in pixels.
const SIDE: usize = 200;

/// One query of [`completions`] with its answer, drawn when made so that no voxels need to be kept.
pub struct Example {
    truth: (Image, String),
    query: (Image, String),
    completion: (Image, String),
    deviation: (Image, String),
}

impl Example {
    /// Draws a query and its completed answer. `names` are the model's classes, `truth` is the index of the true one.
    pub fn new(names: &[&str], truth: usize, object: &Occupancy, observation: &Observation, percept: &Percept) -> Self {
        let name = |s: usize| names.get(s).copied().unwrap_or("?");
        let p = percept.posterior.get(percept.class).copied().unwrap_or(0.0);
        let verdict = if percept.class == truth { "" } else { ", wrong" };
        Self {
            truth: (draw_shape(object, SIDE, Colour::SERIES[2]), format!("truth: {}", name(truth))),
            query: match percept.rotation_spread_rad {
                0.0 => (draw_observation(observation, SIDE), "query".into()),
                spread => (
                    draw_poses(observation, percept.hypotheses.iter().map(|h| (h.rotation, h.probability)), SIDE),
                    format!("± {:.0}°", spread.to_degrees()),
                ),
            },
            completion: (
                draw_completion(observation, &percept.occupancy, SIDE),
                format!("{} {:.0} %{verdict}", name(percept.class), 100.0 * p),
            ),
            deviation: (draw_deviation(observation, &percept.occupancy, &percept.deviation, SIDE), String::new()),
        }
    }
}

/// `count` places spread evenly over `0..total`, or all of them where there are no more.
pub fn spread(total: usize, count: usize) -> Vec<usize> {
    if total <= count { (0..total).collect() } else { (0..count).map(|i| (2 * i + 1) * total / (2 * count)).collect() }
}

/// Euclidean completion error by method, one point per query, the mean as a bar: the counterpart of Fig. 3, left.
pub fn completion_error(evaluations: &[Evaluation]) -> Image {
    let strips: Vec<_> = evaluations.iter().map(|e| strip(e, &e.per_query.iter().map(|q| q.l2).collect::<Vec<_>>(), "")).collect();
    chart(evaluations, "Completion error", "method (bar: mean)", "Euclidean distance to the truth").strips(&strips)
}

/// Time of a query by method, one point per query, the mean as a bar: the counterpart of Fig. 3, right.
pub fn query_time(evaluations: &[Evaluation]) -> Image {
    let strips: Vec<_> = evaluations.iter().map(|e| strip(e, &e.per_query.iter().map(|q| q.ms).collect::<Vec<_>>(), " ms")).collect();
    let chart = chart(evaluations, "Time of one query, completion included", "method (bar: mean)", "milliseconds, logarithmic");
    Chart { y_log: true, ..chart }.strips(&strips)
}

/// Rotation error by method, one point per query, the mean as a bar, raw and symmetry-aware: the counterpart of Figs. 5 and 6.
pub fn pose_error(evaluations: &[Evaluation], icp: &[IcpEvaluation]) -> Image {
    let of_methods = evaluations.iter().map(|e| (table::name(e), e.per_query.iter().filter_map(|q| q.pose_error).collect::<Vec<_>>()));
    let all = of_methods.chain(icp.iter().map(|e| (icp_name(e), e.per_query.clone())));
    let mut strips = Vec::new();
    for (name, errors) in all {
        for (kind, values) in [
            ("", errors.iter().map(|e| e.raw_deg).collect::<Vec<f64>>()),
            (" by symmetry", errors.iter().map(|e| e.symmetry_aware_deg).collect()),
        ] {
            let mean = values.iter().sum::<f64>() / values.len().max(1) as f64;
            strips.push((format!("{name}{kind}: {mean:.1}°"), values));
        }
    }
    let queries = evaluations.first().map_or(0, |e| e.queries);
    let chart = Chart::new(&format!("Pose error, {queries} queries"), "method (bar: mean)", "angle to the true rotation, degrees");
    Chart { width: 240 + 190 * strips.len().max(2), ..chart }.strips(&strips)
}

fn strip(evaluation: &Evaluation, values: &[f64], unit: &str) -> (String, Vec<f64>) {
    let mean = values.iter().sum::<f64>() / values.len().max(1) as f64;
    (format!("{}: {mean:.2}{unit}", table::name(evaluation)), values.to_vec())
}

fn chart(evaluations: &[Evaluation], what: &str, x: &str, y: &str) -> Chart {
    let queries = evaluations.first().map_or(0, |e| e.queries);
    let chart = Chart::new(&format!("{what}, {queries} queries"), x, y);
    Chart { width: 240 + 170 * evaluations.len().max(2), ..chart }
}

/// Accuracy by class and in total; with ModelNet10's classes beside the paper's.
pub fn accuracy(evaluations: &[Evaluation]) -> Image {
    let Some(first) = evaluations.first() else { return Image::new(1, 1) };
    let mut categories: Vec<String> = first.per_class.keys().cloned().collect();
    let values = |e: &Evaluation| {
        let of_class = |class: &String| e.per_class.get(class).map_or(f64::NAN, |c| c.accuracy);
        categories.iter().map(of_class).chain([e.accuracy]).collect()
    };
    let mut series: Vec<(String, Vec<f64>)> = evaluations.iter().map(|e| (table::name(e), values(e))).collect();
    if categories.iter().map(String::as_str).eq(MODELNET10) {
        series.extend(
            paper_rows(first.pose).iter().take(1).map(|(name, percent)| ((*name).to_owned(), percent.iter().map(|p| p / 100.0).collect())),
        );
    }
    categories.push("all".to_owned());
    let title = format!("Accuracy by class, {} queries", first.queries);
    let width = (110 + categories.len() * (24 + 36 * series.len())).clamp(480, 2800);
    let chart = Chart { width, y_range: Some(0.0..1.06), ..Chart::new(&title, "class", "share answered rightly") };
    chart.bars(&categories, &series)
}

/// Queries by confidence in 15 bins: mean confidence, share answered rightly, number of queries; empty bins are left out.
fn reliability_bins(evaluation: &Evaluation) -> Vec<(f64, f64, f64)> {
    let mut bins = [(0.0, 0.0, 0.0); BINS];
    for prediction in &evaluation.predictions {
        let confidence = prediction.posterior.get(&prediction.class).copied().unwrap_or(0.0);
        let bin = &mut bins[((confidence * BINS as f64) as usize).min(BINS - 1)];
        bin.0 += confidence;
        bin.1 += f64::from(u8::from(prediction.class == prediction.truth));
        bin.2 += 1.0;
    }
    bins.into_iter().filter(|bin| bin.2 > 0.0).map(|(confidence, right, count)| (confidence / count, right / count, count)).collect()
}

/// How often answers are right against how sure they are; on the diagonal, posteriors can be taken at their word.
pub fn reliability(evaluations: &[Evaluation]) -> Image {
    let series: Vec<_> = evaluations
        .iter()
        .map(|e| {
            (
                format!("{} (ECE {:.3})", e.method, e.calibration.ece),
                reliability_bins(e).into_iter().filter(|bin| bin.2 >= FEWEST).collect(),
            )
        })
        .collect();
    let y = "share answered rightly";
    let chart = Chart::new("Reliability", "probability of the answer, in bins of 1/15 (area: queries; bins below 3 not drawn)", y);
    let width = (160 + 160 * series.len()).max(560);
    Chart { width, height: 560, x_range: Some(0.0..1.0), y_range: Some(0.0..1.0), diagonal: true, ..chart }.weighted_lines(&series)
}

/// Truth, query, completion and its standard deviation in four rows, one query per column: the counterpart of Fig. 4.
pub fn completions(examples: &[Example], method: &str) -> Image {
    let row = |part: fn(&Example) -> &(Image, String)| examples.iter().map(|e| part(e).clone()).collect();
    let title = format!(
        "Completions ({method}): truth, query (blue seen, grey unknown; arrows: fronts of the hypotheses), answer (orange predicted), \
         its standard deviation (dark 0, yellow {MOST_UNSURE} and more)"
    );
    sheet(&[row(|e| &e.truth), row(|e| &e.query), row(|e| &e.completion), row(|e| &e.deviation)], &title)
}

/// Draws everything into an existing folder. `examples` are answers of the first evaluation's method.
pub fn save(folder: &Path, evaluations: &[Evaluation], icp: &[IcpEvaluation], examples: &[Example]) -> Result<(), SaveError> {
    let method = evaluations.first().map_or("", |e| e.method.name());
    completion_error(evaluations).save(&folder.join("completion_error.png"))?;
    query_time(evaluations).save(&folder.join("query_time.png"))?;
    accuracy(evaluations).save(&folder.join("accuracy.png"))?;
    reliability(evaluations).save(&folder.join("reliability.png"))?;
    if evaluations.iter().any(|e| e.pose_error_deg.is_some()) {
        pose_error(evaluations, icp).save(&folder.join("pose_error.png"))?;
    }
    for (image, file) in [(by_elevation(evaluations), "elevation.png"), (by_views(evaluations), "views.png")] {
        image.map_or(Ok(()), |image| image.save(&folder.join(file)))?;
    }
    completions(examples, method).save(&folder.join("completions.png"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::evaluation::metrics::{self, CalibrationFigures};
    use crate::evaluation::protocol::{CompletionFigures, Milliseconds, Prediction};
    use beo_core::perception::Method;
    use std::collections::BTreeMap;

    /// Answers of "a" with these confidences, among two classes; every third is wrong.
    fn evaluation(confidences: &[f64]) -> Evaluation {
        let truths: Vec<usize> = (0..confidences.len()).map(|n| usize::from(n % 3 == 2)).collect();
        let posteriors: Vec<Vec<f64>> = confidences.iter().map(|p| vec![*p, 1.0 - p]).collect();
        let predictions = confidences.iter().zip(&truths).map(|(p, truth)| Prediction {
            file: String::new(),
            truth: ["a", "b"][*truth].into(),
            class: "a".into(),
            posterior: BTreeMap::from([("a".into(), *p), ("b".into(), 1.0 - p)]),
            pose_error: None,
        });
        let calibration: CalibrationFigures = metrics::calibration(&posteriors, &truths);
        Evaluation {
            pose: "known",
            viewpoint: crate::evaluation::Viewpoint::Top,
            placement: None,
            method: Method::Auto,
            queries: confidences.len(),
            accuracy: 2.0 / 3.0,
            per_class: BTreeMap::new(),
            confusion: BTreeMap::new(),
            completion: CompletionFigures::default(),
            pose_error_deg: None,
            calibration,
            query_ms: Milliseconds { p50: 1.0, p90: 1.0, p99: 1.0 },
            predictions: predictions.collect(),
            per_query: Vec::new(),
        }
    }

    #[test]
    fn examples_are_spread_over_all_queries() {
        assert_eq!(spread(3, 8), [0, 1, 2]);
        assert_eq!(spread(80, 8), [5, 15, 25, 35, 45, 55, 65, 75]);
        assert_eq!(spread(9, 8).len(), 8);
        assert!(spread(0, 8).is_empty());
    }

    #[test]
    fn the_bins_drawn_are_those_of_the_calibration_error() {
        let confidences: Vec<f64> = (0..60).map(|n| 0.51 + 0.49 * f64::from(n * 7 % 60) / 60.0).collect();
        let e = evaluation(&confidences);
        let bins = reliability_bins(&e);
        assert_eq!(bins.iter().map(|b| b.2).sum::<f64>(), 60.0);
        let error: f64 = bins.iter().map(|(confidence, right, count)| (confidence - right).abs() * count / 60.0).sum();
        assert!((error - e.calibration.ece).abs() < 1e-12, "{error} {}", e.calibration.ece);
    }

    #[test]
    fn an_evaluation_without_queries_still_draws() {
        let folder = tempfile::tempdir().unwrap();
        save(folder.path(), &[evaluation(&[])], &[], &[]).unwrap();
        save(folder.path(), &[], &[], &[]).unwrap();
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 5);
    }
}
