//! A subscriber that outlives the daemon.

use super::{CLEAN_UP, LOOK, Pace, SEARCH};
use crate::InstanceName;
use crate::channel::{self, Woken};
use crate::clock::monotonic_ns;
use crate::error::{OpenError, ReconnectError, retry_within};
use crate::gaps::Gaps;
use crate::messages::{Percept, Status};
use crate::subscriber::{Completion, Subscriber, SubscriberOptions};
use rustix::event::{Timespec, epoll};
use rustix::io::Errno;
use rustix::time::{Itimerspec, TimerfdClockId, TimerfdFlags, TimerfdTimerFlags, timerfd_create, timerfd_settime};
use std::os::fd::{AsFd as _, BorrowedFd, OwnedFd};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

/// A daemon that has been silent for so many heartbeats may be dead.
const MISSED_HEARTBEATS: u64 = 4;

/// A daemon that never sent a heartbeat may be dead after this time.
const FIRST_HEARTBEAT: Duration = Duration::from_secs(2);

/// How a wait ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Waited {
    /// The daemon has sent something: take all of it.
    Sent,
    /// Nothing came in time; the daemon is there.
    TimedOut,
    /// No daemon serves the instance (any more, or yet).
    NotRunning,
    /// A signal of the process came first.
    Interrupted,
}

/// Reads what whichever daemon serves the instance says; see [`Subscriber`].
#[derive(Debug)]
pub struct ReconnectingSubscriber {
    instance: InstanceName,
    options: SubscriberOptions,
    link: Option<Subscriber>,
    connected: Instant,
    last_status: Option<Status>,
    gaps: Mutex<Gaps>,
    descriptor: Option<Descriptor>,
    look: Pace,
    clean_up: Pace,
}

impl ReconnectingSubscriber {
    /// As [`Subscriber::open`].
    ///
    /// # Errors
    /// [`OpenError::NotRunning`] before the daemon runs; see [`OpenError`] for the rest.
    pub fn open(instance: &InstanceName, options: &SubscriberOptions) -> Result<Self, OpenError> {
        let link = Some(Subscriber::open(instance, options)?);
        Ok(Self {
            instance: instance.clone(),
            options: *options,
            link,
            connected: Instant::now(),
            last_status: None,
            gaps: Mutex::default(),
            descriptor: None,
            look: Pace::new(LOOK),
            clean_up: Pace::new(CLEAN_UP),
        })
    }

    /// As [`ReconnectingSubscriber::open`], but waits up to `timeout` for the daemon.
    ///
    /// # Errors
    /// As [`ReconnectingSubscriber::open`].
    pub fn open_within(instance: &InstanceName, options: &SubscriberOptions, timeout: Duration) -> Result<Self, OpenError> {
        retry_within(timeout, || Self::open(instance, options))
    }

    /// Waits until the daemon has sent something, at most `timeout` (`None`: without end). Take everything before waiting again: one
    /// wake-up can stand for several percepts, and what was not taken is lost with the daemon that sent it.
    ///
    /// Whether the daemon is still there is looked at in here, and another one is connected to. So a client that only ever waits and takes
    /// need not care; with its own `poll` it calls this with a timeout of zero.
    ///
    /// # Errors
    /// [`ReconnectError::Wait`] if the event service is broken, [`ReconnectError::Open`] if there is a daemon that cannot be connected to.
    pub fn wait(&mut self, timeout: Option<Duration>) -> Result<Waited, ReconnectError> {
        let start = Instant::now();
        if let Some(descriptor) = &self.descriptor {
            descriptor.quiet_timer();
        }
        loop {
            let left = timeout.map_or(Duration::MAX, |timeout| timeout.saturating_sub(start.elapsed()));
            match self.sleep(left.min(self.look.left()))? {
                Woken::Notified => return Ok(Waited::Sent),
                Woken::Interrupted => return Ok(Waited::Interrupted),
                Woken::TimedOut => {}
            }
            if self.look.is_due() {
                self.look_after_the_daemon()?;
            }
            if timeout.is_some_and(|timeout| start.elapsed() >= timeout) {
                return Ok(if self.link.is_some() { Waited::TimedOut } else { Waited::NotRunning });
            }
        }
    }

