//! The zenoh session of an end.

use crate::arguments::Endpoints;
use zenoh::qos::CongestionControl;
use zenoh::{Config, Session, Wait as _};

/// The link cannot be made, or used.
#[derive(Debug, thiserror::Error)]
pub enum LinkError {
    /// No endpoint.
    #[error("nothing to connect: give --listen ENDPOINT or --connect ENDPOINT, as tcp/192.168.1.5:7447")]
    NoEndpoint,
    /// Not an endpoint.
    #[error("`{0}` is no endpoint: write PROTOCOL/ADDRESS:PORT, as tcp/192.168.1.5:7447")]
    Endpoint(String),
    /// The configuration.
    #[error("the configuration of zenoh: {0}")]
    Config(String),
    /// zenoh.
    #[error("{what}: {cause}")]
    Zenoh {
        /// The operation that failed.
        what: String,
        /// zenoh's word for it.
        cause: String,
    },
    /// Shared memory.
    #[error(transparent)]
    Reconnect(#[from] beo_ipc::ReconnectError),
    /// Shared memory.
    #[error(transparent)]
    Open(#[from] beo_ipc::OpenError),
    /// Shared memory.
    #[error(transparent)]
    Wait(#[from] beo_ipc::WaitError),
    /// Shared memory.
    #[error(transparent)]
    Receive(#[from] beo_ipc::ReceiveError),
}

/// The error of an operation that zenoh could not do, named by `what`.
pub fn zenoh_error(what: impl Into<String>) -> impl FnOnce(zenoh::Error) -> LinkError {
    // Its texts have several lines, with the places in its source.
    move |error| LinkError::Zenoh { what: what.into(), cause: error.to_string().split(" at ").next().unwrap_or_default().to_owned() }
}

/// Opens a session at these endpoints alone. An end that cannot be reached yet is tried again and again.
///
/// # Errors
/// [`LinkError`].
pub fn open(endpoints: &Endpoints) -> Result<Session, LinkError> {
    if endpoints.listen.is_empty() && endpoints.connect.is_empty() {
        return Err(LinkError::NoEndpoint);
    }
    let mut config = match &endpoints.config {
        Some(file) => Config::from_file(file).map_err(|error| LinkError::Config(error.to_string()))?,
        None => Config::default(),
    };
    let mut set = |key: &str, value: &str| config.insert_json5(key, value).map_err(|error| LinkError::Config(format!("{key}: {error}")));
    set("mode", "\"peer\"")?;
    set("scouting/multicast/enabled", "false")?;
    set("scouting/gossip/enabled", "false")?;
    set("listen/endpoints", &list(&endpoints.listen)?)?;
    set("connect/endpoints", &list(&endpoints.connect)?)?;
    set("connect/timeout_ms", "-1")?;
    set("connect/exit_on_failure", "false")?;
    set("connect/retry", "{ period_init_ms: 100, period_max_ms: 1000, period_increase_factor: 2 }")?;
    // Messages go out one by one: none waits for the next.
    set("transport/link/tx/queue/batching/enabled", "false")?;
    let all = [&endpoints.listen[..], &endpoints.connect].concat().join(", ");
    zenoh::open(config).wait().map_err(zenoh_error(format!("cannot open {all}")))
}

/// Endpoints as a JSON list.
fn list(endpoints: &[String]) -> Result<String, LinkError> {
    for endpoint in endpoints {
        let is_endpoint = endpoint.split_once('/').is_some_and(|(protocol, address)| !protocol.is_empty() && address.contains(':'));
        if !is_endpoint || endpoint.contains(['"', '\\']) || endpoint.chars().any(char::is_control) {
            return Err(LinkError::Endpoint(endpoint.clone()));
        }
    }
    Ok(format!("[{}]", endpoints.iter().map(|endpoint| format!("\"{endpoint}\"")).collect::<Vec<_>>().join(",")))
}

/// A publisher whose messages go out at once, and wait where the link is full; with `drops`, they are dropped instead.
///
/// # Errors
/// [`LinkError::Zenoh`].
pub fn publisher(session: &Session, key: &str, drops: bool) -> Result<zenoh::pubsub::Publisher<'static>, LinkError> {
    let control = if drops { CongestionControl::Drop } else { CongestionControl::Block };
    let publisher = session.declare_publisher(key.to_owned()).congestion_control(control).express(true).wait();
    publisher.map_err(zenoh_error(format!("cannot publish {key}")))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn endpoints_are_checked_before_zenoh_sees_them() {
        assert_eq!(list(&["tcp/127.0.0.1:1".into(), "tls/[::1]:2".into()]).unwrap(), r#"["tcp/127.0.0.1:1","tls/[::1]:2"]"#);
        for bad in ["127.0.0.1:1", "tcp/127.0.0.1", "/a:1", "tcp/a:1\"", "tcp/a:\n1", ""] {
            assert!(matches!(list(&[bad.into()]), Err(LinkError::Endpoint(_))), "{bad:?}");
        }
        let none = Endpoints { listen: Vec::new(), connect: Vec::new(), config: None };
        assert!(matches!(open(&none), Err(LinkError::NoEndpoint)));
    }
}
