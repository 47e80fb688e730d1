//! Rotation errors, raw and symmetry-aware (section IV-B of the paper reports the raw ones).
//!
//! An object that looks the same after a rotation g gives the same queries when turned by r and by r∘g, so an estimate is
//! compared with every r∘g. The rule that finds these g, from the complete object alone:
//!
//! - A rotation *maps the object to itself* when at least 98 % of the object's surface voxels, rotated about the grid's centre,
//!   fall on or next to (26-neighbourhood) a surface voxel of the object; the rules below demand the same of its inverse. This is
//!   the surface overlap at a tolerance (Nikolov et al., JMIR 2021) with one voxel for the tolerance, which is what sampling two
//!   copies of one shape on two grids can differ by. A plain intersection over union depends too much on that sampling: at
//!   angles that are true symmetries it is 0.7 for thin tables, at others it is 0.8 for solid boxes. What makes up less than
//!   2 % of the surface, or is flatter than a voxel, is overlooked.
//! - About one axis, the rotations that map a body to itself are the n multiples of 360°/n, or all. So n is the largest number
//!   up to 12 for which every multiple passes, and all angles are equivalent when every whole degree passes. Angles that pass
//!   only because they are close to one of these (some degrees around 0 always do) are thereby not taken for symmetries.
//! - Without a known vertical, the same for each axis of the grid, combined with the largest group of the 24 rotations of the
//!   cube that pass. A body that is round about two axes is taken for a ball. Symmetries about oblique axes are not looked for:
//!   training shapes stand along the axes of the grid.

use beo_core::grid::{Dims, Occupancy, cube_rotations};
use fixedbitset::FixedBitSet;
use nalgebra::{Unit, UnitQuaternion, Vector3};
use std::f64::consts::{PI, TAU};

/// Share of the surface voxels that must meet the surface again.
const LEAST_OVERLAP: f64 = 0.98;
/// Most rotations about one axis that are told from all of them.
const MOST_TURNS: usize = 12;
/// Rotations closer than this are the same, in radians.
const SAME_RAD: f64 = 1e-6;

/// Angle of the rotation between an estimate and the truth, in radians, from 0 to π.
pub fn rotation_error(estimate: &UnitQuaternion<f64>, truth: &UnitQuaternion<f64>) -> f64 {
    estimate.angle_to(truth)
}

/// Difference of two yaw angles modulo a full turn, in radians, from 0 to π.
pub fn yaw_error(estimate_rad: f64, truth_rad: f64) -> f64 {
    ((estimate_rad - truth_rad + PI).rem_euclid(TAU) - PI).abs()
}

/// The rotations of an object that leave its queries as they are, found by the rule in the description of this module.
#[derive(Clone, Debug)]
pub struct Symmetries {
    /// Always holds the identity.
    rotations: Vec<UnitQuaternion<f64>>,
    round: Round,
}

/// About which axes every angle is a symmetry.
#[derive(Clone, Copy, Debug)]
enum Round {
    None,
    /// Every rotation about this axis, after each of the listed ones.
    Axis(Unit<Vector3<f64>>),
    Ball,
}

impl Symmetries {
    /// Symmetries about the vertical (pose search `yaw`).
    pub fn yaw(object: &Occupancy) -> Self {
        let surface = Surface::of(object);
        let axis = Vector3::z_axis();
        match surface.turns_about(axis) {
            Some(turns) => Self { rotations: multiples(axis, turns), round: Round::None },
            None => Self { rotations: vec![UnitQuaternion::identity()], round: Round::Axis(axis) },
        }
    }

