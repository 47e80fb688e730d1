//! Small calls to the daemon, each with an answer: to serve another model. Grids never go this way.

use std::ffi::OsStr;
use std::os::unix::ffi::OsStrExt as _;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use iceoryx2::active_request::ActiveRequest;
use iceoryx2::port::server::Server as Port;
use iceoryx2::prelude::{AttributeVerifier, Node, PortFactory as _, ZeroCopySend};
use iceoryx2::service::builder::request_response::{RequestResponseOpenError, RequestResponseOpenOrCreateError};
use iceoryx2::service::port_factory::client::ClientCreateError;
use iceoryx2::service::port_factory::request_response;

use crate::InstanceName;
use crate::channel::{LAYOUT_ATTRIBUTE, PATIENCE, check_layout, failed, receive_error};
use crate::error::{OpenError, ReceiveError};
use crate::joining;
use crate::layout::{Layout, layout};
use crate::memory::{publisher_bytes, require_shared_memory};
use crate::messages::ABI_VERSION;
use crate::node::{Ipc, service_name};
use crate::shared::copy_of;
use crate::text::{from_field, to_field};

/// Processes that can call at a time; each has one call under way.
const CALLERS: usize = 4;

/// Asks the daemon to serve another model.
#[derive(Debug, Clone, Copy, PartialEq, ZeroCopySend)]
#[repr(C)]
#[type_name("beo.v2.ReloadRequest")]
pub struct ReloadRequest {
    /// [`ABI_VERSION`].
    pub abi_version: u32,
    /// The model file's absolute path as the system has it, padded with NUL; empty for the file that is served, read anew.
    pub model: [u8; 4096],
}
layout!(ReloadRequest: 4100, reserved from 4100 { abi_version @ 0, model @ 4 });

impl ReloadRequest {
    /// The model file that is asked for; `None` for the one that is served, read anew.
    ///
    /// # Errors
    /// A text that says what is wrong with the call: it comes from another process.
    pub fn path(&self) -> Result<Option<PathBuf>, String> {
        if self.abi_version != ABI_VERSION {
            return Err(format!("the call has version {}, this daemon knows {ABI_VERSION}", self.abi_version));
        }
        let end = self.model.iter().position(|byte| *byte == 0).ok_or("the path of the model has no end")?;
        let path = Path::new(OsStr::from_bytes(&self.model[..end]));
        match end {
            0 => Ok(None),
            _ if path.is_absolute() => Ok(Some(path.to_owned())),
            _ => Err(format!("the path {} is not absolute", path.display())),
        }
    }
}

/// The daemon's answer.
#[derive(Debug, Clone, Copy, PartialEq, ZeroCopySend)]
#[repr(C)]
#[type_name("beo.v2.ReloadReply")]
pub struct ReloadReply {
    /// [`ABI_VERSION`].
    pub abi_version: u32,
    /// 1 if the model was refused, 0 if it is served.
    pub refused: u32,
    /// The model that is served now.
    pub model_id: u64,
    /// Why it was refused, for people: UTF-8, padded with NUL.
    pub explanation: [u8; 512],
}
layout!(ReloadReply: 528, reserved from 528 { abi_version @ 0, refused @ 4, model_id @ 8, explanation @ 16 });

impl ReloadReply {
    /// The model that is served now, and why not the one asked for.
    pub fn new(model_id: u64, refusal: Option<&str>) -> Self {
        let explanation = to_field(refusal.unwrap_or_default());
        Self { abi_version: ABI_VERSION, refused: u32::from(refusal.is_some()), model_id, explanation }
    }
}

type Service = request_response::PortFactory<Ipc, ReloadRequest, (), ReloadReply, ()>;

/// The daemon's end.
pub(crate) type ControlPort = Port<Ipc, ReloadRequest, (), ReloadReply, ()>;

