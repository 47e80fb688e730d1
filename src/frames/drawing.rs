//! A depth image with the objects in it.

use beo_camera::Frame;
use beo_picture::{Anchor, Colour, Image, TextSize, viridis};

/// Width of the colour bar with its numbers, pixels.
pub(super) const BAR: usize = 72;
/// How much of an object's colour lies over its depths.
const TINT: f32 = 0.25;
/// Colours of objects, in turn: none of those of the depths.
const OBJECTS: [Colour; 6] = [
    Colour::rgb(255, 140, 40),
    Colour::rgb(240, 80, 90),
    Colour::rgb(250, 250, 250),
    Colour::rgb(240, 130, 210),
    Colour::rgb(120, 220, 250),
    Colour::rgb(176, 110, 70),
];
/// Share of the readings that may lie beyond each end of the colours.
const BEYOND: f64 = 0.02;

/// A depth image: near is dark, far is yellow, what has no reading is grey; a bar says what the colours mean in metres. Each object is
/// tinted and outlined in a colour of its own and captioned: `captions` are pairs of label and text, objects without one are captioned by
/// their label. `support` is the label that is no object.
pub fn draw_depth(frame: &Frame<'_>, captions: &[(u16, String)], support: Option<u16>) -> Image {
    let (width, height) = (frame.intrinsics().width() as usize, frame.intrinsics().height() as usize);
    let mut image = Image::new(width + BAR, height);
    let objects = frame.objects(support);
    paint(&mut image, frame, &objects, TINT);
    for label in &objects {
        let text = captions.iter().find(|(of, _)| of == label).map_or_else(|| label.to_string(), |(_, text)| text.clone());
        caption(&mut image, frame, *label, &text, object_colour(&objects, *label).unwrap_or(Colour::INK));
    }
    image
}

/// The colour of a label among all objects, ascending; `None` where it is none of them.
pub(super) fn object_colour(objects: &[u16], label: u16) -> Option<Colour> {
    objects.binary_search(&label).ok().map(|n| OBJECTS[n % OBJECTS.len()])
}

/// Paints the depths into the upper left of an image with the bar beside them; the pixels of each of the objects, ascending, are outlined in
/// its colour and tinted by the share `tint` of it.
pub(super) fn paint(image: &mut Image, frame: &Frame<'_>, objects: &[u16], tint: f32) {
    let (width, height) = (frame.intrinsics().width() as usize, frame.intrinsics().height() as usize);
    let range = range(frame);
    for pixel in 0..width * height {
        let (x, y) = (pixel % width, pixel / width);
        let share = frame.depth(pixel).zip(range).map(|(depth, [near, far])| ((depth - near) / (far - near)) as f32);
        let base = share.map_or(Colour::NO_READING, viridis);
        let own = object_colour(objects, frame.label(pixel));
        let other = |x: usize, y: usize| frame.label(y * width + x) != frame.label(pixel);
        // Two pixels wide, within the object.
        let is_border = (1..=2).any(|d| {
            x >= d && other(x - d, y) || x + d < width && other(x + d, y) || y >= d && other(x, y - d) || y + d < height && other(x, y + d)
        });
        let colour = match own {
            Some(own) if is_border => own,
            Some(own) => base.mix(own, tint),
            None => base,
        };
        image.set(x, y, colour.rgb);
    }
    if let Some(range) = range {
        bar(image, width, height, range);
    }
}

/// Depths at the ends of the colours; `None` where there is no reading.
fn range(frame: &Frame<'_>) -> Option<[f64; 2]> {
    let mut depths: Vec<f64> = (0..frame.depths().len()).filter_map(|pixel| frame.depth(pixel)).collect();
    if depths.is_empty() {
        return None;
    }
    let last = depths.len() - 1;
    let [near, far] = [BEYOND, 1.0 - BEYOND].map(|share| {
        let (_, depth, _) = depths.select_nth_unstable_by((share * last as f64).round() as usize, f64::total_cmp);
        *depth
    });
    // All at one depth: any width will do.
    Some([near, far.max(near + 1e-3)])
}

/// Writes an object's text on a plate above it, within the picture.
pub(super) fn caption(image: &mut Image, frame: &Frame<'_>, label: u16, text: &str, colour: Colour) {
    let (columns, rows) = (frame.intrinsics().width() as usize, frame.intrinsics().height() as usize);
    let of = (0..columns * rows).filter(|pixel| frame.label(*pixel) == label);
    let bounds = of.fold([usize::MAX, 0, usize::MAX], |[left, right, top], pixel| {
        [left.min(pixel % columns), right.max(pixel % columns), top.min(pixel / columns)]
    });
    let (width, height) = (TextSize::Small.width(text) as i32 + 8, TextSize::Small.height() as i32 + 4);
    let middle = (bounds[0].saturating_add(bounds[1]) / 2) as i32;
    let left = (middle - width / 2).clamp(0, (columns as i32 - width).max(0));
    let top = (bounds[2] as i32 - height - 2).clamp(0, (rows as i32 - height).max(0));
    image.rectangle(left, top, width as u32, height as u32, Colour::PAPER.with_opacity(0.88));
    image.rectangle(left, top, 3, height as u32, colour);
    image.text(text, left + 5, top + height / 2, TextSize::Small, Anchor::Left, Colour::INK);
}

