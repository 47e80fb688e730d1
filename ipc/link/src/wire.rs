//! Messages as they come over the wire, from whoever could connect: sizes and versions are checked before anything is laid out by them.
//!
//! Nothing here knows of zenoh, so that hostile bytes can be tried without a network (`fuzz`, target `link`).

use beo_ipc::limits::voxel_count;
use beo_ipc::relay::{ReloadReply, ReloadRequest, from_bytes};
use beo_ipc::validate::validate;
use beo_ipc::{ABI_VERSION, CompletionHeader, ObservationHeader, Percept, Refusal, Status};

/// A message that is none of this version.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("{0} bytes that are no message of version {ABI_VERSION}: build both ends from the same version of beo")]
pub struct Broken(pub usize);

/// An observation that makes no sense.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum BadObservation {
    /// Not even a header.
    #[error("{0} bytes are too few for a header")]
    Short(usize),
    /// What the daemon would refuse by the header.
    #[error(transparent)]
    Refused(#[from] Refusal),
}

/// An observation: its header, and a byte for each of its voxels, which are not looked at.
///
/// # Errors
/// [`BadObservation`]: what a daemon would refuse by its header.
pub fn observation(bytes: &[u8]) -> Result<(ObservationHeader, &[u8]), BadObservation> {
    let (header, voxels) = from_bytes::<ObservationHeader>(bytes).ok_or(BadObservation::Short(bytes.len()))?;
    validate(&header, voxels.len())?;
    Ok((header, voxels))
}

/// A percept.
///
/// # Errors
/// [`Broken`].
pub fn percept(bytes: &[u8]) -> Result<Percept, Broken> {
    match from_bytes::<Percept>(bytes) {
        Some((percept, [])) if percept.abi_version == ABI_VERSION => Ok(percept),
        _ => Err(Broken(bytes.len())),
    }
}

/// A completion: its header, occupancy and deviation, a byte per voxel each.
///
/// # Errors
/// [`Broken`].
pub fn completion(bytes: &[u8]) -> Result<(CompletionHeader, &[u8], &[u8]), Broken> {
    let (header, voxels) = from_bytes::<CompletionHeader>(bytes).ok_or(Broken(bytes.len()))?;
    match voxel_count(header.dims) {
        Some(count) if header.abi_version == ABI_VERSION && voxels.len() == 2 * count => {
            let (occupancy, deviation) = voxels.split_at(count);
            Ok((header, occupancy, deviation))
        }
        _ => Err(Broken(bytes.len())),
    }
}

/// A status, for a grid of possible size.
///
/// # Errors
/// [`Broken`].
pub fn status(bytes: &[u8]) -> Result<Status, Broken> {
    match from_bytes::<Status>(bytes) {
        Some((status, [])) if status.abi_version == ABI_VERSION && voxel_count(status.dims).is_some() => Ok(status),
        _ => Err(Broken(bytes.len())),
    }
}

/// A call for another model; of its path nothing is looked at.
///
/// # Errors
/// [`Broken`].
pub fn reload_request(bytes: &[u8]) -> Result<ReloadRequest, Broken> {
    match from_bytes::<ReloadRequest>(bytes) {
        Some((request, [])) if request.abi_version == ABI_VERSION => Ok(request),
        _ => Err(Broken(bytes.len())),
    }
}

/// The answer to such a call.
///
/// # Errors
/// [`Broken`].
pub fn reload_reply(bytes: &[u8]) -> Result<ReloadReply, Broken> {
    match from_bytes::<ReloadReply>(bytes) {
        Some((reply, [])) if reply.abi_version == ABI_VERSION => Ok(reply),
        _ => Err(Broken(bytes.len())),
    }
}

/// The other machine's clock, nanoseconds.
///
/// # Errors
/// [`Broken`].
pub fn clock(bytes: &[u8]) -> Result<u64, Broken> {
    Ok(u64::from_le_bytes(bytes.try_into().map_err(|_| Broken(bytes.len()))?))
}

#[cfg(test)]
mod tests {
    use super::*;
    use beo_ipc::relay::to_bytes;

