//! Made-up furniture for the demo and for tests: the ten classes of ModelNet10, each a random assembly of boxes, cylinders and
//! ellipsoids with ModelNet's proportions and orientation (z up; what has a back has it at +y, long things lie along y and have
//! their back at +x). No shape of ModelNet is used.

use crate::grid::{Dims, Occupancy, longest_side};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// The classes that [`make`] knows: those of ModelNet10, sorted.
pub const CLASSES: [&str; 10] = ["bathtub", "bed", "chair", "desk", "dresser", "monitor", "night_stand", "sofa", "table", "toilet"];

/// A random piece of furniture, solid, centred, with the longest side of [`longest_side`] voxels; `None` for an unknown class. The
/// same seed gives the same piece; classes do not share random numbers.
pub fn make(class: &str, dims: Dims, rng_seed: u64) -> Option<Occupancy> {
    let index = CLASSES.iter().position(|c| *c == class)?;
    let mut rng = ChaCha8Rng::seed_from_u64(rng_seed);
    rng.set_stream(index as u64);
    let mut r = Random(rng);
    let assembly = match class {
        "bathtub" => bathtub(&mut r),
        "bed" => bed(&mut r),
        "chair" => chair(&mut r),
        "desk" => desk(&mut r),
        "dresser" => dresser(&mut r),
        "monitor" => monitor(&mut r),
        "night_stand" => night_stand(&mut r),
        "sofa" => sofa(&mut r),
        "table" => table(&mut r),
        _ => toilet(&mut r),
    };
    Some(assembly.voxels(dims))
}

struct Random(ChaCha8Rng);

impl Random {
    fn within(&mut self, low: f64, high: f64) -> f64 {
        self.0.random_range(low..high)
    }

    fn chance(&mut self, probability: f64) -> bool {
        self.0.random_range(0.0..1.0) < probability
    }
}

/// A solid given by its axis-aligned bounding box.
#[derive(Clone, Copy)]
enum Kind {
    Cuboid,
    /// An elliptical cylinder along an axis.
    Cylinder(usize),
    Ellipsoid,
}

#[derive(Clone, Copy)]
struct Part {
    kind: Kind,
    low: [f64; 3],
    high: [f64; 3],
    /// Cut out what the parts before it filled.
    is_cut: bool,
}

impl Part {
    /// Whether the part touches the box [low, high].
    fn touches(&self, low: [f64; 3], high: [f64; 3]) -> bool {
        let round = |axis: usize| match self.kind {
            Kind::Cuboid => false,
            Kind::Cylinder(along) => axis != along,
            Kind::Ellipsoid => true,
        };
        // Scaled so that the round part is a ball, whose nearest point in a box is found axis by axis.
        let mut square = 0.0;
        for axis in 0..3 {
            if low[axis] >= self.high[axis] || high[axis] <= self.low[axis] {
                return false;
            }
            if round(axis) {
                let (centre, radius) = ((self.low[axis] + self.high[axis]) / 2.0, (self.high[axis] - self.low[axis]) / 2.0);
                square += ((centre.clamp(low[axis], high[axis]) - centre) / radius).powi(2);
            }
        }
        square < 1.0
    }
}

#[derive(Default)]
struct Assembly(Vec<Part>);

impl Assembly {
    fn add(&mut self, kind: Kind, low: [f64; 3], high: [f64; 3]) {
        self.0.push(Part { kind, low, high, is_cut: false });
    }

    fn cut(&mut self, kind: Kind, low: [f64; 3], high: [f64; 3]) {
        self.0.push(Part { kind, low, high, is_cut: true });
    }

    fn cuboid(&mut self, low: [f64; 3], high: [f64; 3]) {
        self.add(Kind::Cuboid, low, high);
    }

    /// Legs of a square cross-section at the four corners of a rectangle around the origin.
    fn legs(&mut self, half: [f64; 2], thickness: f64, bottom: f64, top: f64) {
        for (sx, sy) in [(-1.0, -1.0), (-1.0, 1.0), (1.0, -1.0), (1.0, 1.0)] {
            let (x, y) = (sx * (half[0] - thickness / 2.0), sy * (half[1] - thickness / 2.0));
            let t = thickness / 2.0;
            self.cuboid([x - t, y - t, bottom], [x + t, y + t, top]);
        }
    }

