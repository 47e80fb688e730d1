//! Which readings of a mask are the object's own.
//!
//! Masks are some pixels too wide, shifted, or boxes, and depth smears at edges. In this order:
//! 1. Readings at the support plane are the plane's: below a height that follows the plane's own scatter and the height of the object,
//!    so that flat things do not vanish. What is low but enclosed by the object's readings and joined to them (the floor of a bowl, the
//!    middle of a plate) stays.
//! 2. Readings that are joined to few neighbours fly between two surfaces.
//! 3. Of what remains, the largest piece, with every piece near it in space or cut off from it by something nearer. The rest is far.

use crate::interior::enclosed;
use crate::joining::{nearest, samples};
use crate::links::Links;
use crate::patch::Patch;
use crate::scene::{LocalSupport, Scene};
use nalgebra::Vector3;

/// Which readings are the object's.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct OwnReadings {
    /// Pixels of the object, ascending.
    pub pixels: Vec<u32>,
    /// Pixels whose readings fly between surfaces, and are nobody's.
    pub flying: Vec<u32>,
    /// Share of the mask's readings at or below the support plane.
    pub share_support: f64,
    /// Share that flies between surfaces.
    pub share_edge: f64,
    /// Share in pieces that do not belong to the main one.
    pub share_far: f64,
}

/// Readings nearer to the plane than this are the plane's whatever the object, metres; or than so many deviations of it.
const LEAST_HEIGHT_M: f64 = 0.003;
const LEAST_DEVIATIONS: f64 = 3.0;
/// Where the mask is too wide, readings at the foot of a high object are the plane's up to this height, metres, or this share of its own.
const FOOT_M: f64 = 0.012;
const FOOT_SHARE: f64 = 0.3;
/// How far the plane around an object may be from the one below it, metres.
const BENT_M: f32 = 5e-4;
/// Something is flat if it is no higher than a foot, or than so many deviations of the support's readings.
const FLAT_DEVIATIONS: f32 = 4.0;
/// Standard errors by which the mean height of something flat is above the support; neighbouring readings err alike: so many count as one.
const FLAT_ERRORS: f32 = 2.0;
const ALIKE: f32 = 10.0;
/// Its readings are those whose mean over so many pixels to all sides is above this share of a deviation.
const FLAT_PIXELS: usize = 2;
const FLAT_SHARE: f32 = 0.6;
/// Neighbours of eight that a reading must be joined to.
const LEAST_NEIGHBOURS: u32 = 3;
/// Pieces nearer than this hang together, metres, or than so many pixels.
const GAP_M: f32 = 0.02;
const GAP_PIXELS: f32 = 6.0;
/// Or than this share of the largest one's extent, at most metres: a bowl's near wall hides what joins it to the far one.
const GAP_SHARE: f32 = 0.5;
const GAP_MOST_M: f32 = 0.1;
/// Share of the main piece below which a piece is a speck.
const SPECK: f64 = 0.01;

const NONE: u8 = 0;
const LOW: u8 = 1;
const HIGH: u8 = 2;
const FLYING: u8 = 3;
const DONE: u8 = 4;

/// Finds an object's own readings among those of its mask. `state` has a 0 for every pixel of the image, before and after.
pub fn own_readings(scene: &Scene<'_>, mask: &[u32], support: Option<&LocalSupport>, least: usize, state: &mut [u8]) -> OwnReadings {
    let heights: Vec<f32> = match support {
        Some(support) => {
            let (n, offset) = (support.plane.normal().into_inner().cast::<f32>(), support.plane.offset() as f32);
            mask.iter().map(|pixel| n.dot(&scene.rays.point(*pixel as usize, scene.depth[*pixel as usize])) + offset).collect()
        }
        None => Vec::new(),
    };
    let mut found = OwnReadings::default();
    for strict in [false, true] {
        found = attempt(scene, mask, &heights, support, strict, state);
        if found.pixels.len() >= least.max(mask.len() / 20) {
            break;
        }
    }
    if let Some(support) = support
        && found.pixels.len() < mask.len() / 2
        && let Some(flat) = flat_thing(scene, mask, &heights, support)
        && flat.pixels.len() >= least.max(found.pixels.len())
    {
        return flat;
    }
    found
}

