//! The text of beo.h: types and functions by cbindgen, and static assertions of every size and offset.

use super::{MESSAGES, repository};
use cbindgen::{Builder, Config, EnumConfig, ExportConfig, FunctionConfig, Language, RenameRule, Style};
use std::fmt::Write;

/// Rust names and their names in C.
const NAMES: [(&str, &str); 30] = [
    ("Outcome", "beo_status"),
    ("SubscriberHandle", "beo_subscriber"),
    ("CompletionHandle", "beo_completion"),
    ("ProducerHandle", "beo_producer"),
    ("LoanHandle", "beo_loan"),
    ("SubscriberOptions", "beo_subscriber_options"),
    ("ProducerOptions", "beo_producer_options"),
    ("CompletionView", "beo_completion_view"),
    ("CameraIntrinsics", "beo_intrinsics"),
    ("DepthFrame", "beo_depth_frame"),
    ("DepthSensor", "beo_sensor_model"),
    ("CameraOptions", "beo_camera_options"),
    ("SupportPlane", "beo_plane"),
    ("PlacedGrid", "beo_grid"),
    ("ObservationHeader", "beo_observation_header"),
    ("Hypothesis", "beo_hypothesis"),
    ("Percept", "beo_percept"),
    ("CompletionHeader", "beo_completion_header"),
    ("Status", "beo_daemon_status"),
    ("PerceptStatus", "beo_percept_status"),
    ("PoseSearch", "beo_pose_search"),
    ("CompletionFrame", "beo_completion_frame"),
    ("Outside", "beo_outside"),
    ("View", "beo_view"),
    ("ScaleSearch", "beo_scale_search"),
    ("Method", "beo_method"),
    ("DaemonState", "beo_daemon_state"),
    ("Unit", "beo_unit"),
    ("tasks", "BEO_TASK"),
    ("cut", "BEO_CUT"),
];

/// Enums that no function mentions: the messages carry their numbers.
const CODES: [&str; 9] =
    ["PerceptStatus", "PoseSearch", "CompletionFrame", "Outside", "View", "ScaleSearch", "Unit", "Method", "DaemonState"];

const SOURCES: [&str; 9] = [
    "ipc/src/codes.rs",
    "ipc/src/messages.rs",
    "ipc/c/src/outcome.rs",
    "ipc/c/src/options.rs",
    "ipc/c/src/common.rs",
    "ipc/c/src/subscriber.rs",
    "ipc/c/src/completion.rs",
    "ipc/c/src/producer.rs",
    "ipc/c/src/camera.rs",
];

const OPENING: &str = "\
/*
 * beo.h: talk to the beo perception daemon over shared memory. Link with libbeo.
 *
 * Generated from the Rust sources: do not edit.
 *
 * Every function that can fail returns a status: 0 done, above 0 try again, below 0 an error; beo_last_error() says more. Handles may be
 * used from any thread, one thread at a time. A NULL, closed, released or wrong handle, a NULL pointer and a wrong size give a status, not
 * a crash. What a function opens, takes or loans belongs to the caller until the function named there ends it. The library starts no
 * threads, installs no signal handlers and prints nothing.
 *
 * Grids are in C order [x][y][z], z fastest and up. Lengths are metres; quaternions are x, y, z, w; stamps are nanoseconds of
 * CLOCK_MONOTONIC, 0 where a stage did not run.
 */";

const CONSTANTS: &str = "
/** The version of this header and of the messages; compare with beo_abi_version(). */
#define BEO_ABI_VERSION 2

/** A class_index that says that there is none. */
#define BEO_NO_CLASS UINT32_MAX
/** A resting_pose that says that there is none: the rotation was not searched among resting poses. */
#define BEO_NO_RESTING_POSE UINT32_MAX
/** A none_probability or fit that says that it was not computed. What was computed is never negative and never NaN. */
#define BEO_NOT_COMPUTED (-1.0f)

