//! Made-up things of no class, so that a model learns what it does not know: lumps of a few solids, two shapes side by side or on one
//! another under one mask, and shapes of a size that their class does not have.

use super::camera_views::{AtRest, ComponentShapes};
use crate::grid::{Dims, Occupancy, Rotation, yaw};
use nalgebra::{Point3, UnitQuaternion, Vector3};
use rand::{Rng, RngExt};
use std::f64::consts::TAU;

/// Sides of things of no class, metres, the longest.
const SIDES_M: [f64; 2] = [0.05, 0.35];
/// A shape of a size that its class does not have is larger, or smaller, by a factor between these.
const WRONG_SIZE: [f64; 2] = [1.9, 3.5];
/// Share of a grid's side that the longest side takes.
const FILLED: f64 = 0.8;
/// Cells along a side of the grid in which the bounds of a compound are found.
const COARSE: usize = 40;

/// A solid of a compound, in a frame of its own in which its longest side is about 1.
enum Solid<'a> {
    /// Half axes.
    Ellipsoid(Vector3<f64>),
    /// Half sides.
    Cuboid(Vector3<f64>),
    /// Radius and half height, along z.
    Cylinder(f64, f64),
    /// A shape, and how many of its voxels are 1.
    Shape(&'a Occupancy, f64),
}

/// A solid as it lies in a compound.
struct Piece<'a> {
    solid: Solid<'a>,
    rotation: Rotation,
    centre: Vector3<f64>,
    scale: f64,
}

impl Piece<'_> {
    fn holds(&self, point: &Vector3<f64>) -> bool {
        let p = self.rotation.inverse() * (point - self.centre) / self.scale;
        match &self.solid {
            Solid::Ellipsoid(half) => p.component_div(half).norm() < 1.0,
            Solid::Cuboid(half) => p.iter().zip(half.iter()).all(|(v, half)| v.abs() < *half),
            Solid::Cylinder(radius, half) => p.xy().norm() < *radius && p.z.abs() < *half,
            Solid::Shape(object, unit) => {
                let dims = <[usize; 3]>::from(object.dims());
                let at: [f64; 3] = std::array::from_fn(|axis| p[axis] * unit + dims[axis] as f64 / 2.0);
                at.iter().zip(dims).all(|(v, side)| *v >= 0.0 && *v < side as f64)
                    && object.is_filled(at[0] as usize, at[1] as usize, at[2] as usize)
            }
        }
    }
}