    /// Symmetries among all rotations (pose search `full`).
    pub fn full(object: &Occupancy) -> Self {
        let surface = Surface::of(object);
        let passing: Vec<_> = cube_rotations().into_iter().filter(|r| surface.meets_itself(r)).collect();
        let mut rotations = largest_group(&passing);
        let mut round = Round::None;
        for axis in [Vector3::z_axis(), Vector3::x_axis(), Vector3::y_axis()] {
            match (surface.turns_about(axis), round) {
                (None, Round::None) => round = Round::Axis(axis),
                (None, _) => round = Round::Ball,
                // Turns by quarters are among the rotations of the cube.
                (Some(1 | 2 | 4), _) => {}
                (Some(turns), _) => {
                    let of_cube = rotations.clone();
                    let turns = multiples(axis, turns);
                    turns.iter().for_each(|turn| of_cube.iter().for_each(|rotation| insert(&mut rotations, turn * rotation)));
                }
            }
        }
        Self { rotations, round }
    }

    /// Number of equivalent rotations, the identity included; `None` where there are infinitely many.
    pub fn order(&self) -> Option<usize> {
        matches!(self.round, Round::None).then_some(self.rotations.len())
    }

    /// Symmetry-aware error: the least angle between `estimate` and truth∘g over the symmetries g, in radians, from 0 to π. Both
    /// turn object axes into grid axes.
    pub fn error(&self, estimate: &UnitQuaternion<f64>, truth: &UnitQuaternion<f64>) -> f64 {
        let difference = truth.inverse() * estimate;
        let angle = |g: &UnitQuaternion<f64>| {
            let rest = difference * g.inverse();
            match self.round {
                Round::None => rest.angle(),
                // The nearest rotation about the axis has the twist of `rest`; what is left is its swing.
                Round::Axis(axis) => {
                    let along = rest.imag().dot(&axis);
                    2.0 * (rest.imag() - along * axis.into_inner()).norm().atan2(along.hypot(rest.w))
                }
                Round::Ball => 0.0,
            }
        };
        self.rotations.iter().map(angle).fold(PI, f64::min)
    }
}

/// The surface of an object, and where a surface voxel may fall to meet it.
struct Surface {
    dims: Dims,
    points: Vec<Vector3<f64>>,
    /// Voxels on or next to the surface.
    near: FixedBitSet,
}

impl Surface {
    fn of(object: &Occupancy) -> Self {
        let dims = object.dims();
        let mut near = FixedBitSet::with_capacity(dims.voxels());
        let mut points = Vec::new();
        for voxel in surface(object) {
            points.push(centre(dims, voxel).into());
            let around = |axis: usize, n: usize| voxel[axis].saturating_sub(1)..(voxel[axis] + 2).min(n);
            for i in around(0, dims.x()) {
                for j in around(1, dims.y()) {
                    let k = around(2, dims.z());
                    near.insert_range(dims.index(i, j, k.start)..dims.index(i, j, k.end - 1) + 1);
                }
            }
        }
        Self { dims, points, near }
    }

    /// Whether the rotated surface falls on or next to the surface.
    fn meets_itself(&self, rotation: &UnitQuaternion<f64>) -> bool {
        let matrix = rotation.to_rotation_matrix();
        let sides = <[usize; 3]>::from(self.dims);
        let half = Vector3::from(sides.map(|n| n as f64 / 2.0));
        let mut misses = (self.points.len() as f64 * (1.0 - LEAST_OVERLAP)) as usize + 1;
        for point in &self.points {
            let at = matrix * point + half;
            let inside = (0..3).all(|axis| (0.0..sides[axis] as f64).contains(&at[axis]));
            if !inside || !self.near.contains(self.dims.index(at.x as usize, at.y as usize, at.z as usize)) {
                misses -= 1;
                if misses == 0 {
                    return false;
                }
            }
        }
        true
    }

    /// Number of rotations about an axis that map the surface to itself; `None` when all do.
    fn turns_about(&self, axis: Unit<Vector3<f64>>) -> Option<usize> {
        if (1..360).all(|degrees: u32| self.meets_itself(&about(axis, f64::from(degrees).to_radians()))) {
            return None;
        }
        let all_pass = |turns: &usize| multiples(axis, *turns).iter().skip(1).all(|r| self.meets_itself(r));
        (2..=MOST_TURNS).rev().find(all_pass).or(Some(1))
    }
}