/** Class posterior: a bit of `tasks`. It is computed in any case. */
#define BEO_TASK_CLASS 1
/** Pose hypotheses: a bit of `tasks`. */
#define BEO_TASK_POSE 2
/** Completed occupancy with its uncertainty: a bit of `tasks`. */
#define BEO_TASK_COMPLETION 4

/** The object goes on beyond the border of the image: a bit of `cut`. */
#define BEO_CUT_BORDER 1
/** Something nearer hides a part of the object: a bit of `cut`. */
#define BEO_CUT_OCCLUDER 2

/** Most classes of a model. */
#define BEO_MAX_CLASSES 64
/** Most pose hypotheses of a percept. */
#define BEO_MAX_HYPOTHESES 8
/** Bytes of a class or frame name: UTF-8, padded with NUL, not necessarily NUL-terminated: print with \"%.32s\". */
#define BEO_NAME_LEN 32
/** Bytes of the explanation of a refused observation, as names: print with \"%.128s\". */
#define BEO_EXPLANATION_LEN 128
";

const INITIALISERS: &str = "
/** Options to start from: `beo_subscriber_options options = BEO_SUBSCRIBER_OPTIONS_INIT;` */
#define BEO_SUBSCRIBER_OPTIONS_INIT { sizeof(beo_subscriber_options), 0, 0, 0 }
/** Options to start from: `beo_producer_options options = BEO_PRODUCER_OPTIONS_INIT;` */
#define BEO_PRODUCER_OPTIONS_INIT { sizeof(beo_producer_options), 0 }
/** Options to start from: `beo_camera_options options = BEO_CAMERA_OPTIONS_INIT;` */
#define BEO_CAMERA_OPTIONS_INIT { sizeof(beo_camera_options), 0, { 0.001, 0.0019, 2.0 }, { 0, 0, 0 }, 2.0 / 3.0, 0, 0, 40, 0 }
/** Zeroes `frame` and sets its size: a statement. */
#define BEO_DEPTH_FRAME_INIT(frame) (memset(&(frame), 0, sizeof(beo_depth_frame)), (frame).size = (uint32_t)sizeof(beo_depth_frame))
/** Zeroes `view` and sets its size: a statement. */
#define BEO_COMPLETION_VIEW_INIT(view) (memset(&(view), 0, sizeof(beo_completion_view)), (view).size = (uint32_t)sizeof(beo_completion_view))
";

/// The whole header.
pub fn text() -> String {
    check_constants();
    let mut builder = Builder::new().with_config(config());
    for source in SOURCES.into_iter().chain(["ipc/c/src/perceive.rs"]) {
        builder = builder.with_src(repository().join(source));
    }
    let mut bytes = Vec::new();
    builder.generate().expect("the sources parse").write(&mut bytes);
    let text = String::from_utf8(bytes).unwrap();
    let text: String = text.lines().map(|line| format!("{}\n", c_words(line))).collect();
    let text = one_line_comments(&text);
    // What Rust says of unsafe functions, in C's words.
    text.replace(" * # Safety\n", " * The caller promises:\n")
}

