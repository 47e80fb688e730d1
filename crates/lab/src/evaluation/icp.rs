//! The paper's baseline for pose (section IV-B): iterative closest points (Besl & McKay 1992) from the query to the mean of its
//! class.
//!
//! Each iteration finds, for every point of the query, the closest point of the mean by a k-d tree (the query is partial, so the mean's
//! points need no partner), and moves the query by the rigid motion of least squares over these pairs. Translation is free, as usual; only
//! the rotation is reported. With rotations about z only, each step is the best motion of that kind, in closed form, rather than a full
//! one that is projected at the end.
//!
//! Between two voxel lattices closest points are as often behind as ahead, so a single alignment may stall some degrees away from
//! the best one: several starts help near the truth too.

use super::symmetry::{centre, surface};
use beo_core::grid::{Dims, Observation, Occupancy};
use fixedbitset::FixedBitSet;
use kdtree::KdTree;
use kdtree::distance::squared_euclidean;
use nalgebra::{Isometry3, Matrix3, Point3, Rotation3, Translation3, UnitQuaternion, Vector3};

/// Most iterations of one start.
const ITERATIONS: usize = 100;
/// A step that turns by less than this, in radians …
const SMALL_STEP_RAD: f64 = 1e-4;
/// … and moves by less than this, in voxels, is the last.
const SMALL_STEP_VOXELS: f64 = 1e-3;

/// A coordinate beyond this, in voxels, is taken for an error.
const FARTHEST: f64 = 1e6;

/// Which rotations are allowed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Freedom {
    /// About z only.
    Yaw,
    /// All.
    Full,
}

/// The mean of a class as surface points, ready to align queries with.
pub struct Icp {
    points: Vec<Point3<f64>>,
    /// Their indices by place.
    target: KdTree<f64, usize, [f64; 3]>,
}

/// Outcome of an alignment.
#[derive(Clone, Copy, Debug)]
pub struct IcpResult {
    /// Turns object axes into grid axes.
    pub rotation_object_to_grid: UnitQuaternion<f64>,
    /// Root of the mean squared distance between the query's points and their closest points at the last iteration, in voxels;
    /// infinite when there was nothing to align.
    pub rms: f64,
}

impl Icp {
    /// Prepares the surface voxels of `mean`; see [`mean_object`].
    pub fn new(mean: &Occupancy) -> Self {
        let points: Vec<Point3<f64>> = surface(mean).map(|voxel| Point3::from(centre(mean.dims(), voxel))).collect();
        let mut target = KdTree::new(3);
        for (index, point) in points.iter().enumerate() {
            // Only points that are not finite are refused.
            let _ = target.add((*point).into(), index);
        }
        Self { points, target }
    }

    /// Aligns a query with the mean, from each of `starts` (guesses of the object's rotation into the grid), and keeps the
    /// alignment of least mean squared distance; the first of equal ones. One start, the identity, is the plain algorithm.
    ///
    /// `query` holds points in voxels from the grid's centre; points that are not finite, or a million voxels away,
    /// are left out. Without points, without a mean or without a start the answer is the identity.
    pub fn align(&self, query: &[[f64; 3]], freedom: Freedom, starts: &[UnitQuaternion<f64>]) -> IcpResult {
        let mut best = IcpResult { rotation_object_to_grid: UnitQuaternion::identity(), rms: f64::INFINITY };
        let query: Vec<Point3<f64>> = query.iter().filter(|p| p.iter().all(|v| v.abs() < FARTHEST)).map(|p| Point3::from(*p)).collect();
        if query.is_empty() || self.target.size() == 0 {
            return best;
        }
        for start in starts.iter().filter(|start| start.coords.iter().all(|v| v.is_finite())) {
            let (motion, mean_squared) = self.align_from(query.iter().map(|point| start.inverse() * point).collect(), freedom);
            let rms = mean_squared.sqrt();
            if rms < best.rms {
                let rotation = UnitQuaternion::new_normalize((start * motion.rotation.inverse()).into_inner());
                best = IcpResult { rotation_object_to_grid: rotation, rms };
            }
        }
        best
    }

    /// The motion that brings `query` to the mean, and the mean squared distance between pairs at the last iteration.
    fn align_from(&self, mut query: Vec<Point3<f64>>, freedom: Freedom) -> (Isometry3<f64>, f64) {
        let (mut whole, mut mean_squared) = (Isometry3::identity(), f64::INFINITY);
        let mut closest = Vec::with_capacity(query.len());
        for _ in 0..ITERATIONS {
            closest.clear();
            closest.extend(query.iter().map(|point| self.closest(point)));
            mean_squared = query.iter().zip(&closest).map(|(q, m)| (q - m).norm_squared()).sum::<f64>() / query.len() as f64;
            let step = match freedom {
                Freedom::Yaw => yaw_step(&query, &closest),
                Freedom::Full => full_step(&query, &closest),
            };
            query.iter_mut().for_each(|point| *point = step * *point);
            whole = step * whole;
            if step.rotation.angle() < SMALL_STEP_RAD && step.translation.vector.norm() < SMALL_STEP_VOXELS {
                break;
            }
        }
        (whole, mean_squared)
    }

