//! Bottles: a body, round or flat, a shoulder, a neck and a cap; some with the handle of a jug at +x, some with a sprayer's head.
//!
//! Heights and widths span what is sold: drinks of 0.25 to 1.5 l (170 to 330 mm high, 57 to 90 wide), sauces (150 to 240), soap and shampoo
//! (140 to 260), cleaners with a sprayer (250 to 290), jugs of milk and detergent (230 to 300 high, 120 to 180 wide).

use super::random::Random;
use super::solid::{Ring, Solid};

/// Ranges from which a bottle is drawn, metres and ratios.
struct Kind {
    height: [f64; 2],
    /// Width over height.
    width: [f64; 2],
    /// Depth over width.
    depth: [f64; 2],
    /// Where the body ends and where the shoulder ends, over the height.
    body: [f64; 2],
    shoulder: [f64; 2],
    /// Radius of neck and cap, over half of the width.
    neck: [f64; 2],
    /// Of the cross-section.
    exponent: [f64; 2],
}

const MUSTARD: Kind = Kind {
    height: [0.16, 0.21],
    width: [0.42, 0.56],
    depth: [0.52, 0.75],
    body: [0.50, 0.68],
    shoulder: [0.72, 0.84],
    neck: [0.26, 0.50],
    exponent: [2.0, 2.8],
};
const BLEACH: Kind = Kind {
    height: [0.20, 0.29],
    width: [0.36, 0.48],
    depth: [0.55, 0.80],
    body: [0.48, 0.64],
    shoulder: [0.74, 0.86],
    neck: [0.30, 0.50],
    exponent: [2.2, 4.0],
};
const DRINK: Kind = Kind {
    height: [0.17, 0.33],
    width: [0.24, 0.36],
    depth: [0.995, 1.0],
    body: [0.45, 0.74],
    shoulder: [0.70, 0.90],
    neck: [0.28, 0.55],
    exponent: [2.0, 2.0001],
};
const KETCHUP: Kind = Kind {
    height: [0.15, 0.24],
    width: [0.32, 0.45],
    depth: [0.55, 0.85],
    body: [0.55, 0.74],
    shoulder: [0.76, 0.88],
    neck: [0.40, 0.80],
    exponent: [2.0, 3.0],
};
const SOAP: Kind = Kind {
    height: [0.14, 0.26],
    width: [0.30, 0.50],
    depth: [0.40, 0.75],
    body: [0.58, 0.78],
    shoulder: [0.74, 0.86],
    neck: [0.18, 0.45],
    exponent: [2.0, 4.5],
};

const JUG: Kind = Kind {
    height: [0.20, 0.30],
    width: [0.44, 0.62],
    depth: [0.55, 1.0],
    body: [0.48, 0.64],
    shoulder: [0.76, 0.88],
    neck: [0.22, 0.40],
    exponent: [2.4, 5.0],
};
const SPRAYER: Kind = Kind {
    height: [0.19, 0.24],
    width: [0.34, 0.50],
    depth: [0.55, 1.0],
    body: [0.45, 0.60],
    shoulder: [0.74, 0.86],
    neck: [0.26, 0.40],
    exponent: [2.0, 3.5],
};

/// The parts of a bottle besides its body.
#[derive(Clone, Copy, PartialEq)]
enum Extra {
    Nothing,
    Handle,
    Head,
}

