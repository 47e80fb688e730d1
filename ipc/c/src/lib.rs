//! The C interface to the beo perception daemon: `libbeo.so.2`, `libbeo.a`; its header is `ipc/include/beo.h`, generated from these files
//! and from the messages of beo-ipc. The rules of the interface are in `ipc/README.md`.
//!
//! - `subscriber`, `completion`, `producer`, `perceive`, `common`: the functions, one file per kind of handle
//! - `camera`: from a depth frame to a carved grid and its header; needs no handle
//! - `outcome`: the status that every function returns, and the last error's text
//! - `handles`: handles are numbers in a table, so that a stale one is found out instead of followed
//! - `options`: the structs of this interface that are not messages
//! - `pointers`: reading and writing through the caller's pointers
//!
//! `unsafe` is in `pointers`, which follows pointers, and in the files of functions, which are unsafe to call and have exported names.

mod camera;
mod common;
mod completion;
mod handles;
mod options;
mod outcome;
mod perceive;
mod pointers;
mod producer;
mod subscriber;
