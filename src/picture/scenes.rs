//! What the program draws of voxels: shapes, queries, completions, means and modes.

use super::{Colour, Image, draw_voxels};
use crate::grid::{Dims, Observation, Occupancy};

/// Predictions below this probability are not drawn.
const FAINTEST: f32 = 0.25;

/// A complete shape in one colour, `side` pixels wide and high.
pub fn draw_shape(object: &Occupancy, side: usize, colour: Colour) -> Image {
    draw_voxels(object.dims(), side, side, |v| object.bits().contains(v).then_some(colour))
}

/// A query: what is known to be filled in colour, the unknown as a faint region.
pub fn draw_observation(observation: &Observation, side: usize) -> Image {
    draw_voxels(observation.dims(), side, side, |v| match (observation.known().contains(v), observation.filled().contains(v)) {
        (_, true) => Some(Colour::KNOWN),
        (false, false) => Some(Colour::UNKNOWN),
        (true, false) => None,
    })
}

/// A completion: what was seen in one colour, what is predicted in another, the more solid the more probable;
/// `probability` has one value per voxel.
pub fn draw_completion(observation: &Observation, probability: &[f32], side: usize) -> Image {
    assert_eq!(probability.len(), observation.dims().voxels(), "one probability per voxel");
    draw_voxels(observation.dims(), side, side, |v| {
        if observation.filled().contains(v) {
            return Some(Colour::KNOWN);
        }
        prediction(probability[v]).filter(|_| !observation.known().contains(v))
    })
}

/// Solid from one half on, where a voxel counts as filled; faint below.
fn prediction(probability: f32) -> Option<Colour> {
    if probability >= 0.5 {
        // Less certain voxels are paler.
        return Some(Colour::PREDICTED.mix(Colour::PAPER, 1.1 * (1.0 - probability)));
    }
    (probability >= FAINTEST).then(|| Colour::PREDICTED.with_opacity(0.3 * (probability - FAINTEST) / (0.5 - FAINTEST)))
}

/// Signed weights, such as a class mean or a mode: orange above zero, blue below, relative to the largest magnitude; small ones
/// are left out.
pub fn draw_weights(dims: Dims, weights: &[f32], side: usize) -> Image {
    assert_eq!(weights.len(), dims.voxels(), "one weight per voxel");
    let largest = weights.iter().fold(0.0_f32, |m, w| m.max(w.abs())).max(f32::MIN_POSITIVE);
    draw_voxels(dims, side, side, |v| {
        let value = weights[v] / largest;
        // Squared, so that the core shows through what surrounds it.
        (value.abs() > 0.15).then(|| Colour::signed(value.signum() * value * value))
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::View;
    use crate::picture::sheet;
    use crate::shapes::furniture;

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
