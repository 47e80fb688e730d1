//! A depth image with what was found in it: readings taken and left, planes, grids.

use super::drawing::{BAR, caption, object_colour, paint};
use beo_camera::{Frame, FrameGrids, Grid, Intrinsics, NoGrid, ObjectGrid, PlacementError, Plane};
use beo_picture::{Anchor, Colour, Image, TextSize};
use nalgebra::{Point3, Unit, Vector3};

/// Readings of a mask that were left, in diagonal stripes: neither a colour of depths nor of objects.
const LEFT: Colour = Colour::rgb(255, 0, 220);
/// Lines on planes.
const PLANE: Colour = Colour::rgb(255, 255, 255);
/// How much of an object's colour lies over the readings that were taken.
const TINT: f32 = 0.4;
/// Height of a line of the text below, pixels.
const LINE: usize = 17;
/// Distances of the lines on planes, metres: the first that is seen under so many pixels.
const SPACINGS_M: [f64; 6] = [0.02, 0.05, 0.1, 0.2, 0.5, 1.0];
const LEAST_SPACING_PIXELS: f64 = 30.0;
/// A reading shows a plane if it is nearer to it than this, metres, or than so many standard deviations, at most metres.
const NEAR_M: f64 = 0.01;
const NEAR_DEVIATIONS: f64 = 3.0;
const NEAR_MOST_M: f64 = 0.03;
/// Pieces that an edge of a grid is drawn in: lenses bend it.
const PIECES: u32 = 48;
/// A share below which nothing is said, of one.
const LEAST_SHARE: f64 = 0.005;

/// The depth image of `frame`, as [`super::draw_depth`] draws it, with what `grids` found in it. Of each object, the readings that were
/// taken are outlined and tinted in its colour, those of its mask that were left are striped; its grid is a wireframe box. Lines at right
/// angles lie on the planes that objects stand on, where they are seen. Below the image are the legend and a line for each object: how many of
/// its mask's readings were taken, which shares were left, and what cuts it off.
pub fn draw_grids(frame: &Frame<'_>, grids: &FrameGrids) -> Image {
    let camera = frame.intrinsics();
    let (width, height) = (camera.width() as usize, camera.height() as usize);
    let objects: Vec<u16> = grids.objects.iter().map(|laid| laid.object).collect();
    let masks = Frame::new(camera, frame.depths(), grids.segments().unwrap_or(frame.labels())).expect("the images have the camera's size");
    let taken = Frame::new(camera, frame.depths(), grids.labels()).expect("the images have the camera's size");
    let lines: Vec<(Colour, String)> = grids
        .objects
        .iter()
        .map(|laid| (object_colour(&objects, laid.object).unwrap_or(Colour::INK), describe(&masks, &taken, laid)))
        .collect();
    let spacing_m = spacing_m(&masks);
    let legend = legend(grids, spacing_m);
    let text_width = lines.iter().map(|(_, text)| text).chain([&legend]).map(|text| 28 + TextSize::Small.width(text)).max().unwrap_or(0);
    let mut image = Image::new((width + BAR).max(text_width), height + 8 + LINE * (1 + lines.len()));
    paint(&mut image, &taken, &objects, TINT);
    for plane in &grids.supports {
        draw_plane(&mut image, &taken, plane, grids, spacing_m);
    }
    for pixel in 0..width * height {
        let label = masks.label(pixel);
        let is_left = masks.depth(pixel).is_some() && taken.label(pixel) != label && objects.binary_search(&label).is_ok();
        if is_left && is_striped(pixel % width, pixel / width) {
            image.set(pixel % width, pixel / width, LEFT.rgb);
        }
    }
    for laid in &grids.objects {
        if let Ok(observed) = &laid.grid {
            draw_box(&mut image, camera, &observed.grid, object_colour(&objects, laid.object).unwrap_or(Colour::INK));
        }
    }
    for (object, (colour, _)) in objects.iter().zip(&lines) {
        caption(&mut image, &masks, *object, &object.to_string(), *colour);
    }
    let row = |n: usize| (height + 4 + n * LINE) as i32;
    for x in 0..14 {
        for y in 0..12 {
            if is_striped(x, y) {
                image.set(x + 6, row(0) as usize + 2 + y, LEFT.rgb);
            }
        }
    }
    image.text(&legend, 26, row(0) + 8, TextSize::Small, Anchor::Left, Colour::INK);
    for (n, (colour, text)) in lines.iter().enumerate() {
        image.rectangle(6, row(n + 1) + 2, 14, 12, Colour::INK);
        image.rectangle(7, row(n + 1) + 3, 12, 10, *colour);
        image.text(text, 26, row(n + 1) + 8, TextSize::Small, Anchor::Left, Colour::INK);
    }
    image
}

fn is_striped(x: usize, y: usize) -> bool {
    (x + y) % 4 < 2
}

