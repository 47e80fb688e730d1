//! The pinhole camera with lens distortion, as ROS's `camera_info` with `plumb_bob` describes it (Brown's model).

use nalgebra::{Point3, Vector3};

/// A pinhole camera: focal lengths and principal point in pixels, distortion k1, k2, p1, p2, k3.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Intrinsics {
    width: u32,
    height: u32,
    focal: [f64; 2],
    centre: [f64; 2],
    distortion: [f64; 5],
    /// Squared radius, of points before distortion, up to which the distortion is one to one.
    reach2: f64,
}

/// Numbers that describe no camera.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum IntrinsicsError {
    /// An image without pixels, or a huge one.
    #[error("the image has {0} × {1} pixels: each side must be from 1 to {max}", max = Intrinsics::MOST_PIXELS)]
    Size(u32, u32),
    /// A focal length is not positive and finite.
    #[error("the focal lengths are {0} and {1} pixels: both must be positive and finite")]
    Focal(f64, f64),
    /// A parameter is not finite.
    #[error("{0} is not finite")]
    NotFinite(&'static str),
}

impl Intrinsics {
    /// Most pixels along one side.
    pub const MOST_PIXELS: u32 = 16_384;

    /// A camera of `width` × `height` pixels with `focal` lengths fx, fy and principal point `centre` cx, cy (pixels, counted from the
    /// centre of the first), and distortion k1, k2, p1, p2, k3 (all 0 for none).
    pub fn new(width: u32, height: u32, focal: [f64; 2], centre: [f64; 2], distortion: [f64; 5]) -> Result<Self, IntrinsicsError> {
        if [width, height].iter().any(|side| !(1..=Self::MOST_PIXELS).contains(side)) {
            return Err(IntrinsicsError::Size(width, height));
        }
        if !focal.iter().all(|f| f.is_finite() && *f > 0.0) {
            return Err(IntrinsicsError::Focal(focal[0], focal[1]));
        }
        if !centre.iter().all(|c| c.is_finite()) {
            return Err(IntrinsicsError::NotFinite("the principal point"));
        }
        if !distortion.iter().all(|d| d.is_finite()) {
            return Err(IntrinsicsError::NotFinite("the distortion"));
        }
        Ok(Self { width, height, focal, centre, distortion, reach2: reach2(distortion) })
    }

    /// Pixels along a row.
    pub fn width(&self) -> u32 {
        self.width
    }

    /// Rows.
    pub fn height(&self) -> u32 {
        self.height
    }

    /// Focal lengths fx, fy, pixels.
    pub fn focal(&self) -> [f64; 2] {
        self.focal
    }

    /// Principal point cx, cy, pixels.
    pub fn centre(&self) -> [f64; 2] {
        self.centre
    }

    /// k1, k2, p1, p2, k3.
    pub fn distortion(&self) -> [f64; 5] {
        self.distortion
    }

    /// Whether straight lines stay straight.
    pub fn is_distorted(&self) -> bool {
        self.distortion != [0.0; 5]
    }

    /// Where a point of the camera frame is seen: u, v in pixels, perhaps outside of the image; `None` for points that are not in front
    /// of the camera, or so far aside that the distortion would fold them back into the image.
    #[inline]
    pub fn project(&self, point: &Point3<f64>) -> Option<[f64; 2]> {
        if point.z <= 0.0 {
            return None;
        }
        let (x, y) = (point.x / point.z, point.y / point.z);
        let [x, y] = if self.is_distorted() {
            if x * x + y * y > self.reach2 {
                return None;
            }
            self.distort([x, y])
        } else {
            [x, y]
        };
        Some([self.focal[0] * x + self.centre[0], self.focal[1] * y + self.centre[1]])
    }

    /// [`Self::project`] of the points `start`, `start + step`, `start + 2 step`, …; not a number where that is `None`.
    pub(crate) fn project_line(&self, start: &Point3<f64>, step: &Vector3<f64>, seen: &mut [[f64; 2]]) {
        let point = |i: usize| start + step * i as f64;
        if self.is_distorted() {
            for (i, at) in seen.iter_mut().enumerate() {
                *at = self.project(&point(i)).unwrap_or([f64::NAN; 2]);
            }
            return;
        }
        for (i, at) in seen.iter_mut().enumerate() {
            let point = point(i);
            let z = if point.z > 0.0 { point.z } else { f64::NAN };
            *at = [self.focal[0] * (point.x / z) + self.centre[0], self.focal[1] * (point.y / z) + self.centre[1]];
        }
    }

    /// Index of the pixel that u, v lie in; `None` outside of the image.
    #[inline]
    pub fn pixel(&self, [u, v]: [f64; 2]) -> Option<usize> {
        let (u, v) = (u + 0.5, v + 0.5);
        let inside = u >= 0.0 && v >= 0.0 && u < f64::from(self.width) && v < f64::from(self.height);
        inside.then(|| v as usize * self.width as usize + u as usize)
    }

    /// The direction seen at u, v, with z = 1: a reading of z metres there is the point z times this.
    pub fn ray(&self, [u, v]: [f64; 2]) -> Vector3<f64> {
        let seen = [(u - self.centre[0]) / self.focal[0], (v - self.centre[1]) / self.focal[1]];
        let [x, y] = if self.is_distorted() { self.undistort(seen) } else { seen };
        Vector3::new(x, y, 1.0)
    }

