//! One object as it was perceived: query, completion from both sides, where the completion is unsure, class, pose and size.

use super::scenes::{FAINTEST, fronts, seen, unsure};
use super::voxels::{Mark, Scene, Side, bounds, draw_axes, draw_scene};
use super::{Anchor, Colour, Image, MOST_UNSURE, TextSize, viridis};
use beo_core::grid::{Observation, Rotation};
use nalgebra::{Point3, Vector3};

/// Side of one picture of voxels, pixels.
const SIDE: usize = 330;
/// Width of the column with classes, notes and legend, pixels.
const COLUMN: usize = 290;
/// Between pictures, pixels.
const GAP: usize = 14;
/// Classes that are shown.
const CLASSES: usize = 10;

/// One object to be drawn. Places and lengths are in voxels from the grid's centre along the grid's axes.
#[derive(Clone, Debug)]
pub struct Perceived<'a> {
    /// Stands above.
    pub title: String,
    /// The observation.
    pub observation: &'a Observation,
    /// Probability of being filled of every voxel.
    pub occupancy: &'a [f32],
    /// Its standard deviation.
    pub deviation: &'a [f32],
    /// The probability of each class, in any order.
    pub classes: Vec<(String, f64)>,
    /// How it may be turned (object to grid) and the probability of each; empty where that was known.
    pub poses: Vec<(Rotation, f64)>,
    /// The pose whose axes are drawn, object to grid.
    pub pose: Option<Rotation>,
    /// The origin of the frame that the grid lies in, and the frame's name; `None` where the observation did not say.
    pub origin: Option<([f64; 3], String)>,
    /// Centre of the object's box, and its lengths along the object's axes.
    pub object_box: Option<([f64; 3], [f64; 3])>,
    /// Lines of text: pose, size.
    pub notes: Vec<String>,
}