fn legend(grids: &FrameGrids, spacing_m: f64) -> String {
    let planes = match grids.supports.len() {
        0 => "no plane".to_owned(),
        1 => format!("a plane with lines every {spacing_m} m"),
        n => format!("{n} planes with lines every {spacing_m} m"),
    };
    let boxes = if grids.objects.is_empty() { "no object" } else { "boxes: the grids" };
    format!("readings of masks that were left; {planes}; {boxes}")
}

/// An object's line: what was taken, what was left, what cuts it.
fn describe(masks: &Frame<'_>, taken: &Frame<'_>, laid: &ObjectGrid) -> String {
    let of = |frame: &Frame<'_>| (0..frame.depths().len()).filter(|p| frame.label(*p) == laid.object && frame.depth(*p).is_some()).count();
    let mut text = format!("{}: {} of {} readings", laid.object, of(taken), of(masks));
    match &laid.grid {
        Ok(observed) => {
            let quality = &observed.quality;
            let shares = [("plane", quality.share_support), ("flying", quality.share_edge), ("apart", quality.share_far)];
            let left: Vec<String> = shares
                .iter()
                .filter(|(_, share)| *share >= LEAST_SHARE)
                .map(|(kind, share)| format!("{kind} {:.0} %", 100.0 * share))
                .collect();
            if !left.is_empty() {
                text += &format!("; left: {}", left.join(", "));
            }
            text += match (quality.cut.border, quality.cut.occluder) {
                (false, false) => "",
                (true, false) => "; cut by the border",
                (false, true) => "; cut by something nearer",
                (true, true) => "; cut by the border and by something nearer",
            };
        }
        Err(NoGrid::NoUp { .. }) => text += "; no grid: what is up is not known",
        Err(NoGrid::TooFewOwn { least, .. } | NoGrid::NoPlace(PlacementError::TooFew { least, .. })) => {
            text += &format!("; no grid: at least {least} are needed")
        }
        Err(NoGrid::NoPlace(_)) => text += "; no grid: they have no extent",
    }
    text
}

/// Distance of the lines on planes that is well seen at the frame's middle depth, metres.
fn spacing_m(frame: &Frame<'_>) -> f64 {
    let mut depths: Vec<f64> = (0..frame.depths().len()).step_by(37).filter_map(|pixel| frame.depth(pixel)).collect();
    depths.sort_by(f64::total_cmp);
    let middle = depths.get(depths.len() / 2).copied().unwrap_or(1.0);
    let [fx, fy] = frame.intrinsics().focal();
    let is_seen = |spacing: &f64| spacing * fx.min(fy) / middle >= LEAST_SPACING_PIXELS;
    SPACINGS_M.into_iter().find(is_seen).unwrap_or(SPACINGS_M[SPACINGS_M.len() - 1])
}

/// Draws lines at right angles on a plane where a reading that is no object's shows it, and no other plane is nearer to it.
fn draw_plane(image: &mut Image, taken: &Frame<'_>, plane: &Plane, grids: &FrameGrids, spacing_m: f64) {
    let camera = taken.intrinsics();
    let width = camera.width() as usize;
    let normal = plane.normal();
    let across = Unit::try_new(Vector3::x() - normal.into_inner() * normal.x, 1e-3);
    let across = across.unwrap_or_else(|| Unit::new_normalize(Vector3::y() - normal.into_inner() * normal.y));
    let along = normal.cross(&across);
    // The square of the plane that a pixel's ray meets: the reading says only whether the plane is seen there, its noise bends no line.
    let squares: Vec<Option<[i64; 2]>> = (0..taken.depths().len())
        .map(|pixel| {
            let depth = taken.depth(pixel)?;
            let ray = camera.unproject([(pixel % width) as f64, (pixel / width) as f64])?;
            let near = NEAR_M.max(NEAR_DEVIATIONS * grids.sensor().deviation(depth)).min(NEAR_MOST_M);
            let slope = normal.dot(&ray);
            let met = ray * (-plane.offset() / slope);
            let point = Point3::from(ray * depth);
            let height = plane.height(&point).abs();
            let is_nearest = grids.supports.iter().all(|other| height <= other.height(&point).abs());
            (slope < 0.0 && met.z > 0.0 && height < near && is_nearest)
                .then(|| [across.dot(&met), along.dot(&met)].map(|at| (at / spacing_m).floor() as i64))
        })
        .collect();
    for (pixel, square) in squares.iter().enumerate() {
        let crosses = |other: usize| squares.get(other).copied().flatten().is_some_and(|other| Some(other) != *square);
        let right = (pixel + 1) % width != 0 && crosses(pixel + 1);
        if square.is_some() && taken.label(pixel) == 0 && (right || crosses(pixel + width)) {
            image.blend(pixel % width, pixel / width, PLANE.with_opacity(0.5));
        }
    }
}

