//! Cans from flat to tall, tubes, and cups without a handle; some of them lying.

use super::random::Random;
use super::solid::{Ring, Solid};
use super::vessel;
use nalgebra::Point3;

/// Typical cans, metres: diameter, height.
const TYPICAL: [[f64; 2]; 9] = [
    [0.085, 0.034], // tuna
    [0.075, 0.050], // pineapple
    [0.066, 0.101], // soup
    [0.066, 0.122], // a drink
    [0.073, 0.110], // tomatoes
    [0.102, 0.139], // coffee
    [0.075, 0.240], // crisps
    [0.100, 0.120], // large
    [0.190, 0.085], // biscuits
];

/// A can, solid, sometimes on its side; or a cup, which is open.
pub(super) fn can(r: &mut Random) -> Solid {
    let mut solid = Solid::default();
    if r.chance(0.15) {
        let height = r.within(0.075, 0.13);
        let top = r.within(0.030, 0.045);
        let bottom = top * r.within(0.65, 1.0);
        let wall = r.within(0.002, 0.004);
        vessel::hollow(&mut solid, &[[bottom, 0.0], [top, height]], wall, r.within(0.004, 0.010));
        return solid;
    }
    let [diameter, height] = if r.chance(0.5) {
        r.one_of(&TYPICAL).map(|side| side * r.about(0.85, 1.18))
    } else {
        let diameter = r.about(0.055, 0.20);
        [diameter, (diameter * r.about(0.35, 3.4)).min(0.28)]
    };
    let radius = diameter / 2.0;
    // Narrower at the ends, as drink cans are, or tapered a little as tubs are; mostly neither.
    let (taper, neck) = match r.within(0.0, 1.0) {
        p if p < 0.2 => (r.within(0.85, 1.0), 0.0),
        p if p < 0.45 => (1.0, r.within(0.03, 0.12) * radius),
        _ => (1.0, 0.0),
    };
    let edge = (2.0 * neck).min(height / 4.0);
    let foot = radius * taper;
    solid.rings(&[
        Ring::circle(foot - neck, 0.0),
        Ring::circle(foot, edge.max(1e-4)),
        Ring::circle(radius, height - edge.max(1e-4)),
        Ring::circle(radius - neck, height),
    ]);
    if r.chance(0.15) {
        // Rolled over, with its longer horizontal side along x.
        let middle = height / 2.0;
        if height > diameter {
            solid.place(|p| Point3::new(p.z - middle, p.y, radius - p.x));
        } else {
            solid.place(|p| Point3::new(p.x, p.z - middle, radius - p.y));
        }
    }
    solid
}