    /// The voxels that the parts touch, scaled and centred as meshes are.
    fn voxels(&self, dims: Dims) -> Occupancy {
        let solid = || self.0.iter().filter(|p| !p.is_cut);
        let low = [0, 1, 2].map(|a| solid().map(|p| p.low[a]).fold(f64::INFINITY, f64::min));
        let high = [0, 1, 2].map(|a| solid().map(|p| p.high[a]).fold(f64::NEG_INFINITY, f64::max));
        let longest = [0, 1, 2].map(|a| high[a] - low[a]).into_iter().fold(0.0, f64::max);
        let scale = longest_side(dims) as f64 * (1.0 - 1e-6) / longest;
        let sides = <[usize; 3]>::from(dims);
        let place = |voxel: [usize; 3], corner: f64| {
            [0, 1, 2].map(|a| (voxel[a] as f64 + corner - sides[a] as f64 / 2.0) / scale + (low[a] + high[a]) / 2.0)
        };
        Occupancy::from_fn(dims, |i, j, k| {
            let voxel = [i, j, k];
            let (near, far, middle) = (place(voxel, 0.0), place(voxel, 1.0), place(voxel, 0.5));
            self.0.iter().fold(false, |filled, part| match part.is_cut {
                true => filled && !part.touches(middle, middle),
                false => filled || part.touches(near, far),
            })
        })
    }
}

// Lengths below are relative to the longest side, about 1. One voxel of a 30³ grid is 1/24 = 0.042.

fn bathtub(r: &mut Random) -> Assembly {
    let mut a = Assembly::default();
    let (x, z) = (r.within(0.21, 0.29), r.within(0.30, 0.44));
    let (wall, floor) = (r.within(0.03, 0.07), r.within(0.04, 0.12));
    let is_round = r.chance(0.5);
    let outer = if is_round { Kind::Cylinder(2) } else { Kind::Cuboid };
    a.add(outer, [-x, -0.5, 0.0], [x, 0.5, z]);
    let inner = if is_round || r.chance(0.5) { Kind::Cylinder(2) } else { Kind::Cuboid };
    a.cut(inner, [wall - x, wall - 0.5, floor], [x - wall, 0.5 - wall, z + 0.1]);
    if r.chance(0.4) {
        // A tap at one end.
        a.cuboid([-0.03, 0.5 - wall, z - 0.05], [0.03, 0.5, z + 0.06]);
    }
    a
}

fn bed(r: &mut Random) -> Assembly {
    let mut a = Assembly::default();
    let x = r.within(0.30, 0.46);
    let (bottom, frame) = (r.within(0.04, 0.12), r.within(0.08, 0.14));
    let mattress = bottom + frame + r.within(0.07, 0.14);
    a.cuboid([-x, -0.5, bottom], [x, 0.5, bottom + frame]);
    a.cuboid([0.03 - x, -0.48, bottom + frame], [x - 0.03, 0.47, mattress]);
    a.legs([x, 0.5], r.within(0.05, 0.09), 0.0, bottom);
    let head = mattress + r.within(0.08, 0.26);
    a.cuboid([-x, 0.45, 0.0], [x, 0.5, head]);
    if r.chance(0.4) {
        a.cuboid([-x, -0.5, 0.0], [x, -0.46, mattress + r.within(0.0, 0.08)]);
    }
    let pillow = |a: &mut Assembly, from: f64, to: f64| a.add(Kind::Ellipsoid, [from, 0.24, mattress - 0.05], [to, 0.45, mattress + 0.07]);
    if x > 0.36 {
        pillow(&mut a, 0.06 - x, -0.02);
        pillow(&mut a, 0.02, x - 0.06);
    } else {
        pillow(&mut a, 0.08 - x, x - 0.08);
    }
    a
}

