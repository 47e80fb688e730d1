//! Table I's layout: accuracy by class, methods side by side, beside the paper's rows; and the pose errors of Fig. 5.

use super::metrics::PoseFigures;
use super::{Evaluation, IcpEvaluation};
use std::fmt::Write;

/// The paper's Table I, known pose, in percent: BEO, its baseline and 3DShapeNets, classes in alphabetical order, then total.
pub(super) const PAPER: [(&str, [f64; 11]); 3] = [
    ("paper: BEO", [48.0, 95.0, 93.0, 46.5, 64.0, 91.0, 55.8, 92.0, 75.0, 80.0, 76.3]),
    ("paper: baseline", [70.0, 94.0, 0.0, 17.4, 67.4, 78.0, 75.6, 88.0, 0.0, 82.0, 56.7]),
    ("paper: 3DShapeNets", [76.0, 77.0, 38.0, 22.1, 90.7, 74.0, 38.4, 57.0, 1.0, 79.0, 54.4]),
];
/// The bottom of Table I: rotation about z unknown, in \[0°, 180°).
pub(super) const PAPER_UNKNOWN_POSE: [(&str, [f64; 11]); 1] =
    [("paper: BEO", [4.0, 64.0, 83.0, 16.3, 51.2, 86.0, 36.0, 49.0, 76.0, 46.0, 54.5])];
/// ModelNet10's classes, in the order of the rows of [`PAPER`].
pub(super) const MODELNET10: [&str; 10] =
    ["bathtub", "bed", "chair", "desk", "dresser", "monitor", "night_stand", "sofa", "table", "toilet"];

/// Accuracies in percent by class and in total, one row per evaluation; with ModelNet10's classes also the paper's rows.
/// In unknown pose rotation errors follow, with those of ICP where it was measured.
pub fn table(evaluations: &[Evaluation], icp: &[IcpEvaluation]) -> String {
    let Some(first) = evaluations.first() else { return String::new() };
    let classes: Vec<&String> = first.per_class.keys().collect();
    let width = |class: &str| class.len().max(6);
    let mut text = format!("{:<19}", "accuracy (%)");
    for class in &classes {
        let _ = write!(text, " {class:>width$}", width = width(class));
    }
    text.push_str("  total\n");
    for evaluation in evaluations {
        let _ = write!(text, "{:<19}", name(evaluation));
        for class in &classes {
            let accuracy = evaluation.per_class.get(*class).map_or(f64::NAN, |c| 100.0 * c.accuracy);
            let _ = write!(text, " {accuracy:>width$.1}", width = width(class));
        }
        let _ = writeln!(text, " {:>6.1}", 100.0 * evaluation.accuracy);
    }
    if classes.iter().map(|c| c.as_str()).eq(MODELNET10) {
        for (name, values) in paper_rows(first.pose) {
            let _ = write!(text, "{name:<19}");
            for (class, value) in classes.iter().zip(values) {
                let _ = write!(text, " {value:>width$.1}", width = width(class));
            }
            let _ = writeln!(text, " {:>6.1}", values[10]);
        }
    }
    text.push('\n');
    let _ = writeln!(
        text,
        "{:<18} {:>7} {:>8} {:>6} {:>7} {:>9}  {:>11} {:>8} {:>13} {:>10} {:>6}  {:>8} {:>8}",
        "method",
        "queries",
        "accuracy",
        "ECE",
        "Brier",
        "log loss",
        "IoU unknown",
        "IoU all",
        "mean: unknown",
        "mean: all",
        "l2",
        "p50 ms",
        "p99 ms"
    );
    for e in evaluations {
        let (c, q) = (&e.completion, &e.calibration);
        let _ = writeln!(
            text,
            "{:<18} {:>7} {:>8.3} {:>6.3} {:>7.3} {:>9.3}  {:>11.3} {:>8.3} {:>13.3} {:>10.3} {:>6.1}  {:>8.2} {:>8.2}",
            name(e),
            e.queries,
            e.accuracy,
            q.ece,
            q.brier,
            q.log_loss,
            c.iou_unknown,
            c.iou_all,
            c.iou_unknown_mean_baseline,
            c.iou_all_mean_baseline,
            c.l2,
            e.query_ms.p50,
            e.query_ms.p99
        );
    }
    let of_methods = evaluations.iter().filter_map(|e| Some((name(e), e.pose_error_deg?, e.query_ms.p50)));
    let of_icp = icp.iter().map(|e| (icp_name(e), e.pose_error_deg, e.query_ms.p50));
    let rows: Vec<(String, PoseFigures, f64)> = of_methods.chain(of_icp).collect();
    if !rows.is_empty() {
        let _ = writeln!(
            text,
            "\n{:<22} {:>7} {:>7} {:>7} {:>22} {:>8}",
            "pose error (degrees)", "median", "mean", "p90", "symmetry-aware median", "p50 ms"
        );
        for (name, pose, ms) in rows {
            let PoseFigures { median, mean, p90, symmetry_aware_median } = pose;
            let _ = writeln!(text, "{name:<22} {median:>7.2} {mean:>7.2} {p90:>7.2} {symmetry_aware_median:>22.2} {ms:>8.2}");
        }
    }
    if evaluations.iter().any(|e| e.placement.is_some()) {
        let _ = writeln!(
            text,
            "\n{:<22} {:>7} {:>7} {:>7} {:>22} {:>22}",
            "size and place", "centre", "size", "lengths", "centre within 1 dev.", "lengths within 1 dev."
        );
        for (e, figures) in evaluations.iter().filter_map(|e| Some((e, e.placement?))) {
            let [centre, size, extent, centre_within, extent_within] = [
                figures.centre_median,
                figures.size_median,
                figures.extent_median,
                figures.centre_within_one_deviation,
                figures.extent_within_one_deviation,
            ];
            let _ = writeln!(text, "{:<22} {centre:>7.3} {size:>7.3} {extent:>7.3} {centre_within:>22.2} {extent_within:>22.2}", name(e));
        }
    }
    text
}

/// Method and viewpoint, for rows and columns.
pub(super) fn name(evaluation: &Evaluation) -> String {
    format!("{}{}", evaluation.method.name(), evaluation.viewpoint.label())
}

/// The paper's rows that an evaluation can be compared with.
pub(super) fn paper_rows(pose: &str) -> &'static [(&'static str, [f64; 11])] {
    match pose {
        "known" => &PAPER,
        "yaw" => &PAPER_UNKNOWN_POSE,
        _ => &[],
    }
}

/// ICP's name in tables and plots.
pub(super) fn icp_name(icp: &IcpEvaluation) -> String {
    if icp.starts == 1 { "ICP, 1 start".into() } else { format!("ICP, {} starts", icp.starts) }
}
