//! How a client joins the running daemon: whether one is there, and who cleans up when it is not what it seems.

use iceoryx2::prelude::{CallbackProgression, Node, PortFactory as _};

use crate::InstanceName;
use crate::channel::{PerceptService, open_percept};
use crate::error::OpenError;
use crate::node::{self, Ipc};
use crate::remains::process_is_gone;

/// The process of the daemon that publishes percepts, if there is one: the first word of who serves the instance.
pub(crate) fn daemon_pid(service: &PerceptService) -> Option<u32> {
    let mut pid = None;
    service.dynamic_config().list_publishers(|publisher| {
        pid = publisher.node_id.pid::<Ipc>().ok().and_then(|pid| u32::try_from(pid.value()).ok());
        CallbackProgression::Stop
    });
    pid
}

/// Whether a daemon publishes percepts. One that was killed counts until someone has cleaned up after it.
pub(crate) fn daemon_runs(service: &PerceptService) -> bool {
    service.dynamic_config().number_of_publishers() > 0
}

/// Whether the process of the daemon that publishes percepts is gone without having cleaned up. A daemon in another process namespace can
/// be taken for gone: to be used only to decide when to look closely.
pub(crate) fn daemon_seems_dead(service: &PerceptService) -> bool {
    daemon_pid(service).is_some_and(process_is_gone)
}

/// A client's node, and the percepts of the running daemon. Where that one was killed, it cleans up after it.
pub(crate) fn join_daemon(role: &str, instance: &InstanceName) -> Result<(Node<Ipc>, PerceptService), OpenError> {
    let node = node::create(role, instance)?;
    let mut service = open_percept(&node, instance)?;
    if daemon_runs(&service) && daemon_seems_dead(&service) {
        // The cleaning removes a service that nobody else has.
        drop(service);
        node::clean_up_and_wait(&node);
        service = open_percept(&node, instance)?;
    }
    if daemon_runs(&service) { Ok((node, service)) } else { Err(OpenError::NotRunning { instance: instance.clone() }) }
}

/// Opens a role; where all places are taken, once more after a cleaning up: killed processes may have them.
pub(crate) fn open_with_room<Role>(
    role: &str,
    instance: &InstanceName,
    open: impl Fn() -> Result<Role, OpenError>,
) -> Result<Role, OpenError> {
    match open() {
        Err(OpenError::Full { .. }) => {
            node::clean_up_and_wait(&node::create(role, instance)?);
            open()
        }
        result => result,
    }
}
