//! Generated files are those of the present messages and functions: the C header and the Python structures.
//!
//! `BEO_WRITE_GENERATED=1 cargo test -p beo-c --test generated` writes them anew.

#[path = "generated/header.rs"]
mod header;
#[path = "generated/python.rs"]
mod python;

use beo_ipc::layout::{Field, Layout};
use beo_ipc::{CompletionHeader, Hypothesis, ObservationHeader, Percept, Status};
use std::path::{Path, PathBuf};

/// A message: its name in Rust, C and Python, its type name in shared memory, its bytes, its fields.
struct Message {
    rust: &'static str,
    c: &'static str,
    type_name: &'static str,
    size: usize,
    fields: &'static [Field],
}

const fn message<M: Layout>(rust: &'static str, c: &'static str, type_name: &'static str) -> Message {
    Message { rust, c, type_name, size: size_of::<M>(), fields: M::FIELDS }
}

/// The messages, nested ones before those that contain them.
const MESSAGES: [Message; 5] = [
    message::<ObservationHeader>("ObservationHeader", "beo_observation_header", "beo.v2.ObservationHeader"),
    message::<Hypothesis>("Hypothesis", "beo_hypothesis", "beo.v2.Hypothesis"),
    message::<Percept>("Percept", "beo_percept", "beo.v2.Percept"),
    message::<CompletionHeader>("CompletionHeader", "beo_completion_header", "beo.v2.CompletionHeader"),
    message::<Status>("Status", "beo_daemon_status", "beo.v2.Status"),
];

fn repository() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

fn check(path: &str, text: &str) {
    let path = repository().join(path);
    if std::env::var_os("BEO_WRITE_GENERATED").is_some() {
        return std::fs::write(&path, text).unwrap();
    }
    let committed = std::fs::read_to_string(&path).unwrap_or_default();
    let differs = committed.lines().zip(text.lines()).position(|(old, new)| old != new);
    assert!(
        committed == text,
        "{} is not current (line {}): run `BEO_WRITE_GENERATED=1 cargo test -p beo-c --test generated`",
        path.display(),
        differs.map_or("at the end".to_owned(), |line| (line + 1).to_string())
    );
}

#[test]
fn the_c_header_is_current() {
    check("ipc/include/beo.h", &header::text());
}

#[test]
fn the_python_messages_are_current() {
    check("examples/python/beo_messages.py", &python::text());
}

#[test]
fn the_page_of_the_contract_names_every_field_and_type() {
    let page = std::fs::read_to_string(repository().join("docs/channels.md")).unwrap();
    for message in MESSAGES {
        assert!(message.rust == "Hypothesis" || page.contains(message.type_name), "{}", message.type_name);
        for field in message.fields {
            assert!(page.contains(&format!("`{}`", field.name)), "{}.{}", message.rust, field.name);
        }
    }
}
