//! Objects of a frame without masks: what stands on a table.
//!
//! Readings above the support and over its outline hang together where neighbours lie on one surface; pieces that are near each other in
//! space are one object: the far wall of a bowl and its near one.

use crate::SensorModel;
use crate::interior::enclosed;
use crate::joining::{Joint, Piece, nearest, samples};
use crate::links::Links;
use crate::own_readings::percentile;
use crate::plan_view::{area, convex_hull};
use crate::rays::Rays;
use crate::regions::{Regions, Run, Window};
use crate::scene::{LocalSupport, Scene};
use crate::supports::Supports;
use crate::table_surface::TableSurface;
use nalgebra::{Vector2, Vector3};

/// Where objects come from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Segmentation {
    /// The label image.
    #[default]
    Labels,
    /// The things that stand on a plane of the depth image.
    Table,
}

/// An object is at least this high above its plane, metres; or so many deviations of the plane's readings.
const LEAST_HEIGHT_M: f32 = 0.006;
const HEIGHT_DEVIATIONS: f32 = 2.5;
/// And at most this.
const MOST_HEIGHT_M: f32 = 0.6;
/// Readings of a piece that may be a part of an object.
const LEAST_PIECE: usize = 12;
/// Pieces nearer to each other than this are one object, metres, or than so many pixels.
const GAP_M: f32 = 0.012;
const GAP_PIXELS: f32 = 4.0;
/// Share of the edge of a region without reading that must lie at its object.
const BESIDE_SHARE: f64 = 0.2;
/// A region is given to a segment that has at least this part of its pixels.
const MOST_FILL: usize = 8;
/// Steps by which the cores of pieces grow.
const GROWTH: usize = 4;
/// A piece that is larger, as a share of the other, is an object of its own, however near.
const PART: f64 = 0.3;
/// Pieces that are compared, at most: the largest.
const MOST_PIECES: usize = 150;
/// Pieces that border on a region without readings do so along at least this share of its edge.
const BRIDGE_LEAST: f64 = 0.05;
/// Pieces meet within so many pixels.
const MEETING: usize = 3;
/// One outline is within another if both together are at most so many times as large as the larger one; of what a dark part separates, more
/// is unseen.
const WITHIN: f32 = 1.3;
const WITHIN_DARK: f32 = 1.8;
/// Two pieces that enclose a floor of this share of their readings are one vessel.
const FLOOR_SHARE: f64 = 0.15;
/// The floor of a vessel is lower above the table, metres.
const FLOOR_M: f32 = 0.012;
/// Points of a piece that are looked at.
const OUTLINE_SAMPLES: usize = 300;
/// An object may hide the edge of its table: so far it may lie beyond, metres.
const OVER_EDGE_M: f32 = 0.05;
/// A piece that begins higher above the table stands on something else, metres.
const FLOATING_M: f32 = 0.25;
/// Something small is noise if it is not higher than so many times the least height; small is this area as seen, square metres.
const SPECK_HEIGHT: f32 = 1.5;
const SPECK_M2: f32 = 0.001;
/// Something with fewer readings is a speck if its area as seen is less than this, square metres; with any number, if it is less than the
/// second: at the edges of parts without readings, sensors see bumps of this size.
const FEW_READINGS: usize = 200;
const FEW_M2: f32 = 8e-4;
const LEAST_M2: f32 = 2.5e-4;
/// A piece that is longer stands around the table and not on it, metres: walls and furniture.
const MOST_LENGTH_M: f32 = 0.6;
/// Readings of an object at least.
const LEAST_PIXELS: usize = 60;

/// Memory that segmentation needs, kept from frame to frame.
#[derive(Clone, Debug, Default)]
pub struct SegmentScratch {
    heights: Vec<f32>,
    /// Readings that may be an object's; others are not a number.
    raised: Vec<f32>,
    state: Vec<u8>,
    links: Links,
}

