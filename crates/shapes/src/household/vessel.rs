//! Open vessels: mugs, bowls and plates. A wall of even thickness about a curve.

use super::random::Random;
use super::solid::{Ring, Solid};

/// A vessel of revolution whose outside follows `curve` (radius, height; upwards, from the edge of its bottom to its rim), with a wall
/// and a floor of the given thickness, metres.
pub(super) fn hollow(solid: &mut Solid, curve: &[[f64; 2]], wall: f64, floor: f64) {
    let (first, last) = (curve[0], curve[curve.len() - 1]);
    let floor = first[1] + floor;
    let mut rings: Vec<Ring> = curve.iter().map(|&[radius, z]| Ring::circle(radius, z)).collect();
    // The inside: the curve moved inwards along its normal, from the rim to the floor.
    let mut inside = Vec::new();
    for n in (0..curve.len()).rev() {
        let (before, after) = (curve[n.saturating_sub(1)], curve[(n + 1).min(curve.len() - 1)]);
        let (along_r, along_z) = (after[0] - before[0], after[1] - before[1]);
        let length = along_r.hypot(along_z);
        let radius = curve[n][0] - wall * along_z / length;
        let z = curve[n][1] + wall * along_r / length;
        if n + 1 == curve.len() {
            inside.push([last[0] - wall, last[1]]);
        } else if z < last[1] - 1e-4 && z > floor + 1e-4 && radius > 0.0 {
            inside.push([radius, z]);
        } else if z <= floor + 1e-4 {
            // Where the inside meets the floor.
            let above = inside.last().copied().unwrap_or([radius, last[1]]);
            let t = if above[1] - z > 1e-9 { ((above[1] - floor) / (above[1] - z)).clamp(0.0, 1.0) } else { 1.0 };
            inside.push([(above[0] + t * (radius - above[0])).max(1e-3), floor]);
            break;
        }
    }
    if let Some(lowest) = inside.last().copied().filter(|[_, z]| *z > floor + 1e-9) {
        inside.push([(lowest[0] * 0.98).max(1e-3), floor]);
    }
    rings.extend(inside.into_iter().map(|[radius, z]| Ring::circle(radius, z)));
    solid.rings(&rings);
}

/// A bowl with a foot; its wall rounded, conical, or in between.
pub(super) fn bowl(r: &mut Random) -> Solid {
    let rim = r.about(0.055, 0.125);
    let height = (2.0 * rim * r.within(0.27, 0.52)).clamp(0.04, 0.095);
    let foot_height = if r.chance(0.7) { r.within(0.002, 0.010) } else { 0.0 };
    let bottom = rim * r.within(0.30, 0.62);
    let roundness = r.within(0.35, 1.0);
    let wall = r.within(0.003, 0.006);
    let mut solid = Solid::default();
    hollow(&mut solid, &rounded(bottom, rim, foot_height, height, roundness), wall, r.within(0.004, 0.008));
    if foot_height > 0.0 {
        // It ends within the floor.
        let foot = bottom * r.within(0.85, 0.98);
        solid.rings(&[Ring::circle(foot, 0.0), Ring::circle(foot, foot_height + 0.002)]);
    }
    solid
}

/// A plate or a shallow dish: a flat well and a rim that rises slowly.
pub(super) fn plate(r: &mut Random) -> Solid {
    let rim = r.within(0.075, 0.145);
    let height = r.within(0.014, 0.040);
    let well = rim * r.within(0.50, 0.78);
    let wall = r.within(0.003, 0.006);
    let rise = r.within(0.3, 0.9);
    // The rim: steep at first, then flat, or straight.
    let bend = well + (rim - well) * r.within(0.15, 0.6);
    let curve = [[well, 0.0], [bend, rise * (height - wall)], [rim, height]];
    let mut solid = Solid::default();
    hollow(&mut solid, &curve, wall, r.within(0.004, 0.007));
    solid
}

/// A mug with its handle at +x.
pub(super) fn mug(r: &mut Random) -> Solid {
    let rim = r.within(0.035, 0.050);
    let height = r.within(0.070, 0.112);
    let wall = r.within(0.003, 0.006);
    let bottom = rim * if r.chance(0.5) { r.within(0.96, 1.02) } else { r.within(0.72, 1.0) };
    let bulge = if r.chance(0.3) { rim * r.within(-0.06, 0.14) } else { 0.0 };
    // A rounded lower edge.
    let edge = if r.chance(0.5) { r.within(0.004, 0.018) } else { 0.001 };
    let radius = |z: f64| bottom + (rim - bottom) * z / height + bulge * (std::f64::consts::PI * z / height).sin();
    let mut curve = Vec::new();
    for n in 0..=6 {
        let (sin, cos) = (std::f64::consts::FRAC_PI_2 * f64::from(n) / 6.0).sin_cos();
        curve.push([radius(edge) - edge * (1.0 - sin), edge * (1.0 - cos)]);
    }
    const STEPS: usize = 12;
    curve.extend((1..=STEPS).map(|n| edge + (height - edge) * n as f64 / STEPS as f64).map(|z| [radius(z), z]));
    let mut solid = Solid::default();
    hollow(&mut solid, &curve, wall, r.within(0.004, 0.009));

    // The handle: a bow from within the wall to within the wall.
    let low = height * r.within(0.10, 0.30);
    let high = height * r.within(0.68, 0.93);
    let reach = r.within(0.024, 0.042);
    let exponent = r.within(1.6, 4.0);
    let lean = r.within(-0.12, 0.12);
    let path: Vec<[f64; 2]> = (0..=20)
        .map(|n| {
            let (sin, cos) = (std::f64::consts::PI * f64::from(n) / 20.0).sin_cos();
            let bent = |v: f64| v.signum() * v.abs().powf(2.0 / exponent);
            let z = (low + high) / 2.0 - (high - low) / 2.0 * bent(cos) + lean * reach * bent(sin.max(0.0));
            let start = radius(z.clamp(0.0, height)) - 0.5 * wall;
            [start + reach * bent(sin.max(0.0)), z]
        })
        .collect();
    let thickness = [r.within(0.0025, 0.0045), r.within(0.004, 0.009)];
    solid.tube(&path, thickness);
    solid
}

/// A curve from the edge of the bottom to the rim: radius − bottom grows with the height to the power `roundness`.
fn rounded(bottom: f64, rim: f64, low: f64, high: f64, roundness: f64) -> Vec<[f64; 2]> {
    const STEPS: usize = 16;
    (0..=STEPS)
        .map(|n| {
            // More steps near the bottom, where the curve bends most.
            let t = (n as f64 / STEPS as f64).powi(2);
            [bottom + (rim - bottom) * t.powf(roundness), low + (high - low) * t]
        })
        .collect()
}
