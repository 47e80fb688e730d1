//! The plane that objects stand on, found in the frame itself, and what is up.
//!
//! RANSAC (Fischler and Bolles, 1981) over triples from a fixed low-discrepancy sequence, so that the same frame gives the same plane,
//! then least squares over what lies near it, weighted by how exact each reading is: what is far away, where readings scatter by
//! centimetres, does not tilt it.

use crate::{Frame, Segments, SensorModel};
use nalgebra::{Matrix3, Point3, SymmetricEigen, Unit, Vector3};

/// A plane in the camera frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Plane {
    normal: Unit<Vector3<f64>>,
    offset: f64,
}

impl Plane {
    /// The plane through `point` with `normal`, which points to the side where objects are.
    pub fn new(normal: Unit<Vector3<f64>>, point: &Point3<f64>) -> Self {
        Self { normal, offset: -normal.dot(&point.coords) }
    }

    /// Unit normal: up, for a support plane.
    pub fn normal(&self) -> Unit<Vector3<f64>> {
        self.normal
    }

    /// Height of the origin, metres: of a support plane, how far the camera is above it.
    pub fn offset(&self) -> f64 {
        self.offset
    }

    /// Signed distance of a point, metres; positive on the side of the normal.
    #[inline]
    pub fn height(&self, point: &Point3<f64>) -> f64 {
        self.normal.dot(&point.coords) + self.offset
    }

    /// The plane moved along its normal by `distance` metres.
    pub fn raised(self, distance: f64) -> Self {
        Self { offset: self.offset - distance, ..self }
    }
}

/// How to look for the support plane.
#[derive(Clone, Copy, Debug)]
pub struct PlaneSearch {
    /// Pixels with this label are the plane's; `None`: those that belong to no object (label 0).
    pub label: Option<u16>,
    /// Direction of up in the camera frame, if known: the plane's normal is within 15° of it. Else the camera is taken to be upright,
    /// rolled by less than 30°, and to look down on the plane.
    pub up: Option<Unit<Vector3<f64>>>,
    /// How far readings may be from the plane.
    pub sensor: SensorModel,
}

/// Points that are looked at, at most.
const MOST_POINTS: usize = 4000;
/// Triples that are tried.
const TRIPLES: u32 = 600;
/// Share of the points that must lie near the plane, and their least number.
const LEAST_SHARE: f64 = 0.15;
const LEAST_POINTS: usize = 60;
/// A reading this near is the plane's, metres; or three standard deviations, …
const NEAR: f64 = 0.004;
/// … but never one farther from it, metres, however noisy the sensor.
const FARTHEST: f64 = 0.03;

/// The plane with the most readings of the frame; `None` where there is none that objects could stand on.
pub fn fit_support(frame: &Frame<'_>, search: &PlaneSearch) -> Option<Plane> {
    fit_support_in(frame, &Segments::new(frame), search)
}

/// As [`fit_support`], where the frame's segments are at hand.
pub fn fit_support_in(frame: &Frame<'_>, segments: &Segments, search: &PlaneSearch) -> Option<Plane> {
    let pixels = segments.pixels(search.label.unwrap_or(0));
    let readings = Readings::new(frame, pixels, &search.sensor);
    if readings.count() < LEAST_POINTS {
        return None;
    }
    // Fractional parts of multiples of these are spread evenly over a cube (the R₃ sequence: powers of the root of x⁴ = x + 1).
    const STEPS: [f64; 3] = [0.819_172_513_396_164_4, 0.671_043_606_703_789_2, 0.549_700_477_901_97];
    let pick = |i: u32, axis: usize| readings.point(((f64::from(i) + 1.0) * STEPS[axis]).fract());
    let mut best: Option<(usize, Plane)> = None;
    for i in 0..TRIPLES {
        let Some(plane) = through([pick(i, 0), pick(i, 1), pick(i, 2)]).filter(|plane| search.allows(plane)) else { continue };
        if let Some(near) = readings.more_near(&plane, best.map(|(near, _)| near)) {
            best = Some((near, plane));
        }
    }
    let mut plane = best?.1;
    for _ in 0..4 {
        plane = least_squares(&readings.near(&plane))?;
    }
    let near = readings.near(&plane).len();
    let enough = near >= LEAST_POINTS && near as f64 >= LEAST_SHARE * readings.count() as f64;
    (enough && search.allows(&plane)).then_some(plane)
}

/// The points to which the plane is fitted, with the distance at which each counts as near, coordinate by coordinate for the sake of vectors.
struct Readings {
    x: Vec<f64>,
    y: Vec<f64>,
    z: Vec<f64>,
    reach: Vec<f64>,
    /// 1 / σ².
    weight: Vec<f64>,
}

