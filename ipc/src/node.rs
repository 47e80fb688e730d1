//! Joining iceoryx2: one explicit configuration, no signal handlers, and one answer to "wrong user".

use std::time::Duration;

use iceoryx2::prelude::{Config, Node, NodeBuilder, NodeName, ServiceName, SignalHandlingMode, ipc_threadsafe};

use crate::error::OpenError;

/// The variant of iceoryx2's services that is used: between processes, its handles usable from any thread.
pub(crate) type Ipc = ipc_threadsafe::Service;

/// The configuration of every node of beo: iceoryx2's built-in defaults (root path and prefix included), so that other iceoryx2 programs find the services.
///
/// Given explicitly because iceoryx2 would otherwise read a file that depends on the working directory.
pub fn config() -> Config {
    Config::default()
}

/// A node named after its role, `beo-ROLE-INSTANCE`. It cleans up after dead nodes first.
pub(crate) fn create(role: &str, instance: &crate::InstanceName) -> Result<Node<Ipc>, OpenError> {
    let name = format!("beo-{role}-{instance}");
    let name =
        NodeName::new(&name).map_err(|error| OpenError::Failed { what: format!("a node named {name}"), cause: format!("{error:?}") })?;
    let config = config();
    let node = NodeBuilder::new()
        .name(&name)
        .signal_handling_mode(SignalHandlingMode::Disabled)
        .config(&config)
        .create::<Ipc>()
        .map_err(|error| no_access(&config, format!("{error:?}")))?;
    node.blocking_cleanup_dead_nodes(Duration::from_millis(500));
    Ok(node)
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
