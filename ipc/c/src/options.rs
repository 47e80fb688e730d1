//! The structs of the interface that are not messages. The first field of each is its size in bytes, set by the caller: so a later version
//! can tell which version of the struct it was given.

use beo_ipc::CompletionHeader;

/// How to subscribe. Start from `BEO_SUBSCRIBER_OPTIONS_INIT`.
#[derive(Debug, Clone, Copy)]
#[repr(C)]
pub struct SubscriberOptions {
    /// `sizeof(beo_subscriber_options)`.
    pub size: u32,
    /// 1: completions too; 0: without them, and the big segment is never mapped. Default: 0.
    pub completion: u32,
    /// How long opening waits for the daemon, milliseconds; negative: without end. Default: 0.
    pub wait_ms: i32,
    /// 0.
    pub reserved: u32,
}

/// How to open a producer. Start from `BEO_PRODUCER_OPTIONS_INIT`.
#[derive(Debug, Clone, Copy)]
#[repr(C)]
pub struct ProducerOptions {
    /// `sizeof(beo_producer_options)`.
    pub size: u32,
    /// How long opening waits for the daemon, milliseconds; negative: without end. Default: 0.
    pub wait_ms: i32,
}

/// A completed grid where it lies in shared memory; valid until its `beo_completion` is released. Start from `BEO_COMPLETION_VIEW_INIT`.
#[derive(Debug, Clone, Copy)]
#[repr(C)]
pub struct CompletionView {
    /// `sizeof(beo_completion_view)`.
    pub size: u32,
    /// 0.
    pub reserved: u32,
    /// Voxels of the grid, and bytes of each of the two arrays.
    pub voxel_count: usize,
    /// Probability of being filled × 255, one byte per voxel, C order `[x][y][z]`.
    pub occupancy: *const u8,
    /// Standard deviation of that probability × 255, one byte per voxel, in the same order.
    pub deviation: *const u8,
    /// The observation that it answers, and where the grid lies: a copy.
    pub header: CompletionHeader,
}

/// A pinhole camera with lens distortion, as ROS's `camera_info` with `plumb_bob` describes it. The camera frame is the optical one: x
/// right, y down, z along the optical axis; pixels count from the centre of the first.
#[derive(Debug, Clone, Copy)]
#[repr(C)]
pub struct CameraIntrinsics {
    /// Pixels of a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Focal length along rows, pixels.
    pub fx: f64,
    /// Focal length along columns, pixels.
    pub fy: f64,
    /// Column of the principal point, pixels.
    pub cx: f64,
    /// Row of the principal point, pixels.
    pub cy: f64,
    /// k1, k2, p1, p2, k3; all 0 for none.
    pub distortion: [f64; 5],
}

/// One depth image and which object each of its pixels belongs to, both row by row. Start from `BEO_DEPTH_FRAME_INIT`.
#[derive(Debug, Clone, Copy)]
#[repr(C)]
pub struct DepthFrame {
    /// `sizeof(beo_depth_frame)`.
    pub size: u32,
    /// 0.
    pub reserved: u32,
    /// The camera.
    pub intrinsics: CameraIntrinsics,
    /// Depth along the optical axis, metres; 0, negative or not finite: no reading. See `beo_depth_from_u16` for sensors of integers.
    pub depth_m: *const f32,
    /// Readings at `depth_m`: width × height.
    pub depth_count: usize,
    /// Label of the object that each pixel belongs to; 0: none.
    pub labels: *const u16,
    /// Labels at `labels`: width × height.
    pub label_count: usize,
}

/// How far readings may be from the surface: σ(z) = constant_m + quadratic_per_m · z², metres. A voxel within `deviations` of it from the
/// surface is filled; that band is never thinner than the voxel.
#[derive(Debug, Clone, Copy)]
#[repr(C)]
pub struct DepthSensor {
    /// Standard deviation at depth 0, metres. Default: 0.001.
    pub constant_m: f64,
    /// Its growth with the squared depth, 1 / metres: 0.0019 for the first Kinect. Default: that.
    pub quadratic_per_m: f64,
    /// Half the width of the band, in standard deviations. Default: 2.
    pub deviations: f64,
}

/// How a depth frame is looked at. Start from `BEO_CAMERA_OPTIONS_INIT`.
#[derive(Debug, Clone, Copy)]
#[repr(C)]
pub struct CameraOptions {
    /// `sizeof(beo_camera_options)`.
    pub size: u32,
    /// Pixels with this label are the support's, at most 65535; 0: those that belong to no object. Default: 0.
    pub support_label: u32,
    /// The sensor.
    pub sensor: DepthSensor,
    /// The direction up in the camera frame, of any length, where it is known (an accelerometer at rest points there); 0, 0, 0 where it is
    /// not: then the support plane says so. Default: that.
    pub up: [f64; 3],
    /// Longest side of what is visible of an object, as a share of its grid's shortest side, above 0 and at most 1. Default: 2 / 3.
    pub share: f64,
    /// The object's longest side, metres, where it is known; 0 where it is not. Default: 0.
    pub known_side_m: f64,
    /// Its standard deviation, metres; 0: exact. Default: 0.
    pub known_side_deviation_m: f64,
    /// Fewest readings of an object for which a grid is laid. Default: 40.
    pub least_readings: u32,
    /// 0.
    pub reserved: u32,
}

/// A plane in the camera frame: what objects stand on.
#[derive(Debug, Clone, Copy)]
#[repr(C)]
pub struct SupportPlane {
    /// Unit normal, to the side where objects are: up.
    pub normal: [f64; 3],
    /// A point p is at the height normal · p + offset_m: of a support plane, how far the camera is above it. Metres.
    pub offset_m: f64,
}

/// Where a grid lies in the camera frame: its own frame has its origin at the grid's centre, axes along the indices, z up. And what is
/// known of the readings that it is carved from.
#[derive(Debug, Clone, Copy)]
#[repr(C)]
pub struct PlacedGrid {
    /// Voxels along x, y, z.
    pub dims: [u32; 3],
    /// The causes that cut the object off: bits of `BEO_CUT_…`; 0: it is seen whole, or nothing is said.
    pub cut: u32,
    /// Edge of a voxel, metres.
    pub voxel_size_m: f64,
    /// The grid's centre, metres.
    pub position_m: [f64; 3],
    /// Turns grid axes into axes of the camera: unit quaternion x, y, z, w.
    pub orientation: [f64; 4],
    /// Share of the object's labelled readings that were left out because they are the support's, 0 to 1.
    pub share_support: f64,
    /// Share that was left out because it lies at an edge in depth, 0 to 1.
    pub share_edge: f64,
    /// Share that was left out because it does not hang together with the object, 0 to 1.
    pub share_far: f64,
    /// Standard deviation of the surface's position along the line of sight, metres; 0 where it is not said.
    pub surface_deviation_m: f64,
}

// As the static assertions in beo.h.
const _: () = assert!(size_of::<SubscriberOptions>() == 16 && size_of::<ProducerOptions>() == 8);
const _: () = assert!(size_of::<CompletionView>() == 8 + 3 * size_of::<usize>() + 288);
const _: () = assert!(size_of::<CameraIntrinsics>() == 80 && size_of::<DepthFrame>() == 88 + 4 * size_of::<usize>());
const _: () = assert!(size_of::<CameraOptions>() == 88 && size_of::<SupportPlane>() == 32 && size_of::<PlacedGrid>() == 112);
