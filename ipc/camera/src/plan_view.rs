//! Points as seen along the normal of a plane, and their convex hull.

use nalgebra::{Vector2, Vector3};

/// Coordinates on a plane.
pub struct PlanView {
    x: Vector3<f32>,
    y: Vector3<f32>,
}

impl PlanView {
    /// Of a plane with that unit normal.
    pub fn of(normal: &Vector3<f32>) -> Self {
        let axis = if normal.x.abs() < 0.7 { Vector3::x() } else { Vector3::y() };
        let x = (axis - normal * normal.dot(&axis)).normalize();
        Self { x, y: normal.cross(&x) }
    }

    /// The two axes on the plane.
    pub fn axes(&self) -> [&Vector3<f32>; 2] {
        [&self.x, &self.y]
    }

    /// The coordinates of a point.
    #[inline]
    pub fn see(&self, point: &Vector3<f32>) -> Vector2<f32> {
        Vector2::new(self.x.dot(point), self.y.dot(point))
    }
}

/// The corners of the convex hull of some points, counter-clockwise (Andrew's monotone chain, 1979).
pub fn convex_hull(mut points: Vec<Vector2<f32>>) -> Vec<Vector2<f32>> {
    points.sort_unstable_by(|a, b| a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y)));
    let turns_left = |a: &Vector2<f32>, b: &Vector2<f32>, c: &Vector2<f32>| (b - a).perp(&(c - a)) > 0.0;
    let mut hull: Vec<Vector2<f32>> = Vec::new();
    let mut half = |points: &mut dyn Iterator<Item = &Vector2<f32>>| {
        let first = hull.len();
        for point in points {
            while hull.len() >= first + 2 && !turns_left(&hull[hull.len() - 2], &hull[hull.len() - 1], point) {
                hull.pop();
            }
            hull.push(*point);
        }
        // The last corner is the other half's first.
        hull.pop();
    };
    half(&mut points.iter());
    half(&mut points.iter().rev());
    hull
}

/// The sides of a convex polygon, for asking of many points whether they lie inside.
#[derive(Clone, Debug, Default)]
pub struct Sides {
    /// Of each side the unit normal inwards, and what a point's component along it is on the side.
    lines: Vec<(Vector2<f32>, f32)>,
}

impl Sides {
    /// Of a polygon with these corners, counter-clockwise; fewer than three have no inside.
    pub fn of(hull: &[Vector2<f32>]) -> Self {
        if hull.len() < 3 {
            return Self::default();
        }
        let line = |(a, b): (&Vector2<f32>, &Vector2<f32>)| {
            let along = (b - a) / (b - a).norm().max(1e-9);
            let inwards = Vector2::new(-along.y, along.x);
            (inwards, inwards.dot(a))
        };
        Self { lines: hull.iter().zip(hull.iter().cycle().skip(1)).map(line).collect() }
    }

    /// How far a point lies inside; negative outside, and where there is no polygon.
    pub fn inside_by(&self, point: &Vector2<f32>) -> f32 {
        let off = self.lines.iter().map(|(inwards, at)| inwards.dot(point) - at);
        off.fold(f32::INFINITY, f32::min).min(if self.lines.is_empty() { -1.0 } else { f32::INFINITY })
    }

    /// Whether a point lies further inside than a margin.
    pub fn is_inside(&self, point: &Vector2<f32>, margin: f32) -> bool {
        !self.lines.is_empty() && self.lines.iter().all(|(inwards, at)| inwards.dot(point) - at > margin)
    }
}

/// The area of a convex polygon.
pub fn area(hull: &[Vector2<f32>]) -> f32 {
    let sides = hull.iter().zip(hull.iter().cycle().skip(1));
    0.5 * sides.map(|(a, b)| a.perp(b)).sum::<f32>()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_hull_of_a_square_with_points_inside_is_the_square() {
        let points = [[0.0, 0.0], [2.0, 0.0], [1.0, 1.0], [2.0, 2.0], [0.0, 2.0], [1.0, 0.0], [0.5, 1.5]];
        let hull = convex_hull(points.iter().map(|[x, y]| Vector2::new(*x, *y)).collect());
        assert_eq!(hull, [[0.0, 0.0], [2.0, 0.0], [2.0, 2.0], [0.0, 2.0]].map(|[x, y]| Vector2::new(x, y)));
        assert_eq!(area(&hull), 4.0);
        let sides = Sides::of(&hull);
        assert_eq!(sides.inside_by(&Vector2::new(1.0, 0.25)), 0.25);
        assert_eq!(sides.inside_by(&Vector2::new(3.0, 1.0)), -1.0);
        assert!(sides.is_inside(&Vector2::new(1.0, 0.25), 0.2) && !sides.is_inside(&Vector2::new(1.0, 0.25), 0.3));
        let none = Sides::of(&hull[..2]);
        assert!(none.inside_by(&Vector2::new(1.0, 0.0)) < 0.0 && !none.is_inside(&Vector2::new(1.0, 0.0), -9.0));
    }
}