    /// For the caller's own `poll` or `epoll`: readable when the daemon has sent something, and four times a second for a look at the
    /// daemon, more often while none is there. When it is readable, call [`ReconnectingSubscriber::wait`] with a timeout of zero, then take everything. It stays the same
    /// over restarts of the daemon and is closed with this subscriber.
    ///
    /// # Errors
    /// [`ReconnectError::Descriptor`] if the process has no descriptors left.
    pub fn file_descriptor(&mut self) -> Result<BorrowedFd<'_>, ReconnectError> {
        let descriptor = match self.descriptor.take() {
            Some(descriptor) => descriptor,
            None => {
                let descriptor = Descriptor::new()?;
                descriptor.tick_every(self.look.interval)?;
                if let Some(link) = &self.link {
                    descriptor.watch(link)?;
                }
                descriptor
            }
        };
        Ok(self.descriptor.insert(descriptor).epoll.as_fd())
    }

    /// Whether a daemon serves the instance, as far as is known since the last wait.
    pub fn is_connected(&self) -> bool {
        self.link.is_some()
    }

    /// The oldest percept not yet taken.
    ///
    /// # Errors
    /// [`ReconnectError::Receive`] if iceoryx2 could not receive it.
    pub fn take_percept(&self) -> Result<Option<Percept>, ReconnectError> {
        let percept = self.link.as_ref().map_or(Ok(None), Subscriber::take_percept)?;
        if let Some(percept) = &percept {
            self.gaps.lock().unwrap_or_else(PoisonError::into_inner).note(percept);
        }
        Ok(percept)
    }

    /// How many percepts were published between those that were taken, and lost here: more came than are kept for a reader, or they came
    /// from a daemon before it was connected to.
    pub fn missed(&self) -> u64 {
        self.gaps.lock().unwrap_or_else(PoisonError::into_inner).missed()
    }

    /// The oldest completion not yet taken, where it lies; see [`Subscriber::take_completion`]. One that is held keeps the channel of its
    /// daemon open.
    ///
    /// # Errors
    /// [`ReconnectError::Receive`]: see [`Subscriber::take_completion`].
    pub fn take_completion(&self) -> Result<Option<Completion>, ReconnectError> {
        Ok(self.link.as_ref().map_or(Ok(None), Subscriber::take_completion)?)
    }

    /// The newest status that a daemon sent, even if it is gone since; `None` before the first.
    ///
    /// # Errors
    /// [`ReconnectError::Receive`] if iceoryx2 could not receive it.
    pub fn status(&mut self) -> Result<Option<Status>, ReconnectError> {
        if let Some(status) = self.link.as_ref().map_or(Ok(None), Subscriber::status)? {
            self.last_status = Some(status);
        }
        Ok(self.last_status)
    }

    fn sleep(&self, at_most: Duration) -> Result<Woken, ReconnectError> {
        if let Some(link) = &self.link {
            return Ok(link.wait_for_wake_up(at_most)?);
        }
        let timeout = Timespec { tv_sec: at_most.as_secs() as i64, tv_nsec: at_most.subsec_nanos().into() };
        Ok(match rustix::event::poll(&mut [], Some(&timeout)) {
            Err(Errno::INTR) => Woken::Interrupted,
            _ => Woken::TimedOut,
        })
    }

    fn look_after_the_daemon(&mut self) -> Result<(), ReconnectError> {
        if self.link.is_none() {
            return self.connect();
        }
        let silent = match self.status()?.filter(|status| status.heartbeat_ns > 0) {
            Some(status) => {
                let patience = MISSED_HEARTBEATS.saturating_mul(status.heartbeat_interval_ns);
                monotonic_ns().saturating_sub(status.heartbeat_ns) > patience
            }
            None => self.connected.elapsed() > FIRST_HEARTBEAT,
        };
        let Some(link) = &self.link else { return Ok(()) };
        if silent && self.clean_up.is_due() {
            link.maintain();
        }
        if !link.daemon_runs() {
            self.link = None;
            self.look_every(SEARCH)?;
            return self.connect();
        }
        Ok(())
    }

    fn look_every(&mut self, interval: Duration) -> Result<(), ReconnectError> {
        self.look = Pace::new(interval);
        self.descriptor.as_ref().map_or(Ok(()), |descriptor| descriptor.tick_every(interval))
    }

    fn connect(&mut self) -> Result<(), ReconnectError> {
        if !channel::exists(&self.instance)? {
            return Ok(());
        }
        match Subscriber::open(&self.instance, &self.options) {
            Ok(link) => {
                if let Some(descriptor) = &self.descriptor {
                    descriptor.watch(&link)?;
                }
                (self.link, self.connected) = (Some(link), Instant::now());
                self.look_every(LOOK)
            }
            Err(error) if error.is_retryable() => Ok(()),
            Err(error) => Err(error.into()),
        }
    }
}

/// One descriptor over changing links: an epoll instance, which can itself be polled, over the present link's socket and a timer.
#[derive(Debug)]
struct Descriptor {
    epoll: OwnedFd,
    timer: OwnedFd,
}

impl Descriptor {
    fn new() -> Result<Self, ReconnectError> {
        let epoll = epoll::create(epoll::CreateFlags::CLOEXEC).map_err(std::io::Error::from)?;
        let timer =
            timerfd_create(TimerfdClockId::Monotonic, TimerfdFlags::NONBLOCK | TimerfdFlags::CLOEXEC).map_err(std::io::Error::from)?;
        epoll::add(&epoll, &timer, epoll::EventData::new_u64(0), epoll::EventFlags::IN).map_err(std::io::Error::from)?;
        Ok(Self { epoll, timer })
    }

    /// How often the timer fires, less than a second apart.
    fn tick_every(&self, interval: Duration) -> Result<(), ReconnectError> {
        let every = rustix::time::Timespec { tv_sec: 0, tv_nsec: interval.subsec_nanos().into() };
        timerfd_settime(&self.timer, TimerfdTimerFlags::empty(), &Itimerspec { it_interval: every, it_value: every })
            .map_err(std::io::Error::from)?;
        Ok(())
    }

    /// The socket of an earlier link leaves by itself when it is closed.
    fn watch(&self, link: &Subscriber) -> Result<(), ReconnectError> {
        let socket = link.file_descriptor();
        Ok(epoll::add(&self.epoll, socket, epoll::EventData::new_u64(0), epoll::EventFlags::IN).map_err(std::io::Error::from)?)
    }

    fn quiet_timer(&self) {
        // An error means that it has not fired.
        let _ = rustix::io::read(&self.timer, &mut [0; 8]);
    }
}

const _: () = {
    const fn usable_from_any_thread<T: Send>() {}
    usable_from_any_thread::<ReconnectingSubscriber>();
};