    /// The mean's point next to a finite one; the mean has some.
    fn closest(&self, point: &Point3<f64>) -> Point3<f64> {
        let mut nearest = self.target.iter_nearest(point.coords.as_ref(), &squared_euclidean).into_iter().flatten();
        nearest.next().map_or(*point, |(_, index)| self.points[*index])
    }
}

/// The mean of a class as an object: the voxels that are filled most often, as many as the class's objects fill on average.
///
/// `mean` gives the mean of the voxel at an index, and is clamped to \[0, 1\]. A fixed level of one half would leave little or
/// nothing of classes of thin shapes (tables), whose parts seldom meet.
pub fn mean_object(dims: Dims, mean: impl Fn(usize) -> f32) -> Occupancy {
    let means: Vec<f32> = (0..dims.voxels()).map(|voxel| mean(voxel).clamp(0.0, 1.0)).collect();
    let count = means.iter().map(|m| f64::from(*m)).sum::<f64>().round() as usize;
    let mut order: Vec<usize> = (0..means.len()).collect();
    order.sort_by(|a, b| means[*b].total_cmp(&means[*a]));
    let mut filled = FixedBitSet::with_capacity(dims.voxels());
    order[..count].iter().for_each(|voxel| filled.insert(*voxel));
    Occupancy::from_bits(dims, filled)
}

/// Centres of the voxels known to be filled, in voxels from the grid's centre.
pub fn filled_points(observation: &Observation) -> Vec<[f64; 3]> {
    let dims = observation.dims();
    observation.filled().ones().map(|index| centre(dims, dims.coordinates(index))).collect()
}

/// `count` starts about z, at equal steps over \[0, `span_rad`).
pub fn yaw_starts(count: usize, span_rad: f64) -> Vec<UnitQuaternion<f64>> {
    let angle = |k: usize| span_rad * k as f64 / count as f64;
    (0..count).map(|k| UnitQuaternion::from_axis_angle(&Vector3::z_axis(), angle(k))).collect()
}

/// The rotation about z and the translation that bring each point of `query` closest, in least squares, to that of `mean` with
/// the same index: the planar case of Umeyama (1991) without scale.
fn yaw_step(query: &[Point3<f64>], mean: &[Point3<f64>]) -> Isometry3<f64> {
    motion(query, mean, |covariance| {
        let (sine, cosine) = (covariance.m12 - covariance.m21, covariance.m11 + covariance.m22);
        Rotation3::from_axis_angle(&Vector3::z_axis(), sine.atan2(cosine))
    })
}

/// The same with any rotation: Arun, Huang and Blostein (1987) with Umeyama's sign, so that it is never a reflection.
fn full_step(query: &[Point3<f64>], mean: &[Point3<f64>]) -> Isometry3<f64> {
    motion(query, mean, |covariance| {
        let svd = covariance.svd(true, true);
        let (Some(u), Some(v_t)) = (svd.u, svd.v_t) else { return Rotation3::identity() };
        let sign = (v_t.transpose() * u.transpose()).determinant().signum();
        Rotation3::from_matrix_unchecked(v_t.transpose() * Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, sign)) * u.transpose())
    })
}