fn bar(image: &mut Image, left: usize, height: usize, [near, far]: [f64; 2]) {
    let (top, bottom) = (16, height as i32 - 17);
    let x = left as i32 + 8;
    for row in top..=bottom {
        image.rectangle(x, row, 12, 1, viridis((row - top) as f32 / (bottom - top).max(1) as f32));
    }
    let steps = ((bottom - top) / 60).clamp(1, 5);
    for step in 0..=steps {
        let share = f64::from(step) / f64::from(steps);
        let y = top + (share * f64::from(bottom - top)).round() as i32;
        let text = format!("{:.2} m", near + share * (far - near));
        image.text(&text, x + 16, y, TextSize::Small, Anchor::Left, Colour::INK);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use beo_camera::Intrinsics;

    fn camera() -> Intrinsics {
        Intrinsics::new(60, 40, [50.0, 50.0], [30.0, 20.0], [0.0; 5]).unwrap()
    }

    #[test]
    fn depths_objects_and_gaps_are_told_apart() {
        let camera = camera();
        let mut depth: Vec<f32> = (0..2400).map(|pixel| 1.0 + (pixel % 60) as f32 / 60.0).collect();
        let mut labels = vec![0; 2400];
        (0..2400).filter(|p| (10..30).contains(&(p % 60)) && (20..35).contains(&(p / 60))).for_each(|p| labels[p] = 7);
        depth[5 * 60 + 45] = 0.0;
        depth[6 * 60 + 45] = f32::NAN;
        let image = draw_depth(&Frame::new(&camera, &depth, &labels).unwrap(), &[(7, "mug".into())], None);
        assert_eq!((image.width(), image.height()), (60 + BAR, 40));
        assert_eq!((image.pixel(45, 5), image.pixel(45, 6)), (Colour::NO_READING.rgb, Colour::NO_READING.rgb));
        assert_eq!((image.pixel(0, 39), image.pixel(59, 39)), (viridis(0.0).rgb, viridis(1.0).rgb));
        assert_eq!((image.pixel(10, 25), image.pixel(29, 34)), (OBJECTS[0].rgb, OBJECTS[0].rgb));
        assert_ne!(image.pixel(20, 28), OBJECTS[0].rgb, "an object is tinted, not hidden");
        assert!((0..20).any(|y| (5..35).any(|x| image.pixel(x, y) == Colour::INK.rgb)), "its caption stands above it");
    }

    #[test]
    #[ignore = "writes pictures for a person to look at: set BEO_PICTURES to a folder"]
    fn pictures_to_look_at() {
        let Some(folder) = std::env::var_os("BEO_PICTURES") else { return };
        let camera = Intrinsics::new(640, 480, [525.0; 2], [320.0, 240.0], [0.0; 5]).unwrap();
        // A table that comes nearer towards the lower border, two balls on it, and no reading beside them.
        let (mut depth, mut labels): (Vec<f32>, Vec<u16>) = (0..640 * 480).map(|p| (2.2 - (p / 640) as f32 / 400.0, 0)).unzip();
        for (label, x, y, radius) in [(1, 200.0, 250.0, 70.0), (2, 430.0, 300.0, 110.0), (3, 600.0, 20.0, 45.0_f32)] {
            for pixel in 0..640 * 480 {
                let across = ((pixel % 640) as f32 - x).hypot((pixel / 640) as f32 - y);
                if across < radius {
                    depth[pixel] = 1.2 - 0.001 * (radius * radius - across * across).sqrt();
                    labels[pixel] = label;
                } else if across < radius + 6.0 && (pixel % 640) as f32 > x {
                    depth[pixel] = 0.0;
                }
            }
        }
        let captions = [(1, "mug 97 %".to_owned()), (2, "bowl 54 %".into())];
        let image = draw_depth(&Frame::new(&camera, &depth, &labels).unwrap(), &captions, None);
        image.save(&std::path::Path::new(&folder).join("depth.png")).unwrap();
    }

    #[test]
    fn an_image_without_readings_is_drawn() {
        let (camera, nothing) = (camera(), vec![0.0; 2400]);
        let image = draw_depth(&Frame::new(&camera, &nothing, &[1; 2400]).unwrap(), &[], Some(1));
        assert_eq!(image.pixel(30, 20), Colour::NO_READING.rgb);
        let flat = vec![2.0; 2400];
        draw_depth(&Frame::new(&camera, &flat, &[0; 2400]).unwrap(), &[], None);
    }
}