/// The constants above are those of beo-ipc.
fn check_constants() {
    use beo_ipc::{cut, limits, tasks};
    let defined = |name: &str, value: u64| assert!(CONSTANTS.contains(&format!("#define {name} {value}\n")), "{name} is not {value}");
    defined("BEO_ABI_VERSION", beo_ipc::ABI_VERSION.into());
    assert_eq!((beo_ipc::NO_CLASS, beo_ipc::NO_RESTING_POSE, beo_ipc::NOT_COMPUTED), (u32::MAX, u32::MAX, -1.0));
    defined("BEO_TASK_CLASS", tasks::CLASS.into());
    defined("BEO_TASK_POSE", tasks::POSE.into());
    defined("BEO_TASK_COMPLETION", tasks::COMPLETION.into());
    assert_eq!(tasks::ALL, 7, "a new task needs its constant");
    defined("BEO_CUT_BORDER", cut::BORDER.into());
    defined("BEO_CUT_OCCLUDER", cut::OCCLUDER.into());
    assert_eq!(cut::ALL, 3, "a new bit needs its constant");
    let (sensor, placement) = (beo_camera::SensorModel::default(), beo_camera::Placement::default());
    assert_eq!([sensor.constant_m, sensor.quadratic_per_m, sensor.deviations], [0.001, 0.0019, 2.0], "BEO_CAMERA_OPTIONS_INIT");
    assert_eq!((placement.share, placement.known_side_m, placement.least_readings), (2.0 / 3.0, None, 40), "BEO_CAMERA_OPTIONS_INIT");
    defined("BEO_MAX_CLASSES", limits::MAX_CLASSES as u64);
    defined("BEO_MAX_HYPOTHESES", limits::MAX_HYPOTHESES as u64);
    defined("BEO_NAME_LEN", limits::NAME_LEN as u64);
    defined("BEO_EXPLANATION_LEN", limits::EXPLANATION_LEN as u64);
}

fn config() -> Config {
    let rename = NAMES.into_iter().map(|(rust, c)| (rust.to_owned(), c.to_owned())).collect();
    Config {
        language: Language::C,
        style: Style::Both,
        cpp_compat: true,
        header: Some(OPENING.to_owned()),
        include_guard: Some("BEO_H".to_owned()),
        no_includes: true,
        sys_includes: ["stddef.h", "stdint.h", "string.h"].map(str::to_owned).to_vec(),
        after_includes: Some(CONSTANTS.to_owned()),
        trailer: Some(format!("{INITIALISERS}{}", assertions())),
        line_length: 120,
        tab_width: 4,
        usize_is_size_t: true,
        export: ExportConfig {
            include: CODES.map(str::to_owned).to_vec(),
            exclude: [
                "ABI_VERSION",
                "NO_CLASS",
                "NO_RESTING_POSE",
                "NOT_COMPUTED",
                "CLASS",
                "POSE",
                "COMPLETION",
                "BORDER",
                "OCCLUDER",
                "ALL",
            ]
            .map(str::to_owned)
            .to_vec(),
            rename,
            ..ExportConfig::default()
        },
        enumeration: EnumConfig { rename_variants: RenameRule::QualifiedScreamingSnakeCase, ..EnumConfig::default() },
        function: FunctionConfig { no_return: None, ..FunctionConfig::default() },
        ..Config::default()
    }
}