/// The rotation that the covariance Σ (q − q̄)(m − m̄)ᵀ gives, about the centroids; the identity where that is no motion.
fn motion(query: &[Point3<f64>], mean: &[Point3<f64>], rotation: impl Fn(Matrix3<f64>) -> Rotation3<f64>) -> Isometry3<f64> {
    let centroid = |points: &[Point3<f64>]| points.iter().map(|point| point.coords).sum::<Vector3<f64>>() / points.len() as f64;
    let (from, to) = (centroid(query), centroid(mean));
    let covariance = query.iter().zip(mean).map(|(q, m)| (q.coords - from) * (m.coords - to).transpose()).sum();
    let rotation = rotation(covariance);
    let motion = Isometry3::from_parts(Translation3::from(to - rotation * from), UnitQuaternion::from_rotation_matrix(&rotation));
    if motion.to_matrix().iter().all(|v| v.is_finite()) { motion } else { Isometry3::identity() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use beo_core::grid::cube_rotations;
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;
    use std::f64::consts::{FRAC_PI_2, PI, TAU};

    /// A cloud of single voxels without symmetry, and their centres. (On the lattice of a flat body the closest points of a
    /// slightly turned copy are as often behind as ahead, and the iteration stalls some degrees away.)
    fn cloud() -> (Occupancy, Vec<[f64; 3]>) {
        let mut rng = ChaCha8Rng::seed_from_u64(3);
        let mut object = Occupancy::empty(Dims::cube(30).unwrap());
        (0..100).for_each(|_| object.fill(rng.random_range(5..25), rng.random_range(5..25), rng.random_range(8..22)));
        let points = filled_points(&Observation::complete(&object));
        (object, points)
    }

    fn turned(points: &[[f64; 3]], rotation: &UnitQuaternion<f64>, shift: [f64; 3]) -> Vec<[f64; 3]> {
        points.iter().map(|p| (rotation * Point3::from(*p) + Vector3::from(shift)).into()).collect()
    }

    fn identity() -> [UnitQuaternion<f64>; 1] {
        [UnitQuaternion::identity()]
    }

    fn yaw(degrees: f64) -> UnitQuaternion<f64> {
        UnitQuaternion::from_axis_angle(&Vector3::z_axis(), degrees.to_radians())
    }

    /// Horn (1987): the rotation of least squares is the unit quaternion that is the eigenvector of the largest eigenvalue of a
    /// symmetric matrix of the covariance.
    fn by_horn(query: &[Point3<f64>], mean: &[Point3<f64>]) -> UnitQuaternion<f64> {
        let centroid = |points: &[Point3<f64>]| points.iter().map(|point| point.coords).sum::<Vector3<f64>>() / points.len() as f64;
        let (from, to) = (centroid(query), centroid(mean));
        let s: Matrix3<f64> = query.iter().zip(mean).map(|(q, m)| (q.coords - from) * (m.coords - to).transpose()).sum();
        #[rustfmt::skip]
        let n = nalgebra::Matrix4::new(
            s.m11 + s.m22 + s.m33, s.m23 - s.m32, s.m31 - s.m13, s.m12 - s.m21,
            s.m23 - s.m32, s.m11 - s.m22 - s.m33, s.m12 + s.m21, s.m31 + s.m13,
            s.m31 - s.m13, s.m12 + s.m21, s.m22 - s.m11 - s.m33, s.m23 + s.m32,
            s.m12 - s.m21, s.m31 + s.m13, s.m23 + s.m32, s.m33 - s.m11 - s.m22,
        );
        let eigen = n.symmetric_eigen();
        let [w, x, y, z] = eigen.eigenvectors.column(eigen.eigenvalues.imax()).into_owned().into();
        UnitQuaternion::from_quaternion(nalgebra::Quaternion::new(w, x, y, z))
    }

    #[test]
    fn the_step_of_any_rotation_is_horns_of_noisy_flat_and_mirrored_pairs() {
        let mut rng = ChaCha8Rng::seed_from_u64(9);
        let mut point = |spread: [f64; 3]| Point3::from(spread.map(|side| side * (2.0 * rng.random::<f64>() - 1.0)));
        let planted = Isometry3::from_parts(Translation3::new(3.0, -2.0, 0.5), UnitQuaternion::from_euler_angles(1.1, -0.4, 2.2));
        for (spread, noise, mirror) in
            [([5.0; 3], 0.0, 1.0), ([5.0; 3], 1.0, 1.0), ([5.0, 4.0, 0.0], 0.1, 1.0), ([5.0, 4.0, 1.0], 0.1, -1.0)]
        {
            let query: Vec<Point3<f64>> = (0..40).map(|_| point(spread)).collect();
            let moved = |q: &Point3<f64>| planted * Point3::new(q.x, q.y, mirror * q.z);
            let mean: Vec<Point3<f64>> = query.iter().map(|q| moved(q) + point([noise; 3]).coords).collect();
            let step = full_step(&query, &mean);
            assert!(step.rotation.angle_to(&by_horn(&query, &mean)) < 1e-9, "{spread:?} {noise} {mirror}");
            if noise == 0.0 {
                assert!(
                    step.rotation.angle_to(&planted.rotation) < 1e-9
                        && (step.translation.vector - planted.translation.vector).norm() < 1e-9
                );
            }
        }
    }

    #[test]
    fn the_step_about_z_leaves_less_error_than_any_other_angle() {
        let mut rng = ChaCha8Rng::seed_from_u64(10);
        let mut point = || Point3::from([5.0, 4.0, 3.0].map(|side| side * (2.0 * rng.random::<f64>() - 1.0)));
        let (query, mean): (Vec<_>, Vec<_>) = (0..30).map(|_| (point(), point())).unzip();
        let error = |motion: &Isometry3<f64>| query.iter().zip(&mean).map(|(q, m)| (motion * q - m).norm_squared()).sum::<f64>();
        let best = yaw_step(&query, &mean);
        for degree in 0..360 {
            let other = motion(&query, &mean, |_| Rotation3::from_axis_angle(&Vector3::z_axis(), f64::from(degree).to_radians()));
            assert!(error(&best) <= error(&other) + 1e-9, "{degree}°");
        }
    }

    #[test]
    fn a_small_rotation_is_recovered_from_one_start() {
        let (object, points) = cloud();
        let icp = Icp::new(&object);
        let oblique = UnitQuaternion::from_euler_angles(0.1, -0.08, 0.12);
        for (freedom, truth) in [(Freedom::Yaw, yaw(12.0)), (Freedom::Yaw, yaw(-9.0)), (Freedom::Full, oblique)] {
            let result = icp.align(&turned(&points, &truth, [0.4, -0.3, 0.2]), freedom, &identity());
            assert!(result.rotation_object_to_grid.angle_to(&truth) < 1e-3, "{freedom:?}: {result:?}, {truth:?}");
            assert!(result.rms < 0.01, "{result:?}");
        }
    }

    #[test]
    fn several_starts_recover_a_large_rotation() {
        let (object, points) = cloud();
        let icp = Icp::new(&object);
        let oblique = UnitQuaternion::from_euler_angles(FRAC_PI_2, 0.1, -0.12);
        let cases = [(Freedom::Yaw, yaw(160.0), yaw_starts(12, TAU)), (Freedom::Full, oblique, cube_rotations())];
        for (freedom, truth, starts) in cases {
            let query = turned(&points, &truth, [0.0; 3]);
            let (one, several) = (icp.align(&query, freedom, &identity()), icp.align(&query, freedom, &starts));
            assert!(one.rotation_object_to_grid.angle_to(&truth) > 0.5, "{freedom:?}: a single start is not expected to do");
            assert!(several.rotation_object_to_grid.angle_to(&truth) < 1e-3, "{freedom:?}: {several:?}, {truth:?}");
            assert!(several.rms < one.rms);
        }
    }

    #[test]
    fn with_yaw_the_rotation_is_about_z_whatever_the_query() {
        let (object, points) = cloud();
        let tilted = turned(&points, &UnitQuaternion::from_euler_angles(0.3, 0.2, 0.1), [1.0, 0.0, -2.0]);
        let rotation = Icp::new(&object).align(&tilted, Freedom::Yaw, &yaw_starts(4, PI)).rotation_object_to_grid;
        assert!(rotation.i.abs() < 1e-9 && rotation.j.abs() < 1e-9, "{rotation:?}");
    }

    #[test]
    fn degenerate_input_gives_a_rotation() {
        let (object, points) = cloud();
        let (icp, nothing) = (Icp::new(&object), Icp::new(&Occupancy::empty(object.dims())));
        let not_a_rotation = UnitQuaternion::new_unchecked(nalgebra::Quaternion::from([f64::NAN; 4]));
        let starts = [not_a_rotation, UnitQuaternion::identity(), yaw(90.0)];
        for freedom in [Freedom::Yaw, Freedom::Full] {
            for query in [&[][..], &[[f64::NAN; 3]], &[[f64::INFINITY, 0.0, 0.0], [1e300; 3]]] {
                let result = icp.align(query, freedom, &starts);
                assert_eq!((result.rotation_object_to_grid, result.rms), (UnitQuaternion::identity(), f64::INFINITY));
            }
            for result in [nothing.align(&points, freedom, &starts), icp.align(&points, freedom, &[])] {
                assert_eq!((result.rotation_object_to_grid, result.rms), (UnitQuaternion::identity(), f64::INFINITY));
            }
            let line: Vec<[f64; 3]> = (0..9).map(|x| [f64::from(x), 0.0, 0.0]).collect();
            for query in [&[[0.0; 3]][..], &[[3.0, 2.0, 1.0]; 4], &[[1.0; 3], [2.0; 3]], &line, &[[9e5, -9e5, 9e5], [0.0; 3]]] {
                let result = icp.align(query, freedom, &starts);
                assert!(result.rms.is_finite() && (result.rotation_object_to_grid.norm() - 1.0).abs() < 1e-9, "{query:?}: {result:?}");
            }
        }
    }

    #[test]
    fn the_mean_object_has_the_mean_number_of_filled_voxels() {
        let dims = Dims::cube(8).unwrap();
        // Never one half, as for a thin part that stands elsewhere in each object.
        let mean = |voxel: usize| if voxel < 40 { 0.3 } else { -0.2 };
        let object = mean_object(dims, mean);
        assert_eq!(object.count(), 12);
        assert!(object.bits().ones().all(|voxel| voxel < 40));
        assert_eq!(mean_object(dims, |_| 2.0).count(), dims.voxels());
        assert_eq!(mean_object(dims, |_| 0.0).count(), 0);
    }
}