impl Readings {
    /// Readings that are counted between two looks at whether the plane can still win.
    const BLOCK: usize = 500;

    fn new(frame: &Frame<'_>, pixels: &[u32], sensor: &SensorModel) -> Self {
        let stride = pixels.len().div_ceil(MOST_POINTS).max(1);
        let empty = || Vec::with_capacity(MOST_POINTS);
        let mut readings = Self { x: empty(), y: empty(), z: empty(), reach: empty(), weight: empty() };
        for point in pixels.iter().step_by(stride).filter_map(|pixel| frame.point(*pixel as usize)) {
            readings.x.push(point.x);
            readings.y.push(point.y);
            readings.z.push(point.z);
            let deviation = sensor.deviation(point.z).max(NEAR / 3.0);
            readings.reach.push((3.0 * deviation).clamp(NEAR, FARTHEST));
            readings.weight.push(deviation.powi(-2));
        }
        readings
    }

    fn count(&self) -> usize {
        self.x.len()
    }

    /// The one at this share of their number.
    fn point(&self, share: f64) -> Point3<f64> {
        let i = (share * self.count() as f64) as usize;
        Point3::new(self.x[i], self.y[i], self.z[i])
    }

    /// How many lie near the plane, if more than `most`.
    fn more_near(&self, plane: &Plane, most: Option<usize>) -> Option<usize> {
        let mut near = 0;
        for start in (0..self.count()).step_by(Self::BLOCK) {
            let end = self.count().min(start + Self::BLOCK);
            near += (start..end).filter(|i| self.is_near(plane, *i)).count();
            if most.is_some_and(|most| near + self.count() - end <= most) {
                return None;
            }
        }
        Some(near)
    }

    #[inline]
    fn is_near(&self, plane: &Plane, i: usize) -> bool {
        plane.height(&Point3::new(self.x[i], self.y[i], self.z[i])).abs() < self.reach[i]
    }

    /// Those near the plane, with their weights.
    fn near(&self, plane: &Plane) -> Vec<(Point3<f64>, f64)> {
        let near = (0..self.count()).filter(|i| self.is_near(plane, *i));
        near.map(|i| (Point3::new(self.x[i], self.y[i], self.z[i]), self.weight[i])).collect()
    }
}

impl PlaneSearch {
    fn allows(&self, plane: &Plane) -> bool {
        let normal = plane.normal();
        match self.up {
            Some(up) => normal.dot(&up) >= 15_f64.to_radians().cos(),
            // Upright and looking down: up is −y and −z of the camera, mixed, and little of x.
            None => normal.x.abs() <= 0.5 && normal.y <= 0.26 && normal.z <= 0.26,
        }
    }
}

/// The plane through three points, its normal towards the camera; `None` if they are nearly on a line.
fn through([a, b, c]: [Point3<f64>; 3]) -> Option<Plane> {
    let normal = Unit::try_new((b - a).cross(&(c - a)), 1e-6)?;
    Some(towards_camera(normal, &a))
}

fn towards_camera(normal: Unit<Vector3<f64>>, point: &Point3<f64>) -> Plane {
    let plane = Plane::new(normal, point);
    if plane.height(&Point3::origin()) < 0.0 { Plane::new(-normal, point) } else { plane }
}

/// The plane with the least weighted squared distances.
fn least_squares(points: &[(Point3<f64>, f64)]) -> Option<Plane> {
    if points.len() < 3 {
        return None;
    }
    let weight: f64 = points.iter().map(|(_, weight)| weight).sum();
    let mean = points.iter().fold(Vector3::zeros(), |sum, (p, weight)| sum + p.coords * *weight) / weight;
    let scatter = points.iter().fold(Matrix3::zeros(), |sum, (p, weight)| {
        let d = p.coords - mean;
        sum + d * d.transpose() * *weight
    });
    // Points beyond all measure have no scatter; without a limit, the iteration would not end on what is not a number.
    let eigen = SymmetricEigen::try_new(scatter, f64::EPSILON, 100)?;
    let least = eigen.eigenvalues.imin();
    let normal = Unit::try_new(eigen.eigenvectors.column(least).into_owned(), 1e-12)?;
    Some(towards_camera(normal, &Point3::from(mean)))
}

