//! The text of beo_messages.py: the messages as ctypes structures, and the numbers in them.

use super::{MESSAGES, Message};
use beo_ipc::layout::Field;
use beo_ipc::{ABI_VERSION, CompletionFrame, DaemonState, Method, NO_CLASS, NO_RESTING_POSE, NOT_COMPUTED, Outside, PerceptStatus};
use beo_ipc::{PoseSearch, ScaleSearch, Unit, View, cut, tasks};
use std::fmt::{Debug, Write};

/// The whole module.
pub fn text() -> String {
    let mut text = String::from(
        "\"\"\"The messages of the beo perception daemon as ctypes structures, exactly as they lie in shared memory.

Generated from the Rust sources: do not edit. What the fields mean is said in ipc/src/messages.rs and in ipc/include/beo.h.
\"\"\"

import ctypes
import enum

",
    );
    for (name, value) in [("ABI_VERSION", ABI_VERSION), ("NO_CLASS", NO_CLASS), ("NO_RESTING_POSE", NO_RESTING_POSE)] {
        writeln!(text, "{name} = {value}").unwrap();
    }
    writeln!(text, "NOT_COMPUTED = {NOT_COMPUTED:?}").unwrap();
    writeln!(text, "CUT_BORDER, CUT_OCCLUDER = {}, {}", cut::BORDER, cut::OCCLUDER).unwrap();
    writeln!(text, "TASK_CLASS, TASK_POSE, TASK_COMPLETION = {}, {}, {}", tasks::CLASS, tasks::POSE, tasks::COMPLETION).unwrap();
    codes(&mut text, "PerceptStatus", PerceptStatus::from_code);
    codes(&mut text, "PoseSearch", PoseSearch::from_code);
    codes(&mut text, "CompletionFrame", CompletionFrame::from_code);
    codes(&mut text, "Outside", Outside::from_code);
    codes(&mut text, "View", View::from_code);
    codes(&mut text, "ScaleSearch", ScaleSearch::from_code);
    codes(&mut text, "Unit", Unit::from_code);
    codes(&mut text, "Method", Method::from_code);
    codes(&mut text, "DaemonState", DaemonState::from_code);
    MESSAGES.iter().for_each(|message| structure(&mut text, message));
    layouts(&mut text);
    text
}

/// An enum whose numbers follow each other from 0.
fn codes<T: Debug>(text: &mut String, name: &str, from_code: impl Fn(u32) -> Option<T>) {
    write!(text, "\n\nclass {name}(enum.IntEnum):\n").unwrap();
    for (code, variant) in (0..).map_while(|code| from_code(code).map(|variant| (code, variant))) {
        writeln!(text, "    {} = {code}", screaming(&format!("{variant:?}"))).unwrap();
    }
}

fn structure(text: &mut String, message: &Message) {
    write!(text, "\n\nclass {}(ctypes.Structure):\n    _fields_ = [\n", message.rust).unwrap();
    for field in message.fields {
        writeln!(text, "        (\"{}\", {}),", field.name, field_type(message, field)).unwrap();
    }
    write!(text, "    ]\n\n    @staticmethod\n    def type_name():\n        return \"{}\"\n", message.type_name).unwrap();
    write!(text, "\n\nassert ctypes.sizeof({}) == {}\n", message.rust, message.size).unwrap();
    for field in message.fields {
        writeln!(
            text,
            "assert {}.{}.offset == {} and {}.{}.size == {}",
            message.rust, field.name, field.offset, message.rust, field.name, field.size
        )
        .unwrap();
    }
}

fn field_type(message: &Message, field: &Field) -> String {
    let (scalar, size) = match field.scalar {
        "u8" => ("ctypes.c_uint8", 1),
        "u32" => ("ctypes.c_uint32", 4),
        "u64" => ("ctypes.c_uint64", 8),
        "f32" => ("ctypes.c_float", 4),
        "f64" => ("ctypes.c_double", 8),
        nested => {
            let nested = MESSAGES.iter().find(|message| message.rust == nested).expect("a known nested message");
            (nested.rust, nested.size)
        }
    };
    let count = field.size / size;
    match (message.rust, field.name) {
        // The only array of arrays: names.
        ("Status", "class_names") => format!("({scalar} * 32) * {}", count / 32),
        _ if count == 1 => scalar.to_owned(),
        _ => format!("{scalar} * {count}"),
    }
}

/// The value of the services' attribute `beo.layout`.
fn layouts(text: &mut String) {
    use beo_ipc::layout::Layout;
    use beo_ipc::{CompletionHeader, ObservationHeader, Percept, Status};
    text.push_str("\n\n# What the attribute `beo.layout` of each service must say.\nLAYOUTS = {\n");
    for (channel, hash) in [
        ("observation", ObservationHeader::LAYOUT_HASH),
        ("percept", Percept::LAYOUT_HASH ^ beo_ipc::Hypothesis::LAYOUT_HASH.rotate_left(1)),
        ("completion", CompletionHeader::LAYOUT_HASH),
        ("status", Status::LAYOUT_HASH),
    ] {
        writeln!(text, "    \"{channel}\": \"{hash:016x}\",").unwrap();
    }
    text.push_str("}\n");
}

fn screaming(name: &str) -> String {
    let mut text = String::new();
    for (index, letter) in name.char_indices() {
        if letter.is_uppercase() && index > 0 {
            text.push('_');
        }
        text.push(letter.to_ascii_uppercase());
    }
    text
}