/// Labels from 1 on of what stands on the supports.
pub fn segment(rays: &Rays, depth: &[f32], sensor: &SensorModel, supports: &Supports, scratch: &mut SegmentScratch) -> Vec<u16> {
    let mut labels = vec![0; depth.len()];
    let Some(main) = supports.planes.first() else { return labels };
    let width = rays.width();
    let table = TableSurface::new(rays, depth, &main.plane);
    // The table's own scatter tells how good the sensor is here; it grows with the distance as the sensor model says.
    let deviations = HEIGHT_DEVIATIONS * main.scatter as f32;
    let (constant, quadratic) = (deviations * sensor.constant_m as f32, deviations * sensor.quadratic_per_m as f32);
    let SegmentScratch { heights, raised, state, links } = scratch;
    heights.resize(depth.len(), 0.0);
    raised.resize(depth.len(), f32::NAN);
    table.heights_of_row([rays.x(), rays.y(), depth], heights);
    for ((z, h), raised) in depth.iter().zip(&*heights).zip(&mut *raised) {
        let is_raised = (*h > LEAST_HEIGHT_M.max(constant + quadratic * z * z)) & (*h < MOST_HEIGHT_M);
        *raised = if is_raised { *z } else { f32::NAN };
    }
    state.clear();
    state.extend(raised.iter().map(|z| if z.is_nan() { 0 } else { WANTED }));
    let wanted: Vec<u32> = (0..depth.len() as u32).filter(|pixel| state[*pixel as usize] == WANTED).collect();
    links.find(raised, width, &Joint::new(rays, sensor));
    let found = pieces_by_core(links, &wanted, state);
    let found = merged(rays, depth, found.into_iter().filter(|piece| piece.pixels.len() >= LEAST_PIECE).collect());
    let (mut next, mut standing) = (1_u16, Vec::new());
    for piece in found {
        if piece.pixels.len() < LEAST_PIXELS || !stands_on(rays, depth, &table, heights, &piece) {
            continue;
        }
        piece.pixels.iter().for_each(|pixel| labels[*pixel as usize] = next);
        standing.push(piece);
        next = next.saturating_add(1);
    }
    let support = LocalSupport { plane: main.plane, deviation_m: f64::from(table.deviation_m) };
    state.fill(0);
    let mut floors = Floors { rays, depth, sensor, support, heights, state };
    let standing = bridged(&mut floors, &table, standing, &mut labels);
    for (i, piece) in standing.iter().enumerate().filter(|(_, piece)| !piece.pixels.is_empty()) {
        floors.within(&labels, &piece.pixels).iter().for_each(|pixel| labels[*pixel as usize] = i as u16 + 1);
    }
    let all = Window { columns: [0, width], rows: [0, rays.height()] };
    // Dark and glossy sides have no reading: they belong to the one object that they lie at.
    fill(&mut labels, width, all, |pixel| depth[pixel] == 0.0, BESIDE_SHARE);
    // What is enclosed lies between what encloses it.
    if let Some(window) = bounds(&labels, width) {
        fill(&mut labels, width, window, |_| true, 1.0);
    }
    labels
}

/// Pieces of one object that a dark or glossy part without readings separates, or the near rim of a vessel, as one. Both border on that
/// part or on each other, and one stands within the other's outline on the table, or together they enclose a floor.
fn bridged(floors: &mut Floors<'_>, table: &TableSurface, standing: Vec<Piece>, labels: &mut [u16]) -> Vec<Piece> {
    let (rays, depth) = (floors.rays, floors.depth);
    let outlines: Vec<Outline> = standing.iter().map(|piece| Outline::of(rays, depth, table, floors.heights, piece)).collect();
    let of = |label: u16| usize::from(label) - 1;
    // The object that each one, by its label, is a part of.
    let mut whole: Vec<u16> = (0..=standing.len() as u16).collect();
    let join = |whole: &mut Vec<u16>, a: u16, b: u16| {
        let pair = [whole[usize::from(a)], whole[usize::from(b)]];
        let (from, to) = (pair[0].max(pair[1]), pair[0].min(pair[1]));
        whole.iter_mut().filter(|other| **other == from).for_each(|other| *other = to);
    };
    for [a, b] in touching(labels, rays.width()) {
        if !outlines[of(a)].is_beside(&outlines[of(b)]) {
            continue;
        }
        let mut is_one = outlines[of(a)].both(&outlines[of(b)]) < WITHIN;
        if !is_one {
            let pair = [&standing[of(a)].pixels[..], &standing[of(b)].pixels[..]].concat();
            is_one = floors.within(labels, &pair).len() as f64 > FLOOR_SHARE * pair.len() as f64;
        }
        if is_one {
            join(&mut whole, a, b);
        }
    }
    for beside in around_dark_parts(labels, depth, [rays.width(), rays.height()]) {
        for (i, a) in beside.iter().enumerate().skip(1) {
            for b in &beside[..i] {
                if outlines[of(*a)].both(&outlines[of(*b)]) < WITHIN_DARK {
                    join(&mut whole, *a, *b);
                }
            }
        }
    }
    labels.iter_mut().for_each(|label| *label = whole[usize::from(*label)]);
    let mut joined: Vec<Piece> = standing.iter().map(|_| Piece::default()).collect();
    for (i, piece) in standing.into_iter().enumerate() {
        joined[usize::from(whole[i + 1]) - 1].pixels.extend(piece.pixels);
    }
    joined
}