/// Filled voxels of `object` with an empty one, or the grid's border, at one of their six faces.
pub(super) fn surface(object: &Occupancy) -> impl Iterator<Item = [usize; 3]> + '_ {
    let dims = object.dims();
    let is_inside = move |&[i, j, k]: &[usize; 3]| {
        i > 0
            && j > 0
            && k > 0
            && object.is_filled(i - 1, j, k)
            && object.is_filled(i + 1, j, k)
            && object.is_filled(i, j - 1, k)
            && object.is_filled(i, j + 1, k)
            && object.is_filled(i, j, k - 1)
            && object.is_filled(i, j, k + 1)
    };
    object.bits().ones().map(move |index| dims.coordinates(index)).filter(move |voxel| !is_inside(voxel))
}

/// Centre of a voxel in voxels from the grid's centre.
pub(super) fn centre(dims: Dims, voxel: [usize; 3]) -> [f64; 3] {
    let sides = <[usize; 3]>::from(dims);
    std::array::from_fn(|axis| voxel[axis] as f64 + 0.5 - sides[axis] as f64 / 2.0)
}

fn about(axis: Unit<Vector3<f64>>, angle_rad: f64) -> UnitQuaternion<f64> {
    UnitQuaternion::from_axis_angle(&axis, angle_rad)
}

/// The `turns` rotations about an axis by multiples of a full turn / `turns`, the identity first.
fn multiples(axis: Unit<Vector3<f64>>, turns: usize) -> Vec<UnitQuaternion<f64>> {
    (0..turns).map(|k| about(axis, TAU * k as f64 / turns as f64)).collect()
}

/// Adds a rotation unless it is there.
fn insert(rotations: &mut Vec<UnitQuaternion<f64>>, rotation: UnitQuaternion<f64>) {
    if rotations.iter().all(|r| r.angle_to(&rotation) > SAME_RAD) {
        rotations.push(rotation);
    }
}

/// The largest group within a set of rotations of the cube that holds the identity. Every such group has two generators.
fn largest_group(rotations: &[UnitQuaternion<f64>]) -> Vec<UnitQuaternion<f64>> {
    let mut largest = vec![UnitQuaternion::identity()];
    for (a, first) in rotations.iter().enumerate() {
        for second in &rotations[a..] {
            let mut group = vec![UnitQuaternion::identity()];
            let mut grown = 0;
            while grown < group.len() {
                for generator in [first, second] {
                    let product = generator * group[grown];
                    insert(&mut group, product);
                }
                grown += 1;
            }
            let is_within = group.iter().all(|g| rotations.iter().any(|r| r.angle_to(g) < SAME_RAD));
            if is_within && group.len() > largest.len() {
                largest = group;
            }
        }
    }
    largest
}

#[cfg(test)]
mod tests {
    use super::*;
    use beo_shapes::furniture;
    use proptest::prelude::*;
    use std::f64::consts::FRAC_PI_2;

    /// The body of those points (in voxels from the grid's centre) that are `inside`.
    fn body(inside: impl Fn(Vector3<f64>) -> bool) -> Occupancy {
        let dims = Dims::cube(30).unwrap();
        Occupancy::from_fn(dims, |i, j, k| inside(centre(dims, [i, j, k]).into()))
    }

    fn is_table(p: Vector3<f64>, half: [f64; 2]) -> bool {
        let is_top = p.x.abs() < half[0] && p.y.abs() < half[1] && (5.0..8.0).contains(&p.z);
        let is_leg = (half[0] - 2.0..half[0]).contains(&p.x.abs()) && (half[1] - 2.0..half[1]).contains(&p.y.abs()) && p.z.abs() < 8.0;
        is_top || is_leg
    }

    fn cylinder(axis: usize) -> Occupancy {
        body(|p| p[axis].abs() < 10.0 && p.norm_squared() - p[axis].powi(2) < 49.0)
    }

    fn yaw(degrees: f64) -> UnitQuaternion<f64> {
        about(Vector3::z_axis(), degrees.to_radians())
    }