impl Perceived<'_> {
    /// Draws it. All views have the same scale.
    pub fn draw(&self) -> Image {
        let dims = self.observation.dims();
        assert_eq!((self.occupancy.len(), self.deviation.len()), (dims.voxels(), dims.voxels()), "one value per voxel each");
        let shown = |v: usize| self.query_colour(v).is_some() || self.completion_colour(v).is_some();
        let fitted = bounds(dims, shown);
        let scene = |side| Scene { side, fitted, ..Scene::new(dims, SIDE, SIDE) };
        // From the camera's side, where that is known.
        let is_behind = self.origin.as_ref().is_some_and(|([x, y, _], _)| (x + y).is_finite() && x + y > 0.0);
        let (front, back) = if is_behind { (Side::Back, Side::Front) } else { (Side::Front, Side::Back) };
        let (front, back) = (scene(front), scene(back));
        let mut query = fronts(dims, self.poses.iter().copied(), SIDE);
        query.extend(self.origin_mark());
        let object: Vec<Mark> = self.box_marks().into_iter().chain(self.axis_marks()).collect();
        let completion = |v| self.completion_colour(v);
        let mut views = [
            (draw_scene(&front, |v| self.query_colour(v), &query), self.query_caption(), front.side),
            (draw_scene(&front, completion, &object), "completion".to_owned(), front.side),
            (draw_scene(&front, |v| self.deviation_colour(v), &[]), "standard deviation of the completion".to_owned(), front.side),
            (draw_scene(&back, completion, &object), "completion from the other side".to_owned(), back.side),
        ];
        deviation_bar(&mut views[2].0);

        let caption = TextSize::Small.height() + 8;
        let top = 2 * GAP + TextSize::Large.height();
        let mut image = Image::new(2 * SIDE + COLUMN + 4 * GAP, top + 2 * (SIDE + caption + GAP));
        let middle = (image.width() / 2) as i32;
        image.text(&self.title, middle, (GAP + TextSize::Large.height() / 2) as i32, TextSize::Large, Anchor::Centre, Colour::INK);
        for (place, (view, text, side)) in views.iter_mut().enumerate() {
            draw_axes(view, *side);
            let (x, y) = (GAP + place % 2 * (SIDE + GAP), top + place / 2 * (SIDE + caption + GAP));
            image.paste(view, x, y);
            let at = ((x + SIDE / 2) as i32, (y + SIDE + caption / 2) as i32);
            image.text(text, at.0, at.1, TextSize::Small, Anchor::Centre, Colour::INK);
        }
        self.draw_column(&mut image, (2 * SIDE + 3 * GAP) as i32, top as i32);
        image
    }

    fn query_caption(&self) -> String {
        if self.poses.is_empty() { "query".into() } else { "query, and where the object's front may be".into() }
    }

    fn query_colour(&self, voxel: usize) -> Option<Colour> {
        seen(self.observation, voxel)
    }

    /// Seen voxels; predicted ones, the paler the less sure; and faint those that may well be filled too.
    fn completion_colour(&self, voxel: usize) -> Option<Colour> {
        if self.observation.known().contains(voxel) {
            return self.observation.filled().contains(voxel).then_some(Colour::KNOWN);
        }
        let p = self.occupancy[voxel];
        if p >= 0.5 {
            return Some(Colour::predicted(self.deviation[voxel]));
        }
        (p >= FAINTEST).then(|| Colour::PREDICTED.with_opacity(0.3 * (p - FAINTEST) / (0.5 - FAINTEST)))
    }

    fn deviation_colour(&self, voxel: usize) -> Option<Colour> {
        unsure(self.observation, self.occupancy, self.deviation, voxel)
    }

    /// Where the frame's origin is: most often the camera. It is far outside of the grid, so an arrow comes from there.
    fn origin_mark(&self) -> Vec<Mark> {
        let Some((at, name)) = &self.origin else { return Vec::new() };
        let Some(direction) = Vector3::from(*at).try_normalize(1e-9).filter(|d| d.iter().all(|side| side.is_finite())) else {
            return Vec::new();
        };
        let sides = <[usize; 3]>::from(self.observation.dims());
        let reach = 0.5 * sides.into_iter().max().unwrap_or(0) as f64;
        let (from, tip) = ((1.25 * reach * direction).into(), (0.85 * reach * direction).into());
        vec![
            Mark::Arrow { from, tip, colour: Colour::INK, width: 2.0 },
            Mark::Text { at: (1.36 * reach * direction).into(), text: name.clone(), colour: Colour::INK },
        ]
    }

    fn axis_marks(&self) -> Vec<Mark> {
        let Some(rotation) = &self.pose else { return Vec::new() };
        let sides = <[usize; 3]>::from(self.observation.dims());
        let (from, half) = match self.object_box {
            Some((centre, lengths)) => (Point3::from(centre), Vector3::from(lengths) / 2.0),
            None => (Point3::origin(), Vector3::repeat(0.38 * sides.into_iter().max().unwrap_or(0) as f64)),
        };
        // The axes reach a little beyond the object.
        let axes = [
            (Vector3::x(), half.x, Colour::X_AXIS, "x"),
            (Vector3::y(), half.y, Colour::Y_AXIS, "y"),
            (Vector3::z(), half.z, Colour::Z_AXIS, "z"),
        ];
        let most = half.max();
        let marks = axes.into_iter().flat_map(|(axis, length, colour, name)| {
            let tip = |beyond: f64| (from + rotation * axis * (length + beyond * most)).into();
            [Mark::Arrow { from: from.into(), tip: tip(0.22), colour, width: 2.2 }, Mark::Text { at: tip(0.36), text: name.into(), colour }]
        });
        marks.collect()
    }

    fn box_marks(&self) -> Vec<Mark> {
        let Some((centre, lengths)) = self.object_box else { return Vec::new() };
        let rotation = self.pose.unwrap_or_default();
        let corner = |bits: usize| {
            let offset = [0, 1, 2].map(|axis| lengths[axis] * if bits >> axis & 1 == 1 { 0.5 } else { -0.5 });
            <[f64; 3]>::from(Point3::from(centre) + rotation * Vector3::from(offset))
        };
        let edges = (0..8_usize).flat_map(|from| (0..3).map(move |axis| (from, from | 1 << axis))).filter(|(from, to)| from != to);
        edges.map(|(from, to)| Mark::Line { from: corner(from), to: corner(to), colour: Colour::BOX, width: 1.0 }).collect()
    }

    /// Class probabilities as bars, notes, and what the colours mean.
    fn draw_column(&self, image: &mut Image, left: i32, top: i32) {
        let line = TextSize::Small.height() as i32 + 7;
        let mut y = top + line / 2;
        let mut classes = self.classes.clone();
        classes.sort_by(|a, b| b.1.total_cmp(&a.1));
        image.text("class", left, y, TextSize::Medium, Anchor::Left, Colour::INK);
        y += line;
        let (names, bar) = (112, COLUMN as i32 - 112 - 58);
        for (place, (name, p)) in classes.iter().take(CLASSES).enumerate() {
            image.text(&fitting(name, names - 6), left, y, TextSize::Small, Anchor::Left, Colour::INK);
            image.rectangle(left + names, y - 6, bar as u32, 13, Colour::FAINT.with_opacity(0.5));
            let colour = if place == 0 { Colour::PREDICTED } else { Colour::PREDICTED.mix(Colour::QUIET, 0.8) };
            let width = (f64::from(bar) * p.clamp(0.0, 1.0)).round() as u32;
            image.rectangle(left + names, y - 6, width.max(u32::from(*p > 0.0)), 13, colour);
            let share = format!("{:.1} %", 100.0 * p);
            image.text(&share, left + COLUMN as i32, y, TextSize::Small, Anchor::Right, Colour::INK);
            y += line;
        }
        if classes.len() > CLASSES {
            let more = format!("and {} less probable", classes.len() - CLASSES);
            image.text(&more, left, y, TextSize::Small, Anchor::Left, Colour::QUIET);
            y += line;
        }
        y += line / 2;
        for note in &self.notes {
            image.text(&fitting(note, COLUMN as i32), left, y, TextSize::Small, Anchor::Left, Colour::INK);
            y += line;
        }
        self.draw_legend(image, left, image.height() as i32 - GAP as i32);
    }

    fn draw_legend(&self, image: &mut Image, left: i32, bottom: i32) {
        let line = TextSize::Small.height() as i32 + 7;
        let mut entries = vec![
            (vec![Colour::KNOWN], "seen"),
            (vec![Colour::UNKNOWN.with_opacity(0.45)], "hidden"),
            ([0.0, 0.33, 0.67, 1.0].map(|share| Colour::predicted(share * MOST_UNSURE)).to_vec(), "predicted, paler where unsure"),
        ];
        if !self.poses.is_empty() {
            entries.push((vec![Colour::PREDICTED], "front, thicker if more probable"));
        }
        if self.pose.is_some() {
            entries.push((vec![Colour::X_AXIS, Colour::Y_AXIS, Colour::Z_AXIS], "the object's axes x, y, z"));
        }
        if self.object_box.is_some() {
            entries.push((vec![Colour::BOX], "the object's box"));
        }
        let mut y = bottom - line * entries.len() as i32 + line / 2;
        for (colours, text) in entries {
            let width = 44 / colours.len() as i32;
            for (place, colour) in colours.iter().enumerate() {
                image.rectangle(left + place as i32 * width, y - 5, width as u32, 11, *colour);
            }
            image.text(text, left + 52, y, TextSize::Small, Anchor::Left, Colour::INK);
            y += line;
        }
    }
}

