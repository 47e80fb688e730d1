//! Pictures of frames for those who look on, by the daemon's picture channel.

use super::sink::Shown;
use beo_ipc::text::to_field;
use beo_ipc::{InstanceName, PictureHeader, PictureSender};
use beo_picture::Image;
use std::time::{Duration, Instant};

/// Time from one picture to the next: drawing takes longer than the grids of a frame.
const PERIOD: Duration = Duration::from_millis(200);

/// Sends pictures while somebody looks. Their faults are told once, and end nothing else.
pub(super) struct LivePictures {
    sender: PictureSender,
    producer_id: u64,
    drawn: Option<Instant>,
    has_complained: bool,
}

impl LivePictures {
    /// Pictures beside the observations of a producer.
    pub(super) fn new(instance: &InstanceName, producer_id: u64) -> Self {
        Self { sender: PictureSender::new(instance), producer_id, drawn: None, has_complained: false }
    }

    /// Draws and sends the picture of a frame, if somebody looks and the last one is long enough ago.
    pub(super) fn show<'i>(&mut self, of: &Shown<'_>, drawn: &dyn Fn() -> &'i Image) {
        if self.drawn.is_some_and(|drawn| drawn.elapsed() < PERIOD) {
            return;
        }
        match self.sender.is_watched() {
            Ok(true) => {}
            Ok(false) => return,
            Err(error) => return self.complain(&error),
        }
        let image = drawn();
        let header = PictureHeader {
            width: image.width() as u32,
            height: image.height() as u32,
            producer_id: self.producer_id,
            capture_ns: of.captured_ns,
            sensor_stamp_ns: of.stamp_ns,
            frame_id: to_field(of.frame_id),
            ..PictureHeader::default()
        };
        if let Err(error) = self.sender.send(&header, image.rgb()) {
            self.complain(&error);
        }
        self.drawn = Some(Instant::now());
    }

    fn complain(&mut self, error: &dyn std::fmt::Display) {
        if !std::mem::replace(&mut self.has_complained, true) {
            warn!("warning: no pictures for the live view: {error}");
        }
    }
}
