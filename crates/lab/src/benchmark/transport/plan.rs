//! The plan of a measurement: payload, means, repeats and order. Both processes follow the same plan, so they need not talk about it.

pub use crate::benchmark::wake::Wake;
use serde::{Deserialize, Serialize};

/// A means of handing a grid to another process.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Way {
    /// Our observation channel.
    Ours,
    /// Publish-subscribe of bytes with an event, by iceoryx2 alone, with the settings of our channel.
    Raw,
    /// The same with handles that must stay on one thread, and so need no lock.
    Local,
    /// A Unix-domain stream socket.
    Socket,
    /// A pipe.
    Pipe,
}

/// The reader's work on the payload.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Work {
    /// Nothing: only the pointer changes hands.
    Pointer,
    /// The sender writes every byte, the reader sums them.
    Sum,
    /// The sender writes every byte, the reader does what our daemon does: it checks and copies them in one pass.
    Validate,
}

/// One kind of hand-over.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Exchange {
    /// By which means.
    pub way: Way,
    /// The reader's work on the payload.
    pub work: Work,
    /// How the reader learns of it.
    pub wake: Wake,
}

impl Exchange {
    /// All that are measured, in the order in which they take turns. A stream has no pointer to hand over.
    pub const ALL: [Self; 11] = [
        Self::new(Way::Ours, Work::Pointer, Wake::Polling),
        Self::new(Way::Raw, Work::Pointer, Wake::Polling),
        Self::new(Way::Local, Work::Pointer, Wake::Polling),
        Self::new(Way::Ours, Work::Pointer, Wake::Event),
        Self::new(Way::Raw, Work::Pointer, Wake::Event),
        Self::new(Way::Local, Work::Pointer, Wake::Event),
        Self::new(Way::Ours, Work::Sum, Wake::Event),
        Self::new(Way::Raw, Work::Sum, Wake::Event),
        Self::new(Way::Socket, Work::Sum, Wake::Event),
        Self::new(Way::Pipe, Work::Sum, Wake::Event),
        Self::new(Way::Ours, Work::Validate, Wake::Event),
    ];

    const fn new(way: Way, work: Work, wake: Wake) -> Self {
        Self { way, work, wake }
    }
}

/// The measured quantity.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Plan {
    /// Sides of the cubic grids, voxels; one byte each.
    pub sides: Vec<u32>,
    /// Hand-overs of each kind in one repeat; fewer where the payload of a big grid is touched.
    pub messages: usize,
    /// Rounds over everything.
    pub repeats: usize,
}

/// The instructions for the reading process.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct ReaderPlan {
    /// Of channels and socket; nobody else uses it.
    pub name: String,
    /// The measured quantity.
    pub plan: Plan,
}

/// Payload up to which the number of hand-overs is not reduced.
const SMALL_BYTES: usize = 300_000;
/// Hand-overs of big grids, at least.
const FEWEST: usize = 30;

/// A stretch of equal hand-overs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Step {
    /// The round.
    pub repeat: usize,
    /// Which of the plan's sides.
    pub grid: usize,
    /// How.
    pub exchange: Exchange,
    /// How many are measured.
    pub messages: usize,
    /// How many go before, unmeasured: they touch every chunk of shared memory in both processes.
    pub warm_up: usize,
}

/// Bytes of a cubic grid.
pub(super) const fn bytes(side: u32) -> usize {
    (side as usize).pow(3)
}

impl Plan {
    /// Everything, in order: kinds of hand-over take turns within a size, sizes within a repeat.
    pub fn steps(&self) -> impl Iterator<Item = Step> + '_ {
        let grids = move || self.sides.iter().copied().enumerate();
        (0..self.repeats).flat_map(move |repeat| {
            grids().flat_map(move |(grid, side)| {
                Exchange::ALL.into_iter().map(move |exchange| {
                    let fewer = (self.messages.saturating_mul(SMALL_BYTES) / bytes(side)).max(FEWEST).min(self.messages);
                    let messages = if exchange.work == Work::Pointer { self.messages } else { fewer };
                    Step { repeat, grid, exchange, messages, warm_up: beo_ipc::channel::observation_chunks(bytes(side)) + 2 }
                })
            })
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_kind_takes_its_turn_in_every_repeat_and_big_grids_fewer() {
        let plan = Plan { sides: vec![30, 254], messages: 1000, repeats: 2 };
        let steps: Vec<Step> = plan.steps().collect();
        assert_eq!(steps.len(), 2 * 2 * Exchange::ALL.len());
        for exchange in Exchange::ALL {
            let of = |grid| steps.iter().filter(move |s| s.exchange == exchange && s.grid == grid);
            assert!(of(0).map(|s| (s.repeat, s.messages)).eq([(0, 1000), (1, 1000)]));
            let big = if exchange.work == Work::Pointer { 1000 } else { FEWEST };
            assert!(of(1).all(|s| s.messages == big && s.warm_up >= 10), "{exchange:?}");
        }
    }
}