    /// The distortion of a point of the plane z = 1.
    fn distort(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        let [k1, k2, p1, p2, k3] = self.distortion;
        let r2 = x * x + y * y;
        let radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3));
        [x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x), y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y]
    }

    /// Its inverse by Newton's method, with the derivative by differences.
    fn undistort(&self, seen: [f64; 2]) -> [f64; 2] {
        const STEP: f64 = 1e-6;
        let mut at = seen;
        for _ in 0..20 {
            let here = self.distort(at);
            let error = [here[0] - seen[0], here[1] - seen[1]];
            if error[0].abs().max(error[1].abs()) < 1e-12 {
                break;
            }
            let (dx, dy) = (self.distort([at[0] + STEP, at[1]]), self.distort([at[0], at[1] + STEP]));
            let [a, c] = [(dx[0] - here[0]) / STEP, (dx[1] - here[1]) / STEP];
            let [b, d] = [(dy[0] - here[0]) / STEP, (dy[1] - here[1]) / STEP];
            let determinant = a * d - b * c;
            if determinant.abs() < 1e-9 {
                break;
            }
            at[0] -= (d * error[0] - b * error[1]) / determinant;
            at[1] -= (a * error[1] - c * error[0]) / determinant;
        }
        at
    }
}

/// The squared radius at which the radial distortion turns back, r (1 + k1 r² + k2 r⁴ + k3 r⁶) being largest; at most that of a field of
/// view of 160°.
fn reach2([k1, k2, _, _, k3]: [f64; 5]) -> f64 {
    const STEPS: u32 = 4000;
    let widest = 80_f64.to_radians().tan();
    for i in 1..=STEPS {
        let r2 = (widest * f64::from(i) / f64::from(STEPS)).powi(2);
        if 1.0 + r2 * (3.0 * k1 + r2 * (5.0 * k2 + r2 * 7.0 * k3)) <= 0.0 {
            return (widest * f64::from(i - 1) / f64::from(STEPS)).powi(2);
        }
    }
    widest * widest
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn kinect(distortion: [f64; 5]) -> Intrinsics {
        Intrinsics::new(640, 480, [525.0, 524.0], [319.5, 239.5], distortion).unwrap()
    }

    #[test]
    fn a_distorted_point_is_where_opencv_puts_it() {
        // cv2.projectPoints([[0.2, -0.1, 0.8]], 0, 0, [[525,0,319.5],[0,524,239.5],[0,0,1]], [0.1, -0.2, 0.001, -0.002, 0.05]):
        // x = 0.25, y = -0.125, r2 = 0.078125; radial = 1 + 0.0078125 - 0.001220703125 + 0.0000238418579
        let [u, v] = kinect([0.1, -0.2, 0.001, -0.002, 0.05]).project(&Point3::new(0.2, -0.1, 0.8)).unwrap();
        let radial = 1.006_615_638_732_910_2;
        let (x, y) = (0.25 * radial - 0.000_062_5 - 0.002 * 0.203_125, -0.125 * radial + 0.001 * 0.109_375 + 0.000_125);
        assert!((u - (525.0 * x + 319.5)).abs() < 1e-9 && (v - (524.0 * y + 239.5)).abs() < 1e-9, "{u} {v}");
    }

    #[test]
    fn numbers_that_describe_no_camera_are_refused() {
        let new = |w, f: f64, c: f64, k| Intrinsics::new(w, 480, [f, f], [c, c], [k; 5]).unwrap_err().to_string();
        assert!(new(0, 500.0, 0.0, 0.0).contains("0 × 480"));
        assert!(new(640, 0.0, 0.0, 0.0).contains("focal") && new(640, f64::NAN, 0.0, 0.0).contains("focal"));
        assert!(new(640, 500.0, f64::INFINITY, 0.0).contains("principal") && new(640, 500.0, 0.0, f64::NAN).contains("distortion"));
    }

    #[test]
    fn what_lies_far_aside_is_not_folded_back_by_the_distortion() {
        let camera = kinect([-0.3, 0.0, 0.0, 0.0, 0.0]);
        // r (1 − 0.3 r²) turns back at r² = 1 / 0.9.
        assert!(camera.project(&Point3::new(1.04, 0.0, 1.0)).is_some());
        assert!(camera.project(&Point3::new(1.07, 0.0, 1.0)).is_none());
        assert!(camera.project(&Point3::new(0.0, 0.0, -1.0)).is_none());
    }

    #[test]
    fn the_points_of_a_line_are_projected_as_each_alone() {
        for camera in [kinect([0.0; 5]), kinect([-0.3, 0.01, 0.002, -0.001, 0.0])] {
            // From behind the camera to far aside.
            let (start, step) = (Point3::new(-0.4, 0.3, -0.1), Vector3::new(0.013, -0.007, 0.011));
            let mut seen = [[7.0; 2]; 60];
            camera.project_line(&start, &step, &mut seen);
            for (i, at) in seen.into_iter().enumerate() {
                let alone = camera.project(&(start + step * i as f64));
                assert_eq!(Some(at).filter(|at| !at[0].is_nan()), alone, "{i}");
                assert!(alone.is_some() || at[1].is_nan());
            }
            assert!(seen[0][0].is_nan() && !seen[59][0].is_nan());
        }
    }

    proptest! {
        #[test]
        fn the_ray_of_a_projection_leads_back(x in -0.5..0.5_f64, y in -0.4..0.4_f64, z in 0.2..5.0_f64, k in prop::array::uniform5(-1.0..1.0_f64)) {
            let camera = kinect([0.2 * k[0], 0.1 * k[1], 0.01 * k[2], 0.01 * k[3], 0.05 * k[4]]);
            let point = Point3::new(x * z, y * z, z);
            let back = camera.ray(camera.project(&point).unwrap()) * z;
            prop_assert!((back - point.coords).norm() < 1e-6 * z, "{} {}", back, point);
        }
    }
}
