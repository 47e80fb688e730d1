//! The planes that the objects of a frame stand on, and what is up.
//!
//! Every plane of the frame is a candidate. What is up is given, or is the normal of the plane that most objects stand on: readings around
//! their masks lie on it and the objects above it. All planes with that normal are supports: an object stands on the highest one below it
//! that is seen around it.

use crate::SensorModel;
use crate::blocks::{Block, flat_blocks};
use crate::own_readings::percentile;
use crate::planes::{FoundPlane, find_planes};
use crate::rays::Rays;
use crate::scene::{LocalSupport, Scene};
use crate::support::Plane;
use nalgebra::{Matrix3, Point3, Unit, Vector3};

/// How far the plane that things stand on may be from the given direction up: cosine of 15°.
const UPRIGHT: f64 = 0.965_925_826_289_068_3;
/// How far supports may be from each other: cosine of 8°.
const PARALLEL: f64 = 0.990_268;
/// Weight of a plane that only a rolled camera, or one that looks up, sees as a floor.
const UNUSUAL: f64 = 0.4;
/// Planes of a frame, at most.
const MOST_PLANES: usize = 5;

/// Prior knowledge of a frame's supports.
#[derive(Clone, Copy, Debug, Default)]
pub struct SupportSearch {
    /// Direction of up in the camera frame, if it is known.
    pub up: Option<Unit<Vector3<f64>>>,
    /// The label whose pixels are the support.
    pub label: Option<u16>,
}

/// Supports of a frame.
#[derive(Clone, Debug)]
pub struct Supports {
    /// Direction of up in the camera frame.
    pub up: Unit<Vector3<f64>>,
    /// The planes, the main one first; may be empty where up was given.
    pub planes: Vec<FoundPlane>,
    /// How far the given direction up was from the plane's normal, radians, where it was corrected.
    pub corrected_rad: Option<f64>,
    /// Which labels are a support, ascending.
    pub labels: Vec<u16>,
}

/// Objects of a frame by their pixels with readings.
pub type Masks<'a> = [(u16, &'a [u32])];

/// The supports of a frame with masks; `None` where nothing says what is up.
pub fn find_supports(scene: &Scene<'_>, masks: &Masks<'_>, search: &SupportSearch) -> Option<Supports> {
    let mut labels: Vec<u16> = Vec::new();
    if let Some(label) = search.label {
        labels.push(label);
    } else {
        labels = masks.iter().filter(|(_, pixels)| is_support(scene, masks, pixels)).map(|(label, _)| *label).collect();
    }
    let of_supports = |pixel: usize| labels.binary_search(&scene.labels[pixel]).is_ok();
    let given = search.label.is_some();
    let blocks = flat_blocks(scene.rays, scene.depth, scene.sensor, |pixel| of_supports(pixel) || !given && scene.labels[pixel] == 0);
    let objects: Vec<(u16, &[u32])> = masks.iter().filter(|(label, _)| labels.binary_search(label).is_err()).copied().collect();
    let planes = find_planes(&blocks, scene.sensor, MOST_PLANES, |normal| search.up.is_none_or(|up| up.dot(normal) >= UPRIGHT));
    let best = planes.iter().map(|plane| merit(scene, &objects, plane, &labels, search.up.is_some() || given)).enumerate();
    let best = best.max_by(|a, b| a.1.total_cmp(&b.1)).map(|(best, _)| best);
    Some(chosen(planes, best?, search.up, labels)).or_else(|| only_up(search))
}

/// Up alone, where it is given.
pub fn only_up(search: &SupportSearch) -> Option<Supports> {
    search.up.map(|up| Supports { up, planes: Vec::new(), corrected_rad: None, labels: search.label.into_iter().collect() })
}

/// The main plane first, then those parallel to it.
pub fn chosen(mut planes: Vec<FoundPlane>, best: usize, given: Option<Unit<Vector3<f64>>>, labels: Vec<u16>) -> Supports {
    let main = planes.remove(best);
    let up = main.plane.normal();
    planes.retain(|plane| plane.plane.normal().dot(&up) >= PARALLEL);
    planes.insert(0, main);
    let corrected_rad = given.map(|given| given.angle(&up));
    Supports { up, planes, corrected_rad, labels }
}

