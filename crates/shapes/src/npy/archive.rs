//! `.npz` files: ZIP archives whose members are stored or deflated, as `numpy.savez` and `numpy.savez_compressed` write them.
//!
//! Members are found by the central directory at the end (APPNOTE.TXT 6.3, sections 4.3.7 to 4.3.16). Nothing is unpacked beyond a size
//! that the caller names, whatever the archive claims. The 64-bit fields are read where NumPy writes them; several volumes and encryption
//! are refused.

use beo_core::text::printable;
use miniz_oxide::inflate::{TINFLStatus, decompress_to_vec_with_limit};

/// A member of an archive.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Member {
    /// Its name.
    pub name: String,
    is_deflated: bool,
    checksum: u32,
    packed: usize,
    /// Bytes once unpacked.
    pub size: usize,
    /// Where its local header starts.
    at: usize,
}

/// An archive in memory.
pub(super) struct Archive<'a> {
    bytes: &'a [u8],
    /// In the order of the directory.
    pub members: Vec<Member>,
}

fn u16_at(bytes: &[u8], at: usize) -> Option<usize> {
    Some(u16::from_le_bytes(bytes.get(at..at.checked_add(2)?)?.try_into().ok()?) as usize)
}

fn u32_at(bytes: &[u8], at: usize) -> Option<u32> {
    Some(u32::from_le_bytes(bytes.get(at..at.checked_add(4)?)?.try_into().ok()?))
}

fn u64_at(bytes: &[u8], at: usize) -> Option<usize> {
    usize::try_from(u64::from_le_bytes(bytes.get(at..at.checked_add(8)?)?.try_into().ok()?)).ok()
}

const END_OF_DIRECTORY: &[u8] = b"PK\x05\x06";
const DIRECTORY_ENTRY: &[u8] = b"PK\x01\x02";
const LOCAL_HEADER: &[u8] = b"PK\x03\x04";
/// Most members read: each takes 46 bytes of the directory.
const MOST_MEMBERS: usize = 4096;

impl<'a> Archive<'a> {
    /// Reads the directory.
    pub fn open(bytes: &'a [u8]) -> Result<Self, String> {
        if !bytes.starts_with(LOCAL_HEADER) && !bytes.starts_with(END_OF_DIRECTORY) {
            return Err("does not start as an .npz file (a ZIP archive) does: write it with numpy.savez".into());
        }
        // 22 bytes, then a comment of up to 65535.
        let from = bytes.len().saturating_sub(22 + 65535);
        let end = bytes[from..].windows(4).rposition(|window| window == END_OF_DIRECTORY).map(|at| from + at);
        let end = end.ok_or("the archive has no directory at its end: the file is incomplete")?;
        let damaged = |at: usize| format!("the archive's directory is damaged at byte {at}");
        let count = u16_at(bytes, end + 10).ok_or_else(|| damaged(end))?;
        let mut at = u32_at(bytes, end + 16).ok_or_else(|| damaged(end))? as usize;
        if count > MOST_MEMBERS {
            return Err(format!("an archive of {count} members, more than {MOST_MEMBERS}"));
        }
        let mut members = Vec::new();
        for _ in 0..count {
            let (member, length) = Member::read(bytes, at)?.ok_or_else(|| damaged(at))?;
            members.push(member);
            at += length;
        }
        Ok(Self { bytes, members })
    }

    /// The names of the members, for messages.
    pub fn names(&self) -> String {
        if self.members.is_empty() {
            return "nothing".into();
        }
        let names: Vec<String> = self.members.iter().take(8).map(|member| printable(&member.name)).collect();
        let more = if self.members.len() > 8 { ", …" } else { "" };
        names.join(", ") + more
    }

