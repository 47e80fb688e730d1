//! The installed library: symbols, SONAME, and the three ways to build against it.

use crate::harness::text;
use crate::harness::{RESOLUTION, instance, serve};
use crate::toolchain::{Language, compile, finish, has, prefix, repository, run, scratch, skip, start};
use std::path::Path;
use std::process::Command;

fn camera_runs(program: &Path) {
    let name = instance();
    let _daemon = serve(&name);
    assert_eq!(finish(start(program, [&name, "1", &RESOLUTION.to_string()])), ["sent observation 1"]);
}

#[test]
fn the_shared_library_exports_our_symbols_alone_under_its_soname() {
    let library = prefix().join("lib/libbeo.so");
    if !has("nm") || !has("readelf") {
        return skip("exported symbols: nm and readelf are not installed");
    }
    let mut nm = Command::new("nm");
    nm.args(["--dynamic", "--defined-only", "--format=posix"]).arg(&library);
    let symbols = text(&run(nm).stdout);
    let names: Vec<&str> = symbols.lines().filter_map(|line| line.split(' ').next()).collect();
    assert!(names.contains(&"beo_subscriber_open"), "{names:?}");
    assert!(names.iter().all(|name| name.starts_with("beo_")), "{names:?}");
    // Every function of the header is there.
    let header = std::fs::read_to_string(prefix().join("include/beo.h")).unwrap();
    let declared =
        header.lines().filter_map(|line| line.split_once('(')?.0.rsplit([' ', '*']).next()).filter(|name| name.starts_with("beo_"));
    let declared: Vec<&str> =
        declared.filter(|name| header.contains(&format!(" {name}(")) || header.contains(&format!("*{name}("))).collect();
    assert!(declared.len() > 15 && declared.iter().all(|name| names.contains(name)), "{declared:?}");
    let mut readelf = Command::new("readelf");
    readelf.arg("--dynamic").arg(&library);
    assert!(text(&run(readelf).stdout).contains("[libbeo.so.2]"));
}

#[test]
fn the_cpp_header_works_without_exceptions_and_with_later_standards() {
    if !Language::Cpp.is_here() {
        return;
    }
    let listen = Language::Cpp.example("listen");
    compile(Language::Cpp, &listen, "listen-without-exceptions", ["-fno-exceptions", "-fno-rtti"]);
    compile(Language::Cpp, &listen, "listen-cpp20", ["-std=c++20"]);
}

#[test]
fn pkg_config_gives_the_line_that_builds_shared_and_static() {
    if !has("pkg-config") {
        return skip("pkg-config is not installed");
    }
    let flags = |arguments: &[&str]| {
        let mut command = Command::new("pkg-config");
        command.args(arguments).arg("beo").env("PKG_CONFIG_PATH", prefix().join("lib/pkgconfig"));
        text(&run(command).stdout).trim().to_owned()
    };
    assert_eq!(flags(&["--modversion"]), "2.0.0");
    let build = |name: &str, flags: String| {
        let program = scratch("bin").join(name);
        let mut command = Command::new(std::env::var_os("CC").unwrap_or("cc".into()));
        command.arg(Language::C.example("camera")).arg("-o").arg(&program).args(flags.split(' '));
        command.arg(format!("-Wl,-rpath,{}/lib", prefix().display()));
        run(command);
        program
    };
    camera_runs(&build("pkg-config-shared", flags(&["--cflags", "--libs"])));
    let fixed = build("pkg-config-static", flags(&["--static", "--cflags", "--libs"]).replace("-lbeo", "-l:libbeo.a"));
    let mut readelf = Command::new("readelf");
    readelf.arg("--dynamic").arg(&fixed);
    assert!(!text(&run(readelf).stdout).contains("libbeo"), "the static program needs no libbeo.so");
    camera_runs(&fixed);
}

#[test]
fn cmake_finds_the_package() {
    if !has("cmake") {
        return skip("cmake is not installed");
    }
    let languages = [("c", Language::C), ("cpp", Language::Cpp)].into_iter().filter(|(_, language)| language.is_here());
    for (language, _) in languages {
        let build = scratch(&format!("cmake-{language}"));
        let mut configure = Command::new("cmake");
        configure.arg("-S").arg(repository().join("examples").join(language)).arg("-B").arg(&build);
        configure.arg(format!("-DCMAKE_PREFIX_PATH={}", prefix().display()));
        run(configure);
        let mut make = Command::new("cmake");
        make.arg("--build").arg(&build);
        run(make);
        camera_runs(&build.join("camera"));
    }
}