/// Up as an upright camera sees it that looks down: −y and −z, and little of x.
pub fn is_usual(normal: &Vector3<f64>) -> bool {
    normal.x.abs() <= 0.5 && normal.y <= 0.26 && normal.z <= 0.26
}

/// How much speaks for a plane as what the objects stand on.
fn merit(scene: &Scene<'_>, objects: &Masks<'_>, plane: &FoundPlane, supports: &[u16], up_is_known: bool) -> f64 {
    let standing: f64 = objects.iter().map(|(_, mask)| stands_on(scene, mask, &plane.plane, supports)).sum();
    let share = plane.weight / (scene.depth.len() as f64);
    let usual = if up_is_known || is_usual(&plane.plane.normal()) { 1.0 } else { UNUSUAL };
    usual * (standing + share.min(1.0))
}

/// Pixels of a ring that are looked at, at most.
const RING_SAMPLES: usize = 900;
/// How wide the ring around an object is, metres; and at least so many pixels.
const RING_M: f32 = 0.05;
const RING_PIXELS: usize = 8;
/// Readings of the ring further than this before or behind the object are not beside it, metres.
const BESIDE_M: f32 = 0.35;

/// Every so manieth of some values, so that there are no more than `most`.
fn some_of<T>(values: &[T], most: usize) -> impl Iterator<Item = &T> {
    values.iter().step_by(values.len().div_ceil(most).max(1))
}

/// Readings around an object that are no object's: pixels of its bounding box, widened, without its own.
fn ring(scene: &Scene<'_>, mask: &[u32], supports: &[u16]) -> Vec<u32> {
    if mask.is_empty() {
        return Vec::new();
    }
    let (width, height) = (scene.rays.width(), scene.rays.height());
    let bounds = mask.iter().fold([usize::MAX, 0, usize::MAX, 0], |[l, r, t, b], pixel| {
        let (u, v) = (*pixel as usize % width, *pixel as usize / width);
        [l.min(u), r.max(u), t.min(v), b.max(v)]
    });
    let depths: Vec<f32> = some_of(mask, 400).map(|pixel| scene.depth[*pixel as usize]).collect();
    let middle = percentile(&depths, 0.5);
    let wide = RING_PIXELS.max((RING_M / scene.rays.pitch(middle).max(1e-6)) as usize).min(width);
    let (left, right) = (bounds[0].saturating_sub(wide), (bounds[1] + wide).min(width - 1));
    let (top, bottom) = (bounds[2].saturating_sub(wide), (bounds[3] + wide).min(height - 1));
    let step = ((((right - left + 1) * (bottom - top + 1)) as f64 / (2 * RING_SAMPLES) as f64).sqrt() as usize).max(1);
    let mut found = Vec::new();
    for v in (top..=bottom).step_by(step) {
        for u in (left..=right).step_by(step) {
            let pixel = v * width + u;
            let (z, label) = (scene.depth[pixel], scene.labels[pixel]);
            if z > 0.0 && (z - middle).abs() < BESIDE_M && (label == 0 || supports.binary_search(&label).is_ok()) {
                found.push(pixel as u32);
            }
        }
    }
    found
}

fn heights(scene: &Scene<'_>, pixels: &[u32], plane: &Plane) -> Vec<f32> {
    let (n, offset) = (plane.normal().into_inner().cast::<f32>(), plane.offset() as f32);
    pixels.iter().map(|pixel| n.dot(&scene.rays.point(*pixel as usize, scene.depth[*pixel as usize])) + offset).collect()
}

