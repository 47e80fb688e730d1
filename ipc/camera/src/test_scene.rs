//! Tests only: a table with simple things on it, seen by a noisy depth camera that looks down on it by 45°.

use crate::rays::Rays;
use crate::support::Plane;
use crate::{Intrinsics, SensorModel};
use nalgebra::{Point3, Unit, Vector3};

/// Something on the table. Places are metres to the right of the camera and in front of it.
#[derive(Clone, Copy, Debug)]
pub enum Thing {
    /// An upright box: place, half of width and depth, height.
    Box([f64; 2], [f64; 2], f64),
    /// An upright cup, open above: place, radius, height, thickness of wall and floor.
    Cup([f64; 2], f64, f64, f64),
}

/// A rendered scene.
pub struct TestScene {
    pub rays: Rays,
    pub depth: Vec<f32>,
    /// Which thing each pixel shows, from 1 on; 0: the table or the floor.
    pub labels: Vec<u16>,
    pub table: Plane,
}

const WIDTH: usize = 320;
const HEIGHT: usize = 240;
/// The camera above the table, metres.
const ABOVE: f64 = 0.55;

impl TestScene {
    /// `things` on a table that ends 0.4 m to the left and right, and 1 m in front, 0.7 m above a floor. Readings are off by up to `noise`
    /// standard deviations of the default sensor.
    pub fn new(things: &[Thing], noise: f64) -> Self {
        let camera = Intrinsics::new(WIDTH as u32, HEIGHT as u32, [290.0; 2], [159.5, 119.5], [0.0; 5]).unwrap();
        let s = std::f64::consts::FRAC_1_SQRT_2;
        let sensor = SensorModel::default();
        let (mut depth, mut labels) = (Vec::new(), Vec::new());
        for pixel in 0..WIDTH * HEIGHT {
            let ray = camera.unproject([(pixel % WIDTH) as f64, (pixel / WIDTH) as f64]).unwrap();
            // To the right, in front, up.
            let ray = Vector3::new(ray.x, s - s * ray.y, -s - s * ray.y);
            let from = Vector3::new(0.0, 0.0, ABOVE);
            let (mut z, mut label) = (-(ABOVE + 0.7) / ray.z, 0);
            let on_table = from - ray * (ABOVE / ray.z);
            if on_table.x.abs() < 0.4 && on_table.y < 1.0 {
                z = -ABOVE / ray.z;
            }
            if ray.z >= 0.0 {
                z = 0.0;
            }
            for (i, thing) in things.iter().enumerate() {
                if let Some(hit) = thing.hit(&from, &ray).filter(|hit| z == 0.0 || *hit < z) {
                    (z, label) = (hit, i as u16 + 1);
                }
            }
            let error = noise * sensor.deviation(z) * ((pixel * 7919 % 1009) as f64 / 504.0 - 1.0);
            depth.push(if z > 0.0 { (z + error) as f32 } else { 0.0 });
            labels.push(label);
        }
        let table = Plane::new(Unit::new_normalize(Vector3::new(0.0, -s, -s)), &Point3::new(0.0, s * ABOVE, s * ABOVE));
        Self { rays: Rays::new(&camera), depth, labels, table }
    }

    /// The pixels with a reading of a label in some label image.
    pub fn pixels(&self, labels: &[u16], label: u16) -> Vec<u32> {
        (0..labels.len() as u32).filter(|pixel| labels[*pixel as usize] == label && self.depth[*pixel as usize] > 0.0).collect()
    }

    /// The labels with the one of a thing `by` pixels wider to all sides.
    pub fn widened(&self, label: u16, by: usize) -> Vec<u16> {
        let mut wide = self.labels.clone();
        for (pixel, wide) in wide.iter_mut().enumerate() {
            let (u, v) = (pixel % WIDTH, pixel / WIDTH);
            let rows = v.saturating_sub(by)..(v + by + 1).min(HEIGHT);
            let mut around = rows.flat_map(|v| (u.saturating_sub(by)..(u + by + 1).min(WIDTH)).map(move |u| v * WIDTH + u));
            if *wide == 0 && around.any(|other| self.labels[other] == label) {
                *wide = label;
            }
        }
        wide
    }
}

impl Thing {
    /// How far along a ray it is hit.
    fn hit(&self, from: &Vector3<f64>, ray: &Vector3<f64>) -> Option<f64> {
        match *self {
            Self::Box([x, y], [half_x, half_y], height) => {
                let (low, high) = (Vector3::new(x - half_x, y - half_y, 0.0), Vector3::new(x + half_x, y + half_y, height));
                let (mut near, mut far) = (0.0_f64, f64::INFINITY);
                for axis in 0..3 {
                    let [a, b] = [low[axis], high[axis]].map(|end| (end - from[axis]) / ray[axis]);
                    (near, far) = (near.max(a.min(b)), far.min(a.max(b)));
                }
                (near < far && near > 0.0).then_some(near)
            }
            Self::Cup([x, y], radius, height, thickness) => {
                let mut hits: Vec<f64> = Vec::new();
                let offset = from - Vector3::new(x, y, 0.0);
                let mut side = |radius: f64, least: f64, nearest: bool| {
                    let (a, b) = (ray.x * ray.x + ray.y * ray.y, offset.x * ray.x + offset.y * ray.y);
                    let c = offset.x * offset.x + offset.y * offset.y - radius * radius;
                    let root = (b * b - a * c).sqrt();
                    let t = if nearest { (-b - root) / a } else { (-b + root) / a };
                    hits.extend(Some(t).filter(|t| (least..=height).contains(&(from.z + t * ray.z))));
                };
                side(radius, 0.0, true);
                side(radius - thickness, thickness, false);
                let mut disc = |at: f64, inner: f64, outer: f64| {
                    let t = (at - from.z) / ray.z;
                    let across = (offset + ray * t).xy().norm();
                    hits.extend(Some(t).filter(|_| (inner..=outer).contains(&across)));
                };
                disc(height, radius - thickness, radius);
                disc(thickness, 0.0, radius - thickness);
                hits.into_iter().filter(|t| *t > 0.0).min_by(f64::total_cmp)
            }
        }
    }
}
