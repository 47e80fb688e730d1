//! The keys of an instance.

use beo_ipc::InstanceName;

/// The keys under which an instance's messages go.
#[derive(Clone, Debug)]
pub struct Keys {
    /// To the daemon: header, then voxels.
    pub observation: String,
    /// From it.
    pub percept: String,
    /// From it: header, then occupancy and deviation.
    pub completion: String,
    /// From it; also by query.
    pub status: String,
    /// By query with a reload request: its reply.
    pub control: String,
    /// By query: CLOCK_MONOTONIC of its machine, nanoseconds, 8 bytes, little-endian.
    pub clock: String,
}

impl Keys {
    /// Those of an instance.
    pub fn new(instance: &InstanceName) -> Self {
        let key = |channel: &str| format!("beo/{instance}/{channel}");
        Self {
            observation: key("observation"),
            percept: key("percept"),
            completion: key("completion"),
            status: key("status"),
            control: key("control"),
            clock: key("clock"),
        }
    }
}
