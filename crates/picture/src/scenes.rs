//! Pictures of voxels: shapes, queries, completions, means and modes.

use super::voxels::{Mark, Scene, draw_scene};
use super::{Colour, Image, MOST_UNSURE, draw_voxels, viridis};
use beo_core::grid::{Dims, Observation, Occupancy, Rotation};
use nalgebra::Vector3;

/// Predictions below this probability are not drawn.
pub(super) const FAINTEST: f32 = 0.25;

/// Rotations less probable are not drawn.
const LEAST_DRAWN: f64 = 0.02;

/// A complete shape in one colour, `side` pixels wide and high.
pub fn draw_shape(object: &Occupancy, side: usize, colour: Colour) -> Image {
    draw_voxels(object.dims(), side, side, |v| object.bits().contains(v).then_some(colour))
}

/// A query: what is known to be filled in colour, the unknown as a faint region.
pub fn draw_observation(observation: &Observation, side: usize) -> Image {
    draw_voxels(observation.dims(), side, side, |v| seen(observation, v))
}

/// How [`draw_observation`] draws a voxel.
pub fn seen(observation: &Observation, voxel: usize) -> Option<Colour> {
    match (observation.known().contains(voxel), observation.filled().contains(voxel)) {
        (_, true) => Some(Colour::KNOWN),
        (false, false) => Some(Colour::UNKNOWN),
        (true, false) => None,
    }
}

/// A query with how it may be turned: for each rotation (object to grid, with its probability) an arrow where the object's
/// front points, −y of the training shapes, and a thinner one where its top points unless that is up. The more probable, the
/// thicker.
pub fn draw_poses(observation: &Observation, poses: impl IntoIterator<Item = (Rotation, f64)>, side: usize) -> Image {
    let dims = observation.dims();
    draw_scene(&Scene::new(dims, side, side), |v| seen(observation, v), &fronts(dims, poses, side))
}

/// Arrows for how an object may be turned, in a picture `side` pixels high.
pub(super) fn fronts(dims: Dims, poses: impl IntoIterator<Item = (Rotation, f64)>, side: usize) -> Vec<Mark> {
    let reach = 0.5 * dims.x().max(dims.y()).max(dims.z()) as f64;
    let mut poses: Vec<(Rotation, f64)> = poses.into_iter().filter(|(_, p)| *p >= LEAST_DRAWN).collect();
    poses.sort_by(|a, b| a.1.total_cmp(&b.1));
    let unit = side as f64 / 200.0;
    let mut arrows = Vec::new();
    for (rotation, p) in &poses {
        let arrow = |axis: Vector3<f64>, colour, most: f64| Mark::Arrow {
            from: [0.0; 3],
            tip: (reach * (rotation * axis)).into(),
            colour,
            width: (0.3 + 0.7 * p) * most * unit,
        };
        let up = rotation * Vector3::z();
        if up.z < 0.999 {
            arrows.push(arrow(Vector3::z(), Colour::SERIES[2], 2.0));
        }
        arrows.push(arrow(-Vector3::y(), Colour::PREDICTED, 4.0));
    }
    arrows
}

/// A completion: what was seen in one colour, what is predicted in another, the more solid the more probable;
/// `probability` has one value per voxel.
pub fn draw_completion(observation: &Observation, probability: &[f32], side: usize) -> Image {
    assert_eq!(probability.len(), observation.dims().voxels(), "one probability per voxel");
    draw_voxels(observation.dims(), side, side, |v| completed(observation, probability[v], v))
}

/// How [`draw_completion`] draws a voxel of this probability.
pub fn completed(observation: &Observation, probability: f32, voxel: usize) -> Option<Colour> {
    if observation.filled().contains(voxel) {
        return Some(Colour::KNOWN);
    }
    prediction(probability).filter(|_| !observation.known().contains(voxel))
}

/// Where a completion is unsure: voxels that count as filled by the standard deviation of their probability, from dark blue (0) to yellow
/// ([`MOST_UNSURE`] and more), those that may well be filled too faint, seen ones pale. One value per voxel each.
pub fn draw_deviation(observation: &Observation, probability: &[f32], deviation: &[f32], side: usize) -> Image {
    let dims = observation.dims();
    assert_eq!((probability.len(), deviation.len()), (dims.voxels(), dims.voxels()), "one value per voxel each");
    draw_voxels(dims, side, side, |v| unsure(observation, probability, deviation, v))
}

pub(super) fn unsure(observation: &Observation, probability: &[f32], deviation: &[f32], voxel: usize) -> Option<Colour> {
    if observation.known().contains(voxel) {
        return observation.filled().contains(voxel).then_some(Colour::SEEN_ASIDE);
    }
    let colour = viridis(deviation[voxel] / MOST_UNSURE);
    match probability[voxel] {
        p if p >= 0.5 => Some(colour),
        p if p >= FAINTEST => Some(colour.with_opacity(0.12)),
        _ => None,
    }
}

