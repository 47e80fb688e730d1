//! Pictures: errors by resolution, and every shape with its completions, from the side that was seen and from the other.

use super::{Example, LeftOut, OneView, Outcome};
use crate::evaluation::metrics::CompletionErrors;
use beo_core::grid::Dims;
use beo_picture::{Chart, Colour, Image, SaveError, completed, draw_voxels, seen, sheet};
use rayon::prelude::*;
use std::path::{Path, PathBuf};

/// The colour of each voxel.
type Scene<'a> = &'a (dyn Fn(usize) -> Option<Colour> + Sync);

/// Pixels of one picture of a shape.
const SIDE: usize = 320;

/// The lines of one figure of merit, and the points of every shape.
fn errors(outcomes: &[Outcome], view: OneView, merit: usize) -> (Image, Image) {
    let (name, value, is_distance) = CompletionErrors::MERITS[merit];
    let label = if is_distance { "Euclidean distance to the truth" } else { "intersection over union" };
    let title = format!("{}, seen {}", name.replace('_', " "), view.name());
    let lines = LeftOut::WAYS.iter().map(|(way, _)| {
        let mean = |o: &Outcome| o.summary.get(way).and_then(|by_merit| by_merit.get(name)).map_or(f64::NAN, |mean| mean.mean);
        let points = outcomes.iter().map(|o| (o.resolution as f64, mean(o), 1.0)).collect();
        (way.replace('_', " "), points)
    });
    let chart = |x_label: &str| {
        let chart = Chart::new(&title, x_label, label);
        if is_distance { Chart { y_log: true, ..chart } } else { Chart { y_range: Some(0.0..1.0), ..chart } }
    };
    let lines = Chart { x_log: true, ..chart("voxels along a side of the grid") }.weighted_lines(&lines.collect::<Vec<_>>());
    let strips: Vec<(String, Vec<f64>)> = outcomes
        .iter()
        .flat_map(|o| {
            LeftOut::WAYS.iter().map(|(way, of)| {
                let short = way.strip_prefix("nearest_by_").unwrap_or(way);
                (format!("{short} {}", o.resolution), o.per_shape.iter().map(|shape| value(of(shape))).collect())
            })
        })
        .collect();
    let width = 240 + 90 * strips.len().max(4);
    (lines, Chart { width, ..chart("completed by, resolution (bar: mean)") }.strips(&strips))
}

/// Draws the errors at all resolutions into an existing folder: of each figure of merit the means, and every shape.
///
/// # Errors
/// [`SaveError`].
pub fn save_errors(folder: &Path, outcomes: &[Outcome], view: OneView) -> Result<(), SaveError> {
    for (merit, (name, ..)) in CompletionErrors::MERITS.iter().enumerate() {
        let (lines, strips) = errors(outcomes, view, merit);
        strips.save(&folder.join(format!("{name}-shapes.png")))?;
        if outcomes.len() > 1 {
            lines.save(&folder.join(format!("{name}.png")))?;
        }
    }
    Ok(())
}

/// Where the colour of a voxel of the picture comes from: the grid as it stood before it was turned for the viewer, and for a picture from
/// the other side upside down, or turned by half a circle.
fn source(turned: Dims, view: OneView, other_side: bool, voxel: usize) -> usize {
    let dims = view.dims(turned);
    let [x, y, z] = dims.into();
    let [i, j, k] = dims.coordinates(voxel);
    let at = match (other_side, view) {
        (false, _) => [i, j, k],
        (true, OneView::Top) => [i, y - 1 - j, z - 1 - k],
        (true, OneView::Side) => [x - 1 - i, y - 1 - j, k],
    };
    let [i, j, k] = view.place(dims, at);
    turned.index(i, j, k)
}

/// Truth, observation, and the completions, in two rows: from the side that was seen, and from the other.
pub fn draw_example(example: &Example<'_>, view: OneView) -> Image {
    let Example { errors, truth, observation, completion, baselines } = example;
    let dims = truth.dims();
    let truly = |voxel: usize| truth.bits().contains(voxel).then_some(Colour::SERIES[2]);
    let observed = |voxel: usize| seen(observation, voxel);
    let ours = |voxel: usize| completed(observation, completion[voxel], voxel);
    let nearest = |voxel: usize| completed(observation, baselines.by_shape(baselines.nearest, voxel), voxel);
    let mean = |voxel: usize| completed(observation, baselines.by_mean(voxel), voxel);
    let scenes: [(Scene<'_>, String); 5] = [
        (&truly, "truth".into()),
        (&observed, format!("seen {} (grey: hidden)", view.name())),
        (&ours, format!("beo: IoU of the hidden {:.3}", errors.beo.iou_unknown)),
        (&nearest, format!("nearest: {:.3}", errors.nearest.iou_unknown)),
        (&mean, format!("mean: {:.3}", errors.mean.iou_unknown)),
    ];
    let pictures: Vec<(Image, String)> = (0..2 * scenes.len())
        .into_par_iter()
        .map(|n| {
            let other_side = n >= scenes.len();
            let (scene, caption) = &scenes[n % scenes.len()];
            let picture = draw_voxels(view.dims(dims), SIDE, SIDE, |voxel| scene(source(dims, view, other_side, voxel)));
            (picture, if other_side { "from the other side".into() } else { caption.clone() })
        })
        .collect();
    let rows: Vec<Vec<(Image, String)>> = pictures.chunks(scenes.len()).map(<[_]>::to_vec).collect();
    sheet(&rows, &format!("{}, {dims}, learned from {} others", errors.file, errors.learned_from))
}

/// Where the picture of a shape goes within the folder of its resolution.
pub fn picture_name(errors: &LeftOut) -> PathBuf {
    let stem = Path::new(&errors.file).with_extension("");
    let parts: Vec<String> = stem.components().map(|part| part.as_os_str().to_string_lossy().into_owned()).collect();
    PathBuf::from(parts.join("-") + ".png")
}
