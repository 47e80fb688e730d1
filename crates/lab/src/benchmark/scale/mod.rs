//! How the cost of queries grows: with classes, basis size, resolution, hidden voxels, threads and subscribers; and that of learning, with
//! resolution and shapes.
//!
//! One of these is varied at a time, the others kept; models are learned in memory from made-up shapes. Cases are measured in
//! turns, so that other work on the machine slows all of them alike, and medians are compared. A line of measurements gets the
//! exponent e of the power law time ∝ size^e that fits it best, beside the one that the algorithm lets expect for large sizes:
//! what does not grow (wake-ups, the parts that another number governs) makes the measured one smaller.
//!
//! | file | what |
//! | --- | --- |
//! | `sweep` | what is varied, and over which sizes |
//! | `shapes` | made-up shapes of any number of classes, at any resolution |
//! | `models` | models learned from them |
//! | `training` | learning timed, with the memory that it takes |
//! | `queries` | queries of one case, timed |
//! | `publishing` | percept and completion handed to many subscribers, timed |
//! | `growth` | medians, exponents, what was expected |
//! | `report` | table and charts |
//! | `error` | a measurement failed |

mod error;
mod growth;
mod models;
mod publishing;
mod queries;
mod report;
mod shapes;
mod sweep;
mod training;

pub use error::ScaleError;
pub use growth::{Line, Series};
pub use report::{chart, table};
pub use sweep::{Scale, Sweep};