/// Probabilities of being filled, such as a class mean: solid are the most probable voxels, as many as are filled on average (the
/// sum of all probabilities), the paler the less probable; down to half the least of these the next ones stand around them, faint.
/// Values outside of 0 to 1 are drawn as these.
pub fn draw_probability(dims: Dims, probability: &[f32], side: usize) -> Image {
    assert_eq!(probability.len(), dims.voxels(), "one probability per voxel");
    let least = least_of_expected(probability);
    draw_voxels(dims, side, side, |v| {
        let p = probability[v].clamp(0.0, 1.0);
        let solid = Colour::PREDICTED.mix(Colour::PAPER, 0.8 * (1.0 - p));
        if p >= least { Some(solid) } else { (p > 0.5 * least).then(|| solid.with_opacity(0.12)) }
    })
}

/// The least probability among the n greatest, where n is the sum of all.
fn least_of_expected(probability: &[f32]) -> f32 {
    let mut sorted: Vec<f32> = probability.iter().map(|p| p.clamp(0.0, 1.0)).collect();
    sorted.sort_by(|a, b| b.total_cmp(a));
    let count = sorted.iter().map(|p| f64::from(*p)).sum::<f64>().round() as usize;
    sorted.get(count.saturating_sub(1)).copied().unwrap_or(1.0).max(0.05)
}

/// Solid from one half on, where a voxel counts as filled; faint below.
fn prediction(probability: f32) -> Option<Colour> {
    if probability >= 0.5 {
        // Less certain voxels are paler.
        return Some(Colour::PREDICTED.mix(Colour::PAPER, 1.1 * (1.0 - probability)));
    }
    (probability >= FAINTEST).then(|| Colour::PREDICTED.with_opacity(0.3 * (probability - FAINTEST) / (0.5 - FAINTEST)))
}

/// Signed weights, such as a mode: orange above zero, blue below, the more intense the greater; weights from half of the largest
/// on (of the 99th percentile, as single voxels can stand out) are solid, those down to a quarter faint, smaller ones left out.
pub fn draw_weights(dims: Dims, weights: &[f32], side: usize) -> Image {
    assert_eq!(weights.len(), dims.voxels(), "one weight per voxel");
    let mut sizes: Vec<f32> = weights.iter().map(|w| w.abs()).collect();
    let place = sizes.len() * 99 / 100;
    let largest = sizes.select_nth_unstable_by(place, f32::total_cmp).1.max(f32::MIN_POSITIVE);
    draw_voxels(dims, side, side, |v| {
        let value = weights[v] / largest;
        let solid = Colour::signed(value.signum()).mix(Colour::PAPER, 0.9 * (1.0 - value.abs().min(1.0)));
        match value.abs() {
            size if size >= 0.5 => Some(solid),
            size if size >= 0.25 => Some(solid.with_opacity(0.15)),
            _ => None,
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sheet;
    use beo_core::furniture;
    use beo_core::grid::View;

    #[test]
    fn as_many_voxels_are_solid_as_are_filled_on_average() {
        // Ten sure voxels and ten of 0.3 on average: 13 are filled on average.
        let mut p = vec![0.0; 100];
        p[..10].fill(1.0);
        p[10..20].iter_mut().enumerate().for_each(|(n, p)| *p = 0.255 + 0.01 * n as f32);
        let least = least_of_expected(&p);
        assert_eq!(p.iter().filter(|p| **p >= least).count(), 13);
        assert!(least_of_expected(&[]) > 0.0 && least_of_expected(&[0.0; 5]) > 0.0);
    }

    #[test]
    #[ignore = "writes pictures for a person to look at: set BEO_PICTURES to a folder"]
    fn pictures_to_look_at() {
        let Some(folder) = std::env::var_os("BEO_PICTURES") else { return };
        let dims = Dims::cube(30).unwrap();
        let rows: Vec<_> = furniture::CLASSES
            .chunks(1)
            .map(|class| {
                (0..7)
                    .map(|seed| {
                        (draw_shape(&furniture::make(class[0], dims, seed).unwrap(), 150, Colour::KNOWN), format!("{} {seed}", class[0]))
                    })
                    .collect()
            })
            .collect();
        sheet(&rows, "Made-up furniture").save(&std::path::Path::new(&folder).join("furniture.png")).unwrap();
        let rows: Vec<Vec<_>> = ["chair", "toilet", "table"]
            .iter()
            .map(|class| {
                let object = furniture::make(class, dims, 3).unwrap();
                let query = View::Top.of(&object);
                let others: Vec<_> = (0..8).map(|s| furniture::make(class, dims, 40 + s).unwrap()).collect();
                let share = |v| others.iter().filter(|o| o.bits().contains(v)).count() as f32 / 8.0;
                let p: Vec<f32> = (0..dims.voxels()).map(share).collect();
                let centred: Vec<f32> =
                    p.iter().zip(0..dims.voxels()).map(|(p, v)| if object.bits().contains(v) { 1.0 - p } else { -p }).collect();
                vec![
                    (draw_shape(&object, 260, Colour::SERIES[2]), "truth".to_owned()),
                    (draw_observation(&query, 260), "query".into()),
                    (draw_completion(&query, &p, 260), "completion".into()),
                    (draw_weights(dims, &p, 260), "mean".into()),
                    (draw_weights(dims, &centred, 260), "mode".into()),
                ]
            })
            .collect();
        sheet(&rows, "Scenes").save(&std::path::Path::new(&folder).join("scenes.png")).unwrap();
    }
}
