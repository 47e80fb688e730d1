//! Ports that stay registered in a service although their node is gone, and take the place of a living one.
//!
//! iceoryx2 0.10.0 removes the tag of a dead node's port before it takes the port out of the service, and does not take a port out whose
//! tag is gone (`cleanup_port_resources` in `src/service/mod.rs`, the arm for `remove_port_tag`). Where the cleaner is killed between the
//! two, the next one passes over the port and removes the node: nobody finds the port dead any more.

use std::collections::BTreeMap;
use std::fmt::Debug;

use iceoryx2::identifiers::UniqueNodeId;
use iceoryx2::prelude::{CallbackProgression, Config, IceoryxSend, PortFactory as _, ZeroCopySend};
use iceoryx2::service::internal::ServiceInternal as _;
use iceoryx2::service::port_factory::{event, publish_subscribe, request_response};
use iceoryx2::service::service_hash::ServiceHash;

use crate::node::Ipc;
use crate::remains::Places;

/// A service whose ports can be listed.
pub(crate) trait Registered: Debug + Send + Sync {
    fn hash(&self) -> ServiceHash;

    /// Every port: the node that it belongs to, and its id.
    fn ports(&self) -> Vec<(UniqueNodeId, u128)>;
}

/// Takes the ports out of `service` whose node is gone.
pub(crate) fn release_forgotten(service: &dyn Registered, config: &Config, places: &Places) {
    let suspects: Vec<_> = service.ports().into_iter().filter(|(node, _)| !places.is_monitored(node.value())).collect();
    if suspects.is_empty() {
        return;
    }
    // Whoever left in good order between the look at the ports and that at the nodes is no longer listed.
    let listed = service.ports();
    let mut forgotten: BTreeMap<UniqueNodeId, Vec<u128>> = BTreeMap::new();
    for (node, port) in suspects.into_iter().filter(|suspect| listed.contains(suspect)) {
        forgotten.entry(node).or_default().push(port);
    }
    for (node, ports) in forgotten {
        let removed = places
            .put_back_tags(node.value(), ports.iter().copied())
            .map_err(|error| error.to_string())
            .and_then(|()| Ipc::__internal_remove_node_from_service(&node, &service.hash(), config).map_err(|error| format!("{error:?}")));
        places.remove_folder(node.value());
        match removed {
            Ok(()) => tracing::info!(ports = ports.len(), "removed ports of a killed process that its cleaner, killed too, had left"),
            Err(error) => tracing::warn!(error, "cannot remove ports of a process that is gone"),
        }
    }
}

/// Ports as they are listed.
#[derive(Default)]
struct Listed(Vec<(UniqueNodeId, u128)>);

impl Listed {
    fn add(&mut self, node: UniqueNodeId, port: u128) -> CallbackProgression {
        self.0.push((node, port));
        CallbackProgression::Continue
    }
}

impl<Payload, Header> Registered for publish_subscribe::PortFactory<Ipc, Payload, Header>
where
    Payload: Debug + IceoryxSend + ?Sized,
    Header: Debug + ZeroCopySend,
{
    fn hash(&self) -> ServiceHash {
        *self.service_hash()
    }

    fn ports(&self) -> Vec<(UniqueNodeId, u128)> {
        let mut listed = Listed::default();
        self.dynamic_config().list_publishers(|port| listed.add(port.node_id, port.publisher_id.value()));
        self.dynamic_config().list_subscribers(|port| listed.add(port.node_id, port.subscriber_id.value()));
        listed.0
    }
}

impl Registered for event::PortFactory<Ipc> {
    fn hash(&self) -> ServiceHash {
        *self.service_hash()
    }

    fn ports(&self) -> Vec<(UniqueNodeId, u128)> {
        let mut listed = Listed::default();
        self.dynamic_config().list_notifiers(|port| listed.add(port.node_id, port.notifier_id.value()));
        self.dynamic_config().list_listeners(|port| listed.add(port.node_id, port.listener_id.value()));
        listed.0
    }
}

impl<Request, Reply> Registered for request_response::PortFactory<Ipc, Request, (), Reply, ()>
where
    Request: Debug + IceoryxSend + ?Sized,
    Reply: Debug + IceoryxSend + ?Sized,
{
    fn hash(&self) -> ServiceHash {
        *self.service_hash()
    }

    fn ports(&self) -> Vec<(UniqueNodeId, u128)> {
        let mut listed = Listed::default();
        self.dynamic_config().list_clients(|port| listed.add(port.node_id, port.client_id.value()));
        self.dynamic_config().list_servers(|port| listed.add(port.node_id, port.server_id.value()));
        listed.0
    }
}