/// From 0 to 1: how well an object stands on a plane. Its ring lies on it, and it lies above.
fn stands_on(scene: &Scene<'_>, mask: &[u32], plane: &Plane, supports: &[u16]) -> f64 {
    if mask.len() < 30 {
        return 0.0;
    }
    let around = ring(scene, mask, supports);
    if around.len() < 20 {
        return 0.0;
    }
    let near = |h: &f32| h.abs() < 0.01;
    let on = heights(scene, &around, plane).iter().filter(|h| near(h)).count() as f64 / around.len() as f64;
    let some: Vec<u32> = some_of(mask, 400).copied().collect();
    let own = heights(scene, &some, plane);
    let above = own.iter().filter(|h| **h > -0.01 && **h < 0.6).count() as f64 / own.len() as f64;
    // What stands on a plane begins at it.
    let lowest = percentile(&own, 0.05);
    let touches = if lowest < 0.05 { 1.0 } else { 0.3 };
    on * above.powi(4) * touches
}

/// The least share of the ring that must lie on an object's support.
const LEAST_ON: f64 = 0.12;
/// How far the support may lie beside the plane that was found, metres: sensors bend planes.
const MOST_BENT_M: f32 = 0.012;
/// How much the support's slope around an object may differ from the whole plane's, radians: one standard deviation.
const BENT_RAD: f64 = 0.02;
/// Readings of the ring that count as one.
const CORRELATED: f64 = 10.0;

/// The support of one object: the highest plane below it that is seen around it, moved and tilted to where the readings around it lie.
pub fn local_support(scene: &Scene<'_>, mask: &[u32], supports: &Supports) -> Option<LocalSupport> {
    let around = ring(scene, mask, &supports.labels);
    let some: Vec<u32> = some_of(mask, 600).copied().collect();
    let mut best: Option<(f32, &FoundPlane)> = None;
    for found in &supports.planes {
        let near = heights(scene, &around, &found.plane).iter().filter(|h| h.abs() < MOST_BENT_M).count();
        if near < 20 || (near as f64) < LEAST_ON * around.len() as f64 {
            continue;
        }
        let own = heights(scene, &some, &found.plane);
        // Masks that are too wide hold readings of what is below.
        let middle = percentile(&own, 0.7);
        if middle < -0.01 {
            continue;
        }
        if best.as_ref().is_none_or(|(lowest, ..)| middle < *lowest) {
            best = Some((middle, found));
        }
    }
    let Some((_, found)) = best else {
        let main = supports.planes.first()?;
        let z = percentile(&some.iter().map(|pixel| scene.depth[*pixel as usize]).collect::<Vec<_>>(), 0.5);
        return Some(LocalSupport { plane: main.plane, deviation_m: scene.sensor.deviation(f64::from(z)) });
    };
    Some(fitted_around(scene, &around, &found.plane))
}