    /// The packed bytes of a member.
    fn packed(&self, member: &Member) -> Result<&'a [u8], String> {
        let at = member.at;
        let damaged = || format!("its header at byte {at} of the archive is damaged or cut off: the file is incomplete");
        let bytes = self.bytes.get(at..).filter(|bytes| bytes.starts_with(LOCAL_HEADER)).ok_or_else(damaged)?;
        let start = 30 + u16_at(bytes, 26).ok_or_else(damaged)? + u16_at(bytes, 28).ok_or_else(damaged)?;
        let end = start.checked_add(member.packed).ok_or_else(damaged)?;
        bytes.get(start..end).ok_or_else(damaged)
    }

    /// The first bytes of a member, at most `most`.
    pub fn start_of(&self, member: &Member, most: usize) -> Result<Vec<u8>, String> {
        let packed = self.packed(member)?;
        if !member.is_deflated {
            return Ok(packed[..packed.len().min(most)].to_vec());
        }
        match decompress_to_vec_with_limit(packed, most) {
            Ok(bytes) => Ok(bytes),
            Err(error) if error.status == TINFLStatus::HasMoreOutput => Ok(error.output),
            Err(_) => Err("its packed bytes are damaged: the file is incomplete or was changed".into()),
        }
    }

    /// A member whose size must be `size`, checked by its checksum.
    pub fn whole(&self, member: &Member, size: usize) -> Result<Vec<u8>, String> {
        if member.size != size {
            return Err(format!("{} bytes where its header needs {size}: the file is incomplete or damaged", member.size));
        }
        let bytes = self.start_of(member, size)?;
        if bytes.len() != size || crc32fast::hash(&bytes) != member.checksum {
            return Err("its bytes do not have the checksum that the archive names: the file is damaged".into());
        }
        Ok(bytes)
    }
}

impl Member {
    /// The entry of the directory at `at`, and its length; none if it is damaged.
    fn read(bytes: &[u8], at: usize) -> Result<Option<(Self, usize)>, String> {
        let Some(entry) = bytes.get(at..).filter(|entry| entry.starts_with(DIRECTORY_ENTRY)) else { return Ok(None) };
        let read = || -> Option<(Self, usize, usize, usize)> {
            let (flags, method) = (u16_at(entry, 8)?, u16_at(entry, 10)?);
            let (checksum, packed, size) = (u32_at(entry, 16)?, u32_at(entry, 20)?, u32_at(entry, 24)?);
            let lengths = [u16_at(entry, 28)?, u16_at(entry, 30)?, u16_at(entry, 32)?];
            let local = u32_at(entry, 42)?;
            let name = String::from_utf8_lossy(entry.get(46..46 + lengths[0])?).into_owned();
            let extra = entry.get(46 + lengths[0]..46 + lengths[0] + lengths[1])?;
            // Fields of 64 bits stand in for those that are all ones, in this order.
            let mut long = long_fields(extra).into_iter();
            let mut field = |short: u32| if short == u32::MAX { long.next() } else { Some(short as usize) };
            let (size, packed, at) = (field(size)?, field(packed)?, field(local)?);
            let member = Self { name, is_deflated: method == 8, checksum, packed, size, at };
            Some((member, flags, method, 46 + lengths.iter().sum::<usize>()))
        };
        let Some((member, flags, method, length)) = read() else { return Ok(None) };
        if flags & 1 == 1 {
            return Err(format!("member `{}` is encrypted: save it without a password", printable(&member.name)));
        }
        if method != 0 && method != 8 {
            let name = printable(&member.name);
            return Err(format!(
                "member `{name}` is packed by method {method}: expected stored or deflated, as numpy.savez_compressed writes"
            ));
        }
        Ok(Some((member, length)))
    }
}

/// The numbers of the extra field that holds 64-bit sizes.
fn long_fields(mut extra: &[u8]) -> Vec<usize> {
    while let (Some(id), Some(length)) = (u16_at(extra, 0), u16_at(extra, 2)) {
        let Some(field) = extra.get(4..4 + length) else { break };
        if id == 1 {
            return (0..length / 8).filter_map(|n| u64_at(field, 8 * n)).collect();
        }
        extra = &extra[4 + length..];
    }
    Vec::new()
}

#[cfg(test)]
mod tests {
    use super::super::parse_npz;
    use super::*;
    use proptest::prelude::*;

