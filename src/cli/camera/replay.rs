//! Plays the frames of a folder at their pace: each object of each frame goes to the sink as a grid, or ends as a line that says why not.

use super::arguments::{Camera, SegmentArgument};
use super::pictures::Pictures;
use super::sink::{Observed, Shown, Sink};
use crate::cli::failure::Failure;
use crate::frames::{CapturedFrame, FrameFolder, StampedPose, draw_grids, question_depth, question_size};
use beo_camera::{FrameGrids, FusedObjects, GridOptions, ObjectGrid, Observer, Segmentation};
use beo_ipc::clock::monotonic_ns;
use nalgebra::Isometry3;
use std::cell::LazyCell;
use std::collections::BTreeSet;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

/// A gravity that is off by less is not worth a line, degrees.
const LEAST_CORRECTION_DEG: f64 = 1.0;
/// A share of an object's readings that is worth a line.
const LARGE_SHARE: f64 = 0.1;

/// Plays the frames and counts.
pub(super) struct Replay<'a> {
    camera: &'a Camera,
    folder: &'a FrameFolder,
    poses: Option<Vec<StampedPose>>,
    pictures: Option<Pictures>,
    options: GridOptions,
    observer: Observer,
    fused: FusedObjects,
    frames: u64,
    unreadable: BTreeSet<usize>,
    without_grid: u64,
    /// Objects of all frames.
    asked: u64,
    /// Something was asked about a unit: once is enough.
    questioned: bool,
}

impl<'a> Replay<'a> {
    pub(super) fn new(
        camera: &'a Camera,
        folder: &'a FrameFolder,
        poses: Option<Vec<StampedPose>>,
        pictures: Option<Pictures>,
        options: GridOptions,
    ) -> Self {
        let (fused, unreadable) = (FusedObjects::default(), BTreeSet::new());
        let observer = Observer::new(options);
        Self {
            camera,
            folder,
            poses,
            pictures,
            options,
            observer,
            fused,
            frames: 0,
            unreadable,
            without_grid: 0,
            asked: 0,
            questioned: false,
        }
    }

    pub(super) fn play(&mut self, stop: &AtomicBool, sink: &mut impl Sink) -> Result<(), Failure> {
        let all = self.folder.count();
        let count = match (self.camera.without_end, self.camera.count) {
            (true, _) => u64::MAX,
            // A frame adds nothing to itself.
            (false, Some(count)) if !self.camera.fuse => count,
            (false, count) => count.unwrap_or(u64::MAX).min(all as u64),
        };
        let mut due = Instant::now();
        for number in 0..count {
            let index = (number % all as u64) as usize;
            if stop.load(Ordering::Relaxed) || self.unreadable.len() == all {
                break;
            }
            if self.unreadable.contains(&index) {
                continue;
            }
            let captured = match self.folder.read(index) {
                Ok(captured) => captured,
                Err(error) => {
                    say!("{}: skipped: {error}", self.folder.name(index));
                    self.unreadable.insert(index);
                    continue;
                }
            };
            if let Some(rate) = self.camera.rate {
                due = wait_until(due, stop) + Duration::from_secs_f64(1.0 / rate);
            }
            self.frame(&captured, index, sink)?;
            sink.frame_ended()?;
            self.frames += 1;
        }
        Ok(())
    }

