//! Clients in C, C++, Rust and Python: the examples as their readers build and run them, against a live daemon, and the C interface's law.
//!
//! The library is built and installed into a temporary folder by `ipc/c/install`, the Debian package by `packaging/debian`. What a machine lacks (CMake, pkg-config, valgrind,
//! Python with the iceoryx2 wheel) is left out with a line that says so.

mod builds;
mod conformance;
mod depth_camera;
mod examples;
#[path = "../program/harness.rs"]
#[allow(dead_code, reason = "shared with the tests of the program, which need more of it")]
mod harness;
mod law;
mod package;
mod python;
mod restart;
mod toolchain;