    #[test]
    fn furniture_has_the_turns_that_one_expects() {
        assert_eq!(Symmetries::yaw(&body(|p| is_table(p, [12.0, 12.0]))).order(), Some(4));
        assert_eq!(Symmetries::yaw(&body(|p| is_table(p, [12.0, 8.0]))).order(), Some(2));
        assert_eq!(Symmetries::yaw(&cylinder(2)).order(), None);
        assert_eq!(Symmetries::yaw(&cylinder(0)).order(), Some(2));
        for seed in 0..5 {
            let chair = furniture::make("chair", Dims::cube(30).unwrap(), seed).unwrap();
            assert_eq!(Symmetries::yaw(&chair).order(), Some(1), "seed {seed}");
            assert_eq!(Symmetries::full(&chair).order(), Some(1), "seed {seed}");
        }
    }

    #[test]
    fn turns_are_found_on_grids_that_are_turned_against_the_object() {
        for degrees in [10.0, 27.0, 45.0] {
            let turned = |half: [f64; 2]| body(move |p| is_table(yaw(-degrees) * p, half));
            assert_eq!(Symmetries::yaw(&turned([11.0, 11.0])).order(), Some(4), "{degrees}");
            assert_eq!(Symmetries::yaw(&turned([11.0, 7.0])).order(), Some(2), "{degrees}");
        }
        // A round top on three legs, which no grid shows exactly.
        let stool = body(|p| {
            let on_leg = |degrees: f64| (yaw(degrees) * Vector3::new(9.0, 0.0, p.z) - p).norm() < 2.0;
            (p.xy().norm() < 11.0 && (6.0..9.0).contains(&p.z)) || (p.z.abs() < 8.0 && [90.0, 210.0, 330.0].into_iter().any(on_leg))
        });
        assert_eq!(Symmetries::yaw(&stool).order(), Some(3));
    }

    #[test]
    fn a_dent_deeper_than_a_voxel_is_no_symmetry() {
        let block = |depth: f64| body(move |p| p.amax() < 11.0 && !(p.x > 11.0 - depth && p.y.abs() < 8.0 && p.z.abs() < 8.0));
        assert_eq!(Symmetries::yaw(&block(1.0)).order(), Some(4));
        assert_eq!(Symmetries::yaw(&block(3.0)).order(), Some(1));
    }

    #[test]
    fn bodies_have_their_rotation_groups() {
        let cuboid = |half: [f64; 3]| Symmetries::full(&body(move |p| (0..3).all(|axis| p[axis].abs() < half[axis])));
        assert_eq!(cuboid([10.0; 3]).order(), Some(24));
        assert_eq!(cuboid([10.0, 10.0, 5.0]).order(), Some(8));
        assert_eq!(cuboid([5.0, 10.0, 10.0]).order(), Some(8));
        assert_eq!(cuboid([12.0, 9.0, 5.0]).order(), Some(4));
        assert_eq!(Symmetries::full(&body(|p| is_table(p, [12.0, 12.0]))).order(), Some(4));
        // Six spokes: no rotation of a cube turns one into the next.
        let wheel = body(|p| {
            let on_spoke = |degrees: f64| (yaw(degrees) * p).y.abs() < 1.5;
            p.z.abs() < 2.0 && p.xy().norm() < 13.0 && [0.0, 60.0, 120.0].into_iter().any(on_spoke)
        });
        assert_eq!(Symmetries::yaw(&wheel).order(), Some(6));
        assert_eq!(Symmetries::full(&wheel).order(), Some(12));
        let ball = Symmetries::full(&body(|p| p.norm() < 11.0));
        assert!(ball.order().is_none());
        assert_eq!(ball.error(&UnitQuaternion::from_euler_angles(0.3, 0.7, -2.0), &UnitQuaternion::identity()), 0.0);
    }