/// The readings of something flat: no single one stands out from the support, but all together do. `None` if they do not, or if something
/// high is in the mask.
fn flat_thing(scene: &Scene<'_>, mask: &[u32], heights: &[f32], support: &LocalSupport) -> Option<OwnReadings> {
    let (width, height) = (scene.rays.width(), scene.rays.height());
    let deviation = support.deviation_m as f32;
    let top = percentile(heights, 0.9);
    let mean = heights.iter().sum::<f32>() / heights.len().max(1) as f32;
    let error = deviation * (ALIKE / heights.len().max(1) as f32).sqrt();
    if top > (FOOT_M as f32).max(FLAT_DEVIATIONS * deviation) || mean < BENT_M + FLAT_ERRORS * error {
        return None;
    }
    let label = mask.first().map(|pixel| scene.labels[*pixel as usize])?;
    let mean_around = |pixel: u32| {
        let (u, v) = (pixel as usize % width, pixel as usize / width);
        let (mut sum, mut count) = (0.0_f32, 0_u32);
        for v in v.saturating_sub(FLAT_PIXELS)..(v + FLAT_PIXELS + 1).min(height) {
            for other in v * width + u.saturating_sub(FLAT_PIXELS)..v * width + (u + FLAT_PIXELS + 1).min(width) {
                if scene.labels[other] == label && scene.depth[other] > 0.0 {
                    // Readings of a mask are ascending, and have their heights beside them.
                    if let Ok(index) = mask.binary_search(&(other as u32)) {
                        (sum, count) = (sum + heights[index], count + 1);
                    }
                }
            }
        }
        sum / count.max(1) as f32
    };
    let least = (2.0 * BENT_M).max(FLAT_SHARE * deviation);
    let pixels: Vec<u32> = mask.iter().copied().filter(|pixel| mean_around(*pixel) > least).collect();
    let share_support = 1.0 - pixels.len() as f64 / mask.len() as f64;
    Some(OwnReadings { pixels, share_support, ..OwnReadings::default() })
}

fn attempt(
    scene: &Scene<'_>,
    mask: &[u32],
    heights: &[f32],
    support: Option<&LocalSupport>,
    strict: bool,
    state: &mut [u8],
) -> OwnReadings {
    let mut found = OwnReadings::default();
    let mut low: Vec<(u32, f32)> = Vec::new();
    if let Some(support) = support {
        let least = LEAST_HEIGHT_M.max(LEAST_DEVIATIONS * support.deviation_m) as f32;
        let top = percentile(heights, 0.95);
        let foot = if strict { least } else { least.max((FOOT_SHARE as f32 * top).min(FOOT_M as f32)) };
        for (pixel, h) in mask.iter().zip(heights) {
            state[*pixel as usize] = if *h > foot { HIGH } else { LOW };
        }
        low.extend(mask.iter().copied().zip(heights.iter().copied()).filter(|(_, h)| *h <= foot));
    } else {
        mask.iter().for_each(|pixel| state[*pixel as usize] = HIGH);
    }
    let high: Vec<u32> = mask.iter().copied().filter(|pixel| state[*pixel as usize] == HIGH).collect();
    let patch = Patch::of(scene.depth, scene.rays.width(), &high, 0);
    let mut links = Links::default();
    links.find(patch.z(), patch.width(), &scene.joint);
    let flying: Vec<u32> = high.iter().copied().filter(|pixel| links.count(patch.place(*pixel)) < LEAST_NEIGHBOURS).collect();
    let places: Vec<u32> = high.iter().map(|pixel| patch.place(*pixel) as u32).collect();
    let mut at_places = vec![NONE; patch.z().len()];
    places.iter().for_each(|place| at_places[*place as usize] = HIGH);
    flying.iter().for_each(|pixel| at_places[patch.place(*pixel)] = FLYING);
    let mut all = links.pieces(&places, &mut at_places, HIGH, DONE);
    all.iter_mut().for_each(|piece| piece.pixels.iter_mut().for_each(|place| *place = patch.pixel(*place)));
    let (mut main, far) = main_pieces(scene, &all);
    let mut at_support = low.len();
    if let Some(support) = support {
        let inside = enclosed(scene, support, &main, &low, state, [LOW, DONE]);
        at_support -= inside.len();
        main.extend(inside);
    }
    let count = mask.len().max(1) as f64;
    found.share_support = at_support as f64 / count;
    found.share_edge = flying.len() as f64 / count;
    found.share_far = far as f64 / count;
    found.pixels = main;
    found.flying = flying;
    found.pixels.sort_unstable();
    mask.iter().for_each(|pixel| state[*pixel as usize] = NONE);
    found
}

