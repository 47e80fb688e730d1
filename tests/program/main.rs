//! The program as its users run it: real processes, real shared memory.

mod bench_query;
mod bench_transport;
mod full_pose;
mod harness;
mod pose;
mod real_shapes;
mod service;
mod training;
mod usage;