/// A bottle, its wide side along x.
pub(super) fn bottle(r: &mut Random) -> Solid {
    let (kind, extra) = match r.within(0.0, 1.0) {
        p if p < 0.22 => (MUSTARD, Extra::Nothing),
        p if p < 0.34 => (BLEACH, if r.chance(0.5) { Extra::Handle } else { Extra::Nothing }),
        p if p < 0.56 => (DRINK, Extra::Nothing),
        p if p < 0.70 => (KETCHUP, Extra::Nothing),
        p if p < 0.86 => (SOAP, Extra::Nothing),
        p if p < 0.93 => (JUG, Extra::Handle),
        _ => (SPRAYER, Extra::Head),
    };
    let mut draw = |[low, high]: [f64; 2]| r.within(low, high);
    let height = draw(kind.height);
    let a = height * draw(kind.width) / 2.0;
    let b = a * draw(kind.depth);
    let body = draw(kind.body);
    let shoulder = draw(kind.shoulder).max(body + 0.06);
    let neck = (a * draw(kind.neck)).min(0.95 * b);
    let exponent = draw(kind.exponent);
    // How the body widens or narrows towards its foot and its middle, and how round the shoulder is.
    let foot = draw([0.88, 1.06]);
    let waist = draw([-0.10, 0.08]);
    let roundness = draw([0.9, 2.4]);
    let cap = neck * draw([1.0, 1.25]);
    let tip = cap * draw([0.55, 1.0]);

    let mut rings = Vec::new();
    let section = |x: f64, y: f64, z: f64, exponent: f64| Ring { half: [x, y], z: z * height, exponent };
    let edge = 0.012;
    rings.push(section(0.93 * foot * a, 0.93 * foot * b, 0.0, exponent));
    const STEPS: usize = 10;
    for n in 0..=STEPS {
        let t = n as f64 / STEPS as f64;
        let swell = foot + (1.0 - foot) * t + waist * (std::f64::consts::PI * t).sin();
        rings.push(section(swell * a, swell * b, edge + (body - edge) * t, exponent));
    }
    // From the body's section to the round neck.
    for n in 1..=STEPS {
        let t = n as f64 / STEPS as f64;
        let left = (1.0 - t.powf(roundness)).max(0.0);
        let round = exponent + (2.0 - exponent) * t;
        rings.push(section(neck + (a - neck) * left, neck + (b - neck) * left, body + (shoulder - body) * t, round));
    }
    let collar = shoulder + 0.25 * (1.0 - shoulder);
    rings.push(section(neck, neck, collar, 2.0));
    rings.push(section(cap, cap, collar + 1e-3, 2.0));
    rings.push(section(tip, tip, 1.0, 2.0));
    let mut solid = Solid::default();
    solid.rings(&rings);
    match extra {
        Extra::Nothing => {}
        Extra::Handle => handle(&mut solid, r, height, a, neck, [body, shoulder]),
        Extra::Head => head(&mut solid, r, height, tip),
    }
    solid
}

/// The handle of a jug: a bow from the neck to the body, at +x.
fn handle(solid: &mut Solid, r: &mut Random, height: f64, a: f64, neck: f64, [body, shoulder]: [f64; 2]) {
    let low = height * (body - r.within(0.05, 0.25));
    let high = height * (shoulder - r.within(0.0, 0.04));
    let reach = r.within(0.012, 0.030);
    let path: Vec<[f64; 2]> = (0..=20)
        .map(|n| {
            let t = f64::from(n) / 20.0;
            let bow = (std::f64::consts::PI * t).sin().powf(0.6);
            // From within the body to within the neck.
            let start = 0.85 * a * (1.0 - t) + 0.6 * neck * t;
            [start + (0.15 * a + reach) * bow + (a - start) * 0.6 * bow, low + (high - low) * t]
        })
        .collect();
    solid.tube(&path, [r.within(0.006, 0.011), r.within(0.008, 0.014)]);
}

/// A sprayer's head on the cap: its nozzle towards +x, with a trigger below.
fn head(solid: &mut Solid, r: &mut Random, height: f64, tip: f64) {
    let (back, front) = (r.within(0.02, 0.035), r.within(0.045, 0.070));
    let (wide, high) = (r.within(0.010, 0.016), r.within(0.028, 0.042));
    let foot = height - 0.004;
    solid.rings(&[Ring::circle(0.9 * tip, height - 0.01), Ring::circle(0.9 * tip, foot + 0.6 * high)]);
    solid.cuboid([-back, -wide, foot + 0.35 * high], [front, wide, foot + high]);
    // The trigger.
    let from = front * r.within(0.55, 0.8);
    solid.cuboid([from - 0.006, -0.6 * wide, foot - r.within(0.012, 0.030)], [from + 0.004, 0.6 * wide, foot + 0.4 * high]);
}
