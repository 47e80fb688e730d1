//! The program as its users run it: real processes, real shared memory.

mod bench;
mod full_pose;
mod harness;
mod hostile;
mod pose;
mod real_shapes;
mod resources;
mod scale;
mod service;
mod training;
mod usage;
