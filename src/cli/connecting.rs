//! Waiting for a daemon: for so long, and no longer than until somebody interrupts.

use super::failure::Failure;
use beo_ipc::{InstanceName, OpenError, Status, Subscriber};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// Time between two looks.
const PAUSE: Duration = Duration::from_millis(20);
/// The history of a channel arrives with the daemon's next heartbeat, even where the wait for the daemon itself is used up.
const HEARTBEAT: Duration = Duration::from_secs(2);

/// A wait for the daemon of an instance.
pub struct Connecting<'a> {
    instance: &'a InstanceName,
    deadline: Instant,
    stop: &'a AtomicBool,
}

impl<'a> Connecting<'a> {
    /// Begins to wait, at most for so long, and not after `stop` is set.
    pub fn within(wait: Duration, instance: &'a InstanceName, stop: &'a AtomicBool) -> Self {
        Self { instance, deadline: Instant::now() + wait, stop }
    }

    /// The result of `open`, as soon as there is a daemon.
    pub fn open<T>(&self, mut open: impl FnMut() -> Result<T, OpenError>) -> Result<T, Failure> {
        loop {
            self.check()?;
            match open() {
                Err(error) if error.is_retryable() && Instant::now() < self.deadline => std::thread::sleep(PAUSE),
                outcome => return Ok(outcome?),
            }
        }
    }

    /// The daemon's status.
    pub fn status(&self, subscriber: &Subscriber) -> Result<Status, Failure> {
        loop {
            self.check()?;
            if let Some(status) = subscriber.status()? {
                return Ok(status);
            }
            if Instant::now() > self.deadline + HEARTBEAT {
                return Err(Failure::Failed(silence(self.instance, subscriber.daemon_pid(), rustix::process::geteuid().as_raw())));
            }
            std::thread::sleep(PAUSE);
        }
    }

    fn check(&self) -> Result<(), Failure> {
        match self.stop.load(Ordering::Relaxed) {
            true => Err(Failure::Failed(format!("interrupted while waiting for a daemon of `{}`", self.instance))),
            false => Ok(()),
        }
    }
}

/// Why a daemon that is there says nothing to a user.
fn silence(instance: &InstanceName, pid: Option<u32>, user: u32) -> String {
    let owner = pid.and_then(|pid| Some((pid, rustix::fs::stat(format!("/proc/{pid}")).ok()?.st_uid)));
    match owner {
        Some((pid, owner)) if owner != user => format!(
            "the daemon of `{instance}` (process {pid}) is user {owner}'s, this program runs as user {user}: they cannot share memory; run it \
             as user {owner}"
        ),
        Some((pid, _)) => format!("the daemon of `{instance}` (process {pid}) sends no status: is it stopped, or its machine overloaded?"),
        None => format!("the daemon of `{instance}` sends no status: it seems to have ended; start `beo serve --instance {instance}`"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn silence_is_explained_by_whose_process_it_is() {
        let (instance, own) = (InstanceName::default(), std::process::id());
        let user = rustix::process::geteuid().as_raw();
        let other = silence(&instance, Some(own), user + 1);
        assert!(other.contains(&format!("(process {own}) is user {user}'s")) && !other.contains("start"), "{other}");
        assert!(silence(&instance, Some(own), user).contains("sends no status: is it stopped"));
        assert!(silence(&instance, None, user).contains("seems to have ended"));
    }

    #[test]
    fn who_is_interrupted_waits_no_longer() {
        let (instance, stop) = (InstanceName::default(), AtomicBool::new(false));
        let waiting = Connecting::within(Duration::from_secs(3600), &instance, &stop);
        let mut tries = 0;
        let outcome = waiting.open(|| {
            tries += 1;
            stop.store(true, Ordering::Relaxed);
            Err::<(), _>(OpenError::NotRunning { instance: instance.clone() })
        });
        assert!(outcome.is_err_and(|failure| failure.to_string().contains("interrupted")));
        assert_eq!(tries, 1);
    }
}