/// The pixels of the largest piece and of those that belong to it; and how many are left.
fn main_pieces(scene: &Scene<'_>, all: &[crate::joining::Piece]) -> (Vec<u32>, usize) {
    let Some(first) = all.first() else { return (Vec::new(), 0) };
    let speck = ((SPECK * first.pixels.len() as f64) as usize).max(4);
    let mut main = first.pixels.clone();
    let size = extent(scene, &first.pixels);
    let mut points = samples(scene.rays, scene.depth, &first.pixels);
    let mut waiting: Vec<&crate::joining::Piece> = all[1..].iter().filter(|piece| piece.pixels.len() >= speck).collect();
    let mut far: usize = all[1..].iter().map(|piece| piece.pixels.len()).sum();
    loop {
        let before = waiting.len();
        waiting.retain(|piece| {
            let own = samples(scene.rays, scene.depth, &piece.pixels);
            let Some((distance, ends)) = nearest(&points, &own) else { return true };
            let z = scene.depth[ends[0] as usize].min(scene.depth[ends[1] as usize]);
            let near = GAP_M.max(GAP_PIXELS * scene.rays.pitch(z)).max((GAP_SHARE * size).min(GAP_MOST_M));
            let is_near = distance < near || is_hidden_between(scene, ends);
            if is_near {
                main.extend_from_slice(&piece.pixels);
                points.extend(own);
                far -= piece.pixels.len();
            }
            !is_near
        });
        if waiting.len() == before || waiting.is_empty() {
            return (main, far);
        }
    }
}

/// How far a piece reaches, metres.
fn extent(scene: &Scene<'_>, pixels: &[u32]) -> f32 {
    let points = samples(scene.rays, scene.depth, pixels);
    let low = points.iter().fold(Vector3::repeat(f32::INFINITY), |low, (p, _)| low.inf(p));
    let high = points.iter().fold(Vector3::repeat(f32::NEG_INFINITY), |high, (p, _)| high.sup(p));
    (high - low).max()
}

/// Whether all between two pixels is nearer than both: one surface behind something.
fn is_hidden_between(scene: &Scene<'_>, ends: [u32; 2]) -> bool {
    let width = scene.rays.width();
    let at = |pixel: u32| [(pixel as usize % width) as f32, (pixel as usize / width) as f32];
    let (a, b) = (at(ends[0]), at(ends[1]));
    let [za, zb] = ends.map(|pixel| scene.depth[pixel as usize]);
    let steps = (a[0] - b[0]).abs().max((a[1] - b[1]).abs()) as usize;
    if steps < 3 {
        return true;
    }
    let (mut nearer, mut seen) = (0, 0);
    for step in 1..steps {
        let share = step as f32 / steps as f32;
        let (u, v) = (a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1]));
        let z = scene.depth[v.round() as usize * width + u.round() as usize];
        let expected = za + share * (zb - za);
        if z > 0.0 {
            seen += 1;
            nearer += usize::from(z < expected - scene.joint.reach(expected));
        }
    }
    seen > 0 && nearer * 5 >= seen * 4
}

