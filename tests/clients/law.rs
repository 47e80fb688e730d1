//! The law of the C interface, by a C program that breaks it.

use crate::harness::{instance, serve};
use crate::toolchain::{Language, compile, finish, has, repository, sanitizers, skip, start};
use std::path::Path;

fn misuse(name: &str, flags: &[&str]) -> std::path::PathBuf {
    compile(Language::C, &repository().join("tests/clients/misuse.c"), name, flags)
}

#[test]
fn misuse_gives_a_status_and_never_a_crash() {
    let name = instance();
    let _daemon = serve(&name);
    assert_eq!(finish(start(&misuse("misuse", sanitizers()), [&name, &instance()])), ["the law holds"]);
}

#[test]
fn misuse_is_clean_under_valgrind() {
    if !has("valgrind") {
        return skip("valgrind is not installed");
    }
    let name = instance();
    let _daemon = serve(&name);
    let program = misuse("misuse-plain", &[]).into_os_string().into_string().unwrap();
    let arguments =
        ["--quiet", "--error-exitcode=99", "--leak-check=full", "--errors-for-leak-kinds=definite", &program, &name, &instance()];
    assert_eq!(finish(start(Path::new("valgrind"), arguments)), ["the law holds"]);
}
