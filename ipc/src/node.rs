//! Joining iceoryx2: one explicit configuration, no signal handlers, and one answer to "wrong user".

use std::time::Duration;

use iceoryx2::node::{NodeState, NodeView as _};
use iceoryx2::prelude::{
    CallbackProgression, Config, Node, NodeBuilder, NodeName, SemanticString as _, ServiceName, SignalHandlingMode, ipc_threadsafe,
};

use crate::error::OpenError;
use crate::memory::{MEMBER_BYTES, require_shared_memory};
use crate::orphans;
use crate::remains::Places;

/// The variant of iceoryx2's services that is used: between processes, its handles usable from any thread.
pub(crate) type Ipc = ipc_threadsafe::Service;

/// Connections to peers that are gone, with something in them that was not taken, which are kept for each channel.
const KEPT_CONNECTIONS: usize = 16;

/// How long a role that is opened waits for another process that cleans up after a dead node.
const LONGEST_CLEANING: Duration = Duration::from_millis(500);

/// The configuration of every node of beo: where things are and how they are named is iceoryx2's built-in default, so that other iceoryx2
/// programs find the services.
///
/// Given explicitly because iceoryx2 would otherwise read a file that depends on the working directory. Nodes do not clean up after dead
/// ones by themselves when they are made and dropped, and neither does the opening of a service: `maintain` does, after a look at what
/// would block it.
pub fn config() -> Config {
    let mut config = Config::default();
    config.global.node.cleanup_dead_nodes_on_creation = false;
    config.global.node.cleanup_dead_nodes_on_destruction = false;
    config.global.service.cleanup_dead_nodes_on_open = false;
    // Of daemons that are gone, the connections with something in them are kept until it is taken. Whoever takes nothing keeps no more than
    // these, and whoever holds samples of as many daemons at a time is none that we know.
    config.defaults.publish_subscribe.subscriber_expired_connection_buffer = KEPT_CONNECTIONS;
    config
}

/// The prefix of all segments' names.
pub(crate) fn prefix() -> Vec<u8> {
    config().global.prefix.as_bytes().to_vec()
}

/// A node named after its role, `beo-ROLE-INSTANCE`.
///
/// It cleans up after nobody. That is the daemon's work while there is one: a cleaner that is killed leaves what others then cannot remove
/// (see [`crate::registered`]), and clients are started and killed more often than the daemon.
///
/// The room for it and for its connections is asked for before anything is made: what iceoryx2 makes in a full /dev/shm is a bus error
/// when it is first written.
pub(crate) fn create(role: &str, instance: &crate::InstanceName) -> Result<Node<Ipc>, OpenError> {
    let name = format!("beo-{role}-{instance}");
    let name =
        NodeName::new(&name).map_err(|error| OpenError::Failed { what: format!("a node named {name}"), cause: format!("{error:?}") })?;
    let config = config();
    require_shared_memory(MEMBER_BYTES)?;
    orphans::remove_and_wait(config.global.prefix.as_bytes());
    NodeBuilder::new()
        .name(&name)
        .signal_handling_mode(SignalHandlingMode::Disabled)
        .config(&config)
        .create::<Ipc>()
        .map_err(|error| no_access(&config, format!("{error:?}")))
}

/// Cleans up after dead nodes. False if an empty segment would block that, and connecting to peers as well: then the next call will.
pub(crate) fn clean_up(node: &Node<Ipc>) -> bool {
    let possible = orphans::remove(node.config().global.prefix.as_bytes());
    if possible {
        remove_dead_nodes(node.config(), Duration::ZERO);
    }
    possible
}

/// As [`clean_up`], but waits for what is in its way and for another process that is cleaning up, for a bounded time.
pub(crate) fn clean_up_and_wait(node: &Node<Ipc>) {
    if orphans::remove_and_wait(node.config().global.prefix.as_bytes()) {
        remove_dead_nodes(node.config(), LONGEST_CLEANING);
    }
}

/// Waits at most `patience` for another process to clean up after each of them. What cannot be removed now, the next call tries again.
fn remove_dead_nodes(config: &Config, patience: Duration) {
    let places = Places::of(config);
    let listed = Node::<Ipc>::list(config, |state| {
        if let NodeState::Dead(dead) = state {
            places.remove_half_made_tags(dead.id().value());
            if let Err(error) = dead.blocking_remove_stale_resources(patience) {
                tracing::debug!(?error, "a dead node cannot be removed yet");
            }
        }
        CallbackProgression::Continue
    });
    if let Err(error) = listed {
        tracing::debug!(?error, "the nodes cannot be listed");
    }
}

fn no_access(config: &Config, cause: String) -> OpenError {
    let root = config.global.root_path().to_string();
    let owner = rustix::fs::stat(root.as_str()).map_or_else(|_| "?".to_owned(), |status| status.st_uid.to_string());
    OpenError::NoAccess { cause, uid: rustix::process::geteuid().as_raw(), root, owner }
}

/// A service name in iceoryx2's type.
pub(crate) fn service_name(name: &str) -> Result<ServiceName, OpenError> {
    name.try_into().map_err(|error| OpenError::Failed { what: format!("`{name}`"), cause: format!("{error:?}") })
}