fn chair(r: &mut Random) -> Assembly {
    let mut a = Assembly::default();
    let (x, y) = (r.within(0.26, 0.38), r.within(0.26, 0.36));
    let seat = r.within(0.40, 0.48);
    let thickness = r.within(0.05, 0.10);
    a.cuboid([-x, -y, seat], [x, y, seat + thickness]);
    let leg = r.within(0.04, 0.08);
    if r.chance(0.75) {
        a.legs([x, y], leg, 0.0, seat);
    } else {
        // A swivel chair: a column on a cross.
        a.add(Kind::Cylinder(2), [-0.05, -0.05, 0.0], [0.05, 0.05, seat]);
        a.cuboid([-x, -0.03, 0.0], [x, 0.03, 0.06]);
        a.cuboid([-0.03, -y, 0.0], [0.03, y, 0.06]);
    }
    let back = r.within(0.05, 0.09);
    if r.chance(0.6) {
        a.cuboid([-x, y - back, seat], [x, y, 1.0]);
    } else {
        for side in [-x, x - leg] {
            a.cuboid([side, y - back, seat], [side + leg, y, 1.0]);
        }
        a.cuboid([-x, y - back, r.within(0.80, 0.86)], [x, y, 1.0]);
        a.cuboid([-x, y - back, 0.60], [x, y, 0.66]);
    }
    if r.chance(0.35) {
        let arm = seat + r.within(0.18, 0.25);
        for side in [-x, x - leg] {
            a.cuboid([side, -y, arm - 0.05], [side + leg, y, arm]);
            a.cuboid([side, -y, seat], [side + leg, leg - y, arm]);
        }
    }
    a
}

fn desk(r: &mut Random) -> Assembly {
    let mut a = Assembly::default();
    let (x, z) = (r.within(0.22, 0.34), r.within(0.44, 0.58));
    let top = r.within(0.04, 0.07);
    a.cuboid([-x, -0.5, z - top], [x, 0.5, z]);
    let drawers = r.within(0.22, 0.32);
    let panel = 0.06;
    a.cuboid([-x, -0.5, 0.0], [x, drawers - 0.5, z - top]);
    let other = if r.chance(0.55) { drawers } else { panel };
    a.cuboid([-x, 0.5 - other, 0.0], [x, 0.5, z - top]);
    if r.chance(0.7) {
        a.cuboid([x - panel, -0.5, z * r.within(0.1, 0.5)], [x, 0.5, z - top]);
    }
    if r.chance(0.2) {
        // A shelf on the top.
        let shelf = z + r.within(0.12, 0.25);
        a.cuboid([x - 0.15, -0.5, shelf - 0.04], [x, 0.5, shelf]);
        a.cuboid([x - 0.04, -0.5, z], [x, 0.5, shelf]);
    }
    a
}

fn dresser(r: &mut Random) -> Assembly {
    let mut a = Assembly::default();
    let (y, z) = if r.chance(0.65) { (r.within(0.30, 0.44), 1.0) } else { (0.5, r.within(0.66, 0.95)) };
    let x = r.within(0.20, 0.30);
    let foot = r.within(0.03, 0.10);
    let top = r.within(0.04, 0.06);
    let overhang = r.within(0.0, 0.04);
    a.cuboid([overhang - x, overhang - y, foot], [x, y - overhang, z - top]);
    a.cuboid([-x, -y, z - top], [x, y, z]);
    a.legs([x - overhang, y - overhang], r.within(0.06, 0.12), 0.0, foot);
    if r.chance(0.5) {
        a.cuboid([overhang - x + 0.03, overhang - y, 0.0], [x, y - overhang, foot]);
    }
    a
}

fn monitor(r: &mut Random) -> Assembly {
    let mut a = Assembly::default();
    let z = r.within(0.56, 0.68);
    let stand = r.within(0.12, 0.24);
    let depth = r.within(0.05, 0.12);
    a.cuboid([-depth, -0.5, stand], [0.0, 0.5, stand + z]);
    let bulge = r.within(0.03, 0.12);
    a.cuboid([0.0, -0.28, stand + 0.1], [bulge, 0.28, stand + z - 0.1]);
    let neck = r.within(0.05, 0.10);
    a.cuboid([-0.03, -neck, 0.0], [0.05, neck, stand + 0.25]);
    let (base, wide) = (r.within(0.12, 0.20), r.within(0.16, 0.28));
    let kind = if r.chance(0.6) { Kind::Cylinder(2) } else { Kind::Cuboid };
    a.add(kind, [-base, -wide, 0.0], [base, wide, 0.05]);
    a
}