/// Direction of up in the camera frame, by gravity (the direction in which things fall) or by the plane that things stand on.
pub fn up_axis(gravity: Option<Vector3<f64>>, support: Option<&Plane>) -> Option<Unit<Vector3<f64>>> {
    match gravity {
        Some(gravity) => Unit::try_new(-gravity, 1e-9).filter(|up| up.iter().all(|value| value.is_finite())),
        None => support.map(Plane::normal),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Intrinsics;

    /// A camera 0.6 m above a table, pitched down by 40°, with readings that are off by up to 2 mm, and a wall behind the table.
    #[test]
    fn the_table_is_found_among_noise_and_a_wall() {
        let camera = Intrinsics::new(160, 120, [131.0, 131.0], [79.5, 59.5], [0.0; 5]).unwrap();
        let (sin, cos) = 40_f64.to_radians().sin_cos();
        let up = Unit::new_normalize(Vector3::new(0.0, -cos, -sin));
        let table = Plane::new(up, &Point3::from(-up.into_inner() * 0.6));
        let wall = Plane::new(Unit::new_normalize(Vector3::new(0.0, sin, -cos)), &Point3::from(Vector3::new(0.0, -sin, cos) * 1.1));
        let labels = vec![0; 160 * 120];
        let depth: Vec<f32> = (0..160 * 120)
            .map(|pixel| {
                let ray = camera.ray([f64::from(pixel % 160), f64::from(pixel / 160)]);
                let to = |plane: &Plane| -plane.height(&Point3::origin()) / plane.normal().dot(&ray);
                let nearest = [to(&table), to(&wall)].into_iter().filter(|z| *z > 0.0).fold(f64::INFINITY, f64::min);
                (nearest + 0.002 * (f64::from(pixel * 7919 % 101) / 50.0 - 1.0)) as f32
            })
            .collect();
        let frame = Frame::new(&camera, &depth, &labels).unwrap();
        let mut search = PlaneSearch { label: None, up: None, sensor: SensorModel::default() };
        let found = fit_support(&frame, &search).unwrap();
        assert!(found.normal().angle(&up) < 0.3_f64.to_radians(), "{}", found.normal().angle(&up).to_degrees());
        assert!((found.height(&Point3::origin()) - 0.6).abs() < 0.002);
        // Told that up is along the wall's normal, it is the wall that is found.
        search.up = Some(wall.normal());
        assert!(fit_support(&frame, &search).unwrap().normal().angle(&wall.normal()) < 1_f64.to_radians());
        search.label = Some(9);
        assert_eq!(fit_support(&frame, &search), None);
    }

    /// A table that ends at 1.2 m and, where it would go on, a floor-like background that rises from it by up to 40 cm at 9 m: most of the readings.
    #[test]
    fn what_is_far_away_does_not_tilt_the_table() {
        let camera = Intrinsics::new(160, 120, [131.0, 131.0], [79.5, 59.5], [0.0; 5]).unwrap();
        let (sin, cos) = 22_f64.to_radians().sin_cos();
        let up = Unit::new_normalize(Vector3::new(0.0, -cos, -sin));
        let table = Plane::new(up, &Point3::from(-up.into_inner() * 0.4));
        let depth: Vec<f32> = (0..160 * 120_u32)
            .map(|pixel| {
                let ray = camera.ray([f64::from(pixel % 160), f64::from(pixel / 160)]);
                let to = |height: f64| -(table.height(&Point3::origin()) - height) / up.dot(&ray);
                let z = to(0.0);
                let far = to(0.045 * (z - 1.2)).clamp(0.0, 9.0);
                if (0.0..1.2).contains(&z) { z as f32 } else { far as f32 }
            })
            .collect();
        let frame = Frame::new(&camera, &depth, &[0; 160 * 120]).unwrap();
        let found = fit_support(&frame, &PlaneSearch { label: None, up: None, sensor: SensorModel::default() }).unwrap();
        assert!(found.normal().angle(&up) < 0.5_f64.to_radians(), "{}", found.normal().angle(&up).to_degrees());
    }

    #[test]
    fn a_plane_that_cannot_win_is_given_up_and_no_other() {
        // 1700 points of which every third lies on the plane z = 1, those at the end more often than those at the start.
        let on = |i: usize| i.is_multiple_of(3) || i > 1200;
        let z: Vec<f64> = (0..1700).map(|i| if on(i) { 1.0 } else { 1.5 }).collect();
        let readings = Readings { x: vec![0.1; 1700], y: vec![0.2; 1700], z, reach: vec![0.01; 1700], weight: vec![1.0; 1700] };
        let plane = Plane::new(-Vector3::z_axis(), &Point3::new(0.0, 0.0, 1.0));
        let count = (0..1700).filter(|i| on(*i)).count();
        assert_eq!(readings.near(&plane).len(), count);
        assert_eq!(readings.more_near(&plane, None), Some(count));
        for most in 0..1700 {
            assert_eq!(readings.more_near(&plane, Some(most)), (count > most).then_some(count), "{most}");
        }
    }
}
