//! Bottles: a body, round or flat, a shoulder, a neck and a cap.

use super::random::Random;
use super::solid::{Ring, Solid};

/// What a bottle is drawn from: ranges, metres and ratios.
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

/// A bottle, its wide side along x.
pub(super) fn bottle(r: &mut Random) -> Solid {
    let kind = match r.within(0.0, 1.0) {
        p if p < 0.28 => MUSTARD,
        p if p < 0.42 => BLEACH,
        p if p < 0.64 => DRINK,
        p if p < 0.80 => KETCHUP,
        _ => SOAP,
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
    solid
}
