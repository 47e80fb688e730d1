//! Boxes: of cardboard, plastic and tin, open ones, and cartons of drinks. Books are left out: nobody calls one a box.
//!
//! Canonical: upright on the smallest face, the middle side along x. How boxes lie is a matter of resting poses, not of shapes.
//!
//! Typical sizes, metres, are those printed on or measured of goods of European and North American supermarkets (retailers' product pages
//! state outer sizes; those of drinks follow from the filling machines' standard bases, such as 95 × 65 and 70 × 70 mm).

use super::random::Random;
use super::solid::Ring;
use super::solid::Solid;
use nalgebra::{Point3, Rotation3, Vector3};

/// Typical boxes, metres, longest side first.
const TYPICAL: [[f64; 3]; 19] = [
    [0.210, 0.160, 0.060], // cereals, crackers
    [0.300, 0.195, 0.065], // cereals, large
    [0.230, 0.160, 0.070], // biscuits
    [0.175, 0.090, 0.040], // sugar
    [0.110, 0.085, 0.035], // pudding
    [0.085, 0.073, 0.028], // gelatin
    [0.145, 0.075, 0.065], // tea bags, 20
    [0.125, 0.080, 0.070], // tea bags
    [0.190, 0.120, 0.045], // tea, flat
    [0.180, 0.095, 0.045], // pasta, 500 g
    [0.140, 0.090, 0.035], // macaroni, 206 g
    [0.190, 0.045, 0.040], // toothpaste
    [0.120, 0.060, 0.022], // medicine
    [0.100, 0.100, 0.100], // a cube
    [0.120, 0.115, 0.110], // tissues, cube
    [0.235, 0.120, 0.085], // tissues
    [0.215, 0.103, 0.065], // a brick
    [0.150, 0.100, 0.055], // a food box of plastic
    [0.165, 0.080, 0.050], // a telephone's
];

/// Cartons of drinks, metres: along x, along y, height without a gable.
const DRINKS: [[f64; 3]; 9] = [
    [0.095, 0.063, 0.167], // 1 l, flat top
    [0.072, 0.070, 0.200], // 1 l, square
    [0.091, 0.058, 0.130], // 0.5 l
    [0.048, 0.038, 0.117], // 0.2 l with a straw
    [0.062, 0.040, 0.085], // 0.2 l, low
    [0.070, 0.070, 0.195], // 1 l, gabled
    [0.095, 0.095, 0.200], // 2 l, gabled
    [0.070, 0.070, 0.110], // 0.5 l, gabled
    [0.057, 0.057, 0.075], // 0.25 l, gabled
];

/// A box, upright.
pub(super) fn carton(r: &mut Random) -> Solid {
    match r.within(0.0, 1.0) {
        p if p < 0.62 => closed(r),
        p if p < 0.92 => drink(r),
        _ => open(r),
    }
}

fn closed(r: &mut Random) -> Solid {
    let mut sides = if r.chance(0.65) {
        r.one_of(&TYPICAL).map(|side| side * r.about(0.85, 1.18))
    } else {
        let longest = r.about(0.07, 0.30);
        let middle = longest * r.within(0.3, 1.0);
        [longest, middle, (middle * r.within(0.15, 1.0)).max(0.014)]
    };
    sides.sort_by(|a, b| b.total_cmp(a));
    let [z, x, y] = sides;
    let mut solid = Solid::default();
    if r.chance(0.75) {
        solid.cuboid([-x / 2.0, -y / 2.0, 0.0], [x / 2.0, y / 2.0, z]);
    } else {
        // Rounded edges, as of boxes of plastic or tin.
        let edge = r.within(0.02, 0.16) * y;
        let exponent = r.about(6.0, 40.0);
        let ring = |less: f64, z: f64| Ring { half: [x / 2.0 - less, y / 2.0 - less], z, exponent };
        solid.rings(&[
            ring(edge, 0.0),
            ring(0.3 * edge, 0.3 * edge),
            ring(0.0, edge),
            ring(0.0, z - edge),
            ring(0.3 * edge, z - 0.3 * edge),
            ring(edge, z),
        ]);
    }
    solid
}

/// A box without a lid, perhaps with something in it.
fn open(r: &mut Random) -> Solid {
    let x = r.about(0.10, 0.32);
    let y = x * r.within(0.45, 1.0);
    let z = (y * r.within(0.35, 1.1)).max(0.05);
    let wall = r.within(0.003, 0.006);
    let mut solid = Solid::default();
    let (a, b) = (x / 2.0, y / 2.0);
    let floor = if r.chance(0.35) { z * r.within(0.2, 0.85) } else { wall };
    solid.cuboid([-a, -b, 0.0], [a, b, floor]);
    for side in [-1.0, 1.0] {
        let (from, to) = ((side * a).min(side * (a - wall)), (side * a).max(side * (a - wall)));
        solid.cuboid([from, -b, 0.0], [to, b, z]);
        let (from, to) = ((side * b).min(side * (b - wall)), (side * b).max(side * (b - wall)));
        solid.cuboid([-a, from, 0.0], [a, to, z]);
    }
    solid
}

/// A carton of milk or juice: with a gable, or a flat or slanting top; often with a cap.
fn drink(r: &mut Random) -> Solid {
    let scale = r.about(0.88, 1.14);
    let [x, y, height] = r.one_of(&DRINKS).map(|side| side * scale * r.about(0.94, 1.06));
    let (x, y) = (x.max(y), x.min(y));
    let (a, b) = (x / 2.0, y / 2.0);
    let mut solid = Solid::default();
    // Where a cap may sit: a point of the top and its normal.
    let (seat, normal) = match r.within(0.0, 1.0) {
        p if p < 0.5 => {
            let rise = b * r.within(0.7, 1.1);
            let ridge = height + rise;
            solid.prism(&[[-b, 0.0], [b, 0.0], [b, height], [0.0, ridge], [-b, height]], [-a, a]);
            let fin = r.within(0.006, 0.014);
            let thick = r.within(0.0015, 0.004);
            solid.cuboid([-a, -thick, ridge - thick * 2.0], [a, thick, ridge + fin]);
            (Point3::new(0.0, b / 2.0, height + rise / 2.0), Vector3::new(0.0, rise, b).normalize())
        }
        p if p < 0.8 => {
            solid.cuboid([-a, -b, 0.0], [a, b, height]);
            (Point3::new(r.within(-0.5, 0.5) * a, 0.0, height), Vector3::z())
        }
        _ => {
            // The top slants towards the front.
            let fall = y * r.within(0.2, 0.6);
            solid.prism(&[[-b, 0.0], [b, 0.0], [b, height - fall], [-b, height]], [-a, a]);
            (Point3::new(0.0, 0.2 * b, height - 0.6 * fall), Vector3::new(0.0, fall, y).normalize())
        }
    };
    if r.chance(0.55) {
        let radius = r.within(0.010, 0.019).min(0.45 * b);
        // It does not reach beyond the front.
        let room = b - seat.y - normal.z * radius;
        let high = r.within(0.008, 0.018).min(if normal.y > 1e-9 { (room / normal.y).max(0.002) } else { 1.0 });
        let mut cap = Solid::default();
        cap.rings(&[Ring::circle(radius, -0.4 * radius), Ring::circle(radius, high)]);
        let turn = Rotation3::rotation_between(&Vector3::z(), &normal).unwrap_or_default();
        cap.place(|p| seat + turn * p.coords);
        solid.append(cap);
    }
    solid
}
