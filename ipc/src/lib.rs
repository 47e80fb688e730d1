//! Channels of the beo daemon.
