//! A look at who is at the other end before iceoryx2 connects to it.
//!
//! Sending and receiving connect to new peers by themselves, and wait for ever for the half-made connection of one that was killed
//! meanwhile (see [`crate::orphans`]). Whoever finds that its peers have changed looks first. Left is the coincidence that a peer is killed
//! within the few microseconds in which it makes a connection, and these are the microseconds between the look and the connecting; the
//! housekeeping of any other process ends that wait too.

use std::fmt::Debug;
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};

use iceoryx2::prelude::{CallbackProgression, IceoryxSend, PortFactory as _, ZeroCopySend};
use iceoryx2::service::port_factory::publish_subscribe::PortFactory;

use crate::memory::{MEMBER_BYTES, require_shared_memory};
use crate::node::{self, Ipc};
use crate::orphans;

/// A sender whose number of peers is the same looks again after this long: only the whole list, which costs as much as half the hand-over
/// of a grid, tells whether one was killed and another one came.
const LOOK_NS: u64 = 1_000_000;

/// The peers that a port was last connected to.
#[derive(Debug, Default)]
pub(crate) struct Peers {
    /// A number that changes with them.
    present: AtomicU64,
    /// How many they were, and when that was seen.
    count: AtomicUsize,
    looked_ns: AtomicU64,
    changes: AtomicU64,
}

impl Peers {
    /// To be called before receiving. False if a dead peer's half-made connection is in the way and cannot be removed, or if there is no
    /// room for a connection: then not now.
    pub fn ready_to_receive<Payload, Header>(&self, service: &PortFactory<Ipc, Payload, Header>) -> bool
    where
        Payload: Debug + IceoryxSend + ?Sized,
        Header: Debug + ZeroCopySend,
    {
        let mut present = Fingerprint::default();
        service.dynamic_config().list_publishers(|peer| present.add(peer.publisher_id.value()));
        self.settle(present)
    }

    /// As [`Self::ready_to_receive`], before sending, at this time.
    pub fn ready_to_send<Payload, Header>(&self, service: &PortFactory<Ipc, Payload, Header>, now_ns: u64) -> bool
    where
        Payload: Debug + IceoryxSend + ?Sized,
        Header: Debug + ZeroCopySend,
    {
        let count = service.dynamic_config().number_of_subscribers();
        let recent = now_ns.saturating_sub(self.looked_ns.load(Ordering::Relaxed)) < LOOK_NS;
        if recent && count == self.count.load(Ordering::Relaxed) {
            return true;
        }
        self.count.store(count, Ordering::Relaxed);
        self.looked_ns.store(now_ns, Ordering::Relaxed);
        let mut present = Fingerprint::default();
        service.dynamic_config().list_subscribers(|peer| present.add(peer.subscriber_id.value()));
        self.settle(present)
    }

    /// How often they have changed.
    pub fn changes(&self) -> u64 {
        self.changes.load(Ordering::Relaxed)
    }

    fn settle(&self, present: Fingerprint) -> bool {
        if self.present.load(Ordering::Relaxed) == present.0 {
            return true;
        }
        let has_room = require_shared_memory(MEMBER_BYTES);
        if let Err(error) = &has_room {
            tracing::warn!(%error, "a peer cannot be connected");
        }
        let settled = has_room.is_ok() && orphans::remove_and_wait(&node::prefix());
        if settled {
            self.changes.fetch_add(1, Ordering::Relaxed);
            self.present.store(present.0, Ordering::Relaxed);
        } else {
            self.looked_ns.store(0, Ordering::Relaxed);
        }
        settled
    }
}

/// Of a set of ids: the same in any order, another one (but for a chance of 2⁻⁶⁴) for another set.
#[derive(Default, Clone, Copy)]
struct Fingerprint(u64);

impl Fingerprint {
    fn add(&mut self, id: u128) -> CallbackProgression {
        // The constants of SplitMix64, so that ids that differ little are far apart.
        let mixed = (id as u64 ^ (id >> 64) as u64).wrapping_mul(0x9E37_79B9_7F4A_7C15);
        self.0 = self.0.wrapping_add((mixed ^ (mixed >> 31)).wrapping_mul(0xBF58_476D_1CE4_E5B9));
        CallbackProgression::Continue
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn another_set_of_peers_has_another_fingerprint() {
        let of = |ids: &[u128]| {
            let mut fingerprint = Fingerprint::default();
            for id in ids {
                fingerprint.add(*id);
            }
            fingerprint.0
        };
        let (a, b) = (713053522950621964180129850869, 713053523116805071952322504182);
        assert_eq!(of(&[a, b]), of(&[b, a]));
        let sets: std::collections::HashSet<u64> = [&[][..], &[a], &[b], &[a, b], &[a + 1], &[a + (1 << 64)]].map(of).into();
        assert_eq!(sets.len(), 6);
    }
}
