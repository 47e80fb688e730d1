//! How an evaluation depends on where the camera was: figures of merit by elevation, and by the number of views that were fused.

use super::{Evaluation, Viewpoint};
use beo_picture::{Chart, Image};
use std::collections::BTreeMap;

/// Accuracy and completion by elevation, one line per method; `None` where there are not two elevations of single views.
pub fn by_elevation(evaluations: &[Evaluation]) -> Option<Image> {
    let of_single_views = |e: &Evaluation| match e.viewpoint {
        Viewpoint::Camera { elevation_deg, fused: 1, .. } => Some(elevation_deg),
        _ => None,
    };
    draw(evaluations, of_single_views, "by elevation of the camera", "elevation above the horizontal, degrees")
}

/// The same by the number of views.
pub fn by_views(evaluations: &[Evaluation]) -> Option<Image> {
    let first = evaluations.iter().find_map(|e| match e.viewpoint {
        Viewpoint::Camera { elevation_deg, .. } => Some(elevation_deg),
        Viewpoint::Top => None,
    })?;
    let of_one_elevation = |e: &Evaluation| match e.viewpoint {
        Viewpoint::Camera { elevation_deg, fused, .. } if elevation_deg == first => Some(fused as f64),
        _ => None,
    };
    draw(evaluations, of_one_elevation, &format!("by number of fused views, at {first:.0}°"), "views")
}

fn draw(evaluations: &[Evaluation], place: impl Fn(&Evaluation) -> Option<f64>, what: &str, x: &str) -> Option<Image> {
    let mut lines: BTreeMap<String, Vec<(f64, f64)>> = BTreeMap::new();
    for (evaluation, at) in evaluations.iter().filter_map(|e| Some((e, place(e)?))) {
        let method = evaluation.method.name();
        for (name, value) in [
            (format!("{method}: accuracy"), evaluation.accuracy),
            (format!("{method}: IoU of hidden voxels"), evaluation.completion.iou_unknown),
            (format!("{method}: IoU of all voxels"), evaluation.completion.iou_all),
        ] {
            lines.entry(name).or_default().push((at, value));
        }
    }
    let mut series: Vec<(String, Vec<(f64, f64)>)> = lines.into_iter().collect();
    series.iter_mut().for_each(|(_, points)| points.sort_by(|a, b| a.0.total_cmp(&b.0)));
    let several = series.first().is_some_and(|(_, points)| points.windows(2).any(|pair| pair[0].0 < pair[1].0));
    let queries = evaluations.first().map_or(0, |e| e.queries);
    let title = format!("Accuracy and completion {what}, {queries} queries each");
    several.then(|| Chart { y_range: Some(0.0..1.0), ..Chart::new(&title, x, "share") }.lines(&series))
}
