//! NumPy's `.npy` format: complete shapes (bool, or u8 of 0 and 1) and observations (u8 of 0, 1 and 255), axes x, y, z.
//!
//! The header is checked before `npyz` sees it: it allocates whatever size a header claims and parses it recursively.

use super::FormatError;
use beo_core::grid::{Dims, Observation, Occupancy};
use beo_core::text::printable;
use npyz::{NpyFile, NpyHeader, Order, TypeChar, WriterBuilder};
use std::io::Write;

fn error(problem: impl Into<String>) -> FormatError {
    FormatError::File { format: "npy", problem: printable(&problem.into()) }
}

/// Reads a three-dimensional bool or u8 array as a complete shape; u8 values are 0 (empty) and 1 (filled).
pub fn parse_npy(bytes: &[u8]) -> Result<Occupancy, FormatError> {
    let (dims, codes) = array(bytes)?;
    if let Some(index) = codes.iter().position(|code| *code > 1) {
        let ([i, j, k], code) = (dims.coordinates(index), codes[index]);
        let hint = if code == 255 { "; this is an observation, not a complete shape" } else { "" };
        return Err(error(format!("voxel ({i}, {j}, {k}) of a shape holds {code}: expected 0 or 1{hint}")));
    }
    Ok(Occupancy::from_fn(dims, |i, j, k| codes[dims.index(i, j, k)] == 1))
}

/// Reads a three-dimensional u8 array as an observation: 0 empty, 1 filled, 255 unknown. Of a bool array all is known.
pub fn parse_npy_observation(bytes: &[u8]) -> Result<Observation, FormatError> {
    let (dims, codes) = array(bytes)?;
    Ok(Observation::from_bytes(dims, &codes)?)
}

/// Writes an observation as a three-dimensional u8 array: 0 empty, 1 filled, 255 unknown.
pub fn write_npy_observation(out: &mut impl Write, observation: &Observation) -> std::io::Result<()> {
    let dims = observation.dims();
    let mut codes = vec![0; dims.voxels()];
    observation.write(&mut codes);
    let shape = <[usize; 3]>::from(dims).map(|n| n as u64);
    let mut writer = npyz::WriteOptions::<u8>::new().default_dtype().shape(&shape).writer(out).begin_nd()?;
    writer.extend(codes)?;
    writer.finish()
}

/// Size and one byte per voxel, in C order.
fn array(bytes: &[u8]) -> Result<(Dims, Vec<u8>), FormatError> {
    check_npy_header(bytes, 3, "three axes x, y, z of 8 to 256 voxels").map_err(error)?;
    let mut data = bytes;
    let header = NpyHeader::from_reader(&mut data).map_err(|e| error(e.to_string()))?;
    let &[x, y, z] = header.shape() else {
        return Err(error(format!("the array has shape {:?}: expected three axes x, y, z", header.shape())));
    };
    let dims = Dims::new(x as usize, y as usize, z as usize)?;
    if data.len() != dims.voxels() {
        return Err(error(format!("{} bytes of data for {dims} voxels of one byte each", data.len())));
    }
    let is_bool = match header.dtype() {
        npyz::DType::Plain(t) if t.type_char() == TypeChar::Bool => true,
        npyz::DType::Plain(t) if t.type_char() == TypeChar::Uint && t.size_field() == 1 => false,
        other => return Err(error(format!("type {}: expected bool or uint8; convert with .astype(bool)", other.descr()))),
    };
    let order = header.order();
    let codes = if is_bool {
        NpyFile::with_header(header, data).into_vec::<bool>().map(|v| v.into_iter().map(u8::from).collect())
    } else {
        NpyFile::with_header(header, data).into_vec::<u8>()
    };
    let codes: Vec<u8> = codes.map_err(|e| error(e.to_string()))?;
    Ok(match order {
        Order::C => (dims, codes),
        Order::Fortran => {
            let place = |[i, j, k]: [usize; 3]| i + dims.x() * (j + dims.y() * k);
            (dims, (0..dims.voxels()).map(|index| codes[place(dims.coordinates(index))]).collect())
        }
    })
}

