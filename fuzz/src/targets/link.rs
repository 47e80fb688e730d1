//! Messages that `beo-link` takes from the network, from whoever could connect.

#[path = "../../../ipc/link/src/wire.rs"]
mod wire;

use super::plain::bytes_of;
use beo_ipc::limits::voxel_count;
use beo_ipc::relay::{Stamped, to_bytes};
use beo_ipc::{CompletionHeader, ObservationHeader, Percept, Status};

/// Any bytes, taken for each of the messages: what is taken has as many voxels as its header says, and its stamps can be moved to another
/// clock.
pub fn run(data: &[u8]) {
    if let Ok((mut header, voxels)) = wire::observation(data) {
        assert_eq!(voxel_count(header.dims), Some(voxels.len()));
        moved(&mut header, data);
    }
    if let Ok((mut header, occupancy, deviation)) = wire::completion(data) {
        assert_eq!([Some(occupancy.len()), Some(deviation.len())], [voxel_count(header.dims); 2]);
        moved(&mut header, data);
    }
    if let Ok(mut percept) = wire::percept(data) {
        moved(&mut percept, data);
        assert_eq!(to_bytes(&percept).len(), data.len());
    }
    if let Ok(mut status) = wire::status(data) {
        moved(&mut status, data);
        assert!(voxel_count(status.dims).is_some());
    }
    if let Ok(request) = wire::reload_request(data) {
        drop(request.path());
    }
    let _ = wire::reload_reply(data);
    assert_eq!(wire::clock(data).is_ok(), data.len() == 8);
}

/// To clocks that are far ahead and far behind.
fn moved(message: &mut impl Stamped, data: &[u8]) {
    let last = data.last_chunk::<8>().map_or(0, |bytes| i64::from_le_bytes(*bytes));
    for offset_ns in [i64::MIN, i64::MAX, last] {
        message.move_stamps(offset_ns);
    }
}

/// Nothing of the size of the message is allocated.
pub fn most_bytes(len: usize) -> usize {
    len + (1 << 16)
}

/// Seeds.
pub fn seeds() -> Vec<Vec<u8>> {
    let observed = ObservationHeader { producer_id: 7, sequence: 1, capture_ns: 5, ..ObservationHeader::new([8; 3]) };
    let completed = CompletionHeader { dims: [8; 3], capture_ns: 5, ..CompletionHeader::default() };
    vec![
        [bytes_of(&observed), vec![255; 512]].concat(),
        [bytes_of(&completed), vec![128; 1024]].concat(),
        bytes_of(&Percept { capture_ns: 5, published_ns: u64::MAX, ..Percept::EMPTY }),
        bytes_of(&Status { dims: [8; 3], heartbeat_ns: 9, ..Status::EMPTY }),
        7_u64.to_le_bytes().to_vec(),
    ]
}
