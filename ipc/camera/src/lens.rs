//! How a lens moves the picture of a point: the models of OpenCV and ROS, forwards in closed form and backwards by Newton's method.
//!
//! Coordinates are those of the plane z = 1 of the camera frame: (x, y) = (X / Z, Y / Z) before the lens, (x″, y″) after it, r² = x² + y².
//!
//! | model | equation |
//! | --- | --- |
//! | plumb_bob (Brown's) | x″ = x R + 2 p1 x y + p2 (r² + 2 x²), y″ = y R + p1 (r² + 2 y²) + 2 p2 x y, R = 1 + k1 r² + k2 r⁴ + k3 r⁶ |
//! | rational_polynomial | the same with R = (1 + k1 r² + k2 r⁴ + k3 r⁶) / (1 + k4 r² + k5 r⁴ + k6 r⁶), and a thin prism: s1 r² + s2 r⁴ on x″, s3 r² + s4 r⁴ on y″ |
//! | modified Brown–Conrady | plumb_bob, but with x R and y R in place of x and y in the tangential terms, as librealsense has it |
//! | equidistant (Kannala–Brandt) | θ = atan r, (x″, y″) = (x, y) / r · θ (1 + k1 θ² + k2 θ⁴ + k3 θ⁶ + k4 θ⁸) |

/// The distortion of a lens.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Lens {
    /// None: straight lines stay straight.
    #[default]
    Straight,
    /// ROS's `plumb_bob`: k1, k2, p1, p2, k3.
    PlumbBob([f64; 5]),
    /// ROS's `rational_polynomial`, in OpenCV's order: k1, k2, p1, p2, k3, k4, k5, k6, then the thin prism s1, s2, s3, s4.
    RationalPolynomial([f64; 12]),
    /// librealsense's modified and inverse Brown–Conrady: k1, k2, p1, p2, k3.
    ModifiedBrownConrady([f64; 5]),
    /// ROS's `equidistant`, OpenCV's `fisheye`: k1, k2, k3, k4.
    Equidistant([f64; 4]),
}

/// Steps in which the first radius is looked for at which a lens folds back.
const STEPS: u32 = 4000;
/// Widest angle from the optical axis that is used, radians: tan θ and its errors grow without bound towards 90°.
const WIDEST_RAD: f64 = 80.0 * std::f64::consts::PI / 180.0;
const WIDEST_FISHEYE_RAD: f64 = 85.0 * std::f64::consts::PI / 180.0;
/// The inverse is found when the distortion leads back to within this, in the plane z = 1: less than 10⁻⁶ pixels of any camera.
const RESIDUAL: f64 = 1e-10;

impl Lens {
    /// As `self`, but without distortion where all coefficients are 0; the equidistant projection bends lines even then.
    pub(crate) fn simplified(self) -> Self {
        match self {
            Self::Equidistant(_) => self,
            _ if self.coefficients().iter().all(|c| *c == 0.0) => Self::Straight,
            _ => self,
        }
    }

    /// The coefficients in the order of the model.
    pub fn coefficients(&self) -> &[f64] {
        match self {
            Self::Straight => &[],
            Self::PlumbBob(k) | Self::ModifiedBrownConrady(k) => k,
            Self::RationalPolynomial(k) => k,
            Self::Equidistant(k) => k,
        }
    }

