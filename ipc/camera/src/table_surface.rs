//! A table as the sensor sees it: bent, and with an outline.
//!
//! Cameras of structured light and stereo bend planes by up to a centimetre over a frame. The bend is a cubic polynomial over the plane,
//! fitted by least squares to what lies near the plane, in rounds without outliers: it follows the sensor's bend and not what is as small
//! as a plate. The outline is the convex hull of those readings.

use crate::own_readings::percentile;
use crate::plan_view::{PlanView, Sides, convex_hull};
use crate::rays::Rays;
use crate::support::Plane;
use nalgebra::{SMatrix, SVector, Vector2, Vector3};

/// Terms of a polynomial of degree 3 in two variables.
const TERMS: usize = 10;
type Polynomial = SVector<f64, TERMS>;

/// How far the sensor may bend a plane, metres.
const MOST_BENT_M: f64 = 0.015;
/// Rounds of least squares.
const ROUNDS: usize = 5;
/// Readings are the table's within so many deviations, but never less than this, metres.
const NEAR_DEVIATIONS: f64 = 2.5;
const NEAR_LEAST_M: f64 = 0.004;
/// Readings that are looked at, at most, about.
const MOST_READINGS: usize = 6000;
/// Fewest readings that a bend is fitted to.
const LEAST_READINGS: usize = 200;
/// Against bends where there are no readings: weight of 0 for each term but the first, in readings at the edge of what is seen.
const STIFFNESS: f64 = 5.0;

/// A table.
pub struct TableSurface {
    normal: Vector3<f32>,
    offset: f32,
    view: PlanView,
    middle: Vector2<f32>,
    scale: f32,
    bend: [f32; TERMS],
    outline: Sides,
    /// Scatter of the table's readings about the bent surface, metres: one standard deviation.
    pub deviation_m: f32,
}

impl TableSurface {
    /// Of the readings of a frame, where they lie near a plane that was found.
    pub fn new(rays: &Rays, depth: &[f32], plane: &Plane) -> Self {
        let normal: Vector3<f32> = plane.normal().into_inner().cast();
        let offset = plane.offset() as f32;
        let view = PlanView::of(&normal);
        let stride = ((depth.len() as f64 / MOST_READINGS as f64).sqrt() as usize).max(1);
        let (width, height) = (rays.width(), rays.height());
        let pixels = (0..height).step_by(stride).flat_map(|v| (0..width).step_by(stride).map(move |u| v * width + u));
        let points = pixels.filter(|pixel| depth[*pixel] > 0.0).map(|pixel| rays.point(pixel, depth[pixel]));
        let near: Vec<(Vector2<f32>, f64)> =
            points.map(|p| (view.see(&p), f64::from(normal.dot(&p) + offset))).filter(|(_, h)| h.abs() < MOST_BENT_M).collect();
        let middle = near.iter().map(|(at, _)| at).sum::<Vector2<f32>>() / near.len().max(1) as f32;
        let scale = near.iter().map(|(at, _)| (at - middle).amax()).fold(0.05, f32::max);
        let mut table = Self { normal, offset, view, middle, scale, bend: [0.0; TERMS], outline: Sides::default(), deviation_m: 0.0 };
        let rows: Vec<(Polynomial, f64, Vector2<f32>)> = near.into_iter().map(|(at, h)| (table.terms(&at).map(f64::from), h, at)).collect();
        let mut bend = Polynomial::zeros();
        let mut reach = MOST_BENT_M;
        for _ in 0..ROUNDS {
            let inner: Vec<&(Polynomial, f64, Vector2<f32>)> =
                rows.iter().filter(|(row, h, _)| (h - row.dot(&bend)).abs() < reach).collect();
            let off: Vec<f32> = inner.iter().map(|(row, h, _)| (h - row.dot(&bend)).abs() as f32).collect();
            table.deviation_m = 1.4826 * percentile(&off, 0.5);
            if inner.len() < LEAST_READINGS {
                break;
            }
            let (mut matrix, mut right) = (SMatrix::<f64, TERMS, TERMS>::zeros(), Polynomial::zeros());
            for (row, h, _) in &inner {
                matrix.ger(1.0, row, row, 1.0);
                right.axpy(*h, row, 1.0);
            }
            (1..TERMS).for_each(|term| matrix[(term, term)] += STIFFNESS);
            let Some(solved) = matrix.cholesky().map(|c| c.solve(&right)) else { break };
            bend = solved;
            let off: Vec<f32> = inner.iter().map(|(row, h, _)| (h - row.dot(&bend)).abs() as f32).collect();
            table.deviation_m = 1.4826 * percentile(&off, 0.5);
            reach = (NEAR_DEVIATIONS * f64::from(table.deviation_m)).clamp(NEAR_LEAST_M, MOST_BENT_M);
        }
        table.bend = std::array::from_fn(|term| bend[term] as f32);
        let own = rows.iter().filter(|(row, h, _)| (h - row.dot(&bend)).abs() < reach).map(|(.., at)| *at);
        table.outline = Sides::of(&convex_hull(own.collect()));
        table
    }

    fn terms(&self, at: &Vector2<f32>) -> SVector<f32, TERMS> {
        let [x, y]: [f32; 2] = ((at - self.middle) / self.scale).into();
        SVector::from([1.0, x, y, x * x, x * y, y * y, x * x * x, x * x * y, x * y * y, y * y * y])
    }

