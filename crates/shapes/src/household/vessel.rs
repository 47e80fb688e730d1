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

/// Fills a vessel of that outside up to `level`, with a surface that rises by `heap` in the middle.
fn fill(solid: &mut Solid, curve: &[[f64; 2]], wall: f64, level: f64, heap: f64) {
    // Within the wall, so that the two overlap.
    let within = |[radius, z]: [f64; 2]| Ring::circle((radius - 0.6 * wall).max(1e-3), z);
    let mut rings: Vec<Ring> = curve.iter().filter(|[_, z]| *z < level - 1e-4).map(|at| within(*at)).collect();
    let Some(above) = curve.iter().position(|[_, z]| *z >= level - 1e-4).filter(|n| *n > 0) else { return };
    let ([r0, z0], [r1, z1]) = (curve[above - 1], curve[above]);
    let share = (level - z0) / (z1 - z0).max(1e-9);
    let top = within([r0 + share * (r1 - r0), level]);
    rings.push(top);
    rings.push(Ring::circle(0.6 * top.half[0], level + 0.7 * heap));
    rings.push(Ring::circle(0.0, level + heap));
    solid.rings(&rings);
}

/// A bowl with a foot; its wall rounded, conical, or in between; sometimes with something in it. Diameters from small bowls for dips
/// (90 mm) over those for rice (115), cereals (140 to 160) and pasta to salad (250).
pub(super) fn bowl(r: &mut Random) -> Solid {
    let rim = r.about(0.045, 0.125);
    let height = (2.0 * rim * r.within(0.27, 0.56)).clamp(0.032, 0.110);
    let foot_height = if r.chance(0.7) { r.within(0.002, 0.010) } else { 0.0 };
    let bottom = rim * r.within(0.30, 0.62);
    let roundness = r.within(0.35, 1.0);
    let wall = r.within(0.003, 0.006);
    let mut solid = Solid::default();
    let curve = rounded(bottom, rim, foot_height, height, roundness);
    hollow(&mut solid, &curve, wall, r.within(0.004, 0.008));
    if r.chance(0.15) {
        fill(&mut solid, &curve, wall, foot_height + (height - foot_height) * r.within(0.4, 0.85), height * r.within(0.0, 0.15));
    }
    if foot_height > 0.0 {
        // It ends within the floor.
        let foot = bottom * r.within(0.85, 0.98);
        solid.rings(&[Ring::circle(foot, 0.0), Ring::circle(foot, foot_height + 0.002)]);
    }
    solid
}

/// A plate or a shallow dish: a flat well and a rim that rises slowly; from saucers (150 mm) to dinner plates (280).
pub(super) fn plate(r: &mut Random) -> Solid {
    let rim = r.within(0.072, 0.145);
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

/// A mug with its handle at +x, or a tumbler, which has none; from espresso (60 mm high) over the usual 80 × 95 mm to large ones;
/// tumblers and paper cups up to 150 mm. Sometimes with something in it.
pub(super) fn mug(r: &mut Random) -> Solid {
    let with_handle = r.chance(0.85);
    let rim = r.within(0.034, 0.050);
    let height = if with_handle { r.within(0.068, 0.115) } else { r.within(0.070, 0.150) };
    let wall = r.within(0.003, 0.006);
    let bottom = rim * if with_handle && r.chance(0.5) { r.within(0.96, 1.02) } else { r.within(0.72, 1.0) };
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
    if r.chance(0.2) {
        fill(&mut solid, &curve, wall, height * r.within(0.45, 0.92), 0.0);
    }
    if !with_handle {
        return solid;
    }

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