/// A plane as it lies around an object: its height and slope there, by least squares over what lies near it, without outliers. The slope is
/// expected to be the whole plane's within [`BENT_RAD`], so that readings on one side alone do not tilt it.
fn fitted_around(scene: &Scene<'_>, around: &[u32], plane: &Plane) -> LocalSupport {
    let normal = plane.normal().into_inner();
    let x = if normal.x.abs() < 0.7 { Vector3::x() } else { Vector3::y() };
    let x = (x - normal * normal.dot(&x)).normalize();
    let y = normal.cross(&x);
    let points: Vec<Vector3<f64>> =
        around.iter().map(|pixel| scene.rays.point(*pixel as usize, scene.depth[*pixel as usize]).cast()).collect();
    let near = points.iter().filter(|p| plane.height(&Point3::from(**p)).abs() < f64::from(MOST_BENT_M));
    let middle = near.clone().sum::<Vector3<f64>>() / near.count().max(1) as f64;
    // Height over the plane as offset + slope · (x, y).
    let mut bend = Vector3::zeros();
    let height = |p: &Vector3<f64>, bend: &Vector3<f64>| {
        plane.height(&Point3::from(*p)) - bend.x - bend.y * x.dot(&(p - middle)) - bend.z * y.dot(&(p - middle))
    };
    let mut reach = f64::from(MOST_BENT_M);
    let mut deviation = reach / 2.0;
    for _ in 0..4 {
        let inner: Vec<&Vector3<f64>> = points.iter().filter(|p| height(p, &bend).abs() < reach).collect();
        if inner.len() < 20 {
            break;
        }
        let (mut matrix, mut right) = (Matrix3::zeros(), Vector3::zeros());
        for p in &inner {
            let row = Vector3::new(1.0, x.dot(&(*p - middle)), y.dot(&(*p - middle)));
            matrix += row * row.transpose();
            right += row * plane.height(&Point3::from(**p));
        }
        // Neighbouring readings err alike: so many count as one.
        let prior = CORRELATED * (deviation / BENT_RAD).powi(2);
        matrix[(1, 1)] += prior;
        matrix[(2, 2)] += prior;
        let Some(solved) = matrix.cholesky().map(|c| c.solve(&right)) else { break };
        bend = solved;
        let off: Vec<f32> = inner.iter().map(|p| height(p, &bend).abs() as f32).collect();
        deviation = f64::from((1.4826 * percentile(&off, 0.5)).max(2e-4));
        reach = (2.5 * deviation).min(f64::from(MOST_BENT_M));
    }
    let tilted = Unit::new_normalize(normal - x * bend.y - y * bend.z);
    LocalSupport {
        plane: Plane::new(tilted, &Point3::from(middle + normal * (bend.x - plane.height(&Point3::from(middle))))),
        deviation_m: deviation,
    }
}

/// A label is a support if it is by far the largest, flat, and other labels stand on it.
fn is_support(scene: &Scene<'_>, masks: &Masks<'_>, pixels: &[u32]) -> bool {
    let readings = scene.depth.iter().filter(|z| **z > 0.0).count();
    if masks.len() < 2 || pixels.len() * 12 < readings {
        return false;
    }
    let Some(first) = pixels.first() else { return false };
    let label = scene.labels[*first as usize];
    let blocks = flat_blocks(scene.rays, scene.depth, scene.sensor, |pixel| scene.labels[pixel] == label);
    let Some(found) = find_planes(&blocks, scene.sensor, 1, |_| true).into_iter().next() else { return false };
    let some: Vec<u32> = some_of(pixels, 2000).copied().collect();
    let flat = heights(scene, &some, &found.plane).iter().filter(|h| h.abs() < 0.012).count() as f64 / some.len() as f64;
    let above = |other: &[u32]| {
        let some: Vec<u32> = some_of(other, 300).copied().collect();
        let own = heights(scene, &some, &found.plane);
        !own.is_empty() && own.iter().filter(|h| **h > -0.015 && **h < 0.6).count() * 10 >= own.len() * 7
    };
    let others: Vec<&[u32]> = masks.iter().filter(|(other, own)| *other != label && own.len() >= 30).map(|(_, own)| *own).collect();
    let standing = others.iter().filter(|own| above(own)).count();
    let larger = others.iter().filter(|own| own.len() * 2 > pixels.len()).count();
    // The side of a large box is seen beside the table that it stands on; a table is beside nothing that lies lower and is near.
    flat > 0.8 && larger == 0 && !others.is_empty() && standing * 10 >= others.len() * 6 && extent(&blocks, &found) > 0.35
}

/// How far a plane's squares reach, metres.
pub fn extent(blocks: &[Block], found: &FoundPlane) -> f64 {
    let (mut low, mut high) = (Vector3::repeat(f64::INFINITY), Vector3::repeat(f64::NEG_INFINITY));
    for block in &found.blocks {
        low = low.inf(&blocks[*block].centre);
        high = high.sup(&blocks[*block].centre);
    }
    (high - low).max()
}