    #[test]
    fn a_cylinder_has_only_the_error_of_its_axis() {
        let truth = UnitQuaternion::from_euler_angles(0.4, -0.9, 2.1);
        for (number, axis, across) in [(0, Vector3::x_axis(), Vector3::y_axis()), (2, Vector3::z_axis(), Vector3::x_axis())] {
            let symmetries = Symmetries::full(&cylinder(number));
            for angle in [0.0, 0.3, 1.0, 2.7] {
                let error = |r: UnitQuaternion<f64>| symmetries.error(&(truth * r), &truth);
                assert!(error(about(axis, angle)) < 1e-6);
                let tilt = about(axis, 0.8) * about(across, angle) * about(axis, -1.9);
                // Upside down is as good.
                assert!((error(tilt) - angle.min(PI - angle)).abs() < 1e-6, "tilted by {angle}: {}", error(tilt));
            }
        }
    }

    #[test]
    fn what_is_not_closed_is_no_group() {
        let (x, z) = (about(Vector3::x_axis(), FRAC_PI_2), about(Vector3::z_axis(), FRAC_PI_2));
        let identity = UnitQuaternion::identity();
        assert_eq!(largest_group(&[identity, z]).len(), 1);
        assert_eq!(largest_group(&[identity, z, z * z]).len(), 2);
        assert_eq!(largest_group(&[identity, x, x.inverse(), z, z * z, z.inverse()]).len(), 4);
    }

    #[test]
    fn the_rotations_of_a_cube_are_24_and_closed() {
        let rotations = cube_rotations();
        assert!(rotations[0].angle() < 1e-12);
        let mut distinct = Vec::new();
        for a in &rotations {
            rotations.iter().for_each(|b| insert(&mut distinct, a * b));
        }
        assert_eq!((rotations.len(), distinct.len()), (24, 24));
    }

    #[test]
    fn an_empty_object_and_grids_with_unequal_sides_are_answered() {
        let dims = Dims::new(16, 24, 12).unwrap();
        assert!(Symmetries::full(&Occupancy::empty(dims)).error(&yaw(20.0), &yaw(0.0)).is_finite());
        // A plate that fits into the grid as it stands only.
        let plate = Occupancy::from_fn(dims, |_, _, k| k == 5 || k == 6);
        assert_eq!(Symmetries::full(&plate).order(), Some(4));
    }

    #[test]
    fn yaw_errors_are_modulo_a_full_turn() {
        for (estimate, truth, error) in
            [(359.0, 1.0, 2.0), (10.0, 350.0, 20.0), (-90.0, 270.0, 0.0), (0.0, 180.0, 180.0), (725.0, 0.0, 5.0)]
        {
            let found = yaw_error(f64::to_radians(estimate), f64::to_radians(truth)).to_degrees();
            assert!((found - error).abs() < 1e-9, "{estimate} and {truth}: {found}");
            assert!((rotation_error(&yaw(estimate), &yaw(truth)).to_degrees() - error).abs() < 1e-6);
        }
    }

    proptest! {
        #[test]
        fn the_symmetry_aware_error_is_at_most_the_raw_one(estimate in prop::array::uniform3(-3.0..3.0_f64), truth in prop::array::uniform3(-3.0..3.0_f64), kind in 0..4_usize) {
            let rotation = |angles: [f64; 3]| UnitQuaternion::from_euler_angles(angles[0], angles[1], angles[2]);
            let (estimate, truth) = (rotation(estimate), rotation(truth));
            let object = [cylinder(2), body(|p| is_table(p, [12.0, 12.0])), body(|p| p.amax() < 10.0), body(|p| is_table(p, [12.0, 8.0]) && p.x < 6.0)];
            let symmetries = Symmetries::full(&object[kind]);
            let (error, raw) = (symmetries.error(&estimate, &truth), rotation_error(&estimate, &truth));
            prop_assert!((0.0..=raw + 1e-9).contains(&error), "{error} and {raw}");
            // Equivalent estimates and truths have the same error.
            for g in &symmetries.rotations {
                prop_assert!(symmetries.error(&(truth * g), &truth) < 1e-6);
                prop_assert!((symmetries.error(&(estimate * g), &truth) - error).abs() < 1e-6);
                prop_assert!((symmetries.error(&estimate, &(truth * g)) - error).abs() < 1e-6);
            }
        }
    }
}