/// Refuses headers that are larger, deeper or name longer numbers than that of an array of `axes` axes, which `expected` describes, can:
/// what is wrong, in words.
pub fn check_npy_header(bytes: &[u8], axes: usize, expected: &str) -> Result<(), String> {
    const LONGEST: usize = 4096;
    let (start, length) = match bytes {
        [0x93, b'N', b'U', b'M', b'P', b'Y', 1, _, a, b, ..] => (10, u16::from_le_bytes([*a, *b]) as usize),
        [0x93, b'N', b'U', b'M', b'P', b'Y', 2 | 3, _, a, b, c, d, ..] => (12, u32::from_le_bytes([*a, *b, *c, *d]) as usize),
        [0x93, b'N', b'U', b'M', b'P', b'Y', ..] => return Err("unknown version or a truncated header".into()),
        _ => return Err("does not start as an .npy file does".into()),
    };
    let header = (length <= LONGEST).then(|| bytes.get(start..start + length)).flatten();
    let header = header.ok_or_else(|| format!("a header of {length} bytes: truncated, or not that of a plain array"))?;
    let text = std::str::from_utf8(header).map_err(|_| "the header is not text")?;
    let shape = text.split_once('(').and_then(|(before, rest)| rest.split_once(')').map(|(shape, after)| (before, shape, after)));
    let is_flat = |s: &str| !s.contains(['(', ')', '[', ']']) && s.matches('{').count() <= 1;
    match shape {
        Some((before, shape, after)) if is_flat(before) && is_flat(after) => {
            let sides: Vec<&str> = shape.split(',').map(|n| n.trim().trim_end_matches('L')).collect();
            let sides = sides.strip_suffix(&[""]).unwrap_or(&sides);
            let is_side = |n: &&str| (1..=6).contains(&n.len()) && n.bytes().all(|b| b.is_ascii_digit());
            if sides.len() == axes && sides.iter().all(is_side) {
                return Ok(());
            }
            let shape: String = shape.chars().take(60).collect();
            Err(format!("the array has shape ({shape}): expected {expected}"))
        }
        _ => Err("the header is not that of a plain array".into()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn file(descr: &str, fortran: &str, shape: &str, data: &[u8]) -> Vec<u8> {
        let header = format!("{{'descr': '{descr}', 'fortran_order': {fortran}, 'shape': {shape}, }}\n");
        let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
        bytes.extend((header.len() as u16).to_le_bytes());
        bytes.extend(header.as_bytes());
        bytes.extend(data);
        bytes
    }

    /// Voxel (1, 2, 3) of an 8×9×10 grid filled, at `index` of the data: numpy.ravel_multi_index((1, 2, 3), (8, 9, 10), order=…)
    /// gives 113 for C and 233 for Fortran order.
    fn one_voxel(index: usize) -> Vec<u8> {
        let mut data = vec![0; 720];
        data[index] = 1;
        data
    }

    #[test]
    fn c_and_fortran_order_name_the_same_voxel() {
        for descr in ["|b1", "|u1"] {
            for (fortran, index) in [("False", 113), ("True", 233)] {
                let object = parse_npy(&file(descr, fortran, "(8, 9, 10)", &one_voxel(index))).unwrap();
                assert_eq!(<[usize; 3]>::from(object.dims()), [8, 9, 10]);
                assert!(object.count() == 1 && object.is_filled(1, 2, 3), "{descr} {fortran}");
            }
        }
    }

    #[test]
    fn malformed_files_are_refused_with_the_reason() {
        let message = |bytes: &[u8]| parse_npy(bytes).unwrap_err().to_string();
        let data = one_voxel(0);
        assert!(message(b"PK\x03\x04").contains("does not start as"));
        assert!(message(&file("<f4", "False", "(8, 9, 10)", &data)).contains("expected bool or uint8"));
        assert!(message(&file("|u1", "False", "(720,)", &data)).contains("shape (720,): expected three axes"));
        assert!(message(&file("|u1", "False", "(8, 9, 11)", &data)).contains("720 bytes of data for 8×9×11"));
        assert!(message(&file("|u1", "False", "(4, 9, 10)", &data)).contains("8 to 256"));
        assert!(message(&file("|u1", "False", "(999999, 999999, 999999)", &data)).contains("8 to 256"));
        assert!(message(&file("|u1", "False", "(99999999999, 9, 9)", &data)).contains("8 to 256"));
        assert!(message(&file("|u1", "False", &"(".repeat(4000), &data)).contains("not that of a plain array"));
        assert!(message(b"\x93NUMPY\x02\x00\xff\xff\xff\xff{").contains("a header of 4294967295 bytes"));
        let mut unknown = data.clone();
        unknown[113] = 255;
        assert!(message(&file("|u1", "False", "(8, 9, 10)", &unknown)).contains("voxel (1, 2, 3) of a shape holds 255"));
        let observation = parse_npy_observation(&file("|u1", "False", "(8, 9, 10)", &unknown)).unwrap();
        assert_eq!(observation.known().count_ones(..), 719);
        unknown[113] = 7;
        let wrong = parse_npy_observation(&file("|u1", "False", "(8, 9, 10)", &unknown)).unwrap_err().to_string();
        assert_eq!(wrong, "voxel (1, 2, 3) holds 7: write 0 for empty, 1 for filled, 255 for unknown");
    }

    #[test]
    fn a_header_with_control_characters_is_refused_in_one_line_that_shows_none() {
        // Found by fuzzing: line breaks in the header came back in the message.
        for shape in ["(8, 9,\n 10,\x1b[2J 11)", "(8,\r\n9)"] {
            let message = parse_npy(&file("|u1", "False", shape, &[0; 720])).unwrap_err().to_string();
            assert!(!message.contains(char::is_control), "{message:?}");
        }
        let message = parse_npy(&file("|u\n1", "False", "(8, 9, 10)", &[0; 720])).unwrap_err().to_string();
        assert!(!message.contains(char::is_control), "{message:?}");
    }

    proptest! {
        #[test]
        fn observations_survive_a_round_trip(codes in prop::collection::vec(prop::sample::select(vec![0_u8, 1, 255]), 8 * 9 * 11)) {
            let observation = Observation::from_bytes(Dims::new(8, 9, 11).unwrap(), &codes).unwrap();
            let mut bytes = Vec::new();
            write_npy_observation(&mut bytes, &observation).unwrap();
            prop_assert_eq!(parse_npy_observation(&bytes).unwrap(), observation);
        }

        #[test]
        fn damaged_files_do_not_panic(at in 0..100_usize, byte in any::<u8>(), descr in "[|<>=]?[a-zA-Z][0-9]{0,3}") {
            let mut bytes = file(&descr, "False", "(8, 9, 10)", &one_voxel(5));
            bytes[at] = byte;
            let _ = parse_npy(&bytes);
            let _ = parse_npy(&bytes[..at]);
        }
    }
}
