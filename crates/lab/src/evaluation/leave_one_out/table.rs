//! The outcome as text: one block of rows per resolution.

use super::{LeftOut, OURS, OneView, Outcome};
use crate::evaluation::metrics::CompletionErrors;
use std::fmt::Write;

/// Mean errors with their standard errors by resolution and way to complete, and of how many shapes ours are better than the others by the
/// intersection over union of what was not observed.
pub fn table(outcomes: &[Outcome], view: OneView) -> String {
    let mut text = format!("each shape by a model of all others, seen {}, pose and class known; mean ± standard error\n", view.name());
    let _ = writeln!(
        text,
        "{:>10} {:>6}  {:<17} {:>15} {:>15} {:>15}  beo better, worse, equal",
        "resolution", "shapes", "completed by", "IoU unknown", "IoU all", "l2"
    );
    for outcome in outcomes {
        for (way, (name, means)) in LeftOut::WAYS.iter().zip(&outcome.summary.0) {
            let (resolution, shapes) =
                if way.0 == OURS { (outcome.resolution.to_string(), outcome.shapes.to_string()) } else { <_>::default() };
            let _ = write!(text, "{resolution:>10} {shapes:>6}  {:<17}", name.replace('_', " "));
            for (merit, _, is_distance) in CompletionErrors::MERITS {
                let Some(mean) = means.get(merit) else { continue };
                let decimals = if is_distance { 2 } else { 3 };
                let _ = write!(text, " {:>7.decimals$} ± {:<5.decimals$}", mean.mean, mean.standard_error);
            }
            if let Some(paired) = outcome.paired.get(name).and_then(|by_merit| by_merit.get("iou_unknown")) {
                let _ = write!(text, "    {:>3} {:>3} {:>3}  p = {:.2e}", paired.better, paired.worse, paired.equal, paired.p);
            }
            text.truncate(text.trim_end().len());
            text.push('\n');
        }
    }
    text
}
