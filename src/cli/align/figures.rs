//! Pictures of an alignment: the mean of the shapes from three sides, and every shape, before and after.

use beo_core::grid::{Dims, DimsError};
use beo_picture::{Colour, Image, draw_probability, sheet};
use beo_shapes::alignment::{AlignmentSettings, Congealed, Placed, ShapeSimilarity, Solid, measured};

/// Shapes on the sheet of all shapes, evenly chosen where there are more.
const MOST_SHOWN: usize = 60;
/// Shapes in a row of it, three pictures each.
const IN_A_ROW: usize = 4;

/// The mean occupancy before, normalised and after, seen along x, y and z and from above at a slant.
pub fn draw_means(name: &str, congealed: &Congealed, settings: &AlignmentSettings) -> Result<Image, DimsError> {
    let dims = Dims::cube(settings.resolution)?;
    let row = |what: &str, placed: &Placed| {
        let bits = format!("{what}: {:.0} bits", placed.entropy);
        let along = ["from the right, along x", "from the front, along y", "from above, along z"];
        let mut row: Vec<(Image, String)> =
            along.iter().enumerate().map(|(axis, text)| (shadow(dims, &placed.mean, axis, 240), (*text).to_owned())).collect();
        row.push((draw_probability(dims, &placed.mean, 240), bits));
        row
    };
    let rows = [row("as they came", &congealed.before), row("principal axes", &congealed.normalised), row("aligned", &congealed.after)];
    Ok(sheet(&rows, &format!("{name}: mean of {} shapes", congealed.after.placements.len())))
}

/// Every shape as it came, aligned, and aligned from above.
pub fn draw_shapes(
    name: &str,
    files: &[&str],
    solids: &[Solid],
    congealed: &Congealed,
    settings: &AlignmentSettings,
) -> Result<Image, DimsError> {
    let dims = Dims::cube(settings.resolution)?;
    let occupancy = |shape: usize, placement: &ShapeSimilarity| measured(&solids[shape..=shape], settings, vec![*placement]).mean;
    let shown: Vec<usize> = (0..solids.len().min(MOST_SHOWN)).map(|n| n * solids.len() / solids.len().min(MOST_SHOWN)).collect();
    let cells: Vec<[(Image, String); 3]> = shown
        .iter()
        .map(|&shape| {
            let before = occupancy(shape, &congealed.before.placements[shape]);
            let after = occupancy(shape, &congealed.after.placements[shape]);
            [
                (draw_probability(dims, &before, 110), files[shape].to_owned()),
                (draw_probability(dims, &after, 110), "aligned".to_owned()),
                (shadow(dims, &after, 2, 110), "from above".to_owned()),
            ]
        })
        .collect();
    let rows: Vec<Vec<(Image, String)>> = cells.chunks(IN_A_ROW).map(|row| row.iter().flatten().cloned().collect()).collect();
    Ok(sheet(&rows, &format!("{name}: each as it came, aligned, and aligned from above")))
}

/// The number of filled voxels along an axis, the darker the more: along x from the right (y to the right), along y from the front (x to
/// the right), along z from above (x to the right, y up).
fn shadow(dims: Dims, occupancy: &[f32], axis: usize, side: usize) -> Image {
    let sides = <[usize; 3]>::from(dims);
    let (u, v) = [(1, 2), (0, 2), (0, 1)][axis];
    let mut sums = vec![0.0_f32; sides[u] * sides[v]];
    for (voxel, value) in occupancy.iter().enumerate() {
        let at = dims.coordinates(voxel);
        sums[at[u] * sides[v] + at[v]] += value;
    }
    let most = sums.iter().copied().fold(f32::MIN_POSITIVE, f32::max);
    let mut image = Image::new(side, side);
    for x in 0..side {
        for y in 0..side {
            let (a, b) = (x * sides[u] / side, (side - 1 - y) * sides[v] / side);
            // The root shows what is thin too.
            image.blend(x, y, Colour::PREDICTED.with_opacity((sums[a * sides[v] + b] / most).sqrt()));
        }
    }
    image
}
