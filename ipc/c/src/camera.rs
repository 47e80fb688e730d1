//! From a depth frame to the grid of an object and the header that goes with it. No handles, no shared memory: the numbers of the crate
//! `beo-camera`, which says what the rules are.

#![allow(unsafe_code)] // exported names, and pointers of the caller's

use crate::options::{CameraOptions, DepthFrame, PlacedGrid, SupportPlane};
use crate::outcome::{Failure, Outcome, guard};
use crate::pointers::{must_not_be_null, numbers, numbers_mut, read, read_sized, store};
use beo_camera::{Carver, Frame, Grid, Intrinsics, Placement, Plane, PlaneSearch, SensorModel, fit_support, place};
use beo_ipc::{CarvedGrid, ObservationHeader};
use nalgebra::{Isometry3, Point3, Quaternion, Translation3, Unit, UnitQuaternion, Vector3};

/// Turns a depth image of integers into metres: `depth_m[i]` = `depth[i]` × `scale_m`, which is 0.001 for millimetres. 0 stays 0: no
/// reading. Once per frame, before the calls below.
///
/// # Safety
/// `depth` is NULL or has `count` readable numbers; `depth_m` is NULL or has `count` writable ones, somewhere else.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn beo_depth_from_u16(depth: *const u16, count: usize, scale_m: f64, depth_m: *mut f32) -> Outcome {
    guard(|| {
        if !(scale_m.is_finite() && scale_m > 0.0) {
            return Err(invalid(format!("`scale_m` is {scale_m}: it must be positive and finite, 0.001 for millimetres")));
        }
        // SAFETY: NULL, or as many readable and writable numbers as the caller promises.
        let (depth, metres) = unsafe { (numbers(depth, count, "depth")?, numbers_mut(depth_m, count, "depth_m")?) };
        metres.iter_mut().zip(depth).for_each(|(metres, depth)| *metres = (f64::from(*depth) * scale_m) as f32);
        Ok(Outcome::Ok)
    })
}

/// Finds the plane that objects stand on, and stores it in `*plane`: the one with the most readings among the pixels of
/// `options.support_label`, its normal within 15° of `options.up`; without that, the camera is taken to be upright and to look down on it.
/// The same frame gives the same plane. `options` may be NULL for the defaults.
///
/// `BEO_STATUS_NOT_SEEN` if there is none: try the next frame, or use a plane that you know.
///
/// # Safety
/// `frame` and `options` are NULL or readable for their `size`, and what the frame points to for as many values as it says; `plane` is
/// NULL or writable.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn beo_fit_support(frame: *const DepthFrame, options: *const CameraOptions, plane: *mut SupportPlane) -> Outcome {
    guard(|| {
        must_not_be_null(plane, "plane")?;
        // SAFETY: as the caller promises.
        let (options, frame) = unsafe { (Options::read(options)?, Images::read(frame)?) };
        let search = PlaneSearch { label: Some(options.support_label), up: options.up, sensor: options.sensor };
        let found = fit_support(&frame.frame()?, &search).ok_or_else(|| {
            let message = format!(
                "the pixels with label {} show no plane that objects could stand on: is the table in the image, and is `options.up` right?",
                options.support_label
            );
            Failure::new(Outcome::NotSeen, message)
        })?;
        let found = SupportPlane { normal: found.normal().into_inner().into(), offset_m: found.height(&Point3::origin()) };
        // SAFETY: writable, as the caller promises.
        unsafe { store(plane, found) };
        Ok(Outcome::Ok)
    })
}

/// Lays a grid of nx × ny × nz voxels about the pixels that are labelled `object`, and stores where it lies in `*grid`: upright, x away
/// from the camera, its centre that of the box about the readings, which reaches down to the support plane if they end near it. Its size
/// is by `options.share`, or by `options.known_side_m`. `options` may be NULL for the defaults; `support` may be NULL if there is none and
/// `options.up` says what is up.
///
/// `BEO_STATUS_NOT_SEEN` if the object has too few readings: leave it out of this frame. `BEO_STATUS_BAD_DIMS` as for a producer.
///
/// # Safety
/// `frame` and `options` are NULL or readable for their `size`, and what the frame points to for as many values as it says; `support` is
/// NULL or readable; `grid` is NULL or writable.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn beo_place_grid(
    frame: *const DepthFrame,
    options: *const CameraOptions,
    object: u16,
    support: *const SupportPlane,
    nx: u32,
    ny: u32,
    nz: u32,
    grid: *mut PlacedGrid,
) -> Outcome {
    guard(|| {
        must_not_be_null(grid, "grid")?;
        // SAFETY: as the caller promises.
        let (options, frame, support) = unsafe { (Options::read(options)?, Images::read(frame)?, plane(support)?) };
        let up = options
            .up
            .or(support.map(|plane| plane.normal()))
            .ok_or_else(|| invalid("nothing says what is up: give `support`, as beo_fit_support finds it, or set `options.up`"))?;
        let dims = [nx, ny, nz].map(|side| side as usize);
        let laid = place(&frame.frame()?, object, &up, support.as_ref(), &options.sensor, dims, &options.placement)?;
        let Isometry3 { rotation, translation } = laid.grid_to_camera();
        let laid = PlacedGrid {
            dims: [nx, ny, nz],
            cut: 0,
            voxel_size_m: laid.voxel_size_m(),
            position_m: translation.vector.into(),
            orientation: rotation.coords.into(),
            share_support: 0.0,
            share_edge: 0.0,
            share_far: 0.0,
            surface_deviation_m: 0.0,
        };
        // SAFETY: writable, as the caller promises.
        unsafe { store(grid, laid) };
        Ok(Outcome::Ok)
    })
}

