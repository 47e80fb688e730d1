use super::*;
use crate::common::beo_last_error;
use crate::options::{CameraIntrinsics, DepthSensor};
use crate::pointers::text_of;
use std::ptr::{null, null_mut};

const WIDTH: usize = 320;
const HEIGHT: usize = 240;
const PIXELS: usize = WIDTH * HEIGHT;

const INTRINSICS: CameraIntrinsics =
    CameraIntrinsics { width: WIDTH as u32, height: HEIGHT as u32, fx: 277.0, fy: 277.0, cx: 160.3, cy: 119.1, distortion: [0.0; 5] };

/// How far down the camera looks, radians.
const PITCH_RAD: f64 = 0.55;

fn up() -> Vector3<f64> {
    Vector3::new(0.0, -PITCH_RAD.cos(), -PITCH_RAD.sin())
}

/// Two blocks on a plane 0.4 m below the camera, ray by ray: depth in steps of a millimetre, and which block each pixel shows.
fn two_blocks() -> (Vec<f32>, Vec<u16>) {
    let (up, right) = (up(), Vector3::x());
    let ahead = Vector3::new(0.0, -PITCH_RAD.sin(), PITCH_RAD.cos());
    // Half sides; where the middle of the foot is, to the right and ahead; turned about the vertical by, radians.
    let blocks = [([0.035, 0.05, 0.07], [-0.09, 0.55], 0.4_f64), ([0.06, 0.03, 0.025], [0.08, 0.62], -0.5)];
    (0..PIXELS)
        .map(|pixel| {
            let (u, v) = ((pixel % WIDTH) as f64, (pixel / WIDTH) as f64);
            let ray = Vector3::new((u - INTRINSICS.cx) / INTRINSICS.fx, (v - INTRINSICS.cy) / INTRINSICS.fy, 1.0);
            let table = -0.4 / up.dot(&ray);
            let mut shown = (if table > 0.0 && table < 5.0 { table } else { 0.0 }, 0);
            for (number, (half, [x, y], turned)) in blocks.iter().enumerate() {
                let centre = right * *x + ahead * *y + up * (half[2] - 0.4);
                let (mut enter, mut leave) = (0.0_f64, 10.0_f64);
                let axes = [right * turned.cos() + ahead * turned.sin(), ahead * turned.cos() - right * turned.sin(), up];
                for (axis, half) in axes.iter().zip(half) {
                    let along = axis.dot(&ray);
                    let (middle, width) = (axis.dot(&centre) / along, half / along.abs());
                    (enter, leave) = (enter.max(middle - width), leave.min(middle + width));
                }
                if enter < leave && (shown.1 == 0 || enter < shown.0) {
                    shown = (enter, number as u16 + 1);
                }
            }
            ((0.001 * (1000.0 * shown.0).round()) as f32, shown.1)
        })
        .unzip()
}

/// A frame without labels.
fn frame(depth: &[f32]) -> DepthFrame {
    DepthFrame {
        size: size_of::<DepthFrame>() as u32,
        reserved: 0,
        intrinsics: INTRINSICS,
        depth_m: depth.as_ptr(),
        depth_count: depth.len(),
        labels: null(),
        label_count: 0,
    }
}

/// As `BEO_CAMERA_OPTIONS_INIT`.
fn options() -> CameraOptions {
    CameraOptions {
        size: size_of::<CameraOptions>() as u32,
        support_label: 0,
        sensor: DepthSensor { constant_m: 0.001, quadratic_per_m: 0.0019, deviations: 2.0 },
        up: [0.0; 3],
        share: 2.0 / 3.0,
        known_side_m: 0.0,
        known_side_deviation_m: 0.0,
        least_readings: 40,
        reserved: 0,
    }
}

/// Memory that shows whether it was written to.
const UNTOUCHED: u16 = 54321;

fn segment(depth: &[f32], options: *const CameraOptions) -> (Outcome, Vec<u16>, u32) {
    let (mut labels, mut count) = (vec![UNTOUCHED; PIXELS], 99);
    // SAFETY: all that is pointed to lives here, with the lengths that are said.
    let outcome = unsafe { beo_segment_table(&frame(depth), options, labels.as_mut_ptr(), labels.len(), &mut count) };
    (outcome, labels, count)
}

