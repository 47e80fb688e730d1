//! The forest's shares of the classes, and of none of them, by what a view measures of the object's box.

use crate::camera_view::Frame;
use crate::class::Reference;
use beo_core::grid::{EMPTY, FILLED, Observation};
use beo_core::model::{CAMERA_MEASURES, Forest, LEAF};
use nalgebra::{Matrix3, Vector3};

/// Of what is not there to be measured.
const ABSENT: f64 = -1.0;
/// Cells along each side of the maps of the near and of the upper side, heights of widths, columns of the profiles, levels.
const MAP: usize = 8;
const HEIGHTS: usize = 12;
const COLUMNS: usize = 10;
const LEVELS: usize = 6;
/// Bands of height, as shares, over which a profile is averaged.
const BANDS: [[f64; 2]; 3] = [[0.1, 0.4], [0.4, 0.7], [0.7, 0.95]];
/// A share of no tree counts as this one.
const LEAST_SHARE: f64 = 1e-3;

/// Logarithms of the shares of the classes, and the probability that the object is of none of them.
pub struct Asked {
    pub log_shares: Vec<f64>,
    pub none: f64,
}

impl Reference {
    /// Asks the forest about a view.
    pub fn ask_forest(&self, frame: &Frame, seen: &Observation, voxel_size_m: Option<f64>) -> Asked {
        let forest = self.model.camera_densities().and_then(|densities| densities.forest.as_ref()).expect("a forest");
        let camera = self.model.metadata.calibration.camera.as_ref().expect("calibrated for cameras");
        let mut shares = shares(forest, &measures(frame, seen, voxel_size_m));
        let none = shares.pop().expect("a share of none").clamp(0.001, 0.999);
        let calibration = camera.none.expect("calibrated for none");
        let logit = calibration.constant + calibration.weight * (none / (1.0 - none)).ln();
        Asked { log_shares: shares.iter().map(|share| (share + LEAST_SHARE).ln()).collect(), none: 1.0 / (1.0 + (-logit).exp()) }
    }
}

/// Odds by the sum over the trees, as shares.
fn shares(forest: &Forest, inputs: &[f64]) -> Vec<f64> {
    let leaf = |mut node: usize| {
        while forest.asks[node] != LEAF {
            // Thresholds lie between single-precision values; what is no number is not below them.
            let is_below = (inputs[usize::from(forest.asks[node])] as f32) <= forest.thresholds[node];
            node = forest.next[node] as usize + if is_below { 0 } else { 1 };
        }
        forest.next[node] as usize
    };
    let leaves: Vec<usize> = forest.roots.iter().map(|root| leaf(*root as usize)).collect();
    let odds = |outcome: usize| leaves.iter().map(|leaf| forest.scores[leaf * forest.outcomes + outcome].to_f64()).sum::<f64>().exp();
    let total: f64 = (0..forest.outcomes).map(odds).sum();
    (0..forest.outcomes).map(|outcome| odds(outcome) / total).collect()
}

/// Place in the box about what is seen, as shares of its sides: depth, width, height; none outside.
fn share(at: &Vector3<f64>, sides: &Vector3<f64>) -> Option<[f64; 3]> {
    let share: [f64; 3] = std::array::from_fn(|axis| (at[axis] + sides[axis] / 2.0) / sides[axis]);
    share.iter().all(|v| (0.0..1.0).contains(v)).then_some(share)
}

fn bin(share: f64, bins: usize) -> usize {
    (share * bins as f64).floor() as usize
}

fn mean(values: &[f64]) -> Option<f64> {
    (!values.is_empty()).then(|| values.iter().sum::<f64>() / values.len() as f64)
}

fn least(values: impl Iterator<Item = f64>) -> Option<f64> {
    values.min_by(f64::total_cmp)
}

fn most(values: impl Iterator<Item = f64>) -> Option<f64> {
    values.max_by(f64::total_cmp)
}

