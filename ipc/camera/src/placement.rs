//! Where the grid of an object lies and how big it is.
//!
//! The rule: z is up; x is the horizontal direction in which the camera looks at the object, so that the camera is on the side of −x. A
//! box along these axes is laid about the object's readings, without the outermost half percent on each side and without readings that
//! have no neighbours (edges). It reaches down to the support plane if the lowest reading is near it, or if what is below the readings is
//! not seen: the sides of dark and glossy things have none. The grid's centre is the box's, and the box's longest side is
//! [`Placement::share`] of the grid's shortest: what is hidden may extend further.

use crate::{Frame, Grid, GridError, Plane, Segments, SensorModel};
use nalgebra::{Isometry3, Matrix3, Point3, Rotation3, Translation3, Unit, UnitQuaternion, Vector3};

/// How a grid is laid about an object.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Placement {
    /// Longest side of the box about what is visible, as a share of the grid's shortest side.
    pub share: f64,
    /// The object's longest side, metres, if it is known: then the grid is as big as it is for training shapes.
    pub known_side_m: Option<f64>,
    /// Fewest readings; 0 counts as 1.
    pub least_readings: usize,
}

impl Default for Placement {
    fn default() -> Self {
        Self { share: 2.0 / 3.0, known_side_m: None, least_readings: 40 }
    }
}

impl Placement {
    /// Longest side of a training shape as a share of its grid.
    pub const CANONICAL_SHARE: f64 = 0.8;
}

/// There is no place for a grid.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum PlacementError {
    /// The object is hardly seen.
    #[error("object {object} has {found} depth readings, at least {least} are needed: is it too small, too far, or out of range?")]
    TooFew {
        /// Label of the object.
        object: u16,
        /// Its readings.
        found: usize,
        /// Fewest readings.
        least: usize,
    },
    /// All readings lie in one point.
    #[error("the readings of object {object} have no extent")]
    NoExtent {
        /// Label of the object.
        object: u16,
    },
    /// The grid is not one.
    #[error(transparent)]
    Grid(#[from] GridError),
}

/// Points that are looked at, at most.
const MOST_POINTS: usize = 4000;
/// Share of the points that is left out at each end of each axis.
const TRIMMED: f64 = 0.005;
/// The box reaches down to the support plane over this, metres, or over this share of its height.
const CONTACT: f64 = 0.02;
const CONTACT_SHARE: f64 = 0.3;

/// Space without readings below the object's own is the object's down to the plane, over this at most, metres.
const MOST_UNSEEN: f64 = 0.35;
/// Readings below which is looked, at most, each at three heights; the least number of pixels without reading there, and their share.
const MOST_DROPPED: usize = 100;
const LEAST_UNSEEN: usize = 20;
const UNSEEN_SHARE: f64 = 0.6;

/// The grid of `dims` voxels for an object, by the rule above.
pub fn place(
    frame: &Frame<'_>,
    object: u16,
    up: &Unit<Vector3<f64>>,
    support: Option<&Plane>,
    sensor: &SensorModel,
    dims: [usize; 3],
    placement: &Placement,
) -> Result<Grid, PlacementError> {
    place_in(frame, &Segments::new(frame), object, up, support, sensor, dims, placement)
}

