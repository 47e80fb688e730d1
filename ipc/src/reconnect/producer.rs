//! A producer that outlives the daemon.

use super::{CLEAN_UP, LOOK, Pace, SEARCH};
use crate::InstanceName;
use crate::channel;
use crate::error::{OpenError, ReconnectError, retry_within};
use crate::identity::unique_id;
use crate::messages::ObservationHeader;
use crate::producer::{Loan, Producer};
use std::time::Duration;

/// Writes observations of one size, whichever daemon serves the instance. Its `producer_id` and the count of its observations go on when
/// the daemon restarts.
#[derive(Debug)]
pub struct ReconnectingProducer {
    instance: InstanceName,
    template: ObservationHeader,
    link: Option<Producer>,
    /// Observations sent over earlier links.
    sent_before: u64,
    look: Pace,
    clean_up: Pace,
}

impl ReconnectingProducer {
    /// As [`Producer::open`].
    ///
    /// # Errors
    /// [`OpenError::NotRunning`] before the daemon runs; see [`OpenError`] for the rest.
    pub fn open(instance: &InstanceName, template: &ObservationHeader) -> Result<Self, OpenError> {
        let template = ObservationHeader { producer_id: unique_id(), ..*template };
        let link = Some(Producer::open_as(instance, &template, 0)?);
        Ok(Self { instance: instance.clone(), template, link, sent_before: 0, look: Pace::new(LOOK), clean_up: Pace::new(CLEAN_UP) })
    }

    /// As [`ReconnectingProducer::open`], but waits up to `timeout` for the daemon.
    ///
    /// # Errors
    /// As [`ReconnectingProducer::open`].
    pub fn open_within(instance: &InstanceName, template: &ObservationHeader, timeout: Duration) -> Result<Self, OpenError> {
        retry_within(timeout, || Self::open(instance, template))
    }

    /// The identifier of this producer; percepts repeat it.
    pub fn id(&self) -> u64 {
        self.template.producer_id
    }

    /// The size of the grids.
    pub fn dims(&self) -> [u32; 3] {
        self.template.dims
    }

    /// Memory for one grid, as [`Producer::loan`].
    ///
    /// # Errors
    /// [`OpenError::NotRunning`] while no daemon runs: leave this grid out and try again with the next one. [`crate::LoanError::NoFreeChunk`] if
    /// more loans are held than there is memory for.
    pub fn loan(&mut self) -> Result<Loan, ReconnectError> {
        self.let_go_if_the_daemon_is_gone();
        if self.link.is_none() {
            self.connect()?;
        }
        match &self.link {
            Some(link) => Ok(link.loan()?),
            None => Err(OpenError::NotRunning { instance: self.instance.clone() }.into()),
        }
    }

    fn let_go_if_the_daemon_is_gone(&mut self) {
        let Some(link) = &self.link else { return };
        if self.look.is_due() && link.daemon_runs() && link.daemon_seems_dead() && self.clean_up.is_due() {
            link.maintain();
        }
        if !link.daemon_runs() {
            self.sent_before = link.sent();
            self.link = None;
            self.look = Pace::new(SEARCH);
            self.look.hurry();
        }
    }

    fn connect(&mut self) -> Result<(), OpenError> {
        if !self.look.is_due() || !channel::exists(&self.instance)? {
            return Ok(());
        }
        match Producer::open_as(&self.instance, &self.template, self.sent_before) {
            Ok(link) => {
                self.link = Some(link);
                self.look = Pace::new(LOOK);
            }
            Err(error) if error.is_retryable() => {}
            Err(error) => return Err(error),
        }
        Ok(())
    }
}

const _: () = {
    const fn usable_from_any_thread<T: Send>() {}
    usable_from_any_thread::<ReconnectingProducer>();
};
