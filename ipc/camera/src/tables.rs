//! Objects of a frame without masks: what stands on a table.
//!
//! Readings above the support and over its outline hang together where neighbours lie on one surface; pieces that are near each other in
//! space are one object: the far wall of a bowl and its near one.

use crate::SensorModel;
use crate::joining::{Joint, Piece, pieces};
use crate::rays::Rays;
use crate::supports::Supports;
use nalgebra::{Unit, Vector3};

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
/// Cells of the table's outline, metres.
const CELL_M: f32 = 0.01;
/// Readings of an object at least.
const LEAST_PIXELS: usize = 60;

/// Labels from 1 on of what stands on the supports.
pub fn segment(rays: &Rays, depth: &[f32], sensor: &SensorModel, supports: &Supports) -> Vec<u16> {
    let mut labels = vec![0; depth.len()];
    let Some(main) = supports.planes.first() else { return labels };
    let (n, offset) = (main.plane.normal().into_inner().cast::<f32>(), main.plane.offset() as f32);
    let [e, f] = axes(&main.plane.normal());
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
    let found: Vec<Piece> = found.into_iter().filter(|piece| piece.pixels.len() >= 12).collect();
    let _ = (e, f, CELL_M);
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

/// Two directions within a plane.
pub fn axes(normal: &Unit<Vector3<f64>>) -> [Vector3<f32>; 2] {
    let least = normal.abs().imin();
    let mut other = Vector3::zeros();
    other[least] = 1.0;
    let e = normal.cross(&other).normalize();
    [e.cast(), normal.cross(&e).cast()]
}
