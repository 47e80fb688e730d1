//! From the daemon's percepts and completions to whole frames.

use crate::answers::Answer;
use crate::completed::{Voxel, filled};
use crate::health::Count;
use crate::shared::Shared;
use beo_ipc::text::from_field;
use beo_ipc::{InstanceName, PerceptStatus, ReconnectError, ReconnectingSubscriber, SubscriberOptions, Waited};
use std::collections::BTreeMap;
use std::sync::atomic::Ordering;
use std::time::Duration;

/// Completions whose percept did not come, at most.
const MOST_KEPT: usize = 64;

/// Reads what the daemon answers.
pub struct Listening {
    subscriber: ReconnectingSubscriber,
    /// Voxels by the observation's number, until its percept comes.
    completed: BTreeMap<u64, Vec<Voxel>>,
}

impl Listening {
    /// Joins the daemon.
    ///
    /// # Errors
    /// As [`ReconnectingSubscriber::open`].
    pub fn open(instance: &InstanceName) -> Result<Self, ReconnectError> {
        let subscriber = ReconnectingSubscriber::open(instance, &SubscriberOptions { completion: true })?;
        Ok(Self { subscriber, completed: BTreeMap::new() })
    }

    /// Waits for the daemon, at most `timeout`, and puts what it said where it belongs.
    ///
    /// # Errors
    /// [`ReconnectError`].
    pub fn turn(&mut self, timeout: Duration, shared: &Shared) -> Result<(), ReconnectError> {
        let waited = self.subscriber.wait(Some(timeout))?;
        let status = self.subscriber.status()?;
        shared.set_status(status.filter(|_| waited != Waited::NotRunning));
        while let Some(percept) = self.subscriber.take_percept()? {
            self.take_completions(shared)?;
            if percept.producer_id != shared.producer_id.load(Ordering::Relaxed) {
                continue;
            }
            let voxels = self.completed.remove(&percept.sequence).unwrap_or_default();
            let is_ok = percept.status == PerceptStatus::Ok.code();
            shared.health.count(if is_ok { Count::Answered } else { Count::Refused });
            if !is_ok {
                shared.health.trouble("refused", &from_field(&percept.explanation));
            }
            shared.frames().close(&percept, is_ok.then_some(Answer { percept, voxels }));
        }
        Ok(())
    }

    /// A completion is there before its percept.
    fn take_completions(&mut self, shared: &Shared) -> Result<(), ReconnectError> {
        while let Some(completion) = self.subscriber.take_completion()? {
            let header = completion.header();
            if header.producer_id == shared.producer_id.load(Ordering::Relaxed) {
                self.completed.insert(header.sequence, filled(header, completion.occupancy(), completion.deviation()));
            }
            while self.completed.len() > MOST_KEPT {
                self.completed.pop_first();
            }
        }
        Ok(())
    }
}
