//! Objects of a frame without masks: what stands on a table.
//!
//! Readings above the support and over its outline hang together where neighbours lie on one surface; pieces that are near each other in
//! space are one object: the far wall of a bowl and its near one.

use crate::SensorModel;
use crate::joining::{Joint, Piece, nearest, pieces, samples};
use crate::rays::Rays;
use crate::supports::Supports;
use nalgebra::Vector3;

/// Where objects come from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Segmentation {
    /// The label image.
    #[default]
    Labels,
    /// What stands on a plane of the depth image.
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
/// Pieces that are compared, at most: the largest.
const MOST_PIECES: usize = 150;
/// Readings of an object at least.
const LEAST_PIXELS: usize = 60;

/// Labels from 1 on of what stands on the supports.
pub fn segment(rays: &Rays, depth: &[f32], sensor: &SensorModel, supports: &Supports) -> Vec<u16> {
    let mut labels = vec![0; depth.len()];
    let Some(main) = supports.planes.first() else { return labels };
    let (n, offset) = (main.plane.normal().into_inner().cast::<f32>(), main.plane.offset() as f32);
    let scatter = main.scatter as f32;
    let mut state = vec![0_u8; depth.len()];
    let mut wanted = Vec::new();
    for (pixel, z) in depth.iter().enumerate() {
        if !(*z > 0.0) {
            continue;
        }
        let h = n.dot(&rays.point(pixel, *z)) + offset;
        let deviation = scatter * sensor.deviation(f64::from(*z)) as f32;
        if h > LEAST_HEIGHT_M.max(HEIGHT_DEVIATIONS * deviation) && h < MOST_HEIGHT_M {
            state[pixel] = 1;
            wanted.push(pixel as u32);
        }
    }
    let joint = Joint::new(rays, sensor);
    let found = pieces(rays, depth, &joint, &wanted, &mut state, 1, 2);
    let found = merged(rays, depth, found.into_iter().filter(|piece| piece.pixels.len() >= LEAST_PIECE).collect());
    let mut next = 1_u16;
    for piece in found {
        if piece.pixels.len() < LEAST_PIXELS {
            continue;
        }
        piece.pixels.iter().for_each(|pixel| labels[*pixel as usize] = next);
        next = next.saturating_add(1);
    }
    labels
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
            if root[i] == root[j] || apart > near {
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