/// All measures of a view, in the order in which the forest asks for them.
fn measures(frame: &Frame, seen: &Observation, voxel_size_m: Option<f64>) -> Vec<f64> {
    let sides = frame.sides_voxels();
    let filled: Vec<Vector3<f64>> = frame.voxels(seen, FILLED);
    let inside: Vec<(Vector3<f64>, [f64; 3])> = filled.iter().filter_map(|at| share(at, &sides).map(|share| (*at, share))).collect();
    // Depth of a voxel's centre in the box, in widths.
    let depth = |at: &Vector3<f64>| (at.x + sides.x / 2.0) / sides.y;
    let mut out: Vec<f64> = sides.iter().map(|side| voxel_size_m.map_or(f64::NAN, |edge| (side * edge).ln())).collect();
    out.extend([(sides.y / sides.z).ln(), (sides.x / sides.y).ln(), frame.elevation]);
    out.push(filled.len() as f64 / (sides.x * sides.y + sides.y * sides.z + sides.z * sides.x));
    for height in 0..HEIGHTS {
        let across = || inside.iter().filter(|(_, share)| bin(share[2], HEIGHTS) == height).map(|(_, share)| share[1]);
        out.push(most(across()).zip(least(across())).map_or(ABSENT, |(high, low)| high - low));
    }
    let cells = || (0..MAP).flat_map(|a| (0..MAP).map(move |b| (a, b)));
    let within =
        |share: &[f64; 3], axes: [usize; 2], cell: (usize, usize)| bin(share[axes[0]], MAP) == cell.0 && bin(share[axes[1]], MAP) == cell.1;
    for cell in cells() {
        let there = inside.iter().filter(|(_, share)| within(share, [1, 2], cell));
        out.push(least(there.map(|(at, _)| depth(at))).unwrap_or(ABSENT));
    }
    let top: Vec<Option<f64>> =
        cells().map(|cell| most(inside.iter().filter(|(_, share)| within(share, [0, 1], cell)).map(|(_, share)| share[2]))).collect();
    out.extend(top.iter().map(|height| height.unwrap_or(ABSENT)));
    let rows = sides.z.ceil() as usize + 1;
    for [low, high] in BANDS {
        let column = |column: usize| {
            let nearest = |row: usize| {
                let is_there = |(at, share): &&(Vector3<f64>, [f64; 3])| {
                    bin(share[1], COLUMNS) == column && (at.z + sides.z / 2.0).floor() as usize == row
                };
                least(inside.iter().filter(is_there).map(|(at, _)| depth(at)))
            };
            let in_band = (0..rows).filter(|row| (low..high).contains(&((*row as f64 + 0.5) / sides.z)));
            mean(&in_band.filter_map(nearest).collect::<Vec<_>>())
        };
        out.extend(bends(&(0..COLUMNS).map(column).collect::<Vec<_>>()).unwrap_or([ABSENT; 9]));
    }
    let of = |is_one: &dyn Fn(usize, usize) -> bool| -> Vec<Option<f64>> {
        cells().zip(&top).filter(|((a, b), _)| is_one(*a, *b)).map(|(_, height)| *height).collect()
    };
    let height = |cells: Vec<Option<f64>>| mean(&cells.into_iter().flatten().collect::<Vec<_>>()).unwrap_or(ABSENT);
    let covered = |cells: Vec<Option<f64>>| cells.iter().flatten().count() as f64 / cells.len() as f64;
    let is_end = |v: usize| v == 0 || v == MAP - 1;
    let middle = height(of(&|a, b| (3..=4).contains(&a) && (3..=4).contains(&b)));
    let rim = height(of(&|a, b| is_end(a) != is_end(b)));
    out.extend([middle, rim, middle - rim, height(of(&|a, _| a == 0)), height(of(&|a, _| a == MAP - 1))]);
    out.extend([covered(of(&|_, _| true)), covered(of(&|a, b| is_end(a) && is_end(b)))]);
    for level in 0..LEVELS {
        out.push(inside.iter().filter(|(_, share)| bin(share[2], LEVELS) == level).count() as f64 / filled.len() as f64);
    }
    let empty: Vec<[f64; 3]> = frame.voxels(seen, EMPTY).iter().filter_map(|at| share(at, &sides)).collect();
    for third in 0..3 {
        let is_there = |share: &&[f64; 3]| bin(share[2], 3) == third && (0.2..0.9).contains(&share[0]) && (0.2..0.8).contains(&share[1]);
        out.push(empty.iter().filter(is_there).count() as f64 / (sides.x * sides.y * sides.z));
    }
    for from in [0.0, 0.8] {
        let mut columns: Vec<[f64; 2]> = inside.iter().filter(|(_, share)| share[2] >= from).map(|(at, _)| [at.x, at.y]).collect();
        columns.sort_by(|a, b| a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1])));
        let is_same = |a: &[f64; 2], b: &[f64; 2]| (0..2).all(|axis| (a[axis] - b[axis]).abs() < 1e-6);
        let mut apart: Vec<[f64; 2]> = Vec::new();
        columns.iter().for_each(|column| {
            if !apart.iter().any(|other| is_same(column, other)) {
                apart.push(*column);
            }
        });
        out.extend(outline(&apart));
    }
    out.push(least(inside.iter().map(|(_, share)| share[2])).unwrap_or(1.0));
    assert_eq!(out.len(), CAMERA_MEASURES);
    out
}