    /// Heights of the readings of a row of pixels that look in the directions (x, y, 1), metres; 0 where there is no reading.
    pub fn heights_of_row(&self, [x, y, z]: [&[f32]; 3], heights: &mut [f32]) {
        let ([across, along], n) = (self.view.axes(), &self.normal);
        for (((x, y), z), height) in x.iter().zip(y).zip(z).zip(heights) {
            let component = |axis: &Vector3<f32>| (axis.x * x + axis.y * y + axis.z) * z;
            let own = self.height_at(component(n) + self.offset, &Vector2::new(component(across), component(along)));
            *height = if *z > 0.0 { own } else { 0.0 };
        }
    }

    /// The height of what is `above` the plane at a place on it.
    #[inline]
    fn height_at(&self, above: f32, place: &Vector2<f32>) -> f32 {
        // Beyond its outline, a cubic would run away.
        let at = (place - self.middle) / self.scale;
        let [x, y]: [f32; 2] = [at.x.clamp(-1.0, 1.0), at.y.clamp(-1.0, 1.0)];
        let b = &self.bend;
        let bend = b[0] + x * (b[1] + x * (b[3] + x * b[6] + y * b[7]) + y * b[4]) + y * (b[2] + y * (b[5] + x * b[8] + y * b[9]));
        above - bend.clamp(-MOST_BENT_M as f32, MOST_BENT_M as f32)
    }

    /// Where a point is on the table, seen along its normal.
    #[inline]
    pub fn see(&self, point: &Vector3<f32>) -> Vector2<f32> {
        self.view.see(point)
    }

    /// How far a point lies inside of the outline, metres, seen along the normal; negative outside.
    pub fn inside_by(&self, point: &Vector3<f32>) -> f32 {
        self.outline.inside_by(&self.view.see(point))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Intrinsics;
    use nalgebra::{Point3, Unit};

    #[test]
    fn a_bent_table_is_level_and_what_stands_on_it_has_its_height() {
        let camera = Intrinsics::new(160, 120, [150.0; 2], [79.5, 59.5], [0.0; 5]).unwrap();
        let rays = Rays::new(&camera);
        // 1 m below a camera that looks straight down, bent by up to 10 mm at the corners; a block of 5 cm on it.
        let is_block = |pixel: usize| (60..80).contains(&(pixel % 160)) && (40..60).contains(&(pixel / 160));
        let bend = |pixel: usize| 0.014 * (((pixel % 160) as f32 / 80.0 - 1.0).powi(2) - 0.4);
        let depth: Vec<f32> = (0..160 * 120).map(|pixel| 1.0 - bend(pixel) - if is_block(pixel) { 0.05 } else { 0.0 }).collect();
        let plane = Plane::new(-nalgebra::Vector3::z_axis(), &Point3::new(0.0, 0.0, 1.0));
        let table = TableSurface::new(&rays, &depth, &plane);
        let mut heights = vec![0.0; depth.len()];
        table.heights_of_row([rays.x(), rays.y(), &depth], &mut heights);
        for (pixel, h) in heights.iter().enumerate() {
            let expected = if is_block(pixel) { 0.05 } else { 0.0 };
            assert!((h - expected).abs() < 0.002, "pixel {pixel}: {h}");
        }
        assert!(table.deviation_m < 0.001);
        assert!(table.inside_by(&Vector3::new(0.0, 0.0, 0.9)) > 0.3 && table.inside_by(&Vector3::new(2.0, 0.0, 1.0)) < 0.0);
        let empty =
            TableSurface::new(&rays, &vec![0.0; depth.len()], &Plane::new(Unit::new_normalize(-nalgebra::Vector3::z()), &Point3::origin()));
        empty.heights_of_row([rays.x(), rays.y(), &depth], &mut heights);
        assert!(heights.iter().all(|h| h.is_finite()) && empty.inside_by(&Vector3::zeros()) < 0.0);
    }

    /// Horner's scheme beside the sum of all terms; beyond the square in which the table was seen, the bend is that of its edge, and it is never
    /// more than sensors bend.
    #[test]
    fn the_bend_is_the_polynomial_within_what_was_seen_and_its_edge_beyond() {
        let camera = Intrinsics::new(8, 8, [10.0; 2], [3.5; 2], [0.0; 5]).unwrap();
        let plane = Plane::new(-nalgebra::Vector3::z_axis(), &Point3::new(0.0, 0.0, 1.0));
        let mut table = TableSurface::new(&Rays::new(&camera), &[0.0; 64], &plane);
        (table.middle, table.scale) = (Vector2::new(0.3, -0.2), 0.5);
        table.bend = std::array::from_fn(|term| [0.3, -0.7, 1.1, 0.9, -1.3, 0.5, 1.7, -0.6, 0.8, -1.9][term] * 1e-3);
        let place = |x: f32, y: f32| table.middle + Vector2::new(x, y) * table.scale;
        for (x, y) in [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (-1.0, 1.0), (0.4, -0.9), (-0.7, -0.3), (0.6, 0.5)] {
            let bend = table.terms(&place(x, y)).dot(&SVector::from(table.bend));
            let found = table.height_at(0.1, &place(x, y));
            assert!((found - (0.1 - bend)).abs() < 1e-6, "({x}, {y}): {found}, {bend}");
            let beyond = |v: f32| if v.abs() == 1.0 { 9.0 * v } else { v };
            assert!((table.height_at(0.1, &place(beyond(x), beyond(y))) - found).abs() < 1e-6, "({x}, {y})");
        }
        table.bend[0] = -1.0;
        assert!((table.height_at(0.1, &place(0.0, 0.0)) - (0.1 + MOST_BENT_M as f32)).abs() < 1e-6);
    }
}
