//! How the shared library is linked: its SONAME, and no symbols but our own.

fn main() {
    // The major version of the C ABI, as `BEO_ABI_VERSION` in beo.h; cargo-c sets the same.
    println!("cargo:rustc-cdylib-link-arg=-Wl,-soname,libbeo.so.2");
    // Otherwise iceoryx2's own C symbols would be exported, and could be mixed up with those of another copy in the same process.
    println!("cargo:rustc-cdylib-link-arg=-Wl,--exclude-libs,ALL");
    println!("cargo:rerun-if-changed=build.rs");
}
