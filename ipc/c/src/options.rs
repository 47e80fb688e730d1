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
    /// What it answers, and where the grid lies: a copy.
    pub header: CompletionHeader,
}

// As the static assertions in beo.h.
const _: () = assert!(size_of::<SubscriberOptions>() == 16 && size_of::<ProducerOptions>() == 8);
const _: () = assert!(size_of::<CompletionView>() == 8 + 3 * size_of::<usize>() + 264);
