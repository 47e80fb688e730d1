//! Where grids go: the interface between the replay, which lays them, and the daemon or the folder that takes them.

use crate::cli::failure::Failure;
use beo_camera::{Carver, FrameGrids, Quality};
use beo_picture::Image;

/// The destinations of grids: the daemon, files, or pictures.
pub(super) trait Sink {
    /// A frame was taken apart, and its grids follow.
    fn segmented(&mut self, of: &Shown<'_>, grids: &FrameGrids) -> Result<(), Failure>;
    /// Carves it into its place, lets `finish` change it, and passes it on.
    fn take(&mut self, of: &Shown<'_>, carver: &Carver<'_>, observed: &Observed, finish: &mut Finish<'_>) -> Result<(), Failure>;
    /// A frame can be drawn, for those who look on.
    fn show<'i>(&mut self, of: &Shown<'_>, drawn: &dyn Fn() -> &'i Image);
    /// All objects of a frame were taken.
    fn frame_ended(&mut self) -> Result<(), Failure>;
}

/// What is known of an object besides its grid.
pub(super) struct Observed {
    /// The readings of its mask.
    pub(super) quality: Quality,
    /// The object of an earlier frame that it is.
    pub(super) continues: Option<u16>,
}

/// Adds what other frames know of the object.
pub(super) type Finish<'a> = dyn FnMut(&mut [u8]) -> Result<(), Failure> + 'a;

/// The report on a frame, besides its grids.
pub(super) struct Shown<'a> {
    pub(super) frame: &'a str,
    pub(super) frame_id: &'a str,
    /// When it was at hand, CLOCK_MONOTONIC.
    pub(super) captured_ns: u64,
    /// The sensor's own time.
    pub(super) stamp_ns: u64,
    /// Several views are one grid.
    pub(super) fused: bool,
}