/// The planes of a frame without masks, and which of them is the main support.
pub fn find_table(rays: &Rays, depth: &[f32], sensor: &SensorModel, search: &SupportSearch) -> Option<Supports> {
    let blocks = flat_blocks(rays, depth, sensor, |_| true);
    let planes = find_planes(&blocks, sensor, MOST_PLANES, |normal| search.up.is_none_or(|up| up.dot(normal) >= UPRIGHT));
    let usual = |plane: &FoundPlane| if search.up.is_some() || is_usual(&plane.plane.normal()) { 1.0 } else { UNUSUAL };
    let merits: Vec<f64> = planes.iter().map(|plane| plane.weight * usual(plane)).collect();
    let first = (0..planes.len()).max_by(|a, b| merits[*a].total_cmp(&merits[*b]))?;
    // Of parallel planes that are large, the highest: a table, and not the floor below it.
    let is_rival = |i: &usize| {
        planes[*i].plane.normal().dot(&planes[first].plane.normal()) >= PARALLEL
            && merits[*i] >= 0.35 * merits[first]
            && extent(&blocks, &planes[*i]) >= 0.3
    };
    let best = (0..planes.len())
        .filter(|i| *i == first || is_rival(i))
        .min_by(|a, b| planes[*a].plane.offset().total_cmp(&planes[*b].plane.offset()))?;
    Some(chosen(planes, best, search.up, Vec::new()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::SensorModel;
    use crate::joining::Joint;
    use crate::test_scene::{TestScene, Thing};

    fn supports_of(scene: &TestScene, labels: &[u16], search: &SupportSearch) -> (Option<Supports>, Option<LocalSupport>) {
        let sensor = SensorModel::default();
        let looked_at = Scene { rays: &scene.rays, depth: &scene.depth, labels, sensor: &sensor, joint: Joint::new(&scene.rays, &sensor) };
        let own: Vec<(u16, Vec<u32>)> =
            [1, 9].map(|label| (label, scene.pixels(labels, label))).into_iter().filter(|(_, p)| !p.is_empty()).collect();
        let masks: Vec<(u16, &[u32])> = own.iter().map(|(label, pixels)| (*label, &pixels[..])).collect();
        let found = find_supports(&looked_at, &masks, search);
        let local = found.as_ref().and_then(|found| local_support(&looked_at, masks[0].1, found));
        (found, local)
    }

    #[test]
    fn the_table_wins_over_the_floor_that_is_seen_beside_it() {
        let scene = TestScene::new(&[Thing::Box([0.1, 0.55], [0.035, 0.025], 0.13)], 1.0);
        let (found, local) = supports_of(&scene, &scene.labels, &SupportSearch::default());
        let up = found.unwrap().up;
        assert!(up.angle(&scene.table.normal()) < 0.5_f64.to_radians(), "{}", up.angle(&scene.table.normal()).to_degrees());
        let local = local.unwrap();
        assert!((local.plane.offset() - scene.table.offset()).abs() < 0.002, "{}", local.plane.offset());
        assert!(local.deviation_m < 0.003);
    }

    #[test]
    fn a_label_that_is_the_table_is_the_support_and_a_gravity_that_is_off_is_corrected() {
        let scene = TestScene::new(&[Thing::Box([0.0, 0.55], [0.035, 0.025], 0.13)], 1.0);
        let is_table = |pixel: usize| scene.table.height(&scene.rays.point(pixel, scene.depth[pixel]).cast().into()).abs() < 0.01;
        let labels: Vec<u16> = (0..scene.labels.len())
            .map(|pixel| if scene.labels[pixel] == 0 && is_table(pixel) { 9 } else { scene.labels[pixel] })
            .collect();
        let (found, local) = supports_of(&scene, &labels, &SupportSearch::default());
        assert_eq!(found.unwrap().labels, [9]);
        assert!((local.unwrap().plane.offset() - scene.table.offset()).abs() < 0.002);
        let tilt = nalgebra::Rotation3::from_axis_angle(&Vector3::x_axis(), 6_f64.to_radians());
        let search = SupportSearch { up: Some(tilt * scene.table.normal()), label: None };
        let found = supports_of(&scene, &scene.labels, &search).0.unwrap();
        assert!((found.corrected_rad.unwrap().to_degrees() - 6.0).abs() < 0.5);
    }

    /// A low table on the table: things 1 on the table and 3 on the low one, both with the floor 0.7 m below in sight.
    #[test]
    fn of_several_tables_each_thing_stands_on_the_highest_one_below_it() {
        let things = [
            Thing::Box([-0.2, 0.5], [0.03, 0.03], 0.09),
            Thing::Box([0.22, 0.6], [0.17, 0.25], 0.12),
            Thing::Box([0.2, 0.5], [0.03, 0.03], 0.12 + 0.07),
        ];
        let scene = TestScene::new(&things, 1.0);
        let labels: Vec<u16> = scene.labels.iter().map(|label| if *label == 2 { 0 } else { *label }).collect();
        let sensor = SensorModel::default();
        let looked_at =
            Scene { rays: &scene.rays, depth: &scene.depth, labels: &labels, sensor: &sensor, joint: Joint::new(&scene.rays, &sensor) };
        let [first, third] = [1, 3].map(|label| scene.pixels(&labels, label));
        let found = find_supports(&looked_at, &[(1, &first[..]), (3, &third[..])], &SupportSearch::default()).unwrap();
        assert!(found.up.angle(&scene.table.normal()) < 0.5_f64.to_radians());
        for (mask, above) in [(&first, 0.0), (&third, 0.12)] {
            let local = local_support(&looked_at, mask, &found).unwrap();
            let height = scene.table.offset() - local.plane.offset();
            assert!((height - above).abs() < 0.003, "{height} m above the table, {above} m are true");
        }
    }

    #[test]
    fn a_bent_table_is_level_around_each_object() {
        let mut scene = TestScene::new(&[Thing::Box([-0.25, 0.45], [0.03, 0.03], 0.02)], 0.3);
        // Bent about the vertical line through the middle of the image: 8 mm at the sides.
        for (pixel, z) in scene.depth.iter_mut().enumerate() {
            *z += 0.008 * ((pixel % 320) as f32 / 160.0 - 1.0).powi(2);
        }
        let local = supports_of(&scene, &scene.labels, &SupportSearch::default()).1.unwrap();
        let wide = scene.widened(1, 14);
        let around = (0..wide.len()).filter(|pixel| wide[*pixel] == 1 && scene.labels[*pixel] == 0);
        let heights: Vec<(usize, f64)> =
            around.map(|pixel| (pixel % 320, local.plane.height(&scene.rays.point(pixel, scene.depth[pixel]).cast().into()))).collect();
        // To the left and to the right of the box alike.
        let middle = heights.iter().map(|(column, _)| column).sum::<usize>() / heights.len();
        for is_left in [false, true] {
            let side: Vec<f64> = heights.iter().filter(|(column, _)| (*column < middle) == is_left).map(|(_, h)| *h).collect();
            let mean = side.iter().sum::<f64>() / side.len() as f64;
            assert!(mean.abs() < 0.0004, "{mean} m, left: {is_left}");
        }
    }

    #[test]
    fn a_plane_reaches_as_far_as_its_own_squares_along_the_longest_axis() {
        let at = |x: f64, y: f64, z: f64| Block { centre: Vector3::new(x, y, z), normal: -Vector3::z(), scatter: 0.0, weight: 1.0 };
        let blocks = [at(0.1, 0.0, 1.0), at(5.0, 5.0, 5.0), at(-0.2, 0.25, 1.1), at(0.0, 0.6, 0.9)];
        let plane = Plane::new(-Vector3::z_axis(), &Point3::new(0.0, 0.0, 1.0));
        let found = |blocks: &[usize]| FoundPlane { plane, weight: 1.0, blocks: blocks.to_vec(), scatter: 0.0 };
        assert!((extent(&blocks, &found(&[0, 2, 3])) - 0.6).abs() < 1e-12);
        assert!((extent(&blocks, &found(&[0, 2])) - 0.3).abs() < 1e-12);
        assert_eq!(extent(&blocks, &found(&[1])), 0.0);
    }
}