/// Intersection over union of two labels of two images.
fn overlap(a: &[u16], of_a: u16, b: &[u16], of_b: u16) -> f64 {
    let count = |test: &dyn Fn(bool, bool) -> bool| a.iter().zip(b).filter(|(a, b)| test(**a == of_a, **b == of_b)).count() as f64;
    count(&|a, b| a && b) / count(&|a, b| a || b)
}

#[test]
fn two_blocks_on_a_table_are_two_labels() {
    let (depth, truth) = two_blocks();
    assert!((1..=2).all(|block| truth.iter().filter(|label| **label == block).count() > 1000), "both blocks are seen");
    let told = CameraOptions { up: (up() * 9.81).into(), ..options() };
    for options in [null(), &raw const told] {
        let (outcome, labels, count) = segment(&depth, options);
        assert_eq!((outcome, count), (Outcome::Ok, 2));
        let best = [1, 2].map(|block| [1, 2].map(|label| overlap(&truth, block, &labels, label)).into_iter().fold(0.0, f64::max));
        assert!(best.iter().all(|iou| *iou > 0.9), "{best:?}");
        assert!(labels.iter().all(|label| *label <= 2), "no other numbers");
        assert_eq!(segment(&depth, options).1, labels, "the same frame gives the same labels");
    }
}

#[test]
fn a_frame_without_objects_is_no_error() {
    let (mut depth, truth) = two_blocks();
    depth.iter_mut().zip(&truth).filter(|(_, label)| **label != 0).for_each(|(depth, _)| *depth = 0.0);
    assert_eq!(segment(&depth, null()), (Outcome::Ok, vec![0; PIXELS], 0), "a bare table");
    for nothing in [0.0, -1.0, f32::NAN, f32::INFINITY] {
        assert_eq!(segment(&[nothing; PIXELS], null()), (Outcome::Ok, vec![0; PIXELS], 0), "{nothing}");
    }
}

#[test]
fn labels_may_be_those_of_the_frame_and_go_on_to_the_support() {
    let (depth, truth) = two_blocks();
    let mut labels = vec![UNTOUCHED; PIXELS];
    let at = labels.as_mut_ptr();
    let frame = DepthFrame { labels: at, label_count: PIXELS, ..frame(&depth) };
    let (mut count, mut plane) = (0, SupportPlane { normal: [0.0; 3], offset_m: 0.0 });
    // SAFETY: all that is pointed to lives here, with the lengths that are said, and is reached by one pointer.
    unsafe {
        assert_eq!(beo_segment_table(&frame, null(), at, PIXELS, &mut count), Outcome::Ok);
        assert_eq!(beo_fit_support(&frame, null(), &mut plane), Outcome::Ok);
    }
    assert!((plane.offset_m - 0.4).abs() < 0.002, "{plane:?}");
    assert!(Vector3::from(plane.normal).angle(&up()) < 0.01, "{plane:?}");
    assert!(overlap(&truth, 0, &labels, 0) > 0.9);
}

