//! Grids into the shared memory of a daemon, and the count of what it answers.

use super::live::LivePictures;
use super::sink::{Finish, Observed, Shown, Sink};
use crate::cli::failure::Failure;
use beo_camera::carve;
use beo_camera::{Carver, FrameGrids};
use beo_ipc::text::{from_field, to_field};
use beo_ipc::{CarvedGrid, ObservationHeader, PerceptStatus, Producer, Subscriber};
use beo_picture::Image;
use std::collections::BTreeMap;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// A daemon that runs and has not answered for so long has nothing more to answer.
const SILENCE: Duration = Duration::from_secs(30);
/// Observations that may wait to be answered where the answers set the pace: no more than the shortest queue of a daemon holds.
const IN_FLIGHT: usize = 2;

/// Grids into shared memory.
pub(super) struct Daemon {
    producer: Producer,
    subscriber: Subscriber,
    pictures: LivePictures,
    stop: Arc<AtomicBool>,
    /// The answers set the pace.
    in_step: bool,
    /// The objects' longest side, if all have the same.
    known_side_m: Option<f64>,
    /// The observations without an answer yet: frame and object.
    pending: BTreeMap<u64, (String, u64)>,
    answers: Answers,
}

/// The outcome of observations, counted.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Answers {
    sent: u64,
    pub(super) answered: u64,
    refused: u64,
    unanswered: u64,
}

impl std::fmt::Display for Answers {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{} observations sent, {} answered, {} refused", self.sent, self.answered, self.refused)?;
        if self.unanswered > 0 { write!(f, ", {} not answered", self.unanswered) } else { Ok(()) }
    }
}

impl Sink for Daemon {
    fn segmented(&mut self, _: &Shown<'_>, _: &FrameGrids) -> Result<(), Failure> {
        Ok(())
    }

    fn take(&mut self, of: &Shown<'_>, carver: &Carver<'_>, observed: &Observed, finish: &mut Finish<'_>) -> Result<(), Failure> {
        if self.in_step {
            self.settle(IN_FLIGHT - 1)?;
        }
        let mut loan = self.producer.loan()?;
        carve(carver, loan.voxels_mut())?;
        finish(loan.voxels_mut())?;
        let template = *loan.header();
        *loan.header_mut() = ObservationHeader {
            producer_id: template.producer_id,
            pose_search: template.pose_search,
            continued_object_id: observed.continues.unwrap_or(carver.object).into(),
            continues: u32::from(observed.continues.is_some()),
            capture_ns: of.captured_ns,
            sensor_stamp_ns: of.stamp_ns,
            frame_id: to_field(of.frame_id),
            ..ObservationHeader::of_grid(&CarvedGrid {
                object_id: carver.object.into(),
                known_side_m: self.known_side_m.unwrap_or(0.0),
                ..CarvedGrid::from(&carver.grid).with_quality(&observed.quality)
            })?
        };
        let sent = loan.send()?;
        self.pending.insert(sent.sequence, (of.frame.to_owned(), carver.object.into()));
        self.answers.sent += 1;
        self.drain()?;
        Ok(())
    }

    fn show<'i>(&mut self, of: &Shown<'_>, drawn: &dyn Fn() -> &'i Image) {
        self.pictures.show(of, drawn);
    }

    fn frame_ended(&mut self) -> Result<(), Failure> {
        if self.in_step { self.settle(0) } else { self.drain().map(drop) }
    }
}

impl Daemon {
    /// Nothing is sent yet. `in_step`: the answers set the pace.
    pub(super) fn new(
        producer: Producer,
        subscriber: Subscriber,
        pictures: LivePictures,
        stop: Arc<AtomicBool>,
        in_step: bool,
        known_side_m: Option<f64>,
    ) -> Self {
        Self { producer, subscriber, pictures, stop, in_step, known_side_m, pending: BTreeMap::new(), answers: Answers::default() }
    }

    /// Waits for the answers that are still to come.
    pub(super) fn finish(mut self) -> Result<Answers, Failure> {
        self.settle(0)?;
        self.give_up(|_, _| true)?;
        Ok(self.answers)
    }

    /// Takes the percepts that have come; how many were ours.
    fn drain(&mut self) -> Result<usize, Failure> {
        let mut count = 0;
        while let Some(percept) = self.subscriber.take_percept()? {
            if percept.producer_id != self.producer.id() {
                continue;
            }
            let Some((frame, object)) = self.pending.remove(&percept.sequence) else { continue };
            count += 1;
            let is_ok = percept.status == PerceptStatus::Ok.code();
            *(if is_ok { &mut self.answers.answered } else { &mut self.answers.refused }) += 1;
            if !is_ok {
                say!("{frame}: object {object} was refused: {}", from_field(&percept.explanation));
            }
            // What was sent of this object before has been overtaken.
            self.give_up(|sequence, other| sequence < percept.sequence && other == object)?;
        }
        Ok(count)
    }

    /// Waits until no more than `left` observations have no answer. When the daemon has fallen silent, they will have none.
    fn settle(&mut self, left: usize) -> Result<(), Failure> {
        let mut quiet = Instant::now();
        while self.pending.len() > left && !self.stop.load(Ordering::Relaxed) {
            if self.drain()? > 0 {
                quiet = Instant::now();
            } else if quiet.elapsed() > SILENCE {
                return self.give_up(|_, _| true);
            } else if !self.producer.daemon_runs() {
                return Err(Failure::Failed(format!(
                    "the daemon has ended, and left {} observations without an answer",
                    self.pending.len()
                )));
            } else {
                self.subscriber.wait(Duration::from_millis(50))?;
            }
        }
        Ok(())
    }

    /// Says which of the observations that wait will have no answer: those of which `is_lost(sequence, object)`.
    fn give_up(&mut self, is_lost: impl Fn(u64, u64) -> bool) -> Result<(), Failure> {
        let lost: Vec<u64> = self.pending.iter().filter(|(sequence, (_, object))| is_lost(**sequence, *object)).map(|(s, _)| *s).collect();
        for (frame, object) in lost.iter().filter_map(|sequence| self.pending.remove(sequence)).collect::<Vec<_>>() {
            self.answers.unanswered += 1;
            say!(
                "{frame}: object {object} was not answered: a newer frame of it came first, or there was no time; use a lower --rate, or none"
            );
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn answers_are_counted_in_one_line_and_missing_ones_named_only_where_there_are_some() {
        let answers = Answers { sent: 3, answered: 2, refused: 1, unanswered: 0 };
        assert_eq!(answers.to_string(), "3 observations sent, 2 answered, 1 refused");
        assert!(Answers { unanswered: 4, ..answers }.to_string().ends_with("1 refused, 4 not answered"));
    }
}