    fn frame(&mut self, captured: &CapturedFrame, index: usize, sink: &mut impl Sink) -> Result<(), Failure> {
        let pose = self.poses.as_ref().map(|poses| poses[index]);
        let camera_to_world = pose.map(|pose| pose.camera_to_world).or(captured.camera_to_world);
        let now_ns = || SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |since| since.as_nanos() as u64);
        let shown = Shown {
            frame: captured.name(),
            frame_id: self.camera.frame_id.as_deref().or(captured.frame_id.as_deref()).unwrap_or("camera"),
            captured_ns: monotonic_ns(),
            stamp_ns: pose.map_or_else(now_ns, |pose| pose.stamp_ns),
            fused: self.camera.fuse,
        };
        let grids = self.lay(captured, camera_to_world)?;
        self.question(captured, &grids);
        self.asked += (grids.objects.len() + captured.hidden.len()) as u64;
        self.say_of(captured.name(), &grids)?;
        sink.segmented(&shown, &grids)?;
        for laid in &grids.objects {
            match &laid.grid {
                Ok(observed) => {
                    let carver = grids.carver(laid.object, observed);
                    let fuse = self.camera.fuse;
                    let of_object = Observed { quality: observed.quality, continues: self.camera.track.continued(laid) };
                    sink.take(&shown, &carver, &of_object, &mut |voxels| {
                        if fuse { Ok(self.fused.fuse(laid.object, voxels)?) } else { Ok(()) }
                    })?;
                }
                Err(reason) => self.say_why_not(captured.name(), reason)?,
            }
        }
        for object in &captured.hidden {
            self.say_why_not(captured.name(), &format!("object {object} has no pixel: its mask is empty, or nearer objects hide it"))?;
        }
        // Last: nobody waits for a picture.
        let drawn = LazyCell::new(|| draw_grids(&captured.frame(), &grids));
        sink.show(&shown, &|| &*drawn);
        if let Some(pictures) = &self.pictures {
            pictures.save(captured.name(), &drawn)?;
        }
        Ok(())
    }

    /// Asks about the unit of the depth where a depth or a size is none that such a scene can have.
    fn question(&mut self, captured: &CapturedFrame, grids: &FrameGrids) {
        if self.questioned {
            return;
        }
        let longest = |laid: &ObjectGrid| {
            let grid = laid.grid.as_ref().ok().filter(|_| self.options.placement.known_side_m.is_none())?.grid;
            let shortest_side = grid.dims().into_iter().min().unwrap_or(0) as f64;
            question_size(captured, laid.object, grid.voxel_size_m() * shortest_side * self.options.placement.share)
        };
        let question = question_depth(captured).or_else(|| grids.objects.iter().find_map(longest));
        if let Some(question) = question {
            warn!("warning: {question}");
            self.questioned = true;
        }
    }

    fn lay(&mut self, captured: &CapturedFrame, camera_to_world: Option<Isometry3<f64>>) -> Result<FrameGrids, Failure> {
        self.observer.segment_by(
            self.camera.segment.map_or_else(
                || if captured.is_labelled { Segmentation::Labels } else { Segmentation::Table },
                SegmentArgument::segmentation,
            ),
        );
        let mut grids = self.observer.observe(&captured.frame());
        if !self.camera.fuse {
            return Ok(grids);
        }
        let place = camera_to_world.ok_or_else(|| {
            Failure::Failed(format!("--fuse: it is not known where the camera was in frame {}: give --trajectory", captured.name()))
        })?;
        self.fused.keep_places(&mut grids, &place)?;
        Ok(grids)
    }

    /// Says where the direction up was corrected, and which masks hold far pieces.
    fn say_of(&self, frame: &str, grids: &FrameGrids) -> Result<(), Failure> {
        if let Some(angle) = grids.corrected_rad.map(f64::to_degrees).filter(|angle| *angle > LEAST_CORRECTION_DEG) {
            say!("{frame}: --gravity is {angle:.1}° off the plane that the objects stand on, which is taken to be level");
        }
        for (object, quality) in grids.objects.iter().filter_map(|laid| Some((laid.object, laid.grid.as_ref().ok()?.quality))) {
            if quality.share_far > LARGE_SHARE {
                let share = 100.0 * quality.share_far;
                say!(
                    "{frame}: object {object}: {share:.0} % of its readings lie apart from the rest and were left out: are these several objects?"
                );
            }
        }
        Ok(())
    }

    fn say_why_not(&mut self, frame: &str, reason: &dyn std::fmt::Display) -> Result<(), Failure> {
        self.without_grid += 1;
        say!("{frame}: no grid: {reason}");
        Ok(())
    }

    pub(super) fn summary(&self) -> String {
        let unreadable = match self.unreadable.len() {
            0 => String::new(),
            n => format!(" ({n} skipped)"),
        };
        format!("{} frames{unreadable}, {} objects without a grid", self.frames, self.without_grid)
    }

    /// How it ended: nothing can be read, or nothing of what was asked got one of the `answers`.
    pub(super) fn outcome(&self, answers: u64) -> Result<(), Failure> {
        let folder = self.camera.folder.display();
        if self.frames == 0 && !self.unreadable.is_empty() {
            return Err(Failure::Failed(format!("no frame of {folder} can be read")));
        }
        if answers == 0 && self.asked > 0 {
            return Err(Failure::Failed(format!("no object of any frame of {folder} was answered: the lines above say why")));
        }
        Ok(())
    }
}

/// Waits for a time; gives that time, or now if it was missed.
fn wait_until(due: Instant, stop: &AtomicBool) -> Instant {
    while let Some(rest) = due.checked_duration_since(Instant::now()) {
        if rest.is_zero() || stop.load(Ordering::Relaxed) {
            return due;
        }
        std::thread::sleep(rest.min(Duration::from_millis(50)));
    }
    Instant::now()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_time_that_was_missed_counts_from_now_and_a_stop_ends_the_wait() {
        let stop = AtomicBool::new(false);
        let missed = Instant::now() - Duration::from_secs(1);
        assert!(wait_until(missed, &stop) > missed);
        let due = Instant::now() + Duration::from_millis(20);
        assert!(wait_until(due, &stop) >= due);
        stop.store(true, Ordering::Relaxed);
        let far = Instant::now() + Duration::from_secs(3600);
        assert_eq!(wait_until(far, &stop), far);
    }
}