    /// Good messages: an observation, a completion, a percept and a status on 8 x 8 x 8 voxels, a call for another model and its answer.
    fn seeds() -> Vec<Vec<u8>> {
        let observed = ObservationHeader { producer_id: 7, sequence: 1, ..ObservationHeader::new([8; 3]) };
        let completed = CompletionHeader { dims: [8; 3], ..CompletionHeader::default() };
        let status = Status { dims: [8; 3], ..Status::EMPTY };
        vec![
            [to_bytes(&observed), &[255; 512]].concat(),
            [to_bytes(&completed), &[128; 1024]].concat(),
            to_bytes(&Percept::EMPTY).to_vec(),
            to_bytes(&status).to_vec(),
            to_bytes(&ReloadRequest { abi_version: ABI_VERSION, model: [b'/'; 4096] }).to_vec(),
            to_bytes(&ReloadReply::new(9, Some("it is damaged"))).to_vec(),
        ]
    }

    /// Which of the seven take it.
    fn takers(bytes: &[u8]) -> [bool; 7] {
        let observation = observation(bytes);
        if let Ok((header, voxels)) = &observation {
            assert_eq!(voxel_count(header.dims), Some(voxels.len()));
        }
        let completion = completion(bytes);
        if let Ok((header, occupancy, deviation)) = &completion {
            assert_eq!([occupancy.len(), deviation.len()].map(Some), [voxel_count(header.dims); 2]);
        }
        let [request, reply] = [reload_request(bytes).is_ok(), reload_reply(bytes).is_ok()];
        [observation.is_ok(), completion.is_ok(), percept(bytes).is_ok(), status(bytes).is_ok(), request, reply, clock(bytes).is_ok()]
    }

    #[test]
    fn each_message_is_taken_for_what_it_is_alone() {
        for (kind, seed) in seeds().iter().enumerate() {
            let expected: [bool; 7] = std::array::from_fn(|taker| taker == kind);
            assert_eq!(takers(seed), expected);
            // A byte too few or too many, and another version.
            let mut other_version = seed.clone();
            other_version[0] ^= 1;
            let mut long = seed.clone();
            long.push(0);
            for wrong in [&seed[..seed.len() - 1], &long, &other_version] {
                assert_eq!(takers(wrong), [false; 7], "message {kind}");
            }
        }
        assert_eq!((clock(&7_u64.to_le_bytes()), clock(&[0; 7]), clock(&[])), (Ok(7), Err(Broken(7)), Err(Broken(0))));
        assert_eq!(observation(&[1, 2]), Err(BadObservation::Short(2)));
    }

    #[test]
    fn whatever_the_bytes_are_they_are_taken_or_refused() {
        // xorshift64: the same inputs in every run.
        let mut state = 0x9e37_79b9_7f4a_7c15_u64;
        let mut next = move || {
            state ^= state << 13;
            state ^= state >> 7;
            state ^= state << 17;
            state
        };
        let extremes = [0, 1, 255, 0x7fff_ffff, 0x8000_0000, u32::MAX, f32::NAN.to_bits(), f32::INFINITY.to_bits()];
        let (mut taken, mut refused) = (0, 0);
        for seed in seeds() {
            for _ in 0..3000 {
                let mut bytes = seed.clone();
                for _ in 0..=next() % 3 {
                    let at = (next() as usize % bytes.len()) & !3;
                    match next() % 4 {
                        0 => bytes[at] = next() as u8,
                        1 => bytes.truncate(at.max(1)),
                        2 => bytes.extend((0..next() % 9).map(|byte| byte as u8)),
                        _ => bytes.iter_mut().skip(at).zip(extremes[next() as usize % 8].to_le_bytes()).for_each(|(byte, new)| *byte = new),
                    }
                }
                let count = takers(&bytes).iter().filter(|taker| **taker).count();
                assert!(count <= 1, "one message is taken for two");
                (taken, refused) = (taken + count, refused + usize::from(count == 0));
            }
        }
        assert!(taken > 1000 && refused > 1000, "{taken} taken, {refused} refused");
    }
}
