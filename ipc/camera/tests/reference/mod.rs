//! Rendered scenes by analytic ray casting, and what carving should say of them: written from the rule alone, on plain arrays, with none
//! of the crate's code.

#![allow(dead_code, reason = "each test uses a part")]

pub type Vector = [f64; 3];
/// Rows.
pub type Matrix = [Vector; 3];

pub const IDENTITY: Matrix = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];

pub fn dot(a: Vector, b: Vector) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

pub fn add(a: Vector, b: Vector) -> Vector {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}

pub fn subtract(a: Vector, b: Vector) -> Vector {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

pub fn scale(a: Vector, s: f64) -> Vector {
    a.map(|v| v * s)
}

pub fn unit(a: Vector) -> Vector {
    scale(a, 1.0 / dot(a, a).sqrt())
}

pub fn cross(a: Vector, b: Vector) -> Vector {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

pub fn apply(m: &Matrix, v: Vector) -> Vector {
    [dot(m[0], v), dot(m[1], v), dot(m[2], v)]
}

pub fn transposed(m: &Matrix) -> Matrix {
    [[m[0][0], m[1][0], m[2][0]], [m[0][1], m[1][1], m[2][1]], [m[0][2], m[1][2], m[2][2]]]
}

pub fn product(a: &Matrix, b: &Matrix) -> Matrix {
    let b = transposed(b);
    [apply(&b, a[0]), apply(&b, a[1]), apply(&b, a[2])]
}

/// The rotation by `angle` radians about `axis` (Rodrigues).
pub fn turn(axis: Vector, angle: f64) -> Matrix {
    let ([x, y, z], (sin, cos)) = (unit(axis), angle.sin_cos());
    let c = 1.0 - cos;
    [
        [cos + x * x * c, x * y * c - z * sin, x * z * c + y * sin],
        [y * x * c + z * sin, cos + y * y * c, y * z * c - x * sin],
        [z * x * c - y * sin, z * y * c + x * sin, cos + z * z * c],
    ]
}

/// A pinhole camera with Brown's distortion.
#[derive(Clone, Copy, Debug)]
pub struct Camera {
    pub width: u32,
    pub height: u32,
    pub focal: [f64; 2],
    pub centre: [f64; 2],
    pub distortion: [f64; 5],
}

impl Camera {
    pub fn vga(distortion: [f64; 5]) -> Self {
        Self { width: 640, height: 480, focal: [525.0, 524.0], centre: [319.7, 239.2], distortion }
    }

    fn distorted(&self, x: f64, y: f64) -> [f64; 2] {
        let [k1, k2, p1, p2, k3] = self.distortion;
        let r2 = x * x + y * y;
        let radial = 1.0 + k1 * r2 + k2 * r2.powi(2) + k3 * r2.powi(3);
        [radial * x + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x), radial * y + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y]
    }

    /// Where a point is seen; `None` behind the camera.
    pub fn project(&self, p: Vector) -> Option<[f64; 2]> {
        let [x, y] = (p[2] > 0.0).then(|| self.distorted(p[0] / p[2], p[1] / p[2]))?;
        Some([self.focal[0] * x + self.centre[0], self.focal[1] * y + self.centre[1]])
    }

    /// The direction with z = 1 that is seen at u, v: by fixed-point iteration, as OpenCV undistorts.
    pub fn direction(&self, [u, v]: [f64; 2]) -> Vector {
        let seen = [(u - self.centre[0]) / self.focal[0], (v - self.centre[1]) / self.focal[1]];
        let mut at = seen;
        for _ in 0..200 {
            let here = self.distorted(at[0], at[1]);
            let off = [seen[0] - here[0], seen[1] - here[1]];
            if off[0].abs() + off[1].abs() < 1e-13 {
                break;
            }
            at = [at[0] + off[0], at[1] + off[1]];
        }
        [at[0], at[1], 1.0]
    }

    /// Column and row of the pixel nearest to u, v.
    pub fn nearest(&self, [u, v]: [f64; 2]) -> Option<[u32; 2]> {
        let (column, row) = ((u + 0.5).floor(), (v + 0.5).floor());
        let inside = column >= 0.0 && row >= 0.0 && column < f64::from(self.width) && row < f64::from(self.height);
        inside.then_some([column as u32, row as u32])
    }

    pub fn index(&self, [column, row]: [u32; 2]) -> usize {
        (row * self.width + column) as usize
    }

    pub fn pixels(&self) -> impl Iterator<Item = [u32; 2]> + use<> {
        let width = self.width;
        (0..width * self.height).map(move |i| [i % width, i / width])
    }
}

#[derive(Clone, Copy, Debug)]
pub enum Shape {
    Sphere {
        centre: Vector,
        radius: f64,
    },
    /// `axes`: rows are the box's axes in the camera frame.
    Cuboid {
        centre: Vector,
        half: Vector,
        axes: Matrix,
    },
    /// About the third of its axes.
    Cylinder {
        centre: Vector,
        radius: f64,
        half: f64,
        axes: Matrix,
    },
    /// normal · p + offset = 0.
    Plane {
        normal: Vector,
        offset: f64,
    },
}

impl Shape {
    /// Smallest positive t at which t · direction is on the surface.
    pub fn hit(&self, direction: Vector) -> Option<f64> {
        match *self {
            Self::Plane { normal, offset } => Some(-offset / dot(normal, direction)).filter(|t| *t > 0.0 && t.is_finite()),
            Self::Sphere { centre, radius } => {
                let (a, b, c) = (dot(direction, direction), dot(direction, centre), dot(centre, centre) - radius * radius);
                let root = (b * b - a * c).max(-1.0);
                if root < 0.0 {
                    return None;
                }
                [(b - root.sqrt()) / a, (b + root.sqrt()) / a].into_iter().find(|t| *t > 0.0)
            }
            Self::Cuboid { centre, half, axes } => {
                let (o, d) = (apply(&axes, scale(centre, -1.0)), apply(&axes, direction));
                first_of(slabs((0..3).map(|axis| (o[axis], d[axis], half[axis])))?)
            }
            Self::Cylinder { centre, radius, half, axes } => {
                let (o, d) = (apply(&axes, scale(centre, -1.0)), apply(&axes, direction));
                let (a, b, c) = (d[0] * d[0] + d[1] * d[1], o[0] * d[0] + o[1] * d[1], o[0] * o[0] + o[1] * o[1] - radius * radius);
                let root = b * b - a * c;
                let round = if a == 0.0 {
                    (c <= 0.0).then_some([f64::NEG_INFINITY, f64::INFINITY])?
                } else if root < 0.0 {
                    return None;
                } else {
                    [(-b - root.sqrt()) / a, (-b + root.sqrt()) / a]
                };
                let [enter, leave] = slabs(std::iter::once((o[2], d[2], half)))?;
                let both = [round[0].max(enter), round[1].min(leave)];
                (both[0] <= both[1]).then_some(both).and_then(first_of)
            }
        }
    }
}

/// Where a ray is within all slabs |o + t d| ≤ half.
fn slabs(slabs: impl Iterator<Item = (f64, f64, f64)>) -> Option<[f64; 2]> {
    let mut within = [f64::NEG_INFINITY, f64::INFINITY];
    for (o, d, half) in slabs {
        if d == 0.0 {
            if o.abs() > half {
                return None;
            }
            continue;
        }
        let ends = [(-half - o) / d, (half - o) / d];
        within = [within[0].max(ends[0].min(ends[1])), within[1].min(ends[0].max(ends[1]))];
    }
    (within[0] <= within[1]).then_some(within)
}

fn first_of([enter, leave]: [f64; 2]) -> Option<f64> {
    [enter, leave].into_iter().find(|t| *t > 0.0)
}

/// Label and depth of what a ray meets first.
pub type Hit = Option<(u16, f64)>;

/// The first shape along a direction with z = 1.
pub fn cast(shapes: &[(u16, Shape)], direction: Vector) -> Hit {
    shapes.iter().filter_map(|(label, shape)| shape.hit(direction).map(|depth| (*label, depth))).min_by(|a, b| a.1.total_cmp(&b.1))
}

/// The depth image, metres, 0 where nothing is seen, and the labels.
pub fn render(camera: &Camera, shapes: &[(u16, Shape)]) -> (Vec<f32>, Vec<u16>) {
    camera
        .pixels()
        .map(|[column, row]| match cast(shapes, camera.direction([f64::from(column), f64::from(row)])) {
            Some((label, depth)) => (depth as f32, label),
            None => (0.0, 0),
        })
        .unzip()
}

/// A grid in the camera frame; columns of `rotation` are its axes.
#[derive(Clone, Copy, Debug)]
pub struct Placed {
    pub dims: [usize; 3],
    pub voxel: f64,
    pub centre: Vector,
    pub rotation: Matrix,
}

impl Placed {
    pub fn at(&self, voxel: [usize; 3]) -> Vector {
        let along = |axis: usize| (voxel[axis] as f64 - (self.dims[axis] as f64 - 1.0) / 2.0) * self.voxel;
        add(self.centre, apply(&self.rotation, [along(0), along(1), along(2)]))
    }

    pub fn voxels(&self) -> impl Iterator<Item = [usize; 3]> + use<> {
        let [nx, ny, nz] = self.dims;
        (0..nx * ny * nz).map(move |i| [i / (ny * nz), i / nz % ny, i % nz])
    }

    /// Half of what a voxel measures along the optical axis: its farthest corner.
    pub fn half_depth(&self) -> f64 {
        (0..8)
            .map(|corner| {
                let side = |bit: u32| if corner >> bit & 1 == 0 { -0.5 } else { 0.5 } * self.voxel;
                apply(&self.rotation, [side(0), side(1), side(2)])[2]
            })
            .fold(0.0, f64::max)
    }
}

/// Constant, quadratic term and number of deviations of a sensor.
pub type Sensor = [f64; 3];

/// The code of a voxel whose centre is at the depth `z`, where a reading says `hit`; and by how much it is so, metres.
pub fn classify(z: f64, hit: Hit, object: u16, sensor: &Sensor, half_depth: f64) -> (u8, f64) {
    let Some((label, depth)) = hit else { return (255, f64::INFINITY) };
    let band = (sensor[2] * (sensor[0] + sensor[1] * depth * depth)).max(half_depth);
    let margin = (z - (depth - band)).abs().min((z - (depth + band)).abs());
    if z < depth - band {
        (0, margin)
    } else if z > depth + band || label != object {
        (255, margin)
    } else {
        (1, margin)
    }
}
