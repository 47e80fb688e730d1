//! Answers and status of a daemon, told to a recording or to viewers as they come.

use super::answers::{as_json, as_text, completion_of, label, ranking};
use super::failure::Failure;
use super::{StatusForm, status_report};
use crate::recording::{Answer, Narrator, Sink};
use beo_ipc::clock::monotonic_ns;
use beo_ipc::text::from_field;
use beo_ipc::{InstanceName, PictureReader, Status, Subscriber};
use std::time::{Duration, Instant};

/// Time between two tellings of the daemon's health.
const HEALTH: Duration = Duration::from_secs(1);

/// A subscriber whose answers are told.
pub struct Narrating<'a> {
    instance: &'a InstanceName,
    subscriber: Subscriber,
    status: Status,
    /// The pictures of cameras, while they are wanted.
    pictures: Option<PictureReader>,
    /// That they cannot be had was said.
    has_complained: bool,
    /// When the daemon's health was told last.
    told: Option<Instant>,
    /// Percepts that were missed, as far as it was said.
    missed: u64,
}

impl<'a> Narrating<'a> {
    /// Begins with what the daemon serves.
    pub fn begin<S: Sink<Error: 'static>>(
        instance: &'a InstanceName,
        subscriber: Subscriber,
        status: Status,
        narrator: &mut Narrator<S>,
    ) -> Result<Self, Failure> {
        narrator.say(&served(&status), monotonic_ns())?;
        Ok(Self { instance, subscriber, status, pictures: None, has_complained: false, told: None, missed: 0 })
    }

    /// Waits for something to tell.
    pub fn wait(&self, timeout: Duration) -> Result<(), Failure> {
        self.subscriber.wait(timeout)?;
        Ok(())
    }

    /// Tells the next answer, with its completion; false if there is none yet. With `seen_too`, what was seen is taken from the completion.
    pub fn answer<S: Sink<Error: 'static>>(&mut self, narrator: &mut Narrator<S>, seen_too: bool) -> Result<bool, Failure> {
        let Some(percept) = self.subscriber.take_percept()? else { return Ok(false) };
        let now_ns = monotonic_ns();
        let completion = completion_of(&self.subscriber, &percept)?;
        if percept.model_id != self.status.model_id {
            self.refresh(narrator)?;
        }
        let status = &self.status;
        let answer = Answer {
            percept: &percept,
            label: &label(&percept, status),
            ranking: &ranking(&percept, status),
            line: &as_text(&percept, &completion, status, now_ns),
            json: &as_json(&percept, &completion, status, now_ns),
        };
        narrator.percept(&answer, now_ns)?;
        if let Some(completion) = &completion {
            narrator.completion(completion.header(), completion.occupancy(), completion.deviation(), seen_too, now_ns)?;
        }
        Ok(true)
    }

    /// Tells the newest pictures of the cameras.
    pub fn pictures<S: Sink<Error: 'static>>(&mut self, narrator: &mut Narrator<S>) -> Result<(), Failure> {
        let Some(reader) = &self.pictures else { return Ok(()) };
        while let Some(picture) = reader.take()? {
            // One that is broken is passed over: the next will come.
            if let Ok(pixels) = picture.pixels() {
                narrator.picture(picture.header(), pixels, monotonic_ns())?;
            }
        }
        Ok(())
    }

    /// Looks at the cameras' pictures where they are wanted, and no longer where they are not. Cameras draw only where somebody looks.
    fn look_at_pictures<S: Sink<Error: 'static>>(&mut self, narrator: &Narrator<S>) {
        if !narrator.wants_pictures() {
            self.pictures = None;
        } else if self.pictures.is_none() {
            match PictureReader::open(self.instance) {
                Ok(reader) => self.pictures = Some(reader),
                // All else is told without them, and the next time they may be had.
                Err(error) if !self.has_complained => {
                    warn!("warning: no pictures of cameras: {error}");
                    self.has_complained = true;
                }
                Err(_) => {}
            }
        }
    }

    /// Housekeeping, as often as you like: tells once a second how the daemon does, and what was missed, and sees whether
    /// pictures are wanted.
    pub fn maintain<S: Sink<Error: 'static>>(&mut self, narrator: &mut Narrator<S>) -> Result<(), Failure> {
        if self.told.is_some_and(|told| told.elapsed() < HEALTH) {
            return Ok(());
        }
        self.told = Some(Instant::now());
        self.subscriber.maintain();
        self.look_at_pictures(narrator);
        self.pictures.iter().for_each(PictureReader::maintain);
        self.refresh(narrator)?;
        let now_ns = monotonic_ns();
        narrator.status(&status_report(self.instance, &self.status, StatusForm::Json, now_ns), now_ns)?;
        if self.subscriber.missed() > self.missed {
            narrator.say(&format!("missed {}", faster_than_read(self.subscriber.missed() - self.missed)), now_ns)?;
            self.missed = self.subscriber.missed();
        }
        Ok(())
    }

    /// Percepts that came faster than they were read, in words; `None` if there were none.
    pub fn missed(&self) -> Option<String> {
        Some(self.subscriber.missed()).filter(|missed| *missed > 0).map(faster_than_read)
    }

    /// Takes the daemon's newest status, and says so if its model is another.
    fn refresh<S: Sink<Error: 'static>>(&mut self, narrator: &mut Narrator<S>) -> Result<(), Failure> {
        let Some(newer) = self.subscriber.status()? else { return Ok(()) };
        if newer.model_id != self.status.model_id {
            narrator.say(&served(&newer), monotonic_ns())?;
        }
        self.status = newer;
        Ok(())
    }
}

fn faster_than_read(percepts: u64) -> String {
    format!("{percepts} percepts, which came faster than they were read")
}

/// The served model, as a line of the log.
fn served(status: &Status) -> String {
    let names: Vec<&str> = status.class_names().collect();
    format!("model {} for grids of {:?}, classes {}", from_field(&status.model_name), status.dims, names.join(", "))
}
