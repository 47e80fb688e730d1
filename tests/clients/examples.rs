//! The examples in Rust, C and C++ (and Python, where it is): what they print.

use crate::harness::{RESOLUTION, Running, instance, serve};
use crate::toolchain::{Language, await_message, compile, finish, sanitizers, start};
use crate::{python, toolchain};
use beo_ipc::{Completion, InstanceName, Subscriber, SubscriberOptions};
use beo_shapes::furniture;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

const COUNT: usize = 3;

/// Starts an example by name with arguments.
type Start = Box<dyn Fn(&str, &[&str]) -> Running>;

/// How the examples of one language are started.
pub struct Examples {
    pub language: &'static str,
    pub start: Start,
}

impl Examples {
    fn compiled(language: &'static str, programs: [(&'static str, PathBuf); 4]) -> Self {
        let start = move |name: &str, arguments: &[&str]| {
            let (_, program) = programs.iter().find(|(example, _)| *example == name).expect("an example of that name");
            start(program, arguments)
        };
        Self { language, start: Box::new(start) }
    }

    pub fn rust() -> Self {
        let folder = Path::new(env!("CARGO_BIN_EXE_beo")).parent().unwrap().join("examples");
        let program = |name| {
            let program = folder.join(name);
            assert!(
                program.exists(),
                "{} is missing: `cargo test` builds it, `cargo test --test clients` alone does not",
                program.display()
            );
            (name, program)
        };
        Self::compiled("Rust", ["camera", "depth_camera", "listen", "grasp"].map(program))
    }

    pub fn c() -> Self {
        let program = |name| (name, compile(Language::C, &Language::C.example(name), &format!("c-{name}"), sanitizers()));
        Self::compiled("C", ["camera", "depth_camera", "listen", "grasp"].map(program))
    }

    pub fn cpp() -> Option<Self> {
        if !Language::Cpp.is_here() {
            return None;
        }
        let program = |name| (name, compile(Language::Cpp, &Language::Cpp.example(name), &format!("cpp-{name}"), sanitizers()));
        Some(Self::compiled("C++", ["camera", "depth_camera", "listen", "grasp"].map(program)))
    }

    pub fn all() -> Vec<Self> {
        [Self::rust(), Self::c()].into_iter().chain(Self::cpp()).chain(python::examples()).collect()
    }
}

/// The class of a line of `listen`, after its form has been checked.
fn heard(line: &str, sequence: usize) -> &str {
    let rest = line.strip_prefix(&format!("#{sequence} ")).unwrap_or_else(|| panic!("{line}"));
    let (class, rest) = rest.split_once(' ').unwrap();
    assert!(furniture::CLASSES.contains(&class), "{line}");
    let (probability, rest) =
        rest.split_once(" %, rotation (0.000, 0.000, 0.000, 1.000), spread 0.0 deg, ").unwrap_or_else(|| panic!("{line}"));
    assert!((10.0..=100.0).contains(&probability.parse::<f64>().unwrap()), "{line}");
    assert!(rest.strip_suffix(" us").unwrap().parse::<f64>().unwrap() > 0.0, "{line}");
    class
}

#[test]
fn every_camera_is_heard_by_every_listener() {
    let examples = Examples::all();
    for camera in &examples {
        let name = instance();
        let _daemon = serve(&name);
        let listeners: Vec<Running> = examples.iter().map(|e| (e.start)("listen", &[&name, &COUNT.to_string()])).collect();
        listeners.iter().for_each(|listener| await_message(listener, "listening"));
        let sent = finish((camera.start)("camera", &[&name, &COUNT.to_string(), &RESOLUTION.to_string()]));
        assert_eq!(sent, (1..=COUNT).map(|n| format!("sent observation {n}")).collect::<Vec<_>>(), "{}", camera.language);
        let mut classes = Vec::new();
        for (listener, example) in listeners.into_iter().zip(&examples) {
            let lines = finish(listener);
            assert_eq!(lines.len(), COUNT, "{}: {lines:?}", example.language);
            classes.extend(lines.iter().enumerate().map(|(index, line)| heard(line, index + 1).to_owned()));
        }
        assert!(classes.iter().all(|class| *class == classes[0]), "one grid, one class: {classes:?}");
    }
}

#[test]
fn a_refused_grid_is_printed_with_its_reason() {
    let name = instance();
    let _daemon = serve(&name);
    let examples = Examples::all();
    let listeners: Vec<Running> = examples.iter().map(|e| (e.start)("listen", &[&name, "1"])).collect();
    listeners.iter().for_each(|listener| await_message(listener, "listening"));
    finish((examples[1].start)("camera", &[&name, "1", "20"]));
    for listener in listeners {
        let lines = finish(listener);
        assert!(lines[0].starts_with("#1 refused: dims are [20, 20, 20]"), "{lines:?}");
    }
}