/// Why a model was not reloaded.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ReloadError {
    /// The daemon cannot be called.
    #[error(transparent)]
    Open(#[from] OpenError),
    /// The path is longer than a call can carry, or has a NUL.
    #[error("the path of the model has {0} bytes: at most 4095 are possible, none of them NUL")]
    BadPath(usize),
    /// The daemon refused the model; the one before goes on.
    #[error("the daemon refused the model and goes on with the one it has: {0}")]
    Refused(String),
    /// The daemon ended before it answered.
    #[error("the daemon ended before it answered: start it again with the model")]
    Gone,
    /// The daemon did not answer in time.
    #[error("the daemon has not answered for {0:?}: see `beo status`; the model may still be loading")]
    NoAnswer(Duration),
    /// Anything else, in iceoryx2's words.
    #[error("cannot call the daemon: {0}")]
    Failed(String),
}

fn layout_text() -> String {
    format!("{:016x}", ReloadRequest::LAYOUT_HASH ^ ReloadReply::LAYOUT_HASH.rotate_left(1))
}

/// Creates the service of control calls, or takes over the one that callers kept.
pub(crate) fn create(node: &Node<Ipc>, instance: &InstanceName) -> Result<(ControlPort, Service), OpenError> {
    use RequestResponseOpenError as E;
    let name = instance.control();
    require_shared_memory(publisher_bytes(4 * CALLERS, size_of::<ReloadReply>()))?;
    let key = LAYOUT_ATTRIBUTE.try_into().map_err(|error| failed(&name, error))?;
    let value = layout_text().as_str().try_into().map_err(|error| failed(&name, error))?;
    let verifier = AttributeVerifier::new().require(&key, &value).map_err(|error| failed(&name, error))?;
    let builder = node
        .service_builder(&service_name(&name)?)
        .request_response::<ReloadRequest, ReloadReply>()
        .max_servers(1)
        .max_clients(CALLERS)
        .max_nodes(CALLERS + 4)
        .max_active_requests_per_client(1)
        .max_loaned_requests(1)
        .max_response_buffer_size(1)
        .max_borrowed_responses_per_pending_response(1);
    let start = Instant::now();
    let service = loop {
        let error = match builder.clone().open_or_create_with_attributes(&verifier) {
            Ok(service) => break service,
            Err(
                error @ RequestResponseOpenOrCreateError::RequestResponseOpenError(
                    E::IsMarkedForDestruction | E::HangsInCreation | E::ServiceInCorruptedState,
                ),
            ) => failed(&name, error),
            Err(error) => return Err(failed(&name, error)),
        };
        if start.elapsed() > PATIENCE {
            return Err(error);
        }
        std::thread::sleep(Duration::from_millis(10));
    };
    let port = service.server_builder().create().map_err(|error| failed(&name, error))?;
    Ok((port, service))
}

/// The next call that waits.
pub(crate) fn receive(port: &ControlPort) -> Result<Option<ReloadCall>, ReceiveError> {
    let active = port.receive().map_err(receive_error)?;
    Ok(active.map(|active| ReloadCall { request: copy_of(active.payload()), active }))
}

/// A caller waits for the answer to this; one that is dropped is never answered.
#[derive(Debug)]
pub struct ReloadCall {
    request: ReloadRequest,
    active: ActiveRequest<Ipc, ReloadRequest, (), ReloadReply, ()>,
}

impl ReloadCall {
    /// The call itself, for a relay.
    pub fn request(&self) -> &ReloadRequest {
        &self.request
    }

    /// The model file that is asked for: see [`ReloadRequest::path`].
    ///
    /// # Errors
    /// As there.
    pub fn model(&self) -> Result<Option<PathBuf>, String> {
        self.request.path()
    }

    /// Answers: the model that is served now, and why not the one asked for. A caller that is gone is its own affair.
    pub fn answer(self, model_id: u64, refusal: Option<&str>) {
        self.forward(&ReloadReply::new(model_id, refusal));
    }

