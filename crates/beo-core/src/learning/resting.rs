//! Resting poses: in which ways a shape comes to rest on a plane, and how probably.
//!
//! A face of the convex hull is stable if the centre of mass projects into it; from any other face the shape topples over an edge to the
//! next. A face is met first with the probability of its solid angle about the centre of mass (Goldberg, Mirtich, Zhuang, Craig, Carlisle
//! and Canny, "Part pose statistics", IEEE Transactions on Robotics and Automation 1999; quasi-static, as drops from low heights).

use super::hull::convex_hull;
use crate::grid::{Occupancy, Rotation, Turn, yaw};
use nalgebra::{Point3, Unit, Vector3};
use std::f64::consts::{FRAC_PI_2, TAU};

/// A stable pose is one of the class's if its direction is within this of one of the six axes, radians.
const REACH: f64 = 40.0 * std::f64::consts::PI / 180.0;
/// Things on tables were put there as they are used as often as they came to rest by themselves.
const PUT: f64 = 0.5;
/// Poses that are less probable are left out.
const LEAST: f64 = 0.08;
/// Poses in which shapes overlap by more, turned in the best way, look alike, and are one.
const ALIKE: f64 = 0.85;
/// Shapes that are compared for that.
const COMPARED: usize = 10;

/// A direction of a shape that points up when it rests, with its probability.
#[derive(Clone, Copy, Debug)]
pub struct Stable {
    /// Unit vector in the shape's axes.
    pub up: Unit<Vector3<f64>>,
    /// Probability.
    pub probability: f64,
}

/// How a shape comes to rest; faces that differ by few degrees apart. Empty where the shape has no volume.
pub fn stable_poses(shape: &Occupancy) -> Vec<Stable> {
    let dims = shape.dims();
    let filled = || shape.bits().ones().map(|voxel| dims.coordinates(voxel).map(|v| v as f64));
    let count = shape.count().max(1) as f64;
    let centre = Point3::from(filled().map(Vector3::from).sum::<Vector3<f64>>() / count);
    let points: Vec<Point3<f64>> = filled().map(Point3::from).collect();
    let Some(hull) = convex_hull(&points) else { return Vec::new() };
    let mut stable: Vec<Stable> = Vec::new();
    for start in 0..hull.faces.len() {
        let angle = solid_angle(&hull.corners(start), &centre);
        let mut at = start;
        // It topples downhill only; a bound for faces that lie in one plane.
        for _ in 0..hull.faces.len() {
            match hull.topples(at, &centre) {
                Some(next) => at = next,
                None => break,
            }
        }
        let up = Unit::new_unchecked(-hull.normals[at].into_inner());
        match stable.iter_mut().find(|other| other.up.angle(&up) < 0.02) {
            Some(other) => other.probability += angle / (2.0 * TAU),
            None => stable.push(Stable { up, probability: angle / (2.0 * TAU) }),
        }
    }
    stable.sort_by(|a, b| b.probability.total_cmp(&a.probability));
    stable
}

/// Solid angle of a triangle (van Oosterom and Strackee 1983).
fn solid_angle(corners: &[Point3<f64>; 3], eye: &Point3<f64>) -> f64 {
    let [a, b, c] = corners.map(|p| (p - eye).try_normalize(1e-12).unwrap_or_default());
    let denominator = 1.0 + a.dot(&b) + b.dot(&c) + c.dot(&a);
    2.0 * a.dot(&b.cross(&c)).abs().atan2(denominator)
}

/// A resting pose of a class.
#[derive(Clone, Debug)]
pub struct Resting {
    /// Object axes to axes with z up, of the class; that of a shape differs by a small tilt.
    pub rotation: Rotation,
    /// Probability among the poses that are kept.
    pub probability: f64,
    /// Of each shape its own rotation, if it rests so.
    pub of: Vec<Option<Rotation>>,
}

/// The rotation that takes one of the six axis directions up: the identity for +z.
fn axis_rotations() -> [Rotation; 6] {
    let (x, y) = (Vector3::x_axis(), Vector3::y_axis());
    let about = |axis: Unit<Vector3<f64>>, turns: f64| Rotation::from_axis_angle(&axis, turns * FRAC_PI_2);
    // Up are +z, −z, +x, −x, +y, −y of the object.
    [about(x, 0.0), about(x, 2.0), about(y, -1.0), about(y, 1.0), about(x, 1.0), about(x, -1.0)]
}