/// A text, cut to a width in pixels.
fn fitting(text: &str, width: i32) -> String {
    let most = (width.max(0) as usize / TextSize::Small.width("m")).max(2);
    if text.chars().count() <= most { text.into() } else { text.chars().take(most - 2).chain("..".chars()).collect() }
}

/// Legend of the colours of the deviation, in the picture's upper right corner.
fn deviation_bar(image: &mut Image) {
    let (right, top, height) = (image.width() as i32 - 10, 14, 90);
    for row in 0..height {
        let value = 1.0 - row as f32 / (height - 1) as f32;
        image.rectangle(right - 12, top + row, 12, 1, viridis(value));
    }
    for (value, at) in [(MOST_UNSURE, top), (MOST_UNSURE / 2.0, top + height / 2), (0.0, top + height - 1)] {
        image.text(&format!("{value}"), right - 17, at, TextSize::Small, Anchor::Right, Colour::QUIET);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use beo_core::furniture;
    use beo_core::grid::{Dims, View, yaw};

    fn drawn(change: impl FnOnce(&mut Perceived<'_>)) -> Image {
        let dims = Dims::cube(16).unwrap();
        let object = furniture::make("chair", dims, 3).unwrap();
        let observation = View::Top.of(&object);
        let filled = |v| object.bits().contains(v);
        let occupancy: Vec<f32> = (0..dims.voxels()).map(|v| if filled(v) { 0.8 } else { 0.1 }).collect();
        let deviation: Vec<f32> = (0..dims.voxels()).map(|v| if observation.known().contains(v) { 0.0 } else { 0.2 }).collect();
        let mut perceived = Perceived {
            title: "a chair".into(),
            observation: &observation,
            occupancy: &occupancy,
            deviation: &deviation,
            classes: vec![("chair".into(), 0.9), ("table".into(), 0.1)],
            poses: Vec::new(),
            pose: None,
            origin: None,
            object_box: None,
            notes: Vec::new(),
        };
        change(&mut perceived);
        perceived.draw()
    }

    fn count(image: &Image, colour: Colour) -> usize {
        (0..image.height()).map(|y| (0..image.width()).filter(|x| image.pixel(*x, y) == colour.rgb).count()).sum()
    }

    #[test]
    fn axes_box_and_origin_are_drawn_where_they_are_known() {
        let plain = drawn(|_| {});
        assert_eq!((count(&plain, Colour::X_AXIS), count(&plain, Colour::BOX)), (0, 0));
        let marked = drawn(|p| {
            p.pose = Some(yaw(0.7));
            p.poses = vec![(yaw(0.7), 0.9), (yaw(2.0), 0.1)];
            p.object_box = Some(([0.0; 3], [8.0, 9.0, 10.0]));
        });
        assert_eq!((plain.width(), plain.height()), (marked.width(), marked.height()));
        for colour in [Colour::X_AXIS, Colour::Y_AXIS, Colour::Z_AXIS, Colour::BOX] {
            assert!(count(&marked, colour) > 300, "{colour:?}: twice in the pictures and once in the legend");
        }
        let ink = count(&plain, Colour::INK);
        assert!(count(&drawn(|p| p.origin = Some(([-50.0, 0.0, 20.0], "camera".into()))), Colour::INK) > ink + 40);
        for nowhere in [[0.0; 3], [f64::NAN; 3], [f64::INFINITY, 0.0, 0.0]] {
            assert!(drawn(|p| p.origin = Some((nowhere, "camera".into()))) == plain, "{nowhere:?}");
        }
    }

    #[test]
    fn what_a_camera_behind_the_object_saw_is_drawn_from_there() {
        let from = |at: [f64; 3]| drawn(|p| p.origin = Some((at, "camera".into())));
        let (front, behind) = (from([-50.0, -9.0, 20.0]), from([50.0, 9.0, 20.0]));
        let second = 2 * GAP + SIDE;
        // The middle column of the second picture and of the fourth below it: the completion from both sides.
        let place = |image: &Image, row: usize| (0..SIDE - 40).map(|y| image.pixel(second + SIDE / 2, row + y)).collect::<Vec<_>>();
        let (top, step) = (2 * GAP + TextSize::Large.height(), SIDE + TextSize::Small.height() + 8 + GAP);
        assert_eq!(place(&behind, top), place(&front, top + step));
        assert_ne!(place(&behind, top), place(&front, top));
    }

    #[test]
    #[ignore = "writes pictures for a person to look at: set BEO_PICTURES to a folder"]
    fn pictures_to_look_at() {
        let Some(folder) = std::env::var_os("BEO_PICTURES") else { return };
        let image = drawn(|p| {
            p.pose = Some(yaw(0.4));
            p.poses = vec![(yaw(0.4), 0.8), (yaw(2.5), 0.15)];
            p.origin = Some(([-60.0, 5.0, 40.0], "camera".into()));
            p.object_box = Some(([0.0, 0.0, 0.5], [9.0, 9.0, 13.0]));
            p.classes = (0..14).map(|n| (format!("class {n}"), 0.5_f64.powi(n + 1))).collect();
            p.notes = vec!["turned by 23° ± 4°".into(), "at (0.512, -0.021, 0.934) m".into(), "0.480 × 0.450 × 0.910 m".into()];
        });
        image.save(&std::path::Path::new(&folder).join("perceived.png")).unwrap();
    }

    #[test]
    fn long_names_and_many_classes_are_cut() {
        let many = drawn(|p| p.classes = (0..64).map(|n| (format!("{n} is a class with a very long name"), 1.0 / 64.0)).collect());
        assert_eq!((many.width(), many.height()), (drawn(|_| {}).width(), drawn(|_| {}).height()));
        assert_eq!((fitting("chair", 70), fitting("a very long name", 70)), ("chair".into(), "a very l..".into()));
    }
}
