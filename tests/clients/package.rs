//! The Debian package: what is in it, and that what is unpacked from it works where it lies.

use crate::harness::{instance, text};
use crate::toolchain::{Language, finish, has, repository, run, scratch, skip, start};
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::LazyLock;

/// The package, built once as tests build things.
fn package() -> &'static Path {
    static PACKAGE: LazyLock<PathBuf> = LazyLock::new(|| {
        let mut command = Command::new(repository().join("packaging/debian"));
        command.arg(scratch("package")).env("BEO_PROFILE", "dev").env("BEO_PROGRAM", env!("CARGO_BIN_EXE_beo"));
        PathBuf::from(text(&run(command).stdout).lines().last().unwrap())
    });
    &PACKAGE
}

fn dpkg(arguments: &[&str]) -> String {
    let mut command = Command::new("dpkg-deb");
    command.args(arguments);
    text(&run(command).stdout)
}

/// The program that was unpacked below `root`, away from the repository and its models.
fn beo(root: &Path, arguments: &[&str]) -> Command {
    let mut command = Command::new(root.join("usr/bin/beo"));
    command.args(arguments).current_dir(root);
    command
}

#[test]
fn the_debian_package_has_everything_and_runs_where_it_is_unpacked() {
    if !has("dpkg-deb") {
        return skip("the Debian package: dpkg-deb is not installed");
    }
    let root = tempfile::tempdir().unwrap();
    let path = package().to_str().unwrap();
    let field = |name: &str| dpkg(&["--field", path, name]).trim().to_owned();
    assert_eq!((field("Package"), field("Version")), ("beo".into(), env!("CARGO_PKG_VERSION").into()));
    assert!(field("Depends").starts_with("libc6 (>= 2."), "{}", field("Depends"));
    // All belongs to root, and nobody else may write it.
    for line in dpkg(&["--contents", path]).lines() {
        let may_write = |place: usize| !line.starts_with('l') && line.as_bytes()[place] == b'w';
        assert!(line.contains("root/root") && !may_write(5) && !may_write(8), "{line}");
    }
    dpkg(&["--extract", path, root.path().to_str().unwrap()]);
    let has_file = |file: &str| assert!(root.path().join(file).exists(), "{file} is missing");
    ["usr/include/beo.h", "usr/include/beo.hpp", "usr/lib/libbeo.so.2", "usr/lib/libbeo.a", "usr/share/cmake/beo"]
        .into_iter()
        .for_each(has_file);
    ["usr/lib/systemd/system/beo@.service", "usr/lib/sysusers.d/beo.conf", "usr/share/doc/beo/copyright"].into_iter().for_each(has_file);
    let unit = std::fs::read_to_string(root.path().join("usr/lib/systemd/system/beo@.service")).unwrap();
    assert!(unit.contains("ExecStart=/usr/bin/beo serve") && !unit.contains("/usr/local"), "{unit}");
    let pkg_config = std::fs::read_to_string(root.path().join("usr/lib/pkgconfig/beo.pc")).unwrap();
    assert!(pkg_config.starts_with("prefix=/usr\n"), "{pkg_config}");
    // The model beside the program is found, and answers.
    let shapes = root.path().join("shapes");
    run(beo(root.path(), &["generate", "household", "--out", shapes.to_str().unwrap(), "--count", "1", "--test", "0"]));
    let mug = std::fs::read_dir(shapes.join("mug/train")).unwrap().next().unwrap().unwrap().path();
    let said = text(&run(beo(root.path(), &["perceive", mug.to_str().unwrap(), "--json"])).stdout);
    let answer: serde_json::Value = serde_json::from_str(&said).unwrap();
    assert!(answer.to_string().contains("mug"), "{said}");
    // A daemon serves it, and a program that is built against the library in the package talks to it.
    let name = instance();
    let daemon = start(&root.path().join("usr/bin/beo"), ["serve", "--instance", &name]);
    let line = daemon.line();
    assert!(line.starts_with("serving") && line.contains("household"), "{line}");
    let (camera, library) = (root.path().join("camera"), root.path().join("usr/lib"));
    let mut compile = Command::new(std::env::var_os("CC").unwrap_or("cc".into()));
    compile.arg(Language::C.example("camera")).arg("-o").arg(&camera).arg("-I").arg(root.path().join("usr/include"));
    compile.arg("-L").arg(&library).args(["-lbeo", "-lm", "-pthread"]).arg(format!("-Wl,-rpath,{}", library.display()));
    run(compile);
    assert_eq!(finish(start(&camera, [&*name, "1", "30"])), ["sent observation 1"]);
    drop(daemon);
}

/// Exit code of the script below where a copy of this system cannot be had.
const NO_COPY: i32 = 77;

/// `dpkg -i` on a copy of this system that is thrown away: a layer over its files, in mounts of its own.
#[test]
fn the_debian_package_is_installed_verified_and_removed_by_dpkg() {
    if !has("dpkg") || !has("dpkg-deb") || !has("unshare") {
        return skip("the installed Debian package: dpkg and unshare are not installed");
    }
    let layer = tempfile::tempdir().unwrap();
    let script = format!(
        r#"set -e
        {{ mount -t tmpfs tmpfs "$1" && mkdir "$1/upper" "$1/work" "$1/root" &&
           mount -t overlay overlay -o "lowerdir=/,upperdir=$1/upper,workdir=$1/work" "$1/root" &&
           mount --rbind /dev "$1/root/dev" && mount -t proc proc "$1/root/proc"; }} 2>/dev/null || exit {NO_COPY}
        cp "$2" "$1/root/tmp/beo.deb"
        inside() {{ chroot "$1/root" sh -ec "$2" </dev/null; }}
        inside "$1" 'dpkg -i /tmp/beo.deb && dpkg --verify beo && dpkg --status beo | grep "install ok installed"'
        inside "$1" 'ldconfig -p | grep -q "libbeo.so.2 .*=> .*/libbeo.so.2"'
        inside "$1" 'if command -v systemd-sysusers >/dev/null; then id beo; fi'
        inside "$1" 'cd /tmp && beo generate household --count 1 --out things >/dev/null && beo perceive things/mug/train/* --json'
        inside "$1" 'dpkg -r beo && test ! -e /usr/bin/beo && test ! -e /usr/share/beo && ! ldconfig -p | grep libbeo'
        "#
    );
    let mut command = Command::new("unshare");
    command.args(["--mount", "sh", "-c", &script, "sh"]).arg(layer.path()).arg(package());
    let output = command.output().unwrap();
    let said = text(&output.stdout) + &text(&output.stderr);
    if output.status.code() == Some(NO_COPY) || said.contains("unshare failed") {
        return skip("the installed Debian package: this may not mount a copy of the system");
    }
    assert!(output.status.success(), "{said}");
    assert!(said.contains("install ok installed") && said.contains("\"class\":\"mug\""), "{said}");
}