fn night_stand(r: &mut Random) -> Assembly {
    let mut a = Assembly::default();
    let (x, y) = (r.within(0.32, 0.44), r.within(0.40, 0.50));
    let (top, panel) = (r.within(0.04, 0.07), 0.06);
    let foot = r.within(0.04, 0.16);
    a.cuboid([-x, -y, 1.0 - top], [x, y, 1.0]);
    a.legs([x - 0.02, y - 0.02], r.within(0.06, 0.10), 0.0, 1.0 - top);
    let (inside_x, inside_y) = (x - 0.02, y - 0.02);
    a.cuboid([-inside_x, -inside_y, foot], [inside_x, inside_y, 1.0 - top]);
    if r.chance(0.6) {
        // An open compartment at the front, below the drawer.
        let shelf = foot + panel;
        a.cut(Kind::Cuboid, [-x, panel - inside_y, shelf], [inside_x - panel, inside_y - panel, r.within(0.5, 0.68)]);
    }
    a
}

fn sofa(r: &mut Random) -> Assembly {
    let mut a = Assembly::default();
    let (x, z) = (r.within(0.20, 0.28), r.within(0.34, 0.44));
    let foot = r.within(0.02, 0.06);
    let seat = z * r.within(0.46, 0.56);
    let (back, arm) = (r.within(0.10, 0.16), r.within(0.07, 0.13));
    a.cuboid([-x, -0.5, foot], [x, 0.5, seat - 0.05]);
    a.cuboid([0.01 - x, arm - 0.5, seat - 0.05], [x - back, 0.5 - arm, seat]);
    a.cuboid([x - back, arm * 0.5 - 0.5, foot], [x, 0.5 - arm * 0.5, z]);
    let arm_top = seat + r.within(0.05, 0.12);
    let is_round = r.chance(0.4);
    for side in [-0.5, 0.5 - arm] {
        a.cuboid([-x, side, foot], [x, side + arm, arm_top - 0.04]);
        let kind = if is_round { Kind::Cylinder(0) } else { Kind::Cuboid };
        a.add(kind, [-x, side, arm_top - 0.09], [x, side + arm, arm_top]);
    }
    a.legs([x, 0.5], 0.06, 0.0, foot);
    a
}

fn table(r: &mut Random) -> Assembly {
    let mut a = Assembly::default();
    let (x, z) = (r.within(0.26, 0.46), r.within(0.38, 0.62));
    let top = r.within(0.03, 0.06);
    let is_round = r.chance(0.3);
    let x = if is_round && r.chance(0.7) { 0.5 } else { x };
    a.add(if is_round { Kind::Cylinder(2) } else { Kind::Cuboid }, [-x, -0.5, z - top], [x, 0.5, z]);
    if is_round {
        let column = r.within(0.04, 0.08);
        a.add(Kind::Cylinder(2), [-column, -column, 0.0], [column, column, z - top]);
        let foot = r.within(0.5, 0.7);
        a.add(Kind::Cylinder(2), [-x * foot, -0.5 * foot, 0.0], [x * foot, 0.5 * foot, 0.05]);
    } else {
        let inset = r.within(0.0, 0.06);
        a.legs([x - inset, 0.5 - inset], r.within(0.04, 0.08), 0.0, z - top);
        if r.chance(0.4) {
            // The frame below the top.
            let frame = z - top - r.within(0.04, 0.08);
            for side in [-1.0, 1.0] {
                let (sx, sy) = (side * (x - inset - 0.03), side * (0.5 - inset - 0.03));
                a.cuboid([sx - 0.02, inset - 0.5, frame], [sx + 0.02, 0.5 - inset, z - top]);
                a.cuboid([inset - x, sy - 0.02, frame], [x - inset, sy + 0.02, z - top]);
            }
        }
    }
    a
}