/// Where a piece stands on its table.
struct Outline {
    hull: Vec<Vector2<f32>>,
    area: f32,
    low: f32,
    high: f32,
}

impl Outline {
    fn of(rays: &Rays, depth: &[f32], table: &TableSurface, heights: &[f32], piece: &Piece) -> Self {
        let some = samples(rays, depth, &piece.pixels);
        let hull = convex_hull(some.iter().map(|(point, _)| table.see(point)).collect());
        let own: Vec<f32> = some.iter().map(|(_, pixel)| heights[*pixel as usize]).collect();
        Self { area: area(&hull), hull, low: percentile(&own, 0.05), high: percentile(&own, 0.95) }
    }

    /// How large the outline of two together is, as a multiple of the larger one.
    fn both(&self, other: &Self) -> f32 {
        area(&convex_hull(self.hull.iter().chain(&other.hull).copied().collect())) / self.area.max(other.area).max(1e-9)
    }

    /// Whether two are at the same height: what stands on another is another.
    fn is_beside(&self, other: &Self) -> bool {
        let overlap = self.high.min(other.high) - self.low.max(other.low);
        overlap > 0.5 * (self.high - self.low).min(other.high - other.low)
    }
}

/// Pairs of labels that meet within a few pixels, along a row or a column.
fn touching(labels: &[u16], width: usize) -> std::collections::BTreeSet<[u16; 2]> {
    let mut found = std::collections::BTreeSet::new();
    let mut last = [0, 0];
    let mut meet = |a: &[u16], b: &[u16]| {
        for (a, b) in a.iter().zip(b).filter(|(a, b)| (a != b) & (**a > 0) & (**b > 0)) {
            let pair = [*a.min(b), *a.max(b)];
            if pair != last {
                found.insert(pair);
                last = pair;
            }
        }
    };
    labels.chunks_exact(width).for_each(|row| meet(row, row.get(MEETING..).unwrap_or(&[])));
    meet(labels, labels.get(MEETING * width..).unwrap_or(&[]));
    found
}

/// For each region without readings, the labels that border on it along much of its edge.
fn around_dark_parts(labels: &[u16], depth: &[f32], [width, height]: [usize; 2]) -> Vec<Vec<u16>> {
    let is_dark = |pixel: usize| labels[pixel] == 0 && depth[pixel] == 0.0;
    let regions = Regions::find(width, Window { columns: [0, width], rows: [0, height] }, is_dark);
    let mut edges = vec![0_usize; regions.count()];
    let mut beside: Vec<(usize, u16)> = Vec::new();
    for (run, region) in regions.runs() {
        around(run, width, height, |other| {
            if !is_dark(other) {
                edges[region] += 1;
                if labels[other] > 0 {
                    beside.push((region, labels[other]));
                }
            }
        });
    }
    beside.sort_unstable();
    let mut found: Vec<(usize, Vec<u16>)> = Vec::new();
    for same in beside.chunk_by(|a, b| a == b) {
        let (region, label) = same[0];
        if (same.len() as f64) < BRIDGE_LEAST * edges[region] as f64 {
            continue;
        }
        match found.last_mut().filter(|(last, _)| *last == region) {
            Some((_, labels)) => labels.push(label),
            None => found.push((region, vec![label])),
        }
    }
    found.into_iter().map(|(_, labels)| labels).filter(|labels| labels.len() > 1).collect()
}

