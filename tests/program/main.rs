//! The program as its users run it: real processes, real shared memory.

mod bench;
mod faults;
mod full_pose;
mod harness;
mod pose;
mod real_shapes;
mod scale;
mod service;
mod training;
mod usage;