/// Writes all `voxel_count` voxels of a grid, those of a loan, say: 0 empty, in front of the measured surface; 1 filled, within the
/// sensor's band of it at a pixel of `object`; 255 unknown, behind it, hidden, without reading or not in the image. With a `support`, what
/// lies below it is empty; it may be NULL, as may `options` for the defaults.
///
/// `BEO_STATUS_WRONG_SIZE` if `voxel_count` is not what the grid's dims say.
///
/// # Safety
/// `frame` and `options` are NULL or readable for their `size`, and what the frame points to for as many values as it says; `support` and
/// `grid` are NULL or readable; `voxels` is NULL or has `voxel_count` writable bytes.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn beo_carve(
    frame: *const DepthFrame,
    options: *const CameraOptions,
    object: u16,
    support: *const SupportPlane,
    grid: *const PlacedGrid,
    voxels: *mut u8,
    voxel_count: usize,
) -> Outcome {
    guard(|| {
        // SAFETY: as the caller promises.
        let (options, frame, support, grid, voxels) = unsafe {
            (Options::read(options)?, Images::read(frame)?, plane(support)?, placed(grid)?, numbers_mut(voxels, voxel_count, "voxels")?)
        };
        Carver { frame: frame.frame()?, object, sensor: options.sensor, support, grid }.carve(voxels)?;
        Ok(Outcome::Ok)
    })
}

/// Fills in `header` for a grid that was carved from a camera's frame: where it lies, in metres in the frame named "camera"; where the
/// camera is; what `grid` says of its readings; size, place, and rotation about the vertical to be found, in class, pose and completion;
/// outside of the grid unknown. `options.known_side_m` and `options.known_side_deviation_m` go with it. `options` may be NULL for the defaults. `object_id` and the rest are then the caller's to set.
///
/// # Safety
/// `grid` is NULL or readable; `options` is NULL or readable for its `size`; `header` is NULL or writable.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn beo_observation_header_of_grid(
    grid: *const PlacedGrid,
    options: *const CameraOptions,
    header: *mut ObservationHeader,
) -> Outcome {
    guard(|| {
        must_not_be_null(header, "header")?;
        // SAFETY: as the caller promises.
        let (options, said, placed) = unsafe { (Options::read(options)?, read(grid, "grid")?, placed(grid)?) };
        let filled = ObservationHeader::of_grid(&CarvedGrid {
            cut: said.cut,
            share_support: said.share_support,
            share_edge: said.share_edge,
            share_far: said.share_far,
            surface_deviation_m: said.surface_deviation_m,
            known_side_m: options.placement.known_side_m.unwrap_or(0.0),
            known_side_deviation_m: options.known_side_deviation_m,
            ..CarvedGrid::from(&placed)
        })?;
        // SAFETY: writable, as the caller promises.
        unsafe { store(header, filled) };
        Ok(Outcome::Ok)
    })
}

fn invalid(message: impl Into<String>) -> Failure {
    Failure::new(Outcome::InvalidArgument, message)
}

/// The caller's options after they have been checked.
struct Options {
    support_label: u16,
    sensor: SensorModel,
    up: Option<Unit<Vector3<f64>>>,
    placement: Placement,
    known_side_deviation_m: f64,
}

