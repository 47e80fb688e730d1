//! Processes that die, freeze or flood, and what becomes of the others.
//!
//! | file | what |
//! | --- | --- |
//! | `roles` | the producers and readers that are killed: this test binary once more |
//! | `witness` | a reader that checks everything it reads |
//! | `kills` | SIGKILL and SIGSTOP of each kind of process at each kind of moment |
//! | `crowd` | a daemon, producers and readers, and random faults among them |
//! | `rounds` | 200 random kills, and what is left of them |
//! | `leftovers` | what dead processes left: in shared memory and in iceoryx2's folder |
//! | `remains` | what a killed cleaner leaves, and what iceoryx2 by itself never looks at again |
//! | `overload` | far more observations than can be answered |
//! | `soak` | hours of random faults, on request |

mod crowd;
mod kills;
mod leftovers;
mod overload;
mod remains;
pub mod roles;
mod rounds;
mod soak;
mod witness;