    /// `numpy.savez_compressed(path, voxels=numpy.indices((8, 8, 8)).sum(0) % 5 == 1)`, by NumPy 2.4.6; the second with `name=numpy.array([1, 2])`
    /// too.
    const ONE: &str = "504b03042d000000080000002100ad10328bffffffffffffffff0a001400766f78656c732e6e70790100100080020000000000006b000000000000009bec17ea1b10c9c850c650ad9e925a9c5ca46ea5a05e9364a8aea3a09e965f54529498179f5f94920a12774bcc294e058a17672416a402f91a163a0a20a4a9a350ab401ee062606400024618c5808362c4a58e5c7d088a5c7d7019f2f4a16a27591f0eed24fb67a0c30f00504b01022d032d000000080000002100ad10328b6b000000800200000a0000000000000000000000800100000000766f78656c732e6e7079504b0506000000000100010038000000a70000000000";
    const TWO: &str = "504b03042d000000080000002100ad10328bffffffffffffffff0a001400766f78656c732e6e70790100100080020000000000006b000000000000009bec17ea1b10c9c850c650ad9e925a9c5ca46ea5a05e9364a8aea3a09e965f54529498179f5f94920a12774bcc294e058a17672416a402f91a163a0a20a4a9a350ab401ee062606400024618c5808362c4a58e5c7d088a5c7d7019f2f4a16a27591f0eed24fb67a0c30f00504b03042d0000000800000021000cfc1ce9ffffffffffffffff080014006e616d652e6e70790100100090000000000000004a000000000000009bec17ea1b10c9c850c650ad9e925a9c5ca46ea5a06e9369a1aea3a09e965f54529498179f5f94920a12774bcc294e058a17672416a402f91a463a9a3a0ab50a14002e4606086082d200504b01022d032d000000080000002100ad10328b6b000000800200000a0000000000000000000000800100000000766f78656c732e6e7079504b01022d032d0000000800000021000cfc1ce94a000000900000000800000000000000000000008001a70000006e616d652e6e7079504b050600000000020002006e0000002b0100000000";

    fn bytes(hex: &str) -> Vec<u8> {
        (0..hex.len() / 2).map(|n| u8::from_str_radix(&hex[2 * n..2 * n + 2], 16).unwrap()).collect()
    }

    #[test]
    fn archives_that_numpy_wrote_are_read() {
        for hex in [ONE, TWO] {
            let object = parse_npz(&bytes(hex)).unwrap();
            assert_eq!(object.count(), 101);
            for voxel in 0..512 {
                let [i, j, k] = object.dims().coordinates(voxel);
                assert_eq!(object.is_filled(i, j, k), (i + j + k) % 5 == 1);
            }
        }
    }

    #[test]
    fn nothing_is_unpacked_beyond_what_a_grid_takes() {
        let archive_bytes = bytes(ONE);
        let archive = Archive::open(&archive_bytes).unwrap();
        let member = &archive.members[0];
        assert_eq!(archive.start_of(member, 100).unwrap().len(), 100);
        assert!(archive.whole(member, 100).unwrap_err().contains("where its header needs 100"));
        let shorter = Member { size: 100, ..member.clone() };
        assert!(archive.whole(&shorter, 100).unwrap_err().contains("checksum"));
    }

    #[test]
    fn damage_is_found_by_the_checksum() {
        let mut damaged = bytes(ONE);
        // In the packed bytes.
        damaged[120] ^= 4;
        let message = parse_npz(&damaged).unwrap_err().to_string();
        assert!(message.contains("damaged") || message.contains("plain array") || message.contains("NumPy"), "{message}");
    }

    proptest! {
        #[test]
        fn damaged_files_do_not_panic(at in 0..431_usize, byte in any::<u8>()) {
            for hex in [ONE, TWO] {
                let mut bytes = bytes(hex);
                let at = at % bytes.len();
                bytes[at] = byte;
                let _ = parse_npz(&bytes);
                let _ = parse_npz(&bytes[..at]);
            }
        }
    }
}
