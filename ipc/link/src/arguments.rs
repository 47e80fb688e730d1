//! The command line.

use beo_ipc::InstanceName;
use clap::{Args, Parser, Subcommand};
use std::path::PathBuf;

/// Carries the channels of a beo daemon to another machine, over zenoh
///
/// Beside the daemon runs `beo-link near`; on the other machine, `beo-link far` plays the daemon for its clients. Nothing is listened to or
/// connected to but what is named here, and nothing is found by multicast. docs/link.md describes the keys, for any zenoh client.
#[derive(Debug, Parser)]
#[command(name = "beo-link", version, max_term_width = 110)]
pub struct Arguments {
    /// Which end this is
    #[command(subcommand)]
    pub end: End,
}

/// An end of the link.
#[derive(Debug, Subcommand)]
pub enum End {
    /// Beside the daemon: passes on what it answers, and gives it what comes from afar
    Near(Near),
    /// Away from the daemon: plays it for the clients of this machine
    Far(Far),
}

/// Where the other end is.
#[derive(Clone, Debug, Args)]
pub struct Endpoints {
    /// Listen at this endpoint, as tcp/192.168.1.5:7447; may be repeated
    #[arg(long, value_name = "ENDPOINT")]
    pub listen: Vec<String>,
    /// Connect to this endpoint, the other end's or a zenoh router's; may be repeated
    #[arg(long, value_name = "ENDPOINT")]
    pub connect: Vec<String>,
    /// A zenoh configuration (JSON5) for all else, such as certificates for TLS; the endpoints are those above
    #[arg(long, value_name = "FILE")]
    pub config: Option<PathBuf>,
}

/// The end beside the daemon.
#[derive(Clone, Debug, Args)]
pub struct Near {
    /// Instance of the daemon, and its name in the keys
    #[arg(long, default_value_t = InstanceName::default(), value_name = "NAME")]
    pub instance: InstanceName,
    /// Where the other end is
    #[command(flatten)]
    pub endpoints: Endpoints,
    /// When the link is full, drop completions rather than hold up percepts
    #[arg(long)]
    pub drop_completions: bool,
    /// When the link is full, drop percepts rather than wait: one slow reader then holds up no other, and sees its gaps by their numbers
    #[arg(long)]
    pub drop_percepts: bool,
}

/// The end away from the daemon.
#[derive(Clone, Debug, Args)]
pub struct Far {
    /// Name of the daemon's instance in the keys
    #[arg(long, default_value_t = InstanceName::default(), value_name = "NAME")]
    pub instance: InstanceName,
    /// Instance that is played here [default: the same]
    #[arg(long = "as", value_name = "NAME")]
    pub played: Option<InstanceName>,
    /// Where the other end is
    #[command(flatten)]
    pub endpoints: Endpoints,
}