/// Static assertions of every size and offset.
fn assertions() -> String {
    let mut text = String::from(
        "
#ifdef __cplusplus
#define BEO_STATIC_ASSERT(condition, text) static_assert(condition, text)
#else
#define BEO_STATIC_ASSERT(condition, text) _Static_assert(condition, text)
#endif

",
    );
    let mut assert = |condition: String| writeln!(text, "BEO_STATIC_ASSERT({condition}, \"layout\");").unwrap();
    for message in &MESSAGES {
        assert(format!("sizeof({}) == {}", message.c, message.size));
        for field in message.fields {
            assert(format!("offsetof({}, {}) == {}", message.c, field.name, field.offset));
            assert(format!("sizeof((({} *)0)->{}) == {}", message.c, field.name, field.size));
        }
    }
    for (c, size, fields) in [
        ("beo_subscriber_options", "16", &[("size", "0"), ("completion", "4"), ("wait_ms", "8"), ("reserved", "12")][..]),
        ("beo_producer_options", "8", &[("size", "0"), ("wait_ms", "4")]),
        (
            "beo_completion_view",
            "8 + 3 * sizeof(void *) + sizeof(beo_completion_header)",
            &[
                ("size", "0"),
                ("reserved", "4"),
                ("voxel_count", "8"),
                ("occupancy", "8 + sizeof(void *)"),
                ("deviation", "8 + 2 * sizeof(void *)"),
                ("header", "8 + 3 * sizeof(void *)"),
            ],
        ),
        (
            "beo_intrinsics",
            "80",
            &[("width", "0"), ("height", "4"), ("fx", "8"), ("fy", "16"), ("cx", "24"), ("cy", "32"), ("distortion", "40")],
        ),
        (
            "beo_depth_frame",
            "88 + 4 * sizeof(void *)",
            &[
                ("size", "0"),
                ("reserved", "4"),
                ("intrinsics", "8"),
                ("depth_m", "88"),
                ("depth_count", "88 + sizeof(void *)"),
                ("labels", "88 + 2 * sizeof(void *)"),
                ("label_count", "88 + 3 * sizeof(void *)"),
            ],
        ),
        ("beo_sensor_model", "24", &[("constant_m", "0"), ("quadratic_per_m", "8"), ("deviations", "16")]),
        (
            "beo_camera_options",
            "88",
            &[
                ("size", "0"),
                ("support_label", "4"),
                ("sensor", "8"),
                ("up", "32"),
                ("share", "56"),
                ("known_side_m", "64"),
                ("known_side_deviation_m", "72"),
                ("least_readings", "80"),
                ("reserved", "84"),
            ],
        ),
        ("beo_plane", "32", &[("normal", "0"), ("offset_m", "24")]),
        (
            "beo_grid",
            "112",
            &[
                ("dims", "0"),
                ("cut", "12"),
                ("voxel_size_m", "16"),
                ("position_m", "24"),
                ("orientation", "48"),
                ("share_support", "80"),
                ("share_edge", "88"),
                ("share_far", "96"),
                ("surface_deviation_m", "104"),
            ],
        ),
    ] {
        assert(format!("sizeof({c}) == {size}"));
        for (field, offset) in fields {
            assert(format!("offsetof({c}, {field}) == {offset}"));
        }
    }
    text
}

/// A line of documentation with Rust's links and names turned into C's.
fn c_words(line: &str) -> String {
    let mut words = String::new();
    let mut rest = line;
    while let Some((before, link, after)) = split_link(rest) {
        words.push_str(before);
        let link = link.trim_start_matches("crate::");
        let (first, field) = link.split_once("::").map_or((link, None), |(first, field)| (first, Some(field)));
        let name = NAMES.iter().find(|(rust, _)| *rust == first).map_or(first, |(_, c)| c);
        let name = match (name, field) {
            ("ABI_VERSION" | "NO_CLASS" | "NO_RESTING_POSE" | "NOT_COMPUTED", _) => format!("BEO_{name}"),
            ("Producer", _) => "beo_producer".to_owned(),
            ("BEO_TASK" | "BEO_CUT", None) => format!("{name}_…"),
            (name, Some(field)) => format!("{name}.{field}"),
            (name, None) => name.to_owned(),
        };
        write!(words, "`{name}`").unwrap();
        rest = after;
    }
    words + rest
}

/// Comments of one line on one line.
fn one_line_comments(text: &str) -> String {
    let lines: Vec<&str> = text.lines().collect();
    let mut short = String::new();
    let mut index = 0;
    while let Some(line) = lines.get(index) {
        match (line.trim(), lines.get(index + 1), lines.get(index + 2).map(|line| line.trim())) {
            ("/**", Some(text), Some("*/")) => {
                let indentation = line.len() - line.trim_start().len();
                writeln!(short, "{}/** {} */", " ".repeat(indentation), text.trim().trim_start_matches("* ")).unwrap();
                index += 3;
            }
            _ => {
                writeln!(short, "{line}").unwrap();
                index += 1;
            }
        }
    }
    short
}

/// The text before the first [`link`], the link, and the text after it.
fn split_link(text: &str) -> Option<(&str, &str, &str)> {
    let (before, rest) = text.split_once("[`")?;
    let (link, after) = rest.split_once("`]")?;
    Some((before, link, after))
}