impl Options {
    /// # Safety
    /// `options` is NULL or readable for its `size`.
    unsafe fn read(options: *const CameraOptions) -> Result<Self, Failure> {
        if options.is_null() {
            let (sensor, placement) = (SensorModel::default(), Placement::default());
            return Ok(Self { support_label: 0, sensor, up: None, placement, known_side_deviation_m: 0.0 });
        }
        // SAFETY: readable for its size, as promised.
        let given = unsafe { read_sized(options, "options") }?;
        let support_label = u16::try_from(given.support_label)
            .map_err(|_| invalid(format!("`options.support_label` is {}: labels end at 65535", given.support_label)))?;
        let sensor = SensorModel::new(given.sensor.constant_m, given.sensor.quadratic_per_m, given.sensor.deviations)?;
        let up = Vector3::from(given.up);
        let up = match up.amax() {
            0.0 => None,
            // Scaled first: the squares of huge and tiny numbers are no numbers.
            largest if up.iter().all(|value| value.is_finite()) => Some(Unit::new_normalize(up / largest)),
            _ => return Err(invalid(format!("`options.up` is {:?}: it must be finite, or 0, 0, 0 if it is not known", given.up))),
        };
        if !(given.share > 0.0 && given.share <= 1.0) {
            return Err(invalid(format!("`options.share` is {}: it must be above 0 and at most 1", given.share)));
        }
        if !(given.known_side_m >= 0.0 && given.known_side_m.is_finite()) {
            return Err(invalid(format!("`options.known_side_m` is {}: it must be positive and finite, or 0", given.known_side_m)));
        }
        if !(given.known_side_deviation_m >= 0.0 && given.known_side_deviation_m.is_finite()) {
            let deviation = given.known_side_deviation_m;
            return Err(invalid(format!(
                "`options.known_side_deviation_m` is {deviation}: it must be finite and not negative, 0 for exact"
            )));
        }
        if given.reserved != 0 {
            return Err(invalid("`options.reserved` is not 0: start from BEO_CAMERA_OPTIONS_INIT"));
        }
        let placement = Placement {
            share: given.share,
            known_side_m: (given.known_side_m > 0.0).then_some(given.known_side_m),
            least_readings: given.least_readings as usize,
        };
        Ok(Self { support_label, sensor, up, placement, known_side_deviation_m: given.known_side_deviation_m })
    }
}

/// The caller's images.
struct Images<'a> {
    intrinsics: Intrinsics,
    depth: &'a [f32],
    labels: &'a [u16],
}

impl Images<'_> {
    /// # Safety
    /// `frame` is NULL or readable for its `size`; its images are NULL or have as many readable values as it says, unchanged as long as
    /// the result is used.
    unsafe fn read(frame: *const DepthFrame) -> Result<Self, Failure> {
        // SAFETY: readable for its size, as promised.
        let given = unsafe { read_sized(frame, "frame") }?;
        if given.reserved != 0 {
            return Err(invalid("`frame.reserved` is not 0: start from BEO_DEPTH_FRAME_INIT"));
        }
        let camera = given.intrinsics;
        let intrinsics = Intrinsics::new(camera.width, camera.height, [camera.fx, camera.fy], [camera.cx, camera.cy], camera.distortion)?;
        // SAFETY: NULL, or as many readable numbers as the frame says, as promised.
        let (depth, labels) = unsafe {
            (numbers(given.depth_m, given.depth_count, "frame.depth_m")?, numbers(given.labels, given.label_count, "frame.labels")?)
        };
        Ok(Self { intrinsics, depth, labels })
    }

    fn frame(&self) -> Result<Frame<'_>, Failure> {
        Ok(Frame::new(&self.intrinsics, self.depth, self.labels)?)
    }
}

/// How far the length of a unit normal or quaternion may be from 1.
const NEARLY_UNIT: f64 = 1e-3;

/// The caller's plane; `None` for NULL.
///
/// # Safety
/// `support` is NULL or readable.
unsafe fn plane(support: *const SupportPlane) -> Result<Option<Plane>, Failure> {
    if support.is_null() {
        return Ok(None);
    }
    // SAFETY: readable, as promised.
    let given = unsafe { read(support, "support") }?;
    let normal = Vector3::from(given.normal);
    let is_unit = (normal.norm() - 1.0).abs() <= NEARLY_UNIT;
    if !(is_unit && given.offset_m.is_finite()) {
        return Err(invalid(format!("`support` is not a plane: its normal is {:?}, its offset {} m", given.normal, given.offset_m)));
    }
    let normal = Unit::new_normalize(normal);
    Ok(Some(Plane::new(normal, &Point3::from(normal.into_inner() * -given.offset_m))))
}

/// The caller's grid.
///
/// # Safety
/// `grid` is NULL or readable.
unsafe fn placed(grid: *const PlacedGrid) -> Result<Grid, Failure> {
    // SAFETY: readable, as promised.
    let given = unsafe { read(grid, "grid") }?;
    let orientation = Quaternion::from(given.orientation);
    let is_unit = (orientation.norm() - 1.0).abs() <= NEARLY_UNIT;
    if !is_unit {
        return Err(invalid(format!("`grid.orientation` is {:?}: it must be a unit quaternion x, y, z, w", given.orientation)));
    }
    let place = Isometry3::from_parts(Translation3::from(given.position_m), UnitQuaternion::new_normalize(orientation));
    Ok(Grid::new(given.dims.map(|side| side as usize), given.voxel_size_m, place)?)
}