/// The numbers of a line.
fn numbers(line: &str) -> Vec<f64> {
    line.split(|c: char| !(c.is_ascii_digit() || c == '.' || c == '-')).filter_map(|word| word.parse().ok()).collect()
}

/// The numbers that `grasp` must print of a completion: sequence, centroid, its deviation, extents. The camera's grid is turned by a
/// quarter about z, so that the sensor's x is −y of the grid and the sensor's y its x: no quaternion is needed to say so.
fn expected_grasp(completion: &Completion) -> Vec<f64> {
    let (n, size) = (RESOLUTION as f64, 1.2 / RESOLUTION as f64);
    let points: Vec<[f64; 3]> = (0..RESOLUTION.pow(3))
        .map(|index| {
            let ijk = [index / RESOLUTION.pow(2), index / RESOLUTION % RESOLUTION, index % RESOLUTION];
            let [x, y, z] = ijk.map(|i| (i as f64 + 0.5 - n / 2.0) * size);
            [0.8 - y, x, 0.4 + z]
        })
        .collect();
    let (p, s) = (completion.occupancy(), completion.deviation());
    let mass: f64 = p.iter().map(|p| f64::from(*p)).sum();
    let centroid: [f64; 3] =
        std::array::from_fn(|axis| points.iter().zip(p).map(|(point, p)| f64::from(*p) * point[axis]).sum::<f64>() / mass);
    let moves: [f64; 3] = std::array::from_fn(|axis| {
        points.iter().zip(s).map(|(point, s)| f64::from(*s) * (point[axis] - centroid[axis]).abs()).sum::<f64>() / mass
    });
    let mut expected = vec![completion.header().sequence as f64];
    expected.extend(centroid.into_iter().chain(moves));
    for axis in 0..3 {
        for deviations in [0, -1, 1] {
            let filled = points.iter().zip(p.iter().zip(s)).filter(|(_, (p, s))| i32::from(**p) + deviations * i32::from(**s) >= 128);
            let along: Vec<f64> = filled.map(|(point, _)| point[axis]).collect();
            let range = along.iter().fold((f64::MAX, f64::MIN), |(low, high), x| (low.min(*x), high.max(*x)));
            expected.push(if along.is_empty() { 0.0 } else { range.1 - range.0 + size });
        }
    }
    expected
}

#[test]
fn every_grasp_says_where_the_object_lies_in_the_sensors_frame() {
    let name = instance();
    let _daemon = serve(&name);
    let subscriber =
        Subscriber::open_within(&InstanceName::new(&name).unwrap(), &SubscriberOptions { completion: true }, Duration::from_secs(60))
            .unwrap();
    let examples = Examples::all();
    let grasps: Vec<Running> = examples.iter().map(|e| (e.start)("grasp", &[&name, "1"])).collect();
    grasps.iter().for_each(|grasp| await_message(grasp, "listening"));
    finish((examples[1].start)("camera", &[&name, "1", &RESOLUTION.to_string()]));
    let start = Instant::now();
    let completion = loop {
        if let Some(completion) = subscriber.take_completion().unwrap() {
            break completion;
        }
        assert!(start.elapsed() < Duration::from_secs(60), "no completion");
        subscriber.wait(Duration::from_millis(50)).unwrap();
    };
    let expected = expected_grasp(&completion);
    assert!(expected[4..7].iter().all(|moves| *moves > 0.0), "something is uncertain: {expected:?}");
    for (grasp, example) in grasps.into_iter().zip(examples) {
        let lines = finish(grasp);
        assert!(lines[0].contains(" in camera: centroid ("), "{}: {lines:?}", example.language);
        let found = numbers(&lines[0]);
        assert_eq!(found.len(), expected.len(), "{}: {lines:?}", example.language);
        let close = found.iter().zip(&expected).all(|(found, expected)| (found - expected).abs() < 0.001);
        assert!(close, "{}: {found:?}, expected {expected:?}", example.language);
    }
}

#[test]
fn c_examples_are_clean_under_valgrind() {
    if !toolchain::has("valgrind") {
        return toolchain::skip("valgrind is not installed");
    }
    let name = instance();
    let _daemon = serve(&name);
    let plain = |example: &str| compile(Language::C, &Language::C.example(example), &format!("plain-{example}"), [""; 0]);
    let checked = |program: PathBuf, arguments: &[&str]| {
        let options = ["--quiet", "--error-exitcode=99", "--leak-check=full", "--errors-for-leak-kinds=definite"].map(Into::into);
        start(Path::new("valgrind"), options.into_iter().chain([program.into_os_string()]).chain(arguments.iter().map(Into::into)))
    };
    let listeners = [checked(plain("listen"), &[&name, "2"]), checked(plain("grasp"), &[&name, "2"])];
    listeners.iter().for_each(|listener| await_message(listener, "listening"));
    assert_eq!(finish(checked(plain("camera"), &[&name, "2", &RESOLUTION.to_string()])).len(), 2);
    for listener in listeners {
        assert_eq!(finish(listener).len(), 2);
    }
}