/// The value below which `share` of the values lie.
pub fn percentile(values: &[f32], share: f64) -> f32 {
    if values.is_empty() {
        return 0.0;
    }
    let mut sorted = values.to_vec();
    let at = ((share * (sorted.len() - 1) as f64).round() as usize).min(sorted.len() - 1);
    *sorted.select_nth_unstable_by(at, f32::total_cmp).1
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::SensorModel;
    use crate::joining::Joint;
    use crate::test_scene::{TestScene, Thing};

    /// The own readings of thing 1 with a label image of its own: how many, and how many of those show something else.
    fn own(scene: &TestScene, labels: &[u16]) -> (OwnReadings, usize, usize) {
        let sensor = SensorModel::default();
        let joint = Joint::new(&scene.rays, &sensor);
        let looked_at = Scene { rays: &scene.rays, depth: &scene.depth, labels, sensor: &sensor, joint };
        let support = LocalSupport { plane: scene.table, deviation_m: 0.001 };
        let mut state = vec![0; scene.depth.len()];
        let found = own_readings(&looked_at, &scene.pixels(labels, 1), Some(&support), 40, &mut state);
        assert!(state.iter().all(|state| *state == 0), "the state is as it was");
        assert!(found.pixels.is_sorted());
        let foreign = found.pixels.iter().filter(|pixel| scene.labels[**pixel as usize] != 1).count();
        let lost = scene.pixels(&scene.labels, 1).len() + foreign - found.pixels.len();
        (found, foreign, lost)
    }

    #[test]
    fn the_floor_of_a_bowl_is_its_own_and_the_table_around_it_is_not() {
        for floor in [0.002, 0.005, 0.01] {
            let bowl = TestScene::new(&[Thing::Cup([0.02, 0.5], 0.08, 0.06, floor)], 0.5);
            for by in [0, 3] {
                let (found, foreign, lost) = own(&bowl, &bowl.widened(1, by));
                let all = bowl.pixels(&bowl.labels, 1).len();
                // At the foot of the outer wall some are: a mask that is too wide has the table there.
                assert!(lost * 6 < all, "floor {floor}, {by} px: {lost} of {all} lost");
                assert!(foreign * 50 < all, "floor {floor}, {by} px: {foreign} of the table");
                assert!(by == 0 || found.share_support > 0.03);
            }
        }
    }

    #[test]
    fn the_table_in_a_box_about_a_thing_is_left() {
        let carton = TestScene::new(&[Thing::Box([0.0, 0.55], [0.035, 0.025], 0.13)], 0.5);
        let shown = carton.pixels(&carton.labels, 1);
        let across = |pixel: &u32| [*pixel as usize % 320, *pixel as usize / 320];
        let bounds =
            shown.iter().map(across).fold([[usize::MAX, 0]; 2], |[[l, r], [t, b]], [u, v]| [[l.min(u), r.max(u)], [t.min(v), b.max(v)]]);
        let is_in = |pixel: usize| (0..2).all(|i| (bounds[i][0]..=bounds[i][1]).contains(&across(&(pixel as u32))[i]));
        let labels: Vec<u16> = (0..carton.labels.len()).map(|pixel| u16::from(is_in(pixel))).collect();
        let (_, foreign, lost) = own(&carton, &labels);
        assert!(lost * 8 < shown.len() && foreign * 100 < shown.len(), "{lost} lost, {foreign} foreign of {}", shown.len());
    }

    #[test]
    fn a_flat_thing_is_its_mask_s_readings_and_a_piece_of_the_table_is_nothing() {
        let knife = TestScene::new(&[Thing::Box([0.0, 0.5], [0.1, 0.01], 0.0025)], 1.0);
        let (found, ..) = own(&knife, &knife.labels);
        let all = knife.pixels(&knife.labels, 1).len();
        assert!(found.pixels.len() * 10 > all * 7, "{} of {all}", found.pixels.len());
        let bare = TestScene::new(&[], 1.0);
        let (found, ..) = own(&bare, &knife.labels);
        assert!(found.pixels.len() < 40, "{}", found.pixels.len());
    }

    #[test]
    fn what_lies_far_behind_is_no_part() {
        // The floor is seen beside a box at the edge of the table.
        let edge = TestScene::new(&[Thing::Box([0.37, 0.6], [0.04, 0.04], 0.1)], 0.5);
        let (found, foreign, lost) = own(&edge, &edge.widened(1, 4));
        let all = edge.pixels(&edge.labels, 1).len();
        assert!(foreign * 50 < all && lost * 10 < all, "{foreign} foreign, {lost} lost of {all}");
        assert!(found.share_far + found.share_edge + found.share_support > 0.05);
    }

    /// A wall at 2 m with other depths in front of it, seen by the test scene's camera: rows `v` and columns `u` of each.
    fn before_a_wall(things: &[(std::ops::Range<usize>, std::ops::Range<usize>, f32)]) -> TestScene {
        let mut scene = TestScene::new(&[], 0.0);
        let width = scene.rays.width();
        scene.depth.iter_mut().enumerate().for_each(|(pixel, z)| {
            let of = things.iter().find(|(v, u, _)| v.contains(&(pixel / width)) && u.contains(&(pixel % width)));
            *z = of.map_or(2.0, |(.., z)| *z);
        });
        scene
    }

    fn scene<'a>(of: &'a TestScene, sensor: &'a SensorModel) -> Scene<'a> {
        Scene { rays: &of.rays, depth: &of.depth, labels: &of.labels, sensor, joint: Joint::new(&of.rays, sensor) }
    }

    #[test]
    fn what_is_nearer_than_both_ends_hides_one_surface() {
        let sensor = SensorModel::default();
        let ends = [95 * 320 + 100, 115 * 320 + 160];
        let is_hidden = |between: f32| {
            let seen = before_a_wall(&[(90..120, 101..160, between), (90..120, 90..170, 1.0)]);
            is_hidden_between(&scene(&seen, &sensor), ends)
        };
        assert_eq!([0.8, 1.0, 1.2, 0.0].map(is_hidden), [true, false, false, false]);
        // Four of five readings are enough, and three are not: the others show the surface itself.
        let partly = |nearer: usize| {
            let seen = before_a_wall(&[(100..101, 101..101 + nearer, 0.8), (90..120, 90..170, 1.0)]);
            is_hidden_between(&scene(&seen, &sensor), [100 * 320 + 100, 100 * 320 + 151])
        };
        assert_eq!([39, 40, 41].map(partly), [false, true, true]);
        // From 0.9 to 1.1 m: in the middle 0.95 m is nearer, at the near end it is not.
        let slanted = |at: usize| {
            let seen =
                before_a_wall(&[(90..120, 100..101, 0.9), (90..120, 160..161, 1.1), (90..120, at..at + 1, 0.95), (90..120, 90..170, 0.0)]);
            is_hidden_between(&scene(&seen, &sensor), [100 * 320 + 100, 100 * 320 + 160])
        };
        assert_eq!([105, 140].map(slanted), [false, true]);
        let seen = before_a_wall(&[]);
        assert!(is_hidden_between(&scene(&seen, &sensor), [100 * 320 + 100, 100 * 320 + 102]), "neighbours have nothing between them");
    }

    /// 40 rows of 3.45 mm at 1 m are 13.5 cm: a piece belongs to them that is nearer than half of that, 19 pixels from the column that is
    /// sampled last, 9 from the edge.
    #[test]
    fn a_piece_belongs_to_the_largest_within_half_its_size_and_specks_do_not() {
        let sensor = SensorModel::default();
        let of = |gap: usize, pixels: usize| {
            let seen = before_a_wall(&[(100..140, 100..140, 1.0), (100..110, 139 + gap..139 + gap + pixels / 10, 1.0)]);
            let piece = |rows: std::ops::Range<u32>, columns: std::ops::Range<u32>| crate::joining::Piece {
                pixels: rows.flat_map(|v| columns.clone().map(move |u| v * 320 + u)).collect(),
            };
            let first = 139 + gap as u32;
            let pieces = [piece(100..140, 100..140), piece(100..110, first..first + pixels as u32 / 10)];
            let (main, far) = main_pieces(&scene(&seen, &sensor), &pieces);
            (main.len(), far)
        };
        assert_eq!(of(8, 100), (1700, 0));
        assert_eq!(of(14, 100), (1600, 100));
        assert_eq!(of(2, 10), (1600, 10), "one of a hundred is 16 pixels");
        assert_eq!(of(2, 20), (1620, 0));
    }
}