/// Pieces together as voxels: the longest side takes [`FILLED`] of the grid. `None` where there is next to nothing.
fn voxels(pieces: &[Piece<'_>], dims: Dims) -> Option<Occupancy> {
    let holds = |point: &Vector3<f64>| pieces.iter().any(|piece| piece.holds(point));
    let (mut low, mut high) = (Vector3::repeat(f64::INFINITY), Vector3::repeat(f64::NEG_INFINITY));
    let step = 4.0 / COARSE as f64;
    let at = |n: usize| (n as f64 + 0.5) * step - 2.0;
    for (i, j, k) in (0..COARSE).flat_map(|i| (0..COARSE).flat_map(move |j| (0..COARSE).map(move |k| (i, j, k)))) {
        let point = Vector3::new(at(i), at(j), at(k));
        if holds(&point) {
            (low, high) = (low.inf(&point.add_scalar(-step / 2.0)), high.sup(&point.add_scalar(step / 2.0)));
        }
    }
    if low.x > high.x {
        return None;
    }
    let sides = <[usize; 3]>::from(dims).map(|side| side as f64);
    let shortest = sides.into_iter().fold(f64::INFINITY, f64::min);
    let edge = (high - low).max() / (FILLED * shortest);
    let middle = Point3::from((low + high) / 2.0);
    let made = Occupancy::from_fn(dims, |i, j, k| {
        let from_middle = Vector3::from_fn(|axis, _| [i, j, k][axis] as f64 + 0.5 - sides[axis] / 2.0);
        holds(&(middle + from_middle * edge).coords)
    });
    (made.count() > 30).then_some(made)
}

/// A thing of no class, made of the shapes of `parts` that are allowed (class, shape) or of none of them.
pub fn distractor(parts: &[ComponentShapes], is_allowed: &dyn Fn(usize, usize) -> bool, rng: &mut impl Rng) -> Option<AtRest> {
    let pick = |rng: &mut dyn Rng| -> Option<&AtRest> {
        // A bounded search: few shapes are left out of some.
        (0..100).find_map(|_| {
            let part = &parts[rng.random_range(0..parts.len())];
            let shape = part.shapes.get(rng.random_range(0..part.shapes.len().max(1)))?;
            is_allowed(part.component.class, shape.shape).then_some(shape)
        })
    };
    let first = pick(rng)?;
    let dims = first.finest().dims();
    let sized = first.side_m.is_some();
    let between = |rng: &mut dyn Rng, [low, high]: [f64; 2]| (low.ln() + (high / low).ln() * rng.random_range(0.0..1.0)).exp();
    let kind = rng.random_range(0.0..1.0);
    if kind < 0.2 && sized {
        let factor = between(rng, WRONG_SIZE);
        let factor = if rng.random_range(0.0..1.0) < 0.5 { factor } else { 1.0 / factor };
        return Some(first.resized(factor));
    }
    if kind < 0.6 {
        let second = pick(rng)?;
        let ratio = match (first.side_m, second.side_m) {
            (Some(a), Some(b)) => b / a,
            _ => between(rng, [0.4, 2.5]),
        };
        let piece = |shape: &'_ AtRest, scale: f64| -> (f64, [Vector3<f64>; 2]) {
            let [low, high] = shape.finest().bounds().unwrap_or_default();
            let unit = (0..3).map(|a| high[a] - low[a]).max().unwrap_or(1) as f64;
            let middle = <[usize; 3]>::from(shape.finest().dims()).map(|side| side as f64 / 2.0);
            let corner = |at: [usize; 3]| Vector3::from_fn(|a, _| scale * (at[a] as f64 - middle[a]) / unit);
            (unit, [corner(low), corner(high)])
        };
        let ((unit_a, box_a), (unit_b, box_b)) = (piece(first, 1.0), piece(second, ratio));
        let largest = ratio.max(1.0);
        // They touch, one beside or above the other.
        let above = rng.random_range(0.0..1.0) < 0.35;
        let mut shift = Vector3::new(0.0, 0.0, box_a[0].z - box_b[0].z);
        if above {
            shift = Vector3::new(rng.random_range(-0.1..0.1), rng.random_range(-0.1..0.1), box_a[1].z - box_b[0].z);
        } else {
            let axis = rng.random_range(0..2);
            shift[axis] = box_a[1][axis] - box_b[0][axis] - rng.random_range(0.0..0.05);
            shift[1 - axis] = rng.random_range(-0.2..0.2);
        }
        let shape = |shape: &'_ AtRest, unit, centre, scale| (shape.finest().clone(), unit, centre, scale);
        let [(a, ua, ca, sa), (b, ub, cb, sb)] = [shape(first, unit_a, Vector3::zeros(), 1.0), shape(second, unit_b, shift, ratio)]
            .map(|(g, u, c, s)| (g, u, c / largest, s / largest));
        let upright = Rotation::identity();
        let pieces = [
            Piece { solid: Solid::Shape(&a, ua), rotation: upright, centre: ca, scale: sa },
            Piece { solid: Solid::Shape(&b, ub), rotation: upright, centre: cb, scale: sb },
        ];
        let extent = box_a[1].sup(&(box_b[1] + shift)) - box_a[0].inf(&(box_b[0] + shift));
        let side_m = first.side_m.map(|side| side * extent.max());
        return Some(first.like(voxels(&pieces, dims)?, side_m));
    }
    // One alone may well look like a class: how often it does is what the shares of the leaves weigh.
    let count = rng.random_range(1..6);
    let pieces: Vec<Piece<'_>> = (0..count)
        .map(|_| {
            let mut half = || Vector3::from_fn(|_, _| between(rng, [0.05, 0.5]));
            let half = half();
            let solid = match rng.random_range(0..3) {
                0 => Solid::Ellipsoid(half),
                1 => Solid::Cuboid(half),
                _ => Solid::Cylinder(half.x, half.z),
            };
            let axis = Vector3::from_fn(|_, _| rng.random_range(-1.0..1.0));
            let tilt = UnitQuaternion::new(axis * rng.random_range(0.0..1.5));
            let rotation = yaw(rng.random_range(0.0..TAU)) * tilt;
            let centre = Vector3::from_fn(|_, _| rng.random_range(-0.45..0.45));
            Piece { solid, rotation, centre, scale: 1.0 }
        })
        .collect();
    let side_m = sized.then(|| between(rng, SIDES_M));
    Some(first.like(voxels(&pieces, dims)?, side_m))
}