    /// (x″, y″) of (x, y).
    pub(crate) fn distort(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        let r2 = x * x + y * y;
        match *self {
            Self::Straight => [x, y],
            Self::PlumbBob([k1, k2, p1, p2, k3]) => {
                let radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3));
                [x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x), y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y]
            }
            Self::RationalPolynomial([k1, k2, p1, p2, k3, k4, k5, k6, s1, s2, s3, s4]) => {
                let radial = (1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))) / (1.0 + r2 * (k4 + r2 * (k5 + r2 * k6)));
                let tangential = [2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x), p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y];
                let prism = [r2 * (s1 + r2 * s2), r2 * (s3 + r2 * s4)];
                [x * radial + tangential[0] + prism[0], y * radial + tangential[1] + prism[1]]
            }
            Self::ModifiedBrownConrady([k1, k2, p1, p2, k3]) => {
                let radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3));
                let (x, y) = (x * radial, y * radial);
                [x + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x), y + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y]
            }
            Self::Equidistant(k) => {
                let r = r2.sqrt();
                // θ / r is 1 in the middle.
                let scale = if r < 1e-9 { 1.0 } else { angle(k, r.atan()) / r };
                [x * scale, y * scale]
            }
        }
    }

    /// (x, y) of (x″, y″): the only one of radius² below `reach2`; `None` where there is none, as behind the edge of a fisheye's picture.
    pub(crate) fn undistort(&self, seen: [f64; 2], reach2: f64) -> Option<[f64; 2]> {
        match *self {
            Self::Straight => Some(seen),
            Self::Equidistant(k) => undistort_fisheye(k, seen, reach2),
            _ => self.undistort_by_newton(seen, reach2),
        }
    }

    /// Newton's method in two dimensions, the derivative by differences; a step that leads away is halved.
    fn undistort_by_newton(&self, seen: [f64; 2], reach2: f64) -> Option<[f64; 2]> {
        const STEP: f64 = 1e-6;
        let error = |at: [f64; 2]| {
            let there = self.distort(at);
            [there[0] - seen[0], there[1] - seen[1]]
        };
        let size = |[x, y]: [f64; 2]| x.abs().max(y.abs());
        let inside = |[x, y]: [f64; 2]| {
            let r2 = x * x + y * y;
            if r2 > reach2 { [x, y].map(|c| c * (reach2 / r2).sqrt()) } else { [x, y] }
        };
        let mut at = inside(seen);
        let mut off = error(at);
        for _ in 0..50 {
            if size(off) < RESIDUAL {
                return Some(at);
            }
            let (dx, dy) = (error([at[0] + STEP, at[1]]), error([at[0], at[1] + STEP]));
            let ([a, c], [b, d]) = ([0, 1].map(|i| (dx[i] - off[i]) / STEP), [0, 1].map(|i| (dy[i] - off[i]) / STEP));
            let determinant = a * d - b * c;
            if determinant.is_nan() || determinant.abs() < 1e-12 {
                return None;
            }
            let step = [(d * off[0] - b * off[1]) / determinant, (a * off[1] - c * off[0]) / determinant];
            let halved = (0..12).map(|n| 0.5_f64.powi(n)).find_map(|share| {
                let next = inside([at[0] - share * step[0], at[1] - share * step[1]]);
                let next_off = error(next);
                (size(next_off) < size(off)).then_some((next, next_off))
            });
            (at, off) = halved?;
        }
        None
    }

    /// The squared radius, before the lens, up to which nearer points stay nearer to the middle: further out the model folds the picture
    /// back, and what it says means nothing. At most that of a field of view of 160°, of a fisheye 170°.
    pub(crate) fn reach2(&self) -> f64 {
        let widest = if matches!(self, Self::Equidistant(_)) { WIDEST_FISHEYE_RAD } else { WIDEST_RAD }.tan();
        let mut last = 0.0;
        for i in 1..=STEPS {
            let r = widest * f64::from(i) / f64::from(STEPS);
            let seen = self.radius(r);
            // NaN, as of a denominator of 0, ends it too.
            if seen.is_nan() || seen <= last {
                return (widest * f64::from(i - 1) / f64::from(STEPS)).powi(2);
            }
            last = seen;
        }
        widest * widest
    }

    /// Radius after the lens of a point at radius `r`, by the radial terms alone; NaN beyond a pole.
    fn radius(&self, r: f64) -> f64 {
        let r2 = r * r;
        let cubic = |a: f64, b: f64, c: f64| 1.0 + r2 * (a + r2 * (b + r2 * c));
        match *self {
            Self::Straight => r,
            Self::PlumbBob([k1, k2, _, _, k3]) | Self::ModifiedBrownConrady([k1, k2, _, _, k3]) => r * cubic(k1, k2, k3),
            Self::RationalPolynomial([k1, k2, _, _, k3, k4, k5, k6, ..]) => {
                let below = cubic(k4, k5, k6);
                if below > 0.0 { r * cubic(k1, k2, k3) / below } else { f64::NAN }
            }
            Self::Equidistant(k) => angle(k, r.atan()),
        }
    }
}

/// Radius in the picture of what is seen θ from the axis.
fn angle([k1, k2, k3, k4]: [f64; 4], theta: f64) -> f64 {
    let t2 = theta * theta;
    theta * (1.0 + t2 * (k1 + t2 * (k2 + t2 * (k3 + t2 * k4))))
}

/// Newton's method for the angle, kept between what is known to be too small and too large.
fn undistort_fisheye(k: [f64; 4], [x, y]: [f64; 2], reach2: f64) -> Option<[f64; 2]> {
    let seen = x.hypot(y);
    let (mut low, mut high) = (0.0, reach2.sqrt().atan());
    // NaN has no inverse.
    if seen.is_nan() || seen > angle(k, high) {
        return None;
    }
    let [k1, k2, k3, k4] = k;
    let mut theta = seen.min(high);
    for _ in 0..100 {
        let off = angle(k, theta) - seen;
        if off.abs() < RESIDUAL {
            break;
        }
        *(if off < 0.0 { &mut low } else { &mut high }) = theta;
        let t2 = theta * theta;
        let slope = 1.0 + t2 * (3.0 * k1 + t2 * (5.0 * k2 + t2 * (7.0 * k3 + t2 * 9.0 * k4)));
        let next = theta - off / slope;
        theta = if next > low && next < high { next } else { 0.5 * (low + high) };
    }
    let scale = if seen < 1e-9 { 1.0 } else { theta.tan() / seen };
    Some([x * scale, y * scale])
}