/// The few resting poses that matter for the shapes of a class; the first stands as the shapes do canonically.
pub fn resting_poses(shapes: &[&Occupancy]) -> Vec<Resting> {
    use rayon::prelude::*;
    let axes = axis_rotations();
    let stable: Vec<Vec<Stable>> = shapes.par_iter().map(|shape| stable_poses(shape)).collect();
    let mut poses: Vec<Resting> = axes
        .iter()
        .map(|axis| {
            let (mut probability, mut of) = (0.0, Vec::with_capacity(shapes.len()));
            for shape in &stable {
                let near = |s: &&Stable| (axis * s.up.into_inner()).angle(&Vector3::z()) < REACH;
                probability += shape.iter().filter(near).map(|s| s.probability).sum::<f64>() / shapes.len().max(1) as f64;
                // Its most probable face there: they are sorted.
                of.push(shape.iter().find(near).map(|s| {
                    let up = axis * s.up.into_inner();
                    Rotation::rotation_between(&up, &Vector3::z()).unwrap_or_default() * axis
                }));
            }
            Resting { rotation: *axis, probability, of }
        })
        .collect();
    // Everything may be put as it is used, whatever its hull.
    poses[0].of.iter_mut().for_each(|own| *own = own.or(Some(Rotation::identity())));
    let mut kept: Vec<(usize, Resting)> = Vec::new();
    for (n, pose) in poses.into_iter().enumerate() {
        match kept.iter_mut().find(|(other, _)| look_alike(shapes, &axes[*other], &axes[n])) {
            Some((_, other)) => other.probability += pose.probability,
            None => kept.push((n, pose)),
        }
    }
    let total: f64 = kept.iter().map(|(_, pose)| pose.probability).sum::<f64>().max(1e-9);
    kept.iter_mut().for_each(|(n, pose)| pose.probability = (1.0 - PUT) * pose.probability / total + if *n == 0 { PUT } else { 0.0 });
    kept.retain(|(n, pose)| *n == 0 || pose.probability >= LEAST && pose.of.iter().flatten().count() >= 4);
    let total: f64 = kept.iter().map(|(_, pose)| pose.probability).sum();
    kept.into_iter().map(|(_, pose)| Resting { probability: pose.probability / total, ..pose }).collect()
}

/// Whether shapes that rest in two ways cannot be told apart but by a quarter turn.
fn look_alike(shapes: &[&Occupancy], one: &Rotation, other: &Rotation) -> bool {
    let step = shapes.len().div_ceil(COMPARED).max(1);
    let overlaps: Vec<f64> = shapes
        .iter()
        .step_by(step)
        .map(|shape| {
            let turned = |rotation: &Rotation| Turn::new(shape.dims(), rotation).occupancy(shape);
            let a = turned(one);
            let overlap = |turn: usize| {
                let b = turned(&(yaw(turn as f64 * FRAC_PI_2) * other));
                let both = a.overlap(&b) as f64;
                both / (a.count() as f64 + b.count() as f64 - both).max(1.0)
            };
            (0..4).map(overlap).fold(0.0, f64::max)
        })
        .collect();
    overlaps.iter().sum::<f64>() / overlaps.len().max(1) as f64 > ALIKE
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::Dims;

    fn cuboid(sides: [usize; 3]) -> Occupancy {
        let dims = Dims::cube(30).unwrap();
        let inside = |at: usize, side: usize| at >= 15 - side / 2 && at < 15 - side / 2 + side;
        Occupancy::from_fn(dims, |i, j, k| inside(i, sides[0]) && inside(j, sides[1]) && inside(k, sides[2]))
    }

    /// A cuboid rests on each of its six faces with the probability of the solid angle under which it is seen from the centre; that of a
    /// rectangle 2a × 2b at height h is 4 asin(a b / √((a² + h²)(b² + h²))).
    #[test]
    fn a_cuboid_rests_on_its_faces_by_their_solid_angles() {
        let sides = [20, 12, 6];
        let stable = stable_poses(&cuboid(sides));
        assert_eq!(stable.len(), 6);
        // Voxel centres span one less than the voxels.
        let [a, b, c] = sides.map(|s| (s as f64 - 1.0) / 2.0);
        let share = |a: f64, b: f64, h: f64| (a * b / ((a * a + h * h) * (b * b + h * h)).sqrt()).asin() / std::f64::consts::PI;
        for (axis, expected) in [(0, share(b, c, a)), (1, share(a, c, b)), (2, share(a, b, c))] {
            let along: Vec<_> = stable.iter().filter(|s| s.up[axis].abs() > 0.999).collect();
            assert_eq!(along.len(), 2);
            assert!(along.iter().all(|s| (s.probability - expected).abs() < 1e-6), "{axis}: {along:?} {expected}");
        }
    }

    #[test]
    fn a_box_has_three_resting_poses_and_a_cylinder_two() {
        let shapes = [cuboid([12, 8, 22]), cuboid([14, 6, 20]), cuboid([13, 7, 22]), cuboid([12, 6, 20])];
        let poses = resting_poses(&shapes.iter().collect::<Vec<_>>());
        assert_eq!(poses.len(), 3);
        assert!(poses[0].rotation.angle() < 1e-9 && poses[0].probability > PUT);
        assert!((poses.iter().map(|p| p.probability).sum::<f64>() - 1.0).abs() < 1e-9);
        let dims = Dims::cube(30).unwrap();
        let can = |radius: f64, half: usize| {
            Occupancy::from_fn(dims, |i, j, k| (i as f64 - 14.5).hypot(j as f64 - 14.5) < radius && k.abs_diff(15) < half)
        };
        let cans = [can(6.0, 11), can(7.0, 10), can(5.0, 12), can(6.5, 12)];
        let poses = resting_poses(&cans.iter().collect::<Vec<_>>());
        assert_eq!(poses.len(), 2, "{poses:?}");
        // Lying, the axis is horizontal.
        let axis = poses[1].rotation * Vector3::z();
        assert!(axis.z.abs() < 1e-9 && poses[1].of.iter().all(Option::is_some));
    }

    #[test]
    fn nothing_and_flat_things_have_no_stable_pose_by_their_hull() {
        let dims = Dims::cube(30).unwrap();
        assert!(stable_poses(&Occupancy::empty(dims)).is_empty());
        assert!(stable_poses(&cuboid([10, 10, 1])).is_empty());
        let flat = cuboid([10, 10, 1]);
        assert_eq!(resting_poses(&[&flat, &flat, &flat, &flat]).len(), 1);
    }
}