/// The pixels above, below, to the left and to the right of a run that lie in the image; those beside two of its pixels are given twice.
fn around(run: &Run, width: usize, height: usize, mut look: impl FnMut(usize)) {
    let first = run.row * width;
    if run.start > 0 {
        look(first + run.start - 1);
    }
    if run.end < width {
        look(first + run.end);
    }
    if run.row > 0 {
        (first - width + run.start..first - width + run.end).for_each(&mut look);
    }
    if run.row + 1 < height {
        (first + width + run.start..first + width + run.end).for_each(&mut look);
    }
}

/// The smallest part of the image that holds all labelled pixels.
fn bounds(labels: &[u16], width: usize) -> Option<Window> {
    let mut found: Option<Window> = None;
    for (row, labels) in labels.chunks_exact(width).enumerate() {
        let Some(first) = labels.iter().position(|label| *label > 0) else { continue };
        let end = width - labels.iter().rev().position(|label| *label > 0).unwrap_or(0);
        let Window { columns: [left, right], rows: [top, _] } = found.unwrap_or(Window { columns: [first, end], rows: [row, row] });
        found = Some(Window { columns: [left.min(first), right.max(end)], rows: [top, row + 1] });
    }
    found
}

/// Looks for low readings that objects enclose.
struct Floors<'a> {
    rays: &'a Rays,
    depth: &'a [f32],
    sensor: &'a SensorModel,
    support: LocalSupport,
    heights: &'a [f32],
    state: &'a mut [u8],
}

impl Floors<'_> {
    /// Unlabelled readings that some pixels enclose.
    fn within(&mut self, labels: &[u16], pixels: &[u32]) -> Vec<u32> {
        let width = self.rays.width();
        let [left, right, top, bottom] = pixels.iter().fold([usize::MAX, 0, usize::MAX, 0], |[l, r, t, b], pixel| {
            let (u, v) = (*pixel as usize % width, *pixel as usize / width);
            [l.min(u), r.max(u), t.min(v), b.max(v)]
        });
        let is_low = |pixel: &usize| labels[*pixel] == 0 && self.depth[*pixel] > 0.0 && self.heights[*pixel].abs() < FLOOR_M;
        let mut low: Vec<(u32, f32)> = Vec::new();
        for v in top..=bottom {
            low.extend((v * width + left..=v * width + right).filter(is_low).map(|pixel| (pixel as u32, self.heights[pixel])));
        }
        let joint = Joint::new(self.rays, self.sensor);
        let scene = Scene { rays: self.rays, depth: self.depth, labels, sensor: self.sensor, joint };
        let found = enclosed(&scene, &self.support, pixels, &low, self.state, [1, 2]);
        low.iter().for_each(|(pixel, _)| self.state[*pixel as usize] = 0);
        found
    }
}

/// Whether a piece lies over the table, reaches down near to it, and is neither noise nor furniture.
fn stands_on(rays: &Rays, depth: &[f32], table: &TableSurface, heights: &[f32], piece: &Piece) -> bool {
    let step = piece.pixels.len().div_ceil(OUTLINE_SAMPLES).max(1);
    let some: Vec<u32> = piece.pixels.iter().step_by(step).copied().collect();
    let over = some.iter().filter(|pixel| table.inside_by(&rays.point(**pixel as usize, depth[**pixel as usize])) > -OVER_EDGE_M).count();
    let own: Vec<f32> = some.iter().map(|pixel| heights[*pixel as usize]).collect();
    let points: Vec<Vector3<f32>> = some.iter().map(|pixel| rays.point(*pixel as usize, depth[*pixel as usize])).collect();
    let pitch = rays.pitch(percentile(&points.iter().map(|point| point.z).collect::<Vec<_>>(), 0.5));
    let area = pitch * pitch * piece.pixels.len() as f32;
    let is_low = percentile(&own, 0.9) < SPECK_HEIGHT * LEAST_HEIGHT_M.max(HEIGHT_DEVIATIONS * table.deviation_m);
    let is_speck = is_low && area < SPECK_M2 || area < LEAST_M2 || piece.pixels.len() < FEW_READINGS && area < FEW_M2;
    let length = [Vector3::x(), Vector3::y(), Vector3::z()].map(|axis| {
        let along: Vec<f32> = points.iter().map(|point| point.dot(&axis)).collect();
        percentile(&along, 0.98) - percentile(&along, 0.02)
    });
    let is_long = length.into_iter().fold(0.0, f32::max) > MOST_LENGTH_M;
    3 * over >= some.len() && percentile(&own, 0.02) < FLOATING_M && !is_speck && !is_long
}