#[test]
fn misuse_is_told_and_nothing_is_written() {
    let (depth, _) = two_blocks();
    let good = frame(&depth);
    let mut labels = vec![UNTOUCHED; PIXELS];
    let mut count = 99;
    let mut refuses = |frame: *const DepthFrame, options: *const CameraOptions, at: Option<*mut u16>, len: usize, outcome, told: &str| {
        // SAFETY: NULL, or what lives here with at least the lengths that are said, or lengths and pointers that are refused unread.
        let given = unsafe { beo_segment_table(frame, options, at.unwrap_or(labels.as_mut_ptr()), len, &mut count) };
        assert_eq!(given, outcome, "{told}");
        let text = text_of(beo_last_error());
        assert!(text.contains(told), "{text}");
        assert!(count == 99 && labels.iter().all(|label| *label == UNTOUCHED), "{told}");
    };
    let null_frame = DepthFrame { depth_m: null(), ..good };
    let short = DepthFrame { depth_count: PIXELS - 1, ..good };
    let wrong_size = DepthFrame { size: 8, ..good };
    let reserved = DepthFrame { reserved: 1, ..good };
    let no_camera = DepthFrame { intrinsics: CameraIntrinsics { fx: 0.0, ..INTRINSICS }, ..good };
    let endless = DepthFrame { depth_count: usize::MAX, ..good };
    let odd = DepthFrame { depth_m: depth.as_ptr().cast::<u8>().wrapping_add(1).cast(), ..good };
    refuses(null(), null(), None, PIXELS, Outcome::InvalidArgument, "`frame` is NULL");
    refuses(&null_frame, null(), None, PIXELS, Outcome::InvalidArgument, "`frame.depth_m` is NULL");
    refuses(&good, null(), Some(null_mut()), PIXELS, Outcome::InvalidArgument, "`labels` is NULL");
    refuses(&good, null(), None, PIXELS - 1, Outcome::WrongSize, "label image has 76799 pixels");
    refuses(&good, null(), None, 0, Outcome::WrongSize, "label image has 0 pixels");
    refuses(&good, null(), None, usize::MAX, Outcome::WrongSize, "`labels` has");
    refuses(&short, null(), None, PIXELS, Outcome::WrongSize, "depth image has 76799 pixels");
    refuses(&endless, null(), None, PIXELS, Outcome::WrongSize, "`frame.depth_m` has");
    refuses(&odd, null(), None, PIXELS, Outcome::InvalidArgument, "aligned");
    refuses(&wrong_size, null(), None, PIXELS, Outcome::WrongSize, "`frame`.size is 8");
    refuses(&reserved, null(), None, PIXELS, Outcome::InvalidArgument, "frame.reserved");
    refuses(&no_camera, null(), None, PIXELS, Outcome::InvalidArgument, "focal");
    let sensor = CameraOptions { sensor: DepthSensor { constant_m: -1.0, ..options().sensor }, ..options() };
    let no_up = CameraOptions { up: [f64::NAN, 0.0, 0.0], ..options() };
    let wrong_size = CameraOptions { size: 8, ..options() };
    refuses(&good, &sensor, None, PIXELS, Outcome::InvalidArgument, "-1");
    refuses(&good, &no_up, None, PIXELS, Outcome::InvalidArgument, "`options.up`");
    refuses(&good, &wrong_size, None, PIXELS, Outcome::WrongSize, "`options`.size is 8");
    // SAFETY: as above; `object_count` is NULL.
    let given = unsafe { beo_segment_table(&good, null(), labels.as_mut_ptr(), PIXELS, null_mut()) };
    assert_eq!(given, Outcome::InvalidArgument);
    assert!(text_of(beo_last_error()).contains("`object_count` is NULL"));
    assert!(labels.iter().all(|label| *label == UNTOUCHED));
}

#[test]
fn odd_cameras_and_options_never_fault() {
    for (width, height) in [(1, 1), (1, 9), (9, 1), (2, 3), (24, 16), (64, 48)] {
        let depth: Vec<f32> = (0..width * height).map(|i| [0.9, 0.9, 0.8, f32::NAN, 1e-30, 3e38, -1.0][i * i % 7]).collect();
        for [fx, fy, cx] in [[20.0, 20.0, 5.0], [1e-9, 1e-9, 0.0], [1e12, 1e12, 0.0], [1e-300, 1e300, 1e300]] {
            for up in [[0.0; 3], [0.0, -1.0, 0.0], [1e-300, 0.0, 0.0], [1e300, 1e300, -1e300]] {
                for constant_m in [0.0, 0.001, 1e30] {
                    let camera = CameraIntrinsics { width: width as u32, height: height as u32, fx, fy, cx, ..INTRINSICS };
                    let frame = DepthFrame { intrinsics: camera, ..frame(&depth) };
                    let sensor = DepthSensor { constant_m, ..options().sensor };
                    let (mut labels, mut count) = (vec![UNTOUCHED; depth.len()], 0);
                    let options = CameraOptions { up, sensor, ..options() };
                    // SAFETY: all that is pointed to lives here, with the lengths that are said.
                    let outcome = unsafe { beo_segment_table(&frame, &options, labels.as_mut_ptr(), labels.len(), &mut count) };
                    let told = text_of(beo_last_error());
                    assert_ne!(outcome, Outcome::Internal, "{width} × {height}, {fx} {fy} {cx}, {up:?}, {constant_m}: {told}");
                    assert!(outcome != Outcome::Ok || labels.iter().all(|label| u32::from(*label) <= count), "{outcome:?}");
                }
            }
        }
    }
}