/// Of columns of voxels from above: widths in eight directions over half a turn relative to the largest, without one of two hundred at either end,
/// the least of them, and the area relative to the square of the largest.
fn outline(columns: &[[f64; 2]]) -> [f64; 10] {
    if columns.len() < 8 {
        return [ABSENT; 10];
    }
    let width = |n: usize| {
        let angle = std::f64::consts::PI * n as f64 / 8.0;
        let mut along: Vec<f64> = columns.iter().map(|[x, y]| x * angle.cos() + y * angle.sin()).collect();
        along.sort_by(f64::total_cmp);
        let left_out = columns.len() / 200;
        along[columns.len() - 1 - left_out] - along[left_out] + 1.0
    };
    let widths: Vec<f64> = (0..8).map(width).collect();
    let largest = most(widths.iter().copied()).unwrap();
    let last = [least(widths.iter().copied()).unwrap() / largest, columns.len() as f64 / largest.powi(2)];
    let all: Vec<f64> = widths.iter().map(|width| width / largest).chain(last).collect();
    all.try_into().unwrap()
}

/// How a profile bends over its width, from −1 to 1: slope and curvature of a parabola, what a line, a parabola, the best corner and half an
/// ellipse leave, corner less ellipse, the ellipse's depth, and the nearest column before the mean of both ends.
fn bends(profile: &[Option<f64>]) -> Option<[f64; 9]> {
    let across = |column: usize| (2.0 * column as f64 + 1.0) / COLUMNS as f64 - 1.0;
    let points: Vec<(f64, f64)> = profile.iter().enumerate().filter_map(|(column, v)| v.map(|v| (across(column), v))).collect();
    if points.len() < COLUMNS / 2 {
        return None;
    }
    // Least squares of 1, t and a third function, slightly regularised: factors, and the root mean square of what is left.
    let fit = |third: &dyn Fn(f64) -> f64| -> (Vector3<f64>, f64) {
        let row = |t: f64| Vector3::new(1.0, t, third(t));
        let gram: Matrix3<f64> = points.iter().map(|(t, _)| row(*t) * row(*t).transpose()).sum();
        let right: Vector3<f64> = points.iter().map(|(t, v)| row(*t) * *v).sum();
        let factors = (gram + Matrix3::identity() * 1e-9).lu().solve(&right).expect("regularised");
        let left = points.iter().map(|(t, v)| (v - row(*t).dot(&factors)).powi(2)).sum::<f64>() / points.len() as f64;
        (factors, left.sqrt())
    };
    let (_, line) = fit(&|_| 0.0);
    let (bent, parabola) = fit(&|t| t * t);
    let (round, ellipse) = fit(&|t| (1.0 - t * t).max(0.0).sqrt());
    let corner = least((-3..=3).map(|n| fit(&|t| (t - 0.2 * f64::from(n)).abs()).1))?;
    let nearest = least(points.iter().map(|p| p.1))?;
    let ends = (points[0].1 + points[points.len() - 1].1) / 2.0;
    Some([bent.y, bent.z, line, parabola, corner, ellipse, corner - ellipse, round.z, nearest - ends])
}
