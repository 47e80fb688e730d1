//! Cans from flat to tall, tins, and tubes of cardboard; upright.
//!
//! Sizes are the trade's nominal ones: diameters of can ends (52 to 99 mm; 202 to 603 in sixteenths of an inch), heights of drinks by
//! filling volume, and measured ones of crisps tubes.

use super::random::Random;
use super::solid::{Ring, Solid};

/// Typical cans, metres: diameter, height.
const TYPICAL: [[f64; 2]; 15] = [
    [0.085, 0.034], // tuna
    [0.075, 0.050], // pineapple
    [0.066, 0.101], // soup
    [0.066, 0.115], // a drink, 330 ml
    [0.066, 0.122], // a drink, 12 oz
    [0.066, 0.168], // a drink, 500 ml
    [0.058, 0.146], // a drink, slender
    [0.053, 0.135], // a drink, 250 ml
    [0.053, 0.090], // a drink, 150 ml
    [0.073, 0.110], // tomatoes
    [0.102, 0.139], // coffee
    [0.099, 0.120], // large
    [0.077, 0.237], // crisps
    [0.072, 0.255], // crisps, slender
    [0.077, 0.090], // crisps, small
];

/// A can, closed.
pub(super) fn can(r: &mut Random) -> Solid {
    let mut solid = Solid::default();
    let [diameter, height] = if r.chance(0.75) {
        let size = r.about(0.94, 1.07);
        r.one_of(&TYPICAL).map(|side| side * size * r.about(0.95, 1.05))
    } else {
        let diameter = r.about(0.050, 0.16);
        [diameter, (diameter * r.about(0.35, 3.2)).clamp(0.028, 0.27)]
    };
    let radius = diameter / 2.0;
    // Narrower at the ends, as drink cans are, or tapered a little as tubs are, or with a wider lid; mostly none of it.
    let (taper, neck, lid) = match r.within(0.0, 1.0) {
        p if p < 0.12 => (r.within(0.85, 1.0), 0.0, 0.0),
        p if p < 0.45 => (1.0, r.within(0.05, 0.16) * radius, 0.0),
        p if p < 0.65 => (1.0, 0.0, r.within(0.001, 0.003)),
        _ => (1.0, 0.0, 0.0),
    };
    let edge = (2.0 * neck).min(height / 4.0).max(1e-4);
    let foot = radius * taper;
    // The end lies within a rim on many of them.
    let (rim, deep) = if r.chance(0.5) { (r.within(0.002, 0.004), r.within(0.002, 0.006).min(0.15 * height)) } else { (0.0, 0.0) };
    let mut rings = vec![Ring::circle(foot - neck, 0.0), Ring::circle(foot, edge), Ring::circle(radius, height - edge)];
    if lid > 0.0 {
        let high = r.within(0.006, 0.014).min(0.3 * height);
        rings = vec![Ring::circle(foot, 0.0), Ring::circle(radius, height - high), Ring::circle(radius + lid, height - high + 1e-4)];
    }
    let top = radius - neck + lid;
    rings.push(Ring::circle(top, height));
    if rim > 0.0 {
        rings.extend([Ring::circle(top - rim, height), Ring::circle(top - rim, height - deep)]);
    }
    solid.rings(&rings);
    solid
}