/// As [`place`], where the frame's segments are at hand: for several objects of one frame.
#[allow(clippy::too_many_arguments)] // those of `place`, and the segments
pub fn place_in(
    frame: &Frame<'_>,
    segments: &Segments,
    object: u16,
    up: &Unit<Vector3<f64>>,
    support: Option<&Plane>,
    sensor: &SensorModel,
    dims: [usize; 3],
    placement: &Placement,
) -> Result<Grid, PlacementError> {
    let pixels = segments.pixels(object);
    let least = placement.least_readings.max(1);
    if pixels.len() < least {
        return Err(PlacementError::TooFew { object, found: pixels.len(), least });
    }
    let stride = pixels.len().div_ceil(MOST_POINTS);
    let points_of = |keep: &dyn Fn(usize) -> bool| -> Vec<Point3<f64>> {
        pixels
            .iter()
            .step_by(stride)
            .map(|pixel| *pixel as usize)
            .filter(|pixel| keep(*pixel))
            .filter_map(|pixel| frame.point(pixel))
            .collect()
    };
    let mut points = points_of(&|pixel| has_neighbours(frame, sensor, pixel));
    if points.len() < least {
        points = points_of(&|_| true);
    }
    let middle = points.iter().fold(Vector3::zeros(), |sum, p| sum + p.coords) / points.len() as f64;
    let axes = axes(up, &middle);
    let [mut low, mut high] = [Vector3::zeros(), Vector3::zeros()];
    let mut along = Vec::with_capacity(points.len());
    for axis in 0..3 {
        let direction = axes.column(axis);
        along.clear();
        along.extend(points.iter().map(|p| direction.dot(&p.coords)));
        [low[axis], high[axis]] = trimmed(&mut along);
    }
    if let Some(plane) = support {
        // Up need not be the plane's normal: its height where the object stands.
        let foot = Point3::from(axes * Vector3::new((low.x + high.x) / 2.0, (low.y + high.y) / 2.0, low.z));
        let gap = plane.height(&foot) / plane.normal().dot(up).max(0.1);
        if gap <= CONTACT.max(CONTACT_SHARE * (high.z - low.z)) || gap <= MOST_UNSEEN && is_unseen_below(frame, object, &points, up, plane)
        {
            low.z = (low.z - gap).min(high.z);
        }
    }
    let longest = (high - low).max();
    if longest.is_nan() || longest <= 0.0 {
        return Err(PlacementError::NoExtent { object });
    }
    let shortest_side = dims.into_iter().min().unwrap_or(1) as f64;
    let voxel = match placement.known_side_m {
        Some(side) => side / (Placement::CANONICAL_SHARE * shortest_side),
        None => longest / (placement.share * shortest_side),
    };
    let centre = axes * ((low + high) / 2.0);
    let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(axes));
    Ok(Grid::new(dims, voxel, Isometry3::from_parts(Translation3::from(centre), rotation))?)
}

/// Whether most of what is between an object's readings and the plane below them has no reading, and so does not float.
fn is_unseen_below(frame: &Frame<'_>, object: u16, points: &[Point3<f64>], up: &Unit<Vector3<f64>>, plane: &Plane) -> bool {
    let (mut unseen, mut seen) = (0_usize, 0_usize);
    for point in points.iter().step_by(points.len().div_ceil(MOST_DROPPED).max(1)) {
        let height = plane.height(point) / plane.normal().dot(up).max(0.1);
        for share in [0.25, 0.5, 0.75] {
            let below = point - up.into_inner() * (share * height);
            let Some(pixel) = frame.intrinsics().project(&below).and_then(|at| frame.intrinsics().pixel(at)) else { continue };
            match frame.depth(pixel) {
                None => unseen += 1,
                // Behind the object itself nothing can be seen.
                Some(_) => seen += usize::from(frame.label(pixel) != object),
            }
        }
    }
    unseen >= LEAST_UNSEEN && unseen as f64 >= UNSEEN_SHARE * (unseen + seen) as f64
}

/// Grid axes as columns, in the camera frame, for an object at `middle`.
fn axes(up: &Unit<Vector3<f64>>, middle: &Vector3<f64>) -> Matrix3<f64> {
    let horizontal = |direction: &Vector3<f64>| direction - up.into_inner() * up.dot(direction);
    // Seen from straight above, the horizontal direction of looking says nothing: then x is up in the image.
    let away = horizontal(&middle.normalize());
    let x = if away.norm() > 0.05 { away } else { horizontal(&-Vector3::y()) };
    let x = x.try_normalize(1e-9).unwrap_or_else(|| horizontal(&Vector3::x()).normalize());
    Matrix3::from_columns(&[x, up.cross(&x), up.into_inner()])
}

/// Whether two of a pixel's four neighbours belong to the same object and are about as far away.
fn has_neighbours(frame: &Frame<'_>, sensor: &SensorModel, pixel: usize) -> bool {
    let width = frame.intrinsics().width() as usize;
    let (column, depth) = (pixel % width, frame.depth(pixel).unwrap_or(0.0));
    let beside = [
        (column > 0).then(|| pixel - 1),
        (column + 1 < width).then_some(pixel + 1),
        pixel.checked_sub(width),
        Some(pixel + width).filter(|below| *below < frame.labels().len()),
    ];
    let near = 0.01_f64.max(6.0 * sensor.deviation(depth));
    let alike =
        |other: &usize| frame.label(*other) == frame.label(pixel) && frame.depth(*other).is_some_and(|other| (other - depth).abs() < near);
    beside.iter().flatten().filter(|other| alike(other)).count() >= 2
}

/// Lower and upper end of the values, without the outermost on both sides.
fn trimmed(values: &mut [f64]) -> [f64; 2] {
    let left_out = (TRIMMED * values.len() as f64) as usize;
    let last = values.len() - 1 - left_out;
    let (_, low, _) = values.select_nth_unstable_by(left_out, f64::total_cmp);
    let low = *low;
    let (_, high, _) = values.select_nth_unstable_by(last, f64::total_cmp);
    [low, *high]
}
