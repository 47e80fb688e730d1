//! The control call that asks for another model.

use super::plain::{bytes_of, message};
use beo_ipc::ABI_VERSION;
use beo_ipc::control::ReloadRequest;

/// A call: the path that it names is absolute and has no NUL, or it is refused with a reason.
pub fn run(data: &[u8]) {
    let (request, _) = message::<ReloadRequest>(data);
    match request.path() {
        Ok(Some(path)) => assert!(path.is_absolute() && !path.as_os_str().as_encoded_bytes().contains(&0)),
        Ok(None) => assert_eq!(request.model[0], 0),
        Err(reason) => assert!(!reason.is_empty()),
    }
}

/// A small multiple of the call.
pub fn most_bytes(len: usize) -> usize {
    16 * len + (1 << 16)
}

/// Seeds.
pub fn seeds() -> Vec<Vec<u8>> {
    let paths: [&[u8]; 4] = [b"/models/household.safetensors", b"", b"models/relative.safetensors", b"/models/\xff\x1b[31m"];
    let call = |path: &&[u8]| {
        let mut request = ReloadRequest { abi_version: ABI_VERSION, model: [0; 4096] };
        request.model[..path.len()].copy_from_slice(path);
        bytes_of(&request)
    };
    let endless = bytes_of(&ReloadRequest { abi_version: ABI_VERSION, model: [b'/'; 4096] });
    paths.iter().map(call).chain([endless]).collect()
}