const WANTED: u8 = 1;
const CORE: u8 = 2;
const DONE: u8 = 3;

/// Pieces whose readings hang together through readings that are joined to all their neighbours, with what borders on them: so that what
/// is smeared between two objects does not bridge them. What is too thin for that makes pieces of its own.
fn pieces_by_core(links: &Links, wanted: &[u32], state: &mut [u8]) -> Vec<Piece> {
    let core: Vec<u32> = wanted.iter().copied().filter(|pixel| links.are_all(*pixel as usize)).collect();
    core.iter().for_each(|pixel| state[*pixel as usize] = CORE);
    let mut found = links.pieces(&core, state, CORE, DONE);
    // All grow by the same number of steps, so that each gets what is nearest to it.
    let mut fronts: Vec<Vec<u32>> = found.iter().map(|piece| piece.pixels.clone()).collect();
    for _ in 0..GROWTH {
        for (piece, front) in found.iter_mut().zip(&mut fronts) {
            let mut next = Vec::new();
            for pixel in front.iter() {
                for other in links.of(*pixel as usize) {
                    if state[other] == WANTED {
                        state[other] = DONE;
                        next.push(other as u32);
                    }
                }
            }
            piece.pixels.extend_from_slice(&next);
            *front = next;
        }
    }
    found.extend(links.pieces(wanted, state, WANTED, DONE));
    found.sort_by_key(|piece| (usize::MAX - piece.pixels.len(), piece.pixels[0]));
    found
}

/// The border of a region of free pixels.
#[derive(Clone, Copy, Default)]
struct Border {
    pixels: usize,
    /// It reaches the window's border, or several segments border on it.
    is_open: bool,
    edge: usize,
    beside: usize,
    /// The segment that borders on it; 0: none yet.
    label: u16,
}

/// Gives regions of free pixels to the segment that borders on them along at least a share of their edge, if no other does and they do not
/// reach the border of the window; with a share of 1 to the one that encloses them: the floor of a bowl, the middle of a plate.
fn fill(labels: &mut [u16], width: usize, window: Window, is_free: impl Fn(usize) -> bool, least_share: f64) {
    let mut sizes = vec![0_usize; usize::from(labels.iter().copied().max().unwrap_or(0)) + 1];
    labels.iter().for_each(|label| sizes[usize::from(*label)] += 1);
    let height = labels.len() / width;
    let regions = Regions::find(width, window, |pixel| labels[pixel] == 0 && is_free(pixel));
    let mut borders = vec![Border::default(); regions.count()];
    let ([left, right], [top, bottom]) = (window.columns, window.rows);
    for (run, region) in regions.runs() {
        let border = &mut borders[region];
        border.pixels += run.end - run.start;
        border.is_open |= run.start == left || run.end == right || run.row == top || run.row + 1 == bottom;
    }
    for (run, region) in regions.runs() {
        let border = &mut borders[region];
        if border.is_open {
            continue;
        }
        around(run, width, height, |other| match labels[other] {
            0 => border.edge += usize::from(!is_free(other)),
            label => {
                (border.edge, border.beside) = (border.edge + 1, border.beside + 1);
                border.is_open |= border.label != 0 && border.label != label;
                border.label = label;
            }
        });
    }
    for (run, region) in regions.runs() {
        let Border { pixels, is_open, edge, beside, label } = borders[region];
        let is_beside = label > 0 && !is_open && beside as f64 >= least_share * edge as f64;
        if is_beside && pixels < MOST_FILL * sizes[usize::from(label)] {
            labels[run.row * width + run.start..run.row * width + run.end].fill(label);
        }
    }
}