    /// Answers with a reply as it is: that of a daemon elsewhere.
    pub fn forward(self, reply: &ReloadReply) {
        if let Err(error) = self.active.send_copy(*reply) {
            tracing::debug!(?error, "the answer to a control call was not delivered");
        }
    }
}

/// Asks the daemon of `instance` to serve another model file, or with `None` the one it serves, read anew; waits up to `timeout` for its
/// word. The model before serves until the new one has been checked. Returns the id of the model that is served now.
///
/// # Errors
/// [`ReloadError::Refused`] if the file cannot be served, [`OpenError::NotRunning`] if no daemon runs; see [`ReloadError`] for the rest.
pub fn request_reload(instance: &InstanceName, model: Option<&Path>, timeout: Duration) -> Result<u64, ReloadError> {
    let mut request = ReloadRequest { abi_version: ABI_VERSION, model: [0; 4096] };
    if let Some(path) = model {
        let path = std::path::absolute(path).map_err(|error| ReloadError::Failed(error.to_string()))?;
        let bytes = path.as_os_str().as_bytes();
        if bytes.len() >= request.model.len() || bytes.contains(&0) {
            return Err(ReloadError::BadPath(bytes.len()));
        }
        request.model[..bytes.len()].copy_from_slice(bytes);
    }
    let reply = forward_reload(instance, &request, timeout)?;
    match reply.refused {
        0 => Ok(reply.model_id),
        _ => Err(ReloadError::Refused(from_field(&reply.explanation).to_owned())),
    }
}

/// Calls the daemon of `instance` with a request as it is, and gives its reply as it is.
///
/// # Errors
/// As [`request_reload`], but that a refusal is a reply like another.
pub fn forward_reload(instance: &InstanceName, request: &ReloadRequest, timeout: Duration) -> Result<ReloadReply, ReloadError> {
    const ROLE: &str = "control";
    let (_node, client) = joining::open_with_room(ROLE, instance, || {
        let (node, _) = joining::join_daemon(ROLE, instance)?;
        let client = open(&node, instance)?.client_builder().create().map_err(|error| match error {
            ClientCreateError::ExceedsMaxSupportedClients => OpenError::Full { service: instance.control(), role: "caller" },
            error => failed(&instance.control(), error),
        })?;
        Ok((node, client))
    })?;
    let pending = client.send_copy(*request).map_err(|error| ReloadError::Failed(format!("{error:?}")))?;
    if pending.number_of_server_connections() == 0 {
        return Err(OpenError::NotRunning { instance: instance.clone() }.into());
    }
    let start = Instant::now();
    loop {
        // Asked before looking for the answer: one that came with the end of the connection is still found.
        let connected = pending.is_connected();
        if let Some(reply) = pending.receive().map_err(|error| ReloadError::Failed(format!("{error:?}")))? {
            return Ok(copy_of(reply.payload()));
        }
        if !connected {
            return Err(ReloadError::Gone);
        }
        if start.elapsed() > timeout {
            return Err(ReloadError::NoAnswer(timeout));
        }
        std::thread::sleep(Duration::from_millis(10));
    }
}

fn open(node: &Node<Ipc>, instance: &InstanceName) -> Result<Service, OpenError> {
    use RequestResponseOpenError as E;
    let name = instance.control();
    let builder = node.service_builder(&service_name(&name)?).request_response::<ReloadRequest, ReloadReply>();
    let service = builder.open().map_err(|error| match error {
        E::DoesNotExist | E::IsMarkedForDestruction | E::HangsInCreation | E::ServiceInCorruptedState => {
            OpenError::NotRunning { instance: instance.clone() }
        }
        E::IncompatibleRequestOrResponseType | E::IncompatibleMessagingPattern | E::VersionMismatch => {
            OpenError::OtherVersion { service: name.clone(), cause: format!("{error:?}") }
        }
        E::ExceedsMaxNumberOfNodes => OpenError::Full { service: name.clone(), role: "process" },
        error => failed(&name, error),
    })?;
    check_layout(&name, service.attributes(), &layout_text())?;
    Ok(service)
}
