//! The pinhole camera with a lens: from points of the camera frame to pixels and back.

use crate::Lens;
use nalgebra::{Point3, Vector3};

/// A pinhole camera: focal lengths and principal point in pixels, and the distortion of its lens.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Intrinsics {
    width: u32,
    height: u32,
    focal: [f64; 2],
    centre: [f64; 2],
    lens: Lens,
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
    /// centre of the first), and distortion k1, k2, p1, p2, k3 of Brown's model (all 0 for none).
    ///
    /// # Errors
    /// [`IntrinsicsError`] for numbers that describe no camera.
    pub fn new(width: u32, height: u32, focal: [f64; 2], centre: [f64; 2], distortion: [f64; 5]) -> Result<Self, IntrinsicsError> {
        Self::with_lens(width, height, focal, centre, Lens::PlumbBob(distortion))
    }

    /// As [`Self::new`], with any [`Lens`].
    ///
    /// # Errors
    /// [`IntrinsicsError`] for numbers that describe no camera.
    pub fn with_lens(width: u32, height: u32, focal: [f64; 2], centre: [f64; 2], lens: Lens) -> Result<Self, IntrinsicsError> {
        if [width, height].iter().any(|side| !(1..=Self::MOST_PIXELS).contains(side)) {
            return Err(IntrinsicsError::Size(width, height));
        }
        if !focal.iter().all(|f| f.is_finite() && *f > 0.0) {
            return Err(IntrinsicsError::Focal(focal[0], focal[1]));
        }
        if !centre.iter().all(|c| c.is_finite()) {
            return Err(IntrinsicsError::NotFinite("the principal point"));
        }
        if !lens.coefficients().iter().all(|d| d.is_finite()) {
            return Err(IntrinsicsError::NotFinite("the distortion"));
        }
        let lens = lens.simplified();
        Ok(Self { width, height, focal, centre, lens, reach2: lens.reach2() })
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

    /// The distortion; [`Lens::Straight`] where all coefficients of a model are 0.
    pub fn lens(&self) -> Lens {
        self.lens
    }

    /// Whether straight lines do not stay straight.
    pub fn is_distorted(&self) -> bool {
        self.lens != Lens::Straight
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
            self.lens.distort([x, y])
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

    /// The direction seen at u, v, with z = 1: a reading of z metres there is the point z times this. [`Self::project`] leads back to u, v
    /// within 10⁻⁶ pixels. `None` where the lens shows nothing that is in front of the camera, as in the corners of a fisheye's picture.
    pub fn unproject(&self, [u, v]: [f64; 2]) -> Option<Vector3<f64>> {
        let seen = [(u - self.centre[0]) / self.focal[0], (v - self.centre[1]) / self.focal[1]];
        let [x, y] = if self.is_distorted() { self.lens.undistort(seen, self.reach2)? } else { seen };
        Some(Vector3::new(x, y, 1.0))
    }

    /// As [`Self::unproject`]; where that is `None`, the outermost direction on the same side, which is finite but shows nothing of the
    /// scene.
    pub fn ray(&self, at: [f64; 2]) -> Vector3<f64> {
        self.unproject(at).unwrap_or_else(|| {
            let [x, y] = [0, 1].map(|axis| (at[axis] - self.centre[axis]) / self.focal[axis]);
            let length = x.hypot(y);
            let scale = if length.is_finite() && length > 0.0 { self.reach2.sqrt() / length } else { 0.0 };
            Vector3::new(x, y, 0.0).map(|c| if scale > 0.0 { c * scale } else { 0.0 }) + Vector3::z()
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn kinect(distortion: [f64; 5]) -> Intrinsics {
        with_lens(Lens::PlumbBob(distortion))
    }

    fn with_lens(lens: Lens) -> Intrinsics {
        Intrinsics::with_lens(640, 480, [525.0, 524.0], [319.5, 239.5], lens).unwrap()
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

    const RATIONAL: [f64; 12] = [0.78, -2.98, 0.0007, 0.00006, 1.7, 0.66, -2.81, 1.63, 0.0, 0.0, 0.0, 0.0];
    const PRISM: [f64; 12] = [0.1, -0.2, 0.001, -0.002, 0.05, 0.02, -0.01, 0.03, 0.001, -0.002, 0.003, 0.0005];
    const FISHEYE: [f64; 4] = [0.01, 0.002, -0.003, 0.0004];

    #[test]
    fn rational_thin_prism_and_fisheye_points_are_where_opencv_puts_them() {
        // cv2.projectPoints and cv2.fisheye.projectPoints of OpenCV 4 with the camera matrix [[525,0,319.5],[0,524,239.5],[0,0,1]].
        let rows = [
            (Lens::RationalPolynomial(RATIONAL), [0.2, -0.1, 0.8], [451.794748095621, 173.508505325376]),
            (Lens::RationalPolynomial(RATIONAL), [-0.5, 0.4, 1.0], [49.545726161310, 455.212760497483]),
            (Lens::RationalPolynomial(RATIONAL), [0.05, 0.5, 0.9], [349.382699010280, 537.774130403842]),
            (Lens::RationalPolynomial(PRISM), [0.2, -0.1, 0.8], [451.206857903387, 173.913688279978]),
            (Lens::RationalPolynomial(PRISM), [-0.5, 0.4, 1.0], [55.290401907979, 451.055668531762]),
            (Lens::RationalPolynomial(PRISM), [0.05, 0.5, 0.9], [348.632162515886, 533.597415801749]),
            (Lens::Equidistant(FISHEYE), [0.2, -0.1, 0.8], [447.580148068870, 175.581907058964]),
            (Lens::Equidistant(FISHEYE), [-0.5, 0.4, 1.0], [85.232107068030, 426.557334699203]),
            (Lens::Equidistant(FISHEYE), [2.0, 1.0, 0.5], [960.854666327030, 559.566519195585]),
        ];
        for (lens, point, [u, v]) in rows {
            let [x, y] = with_lens(lens).project(&Point3::from(point)).unwrap();
            assert!((x - u).abs() < 1e-8 && (y - v).abs() < 1e-8, "{lens:?} {point:?}: {x} {y}, {u} {v}");
        }
    }

    #[test]
    fn modified_brown_conrady_is_as_librealsense_computes_it() {
        // x = 0.25, y = -0.125, r² = 0.078125, radial as above; then X = x radial, Y = y radial,
        // X + 2 p1 X Y + p2 (r² + 2 X²), Y + 2 p2 X Y + p1 (r² + 2 Y²), from rs2_project_point_to_pixel.
        let lens = Lens::ModifiedBrownConrady([0.1, -0.2, 0.001, -0.002, 0.05]);
        let [u, v] = with_lens(lens).project(&Point3::new(0.2, -0.1, 0.8)).unwrap();
        let (x, y) = (0.251_653_909_683_227_55, -0.125_826_954_841_613_78);
        let seen =
            [x + 2.0 * 0.001 * x * y - 0.002 * (0.078_125 + 2.0 * x * x), y - 2.0 * 0.002 * x * y + 0.001 * (0.078_125 + 2.0 * y * y)];
        assert!((u - (525.0 * seen[0] + 319.5)).abs() < 1e-9 && (v - (524.0 * seen[1] + 239.5)).abs() < 1e-9, "{u} {v}");
    }

    #[test]
    fn coefficients_that_do_nothing_are_no_distortion_but_a_fisheye_is_always_one() {
        assert_eq!(with_lens(Lens::RationalPolynomial([0.0; 12])), kinect([0.0; 5]));
        assert!(!kinect([0.0; 5]).is_distorted() && with_lens(Lens::Equidistant([0.0; 4])).is_distorted());
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
        // The largest radius in the picture is 1.0541 · 2/3 = 0.7027: beyond it nothing is seen.
        let at = |radius: f64| [319.5 + 525.0 * radius, 239.5];
        assert!(camera.unproject(at(0.70)).is_some() && camera.unproject(at(0.71)).is_none());
        assert!(camera.ray(at(0.71)).iter().all(|c| c.is_finite()) && (camera.ray(at(0.71)).x - 1.0541).abs() < 0.01);
        // A pole of the rational model: the denominator 1 − r² is 0 at r = 1.
        let mut pole = [0.0; 12];
        pole[5] = -1.0;
        let camera = with_lens(Lens::RationalPolynomial(pole));
        assert!(camera.project(&Point3::new(0.98, 0.0, 1.0)).is_some() && camera.project(&Point3::new(1.02, 0.0, 1.0)).is_none());
    }

    #[test]
    fn the_points_of_a_line_are_projected_as_each_alone() {
        for camera in [kinect([0.0; 5]), kinect([-0.3, 0.01, 0.002, -0.001, 0.0]), with_lens(Lens::Equidistant(FISHEYE))] {
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

    #[test]
    fn every_pixel_of_every_lens_leads_back_to_itself_or_shows_nothing() {
        let lenses = [
            (Lens::PlumbBob([0.1, -0.2, 0.001, -0.002, 0.05]), true),
            (Lens::PlumbBob([-0.28, 0.09, 0.0005, -0.0003, 0.0]), true),
            (Lens::ModifiedBrownConrady([0.18, -0.53, -0.0014, 0.0001, 0.49]), true),
            (Lens::RationalPolynomial(RATIONAL), true),
            (Lens::RationalPolynomial(PRISM), true),
            (Lens::Equidistant(FISHEYE), true),
            // Folds back within the image.
            (Lens::PlumbBob([-0.9, 0.0, 0.0, 0.0, 0.0]), false),
            (Lens::Equidistant([-0.5, 0.0, 0.0, 0.0]), false),
        ];
        for (lens, all) in lenses {
            let camera = with_lens(lens);
            let mut shown = 0;
            for pixel in (0..640 * 480).step_by(97) {
                let at = [f64::from(pixel % 640), f64::from(pixel / 640)];
                if let Some(ray) = camera.unproject(at) {
                    let back = camera.project(&Point3::from(ray * 1.3)).unwrap();
                    assert!((back[0] - at[0]).hypot(back[1] - at[1]) < 1e-6, "{lens:?} {at:?}: {back:?}");
                    shown += 1;
                }
                assert!(camera.ray(at).iter().all(|c| c.is_finite()));
            }
            assert!(shown > 500 && (shown == (640_usize * 480).div_ceil(97)) == all, "{lens:?}: {shown}");
        }
    }

    proptest! {
        #[test]
        fn the_ray_of_a_projection_leads_back(x in -0.5..0.5_f64, y in -0.4..0.4_f64, z in 0.2..5.0_f64, k in prop::array::uniform5(-1.0..1.0_f64)) {
            let plumb_bob = [0.2 * k[0], 0.1 * k[1], 0.01 * k[2], 0.01 * k[3], 0.05 * k[4]];
            let point = Point3::new(x * z, y * z, z);
            for lens in [Lens::PlumbBob(plumb_bob), Lens::ModifiedBrownConrady(plumb_bob), Lens::Equidistant([k[0], k[1], k[2], k[3]].map(|k| 0.05 * k))] {
                let camera = with_lens(lens);
                let back = camera.ray(camera.project(&point).unwrap()) * z;
                prop_assert!((back - point.coords).norm() < 1e-6 * z, "{:?} {} {}", lens, back, point);
            }
        }

        #[test]
        fn whatever_the_coefficients_a_ray_is_finite_and_an_unprojected_pixel_leads_back(
            k in prop::array::uniform12(-3.0..3.0_f64), u in -50.0..700.0_f64, v in -50.0..530.0_f64,
        ) {
            for lens in [Lens::RationalPolynomial(k), Lens::Equidistant([k[0], k[1], k[2], k[3]]), Lens::PlumbBob([k[0], k[1], k[2], k[3], k[4]])] {
                let camera = with_lens(lens);
                prop_assert!(camera.ray([u, v]).iter().all(|c| c.is_finite()));
                if let Some(ray) = camera.unproject([u, v]) {
                    let back = camera.project(&Point3::from(ray)).unwrap();
                    prop_assert!((back[0] - u).hypot(back[1] - v) < 1e-6);
                }
            }
        }
    }
}