fn toilet(r: &mut Random) -> Assembly {
    let mut a = Assembly::default();
    let x = r.within(0.24, 0.30);
    let rim = r.within(0.44, 0.52);
    let tank = r.within(0.20, 0.26);
    let front = -0.48;
    let bowl_back = 0.5 - tank + 0.08;
    // The bowl narrows to its foot.
    a.add(Kind::Ellipsoid, [-x, front, rim - 0.36], [x, bowl_back, rim + 0.28]);
    a.cut(Kind::Cuboid, [-1.0, -1.0, rim], [1.0, 1.0, 2.0]);
    a.cut(Kind::Ellipsoid, [0.07 - x, front + 0.07, rim - 0.20], [x - 0.07, bowl_back - 0.12, rim + 0.20]);
    if r.chance(0.5) {
        // The lid is closed.
        a.add(Kind::Cylinder(2), [-x, front, rim - 0.02], [x, bowl_back, rim + 0.04]);
    } else {
        a.cuboid([0.03 - x, bowl_back - 0.13, rim], [x - 0.03, bowl_back - 0.06, rim + 0.36]);
    }
    let foot = x * r.within(0.62, 0.82);
    a.cuboid([-foot, -0.20, 0.0], [foot, 0.42, rim - 0.18]);
    a.add(Kind::Cylinder(2), [-foot, -0.36, 0.0], [foot, 0.10, rim - 0.22]);
    a.cuboid([-foot, 0.10, rim - 0.20], [foot, 0.5, rim + 0.02]);
    let height = r.within(0.86, 1.0);
    a.cuboid([-x, 0.5 - tank, rim], [x, 0.5, height - 0.05]);
    a.cuboid([-x - 0.01, 0.49 - tank, height - 0.05], [x + 0.01, 0.51, height]);
    a
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pieces_are_as_large_as_shapes_of_a_library_and_centred() {
        for side in [8, 30, 64] {
            let dims = Dims::cube(side).unwrap();
            for class in CLASSES {
                for seed in 0..20 {
                    let object = make(class, dims, seed).unwrap();
                    let filled: Vec<_> = object.bits().ones().map(|v| dims.coordinates(v)).collect();
                    let extent = [0, 1, 2].map(|a| {
                        let of = || filled.iter().map(|v| v[a]);
                        (of().min().unwrap(), of().max().unwrap() + 1)
                    });
                    let longest = extent.iter().map(|(low, high)| high - low).max().unwrap();
                    assert_eq!(longest, longest_side(dims), "{class} {seed} {side}");
                    let off = extent.iter().map(|(low, high)| (low + high).abs_diff(side)).max().unwrap();
                    assert!(off <= 1, "{class} {seed} is off the middle: {extent:?}");
                }
            }
        }
    }

    #[test]
    fn a_seed_gives_one_piece_and_others_differ() {
        let dims = Dims::cube(30).unwrap();
        for class in CLASSES {
            assert_eq!(make(class, dims, 7), make(class, dims, 7));
            assert_ne!(make(class, dims, 7), make(class, dims, 8), "{class}");
        }
        assert_eq!(make("piano", dims, 7), None);
    }

    #[test]
    fn backs_are_where_modelnet_has_them() {
        let dims = Dims::cube(30).unwrap();
        // Mean of one coordinate over the upper half of the piece, relative to the middle.
        let upper = |class, axis: usize| {
            let objects = (0..30).map(|seed| make(class, dims, seed).unwrap());
            let means = objects.map(|o| {
                let filled: Vec<_> = o.bits().ones().map(|v| dims.coordinates(v)).filter(|v| v[2] >= 17).collect();
                filled.iter().map(|v| v[axis] as f64 - 14.5).sum::<f64>() / filled.len() as f64
            });
            means.sum::<f64>() / 30.0
        };
        assert!(upper("chair", 1) > 2.0 && upper("toilet", 1) > 2.0 && upper("bed", 1) > 2.0);
        assert!(upper("sofa", 0) > 1.0);
    }
}
