//! The program as its users run it: real processes, real shared memory.

mod align;
mod bench;
mod camera;
mod camera_inputs;
mod client;
mod faults;
mod full_pose;
mod harness;
mod hostile;
mod household;
mod injection;
mod large;
mod leave_one_out;
mod masks;
mod operations;
mod pictures;
mod pose;
mod real_shapes;
mod record;
mod resources;
mod service;
mod tables;
mod training;
mod usage;
mod view;
mod viewing;