/// Pieces that are near each other in space, as one; the largest first.
fn merged(rays: &Rays, depth: &[f32], mut pieces: Vec<Piece>) -> Vec<Piece> {
    pieces.truncate(MOST_PIECES);
    let points: Vec<_> = pieces.iter().map(|piece| samples(rays, depth, &piece.pixels)).collect();
    let boxes: Vec<[Vector3<f32>; 2]> = points
        .iter()
        .map(|points| {
            let low = points.iter().fold(Vector3::repeat(f32::INFINITY), |low, (p, _)| low.inf(p));
            let high = points.iter().fold(Vector3::repeat(f32::NEG_INFINITY), |high, (p, _)| high.sup(p));
            [low, high]
        })
        .collect();
    // Each piece belongs to the first one that it is near to, directly or by others.
    let mut root: Vec<usize> = (0..pieces.len()).collect();
    for i in 1..pieces.len() {
        for j in 0..i {
            let near = GAP_M.max(GAP_PIXELS * rays.pitch(boxes[i][0].z.max(boxes[j][0].z)));
            let apart = (boxes[i][0] - boxes[j][1]).sup(&(boxes[j][0] - boxes[i][1])).max();
            let is_part = (pieces[i].pixels.len() as f64) < PART * pieces[j].pixels.len() as f64;
            if root[i] == root[j] || apart > near || !is_part {
                continue;
            }
            if nearest(&points[i], &points[j]).is_some_and(|(distance, _)| distance < near) {
                let (from, to) = (root[i].max(root[j]), root[i].min(root[j]));
                root.iter_mut().filter(|r| **r == from).for_each(|r| *r = to);
            }
        }
    }
    for i in (0..pieces.len()).rev().filter(|i| root[*i] != *i).collect::<Vec<_>>() {
        let pixels = std::mem::take(&mut pieces[i].pixels);
        pieces[root[i]].pixels.extend(pixels);
    }
    pieces.retain(|piece| !piece.pixels.is_empty());
    pieces
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::supports::{SupportSearch, find_table};
    use crate::test_scene::{TestScene, Thing};

    fn segmented(scene: &TestScene) -> Vec<u16> {
        let sensor = SensorModel::default();
        let supports = find_table(&scene.rays, &scene.depth, &sensor, &SupportSearch::default()).unwrap();
        segment(&scene.rays, &scene.depth, &sensor, &supports, &mut SegmentScratch::default())
    }

    /// For each thing the largest overlap over union of a segment with it; and the number of segments.
    fn overlaps(scene: &TestScene, found: &[u16], things: u16) -> (Vec<f64>, usize) {
        let count = found.iter().copied().max().unwrap_or(0);
        let of = |thing: u16, label: u16| {
            let pairs = scene.labels.iter().zip(found).map(|(a, b)| (*a == thing, *b == label));
            let (both, any) = pairs.fold((0, 0), |(both, any), (a, b)| (both + u32::from(a && b), any + u32::from(a || b)));
            f64::from(both) / f64::from(any)
        };
        let best = (1..=things).map(|thing| (1..=count).map(|label| of(thing, label)).fold(0.0, f64::max)).collect();
        (best, (1..=count).filter(|label| found.contains(label)).count())
    }

    #[test]
    fn each_thing_on_a_table_is_one_segment_with_its_floor() {
        let things = [
            Thing::Cup([-0.15, 0.5], 0.07, 0.06, 0.004),
            Thing::Box([0.05, 0.6], [0.03, 0.03], 0.12),
            Thing::Box([0.2, 0.45], [0.05, 0.03], 0.02),
        ];
        let scene = TestScene::new(&things, 0.7);
        let (best, count) = overlaps(&scene, &segmented(&scene), 3);
        assert!(best.iter().all(|overlap| *overlap > 0.85), "{best:?}");
        assert_eq!(count, 3, "and no speck is one");
    }

    #[test]
    fn a_dark_band_about_a_can_leaves_it_one_object_and_an_empty_table_has_none() {
        let mut scene = TestScene::new(&[Thing::Box([0.0, 0.55], [0.035, 0.035], 0.13)], 0.5);
        let front: Vec<u32> = scene.pixels(&scene.labels, 1);
        let rows = front.iter().map(|pixel| *pixel as usize / 320);
        let (top, bottom) = (rows.clone().min().unwrap(), rows.max().unwrap());
        let dark = top + (bottom - top) / 2..top + (bottom - top) * 7 / 10;
        front.iter().filter(|pixel| dark.contains(&(**pixel as usize / 320))).for_each(|pixel| scene.depth[*pixel as usize] = 0.0);
        let (best, count) = overlaps(&scene, &segmented(&scene), 1);
        assert!(best[0] > 0.85 && count == 1, "{best:?} of {count}");
        let bare = TestScene::new(&[], 1.0);
        assert!(segmented(&bare).iter().all(|label| *label == 0));
    }
}