/// Draws the edges of a grid's box, where they are in front of the camera and within its image.
fn draw_box(image: &mut Image, camera: &Intrinsics, grid: &Grid, colour: Colour) {
    let corners = corners(grid);
    for from in 0..8 {
        for to in [1, 2, 4].map(|axis| from | axis).into_iter().filter(|to| *to != from) {
            let at = |step: u32| {
                let point = corners[from] + (corners[to] - corners[from]) * (f64::from(step) / f64::from(PIECES));
                let [u, v] = camera.project(&point)?;
                let inside = u > -0.5 && v > -0.5 && u < f64::from(camera.width()) - 0.5 && v < f64::from(camera.height()) - 0.5;
                inside.then(|| (u.round() as i32, v.round() as i32))
            };
            for step in 0..PIECES {
                if let (Some(from), Some(to)) = (at(step), at(step + 1)) {
                    image.line(from, to, 1, colour);
                }
            }
        }
    }
}

/// Corners of a grid's box in the camera frame, metres; bit 0, 1, 2 of the index: the upper end along x, y, z.
fn corners(grid: &Grid) -> [Point3<f64>; 8] {
    let half = grid.dims().map(|side| 0.5 * side as f64 * grid.voxel_size_m());
    std::array::from_fn(|corner| {
        let at = |axis: usize| if (corner >> axis) & 1 == 1 { half[axis] } else { -half[axis] };
        grid.grid_to_camera() * Point3::new(at(0), at(1), at(2))
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use beo_camera::{GridOptions, lay_grids};

    #[test]
    fn readings_taken_and_left_have_their_colours_and_the_box_its_corners() {
        // A block's face at 0.9 m before a wall at 1.5 m; the mask is six pixels too wide to the left and right.
        let camera = Intrinsics::new(160, 120, [150.0; 2], [79.5, 59.5], [0.0; 5]).unwrap();
        let (mut depth, mut labels) = (vec![1.5_f32; 160 * 120], vec![0_u16; 160 * 120]);
        for pixel in 0..160 * 120 {
            let (x, y) = (pixel % 160, pixel / 160);
            if (45..75).contains(&y) && (60..100).contains(&x) {
                depth[pixel] = 0.9;
            }
            if (45..75).contains(&y) && (54..106).contains(&x) {
                labels[pixel] = 5;
            }
        }
        let frame = Frame::new(&camera, &depth, &labels).unwrap();
        let options = GridOptions { gravity: Some(Vector3::y_axis()), ..GridOptions::new([20; 3]) };
        let grids = lay_grids(frame, &options);
        let image = draw_grids(&frame, &grids);
        assert_eq!(image.height(), 120 + 8 + 2 * LINE);
        let own = object_colour(&[5], 5).unwrap();
        assert_eq!(image.pixel(60, 50), own.rgb, "what was taken is outlined");
        assert_ne!(image.pixel(80, 60), draw_depth_of(&frame, &[0; 160 * 120]).pixel(80, 60), "and tinted");
        for (x, y) in [(54, 60), (57, 51), (105, 51)] {
            let is_left = |x: &usize| is_striped(*x, y) && grids.labels()[y * 160 + x] == 0 && labels[y * 160 + x] == 5;
            let striped: Vec<usize> = (x..x + 4).filter(is_left).collect();
            assert!(!striped.is_empty() && striped.iter().all(|x| image.pixel(*x, y) == LEFT.rgb), "{x} {y}");
        }
        assert!((61..99).all(|x| image.pixel(x, 60) != LEFT.rgb), "what was taken has no stripes");

        // The grid's corners by the pinhole's formula, from the axes in the camera frame: x forward, y left, z up.
        let grid = grids.objects[0].grid.as_ref().unwrap().grid;
        let half = 10.0 * grid.voxel_size_m();
        let centre = grid.grid_to_camera().translation.vector;
        let axes = grid.grid_to_camera().rotation.to_rotation_matrix();
        let mut seen = 0;
        for signs in 0..8 {
            let sign = |bit: usize| if (signs >> bit) & 1 == 1 { half } else { -half };
            let p = centre + axes * Vector3::new(sign(0), sign(1), sign(2));
            let (u, v) = ((150.0 * p.x / p.z + 79.5).round(), (150.0 * p.y / p.z + 59.5).round());
            // The caption may lie over upper ones.
            if v > 59.5 && (0.0..160.0).contains(&u) && v < 120.0 {
                seen += 1;
                assert_eq!(image.pixel(u as usize, v as usize), own.rgb, "corner {signs} at {u}, {v}");
            }
        }
        assert_eq!(seen, 4, "the lower corners are in the image");
    }

    fn draw_depth_of(frame: &Frame<'_>, labels: &[u16]) -> Image {
        crate::frames::draw_depth(&Frame::new(frame.intrinsics(), frame.depths(), labels).unwrap(), &[], None)
    }
}
