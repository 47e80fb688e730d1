//! NumPy's `.npy` and `.npz` files: complete shapes (bool, or u8 of 0 and 1) and observations (u8 of 0, 1 and 255), axes x, y, z.

mod archive;
mod array;

pub use self::array::{LONGEST_HEADER, NpyHeader, NpyKind, NpyNumber, write_npy_header};

use self::archive::{Archive, Member};
use super::FormatError;
use beo_core::grid::{Dims, Observation, Occupancy};
use beo_core::text::printable;
use std::io::Write;

/// The longest side of a grid.
const LONGEST_SIDE: usize = 256;

fn error(format: &'static str, problem: impl Into<String>) -> FormatError {
    FormatError::File { format, problem: printable(&problem.into()) }
}

/// Reads a three-dimensional bool or u8 array as a complete shape; u8 values are 0 (empty) and 1 (filled).
///
/// # Errors
/// [`FormatError`]: another type or shape, data that do not fit, other values.
pub fn parse_npy(bytes: &[u8]) -> Result<Occupancy, FormatError> {
    let grid = Grid::of(bytes).map_err(|problem| error("npy", problem))?;
    grid.shape().map_err(|problem| error("npy", problem))
}

/// Reads the one three-dimensional array of an `.npz` file as [`parse_npy`] does.
///
/// # Errors
/// [`FormatError`]: no archive of arrays, none or several that could be meant, and as of [`parse_npy`].
pub fn parse_npz(bytes: &[u8]) -> Result<Occupancy, FormatError> {
    let grid = archived(bytes).map_err(|problem| error("npz", problem))?;
    grid.shape().map_err(|problem| error("npz", problem))
}

/// Reads a three-dimensional u8 array as an observation: 0 empty, 1 filled, 255 unknown. Of a bool array all is known.
///
/// # Errors
/// [`FormatError`], as of [`parse_npy`].
pub fn parse_npy_observation(bytes: &[u8]) -> Result<Observation, FormatError> {
    let Grid { dims, codes } = Grid::of(bytes).map_err(|problem| error("npy", problem))?;
    Ok(Observation::from_bytes(dims, &codes)?)
}

/// Reads the one three-dimensional array of an `.npz` file as [`parse_npy_observation`] does.
///
/// # Errors
/// [`FormatError`], as of [`parse_npz`].
pub fn parse_npz_observation(bytes: &[u8]) -> Result<Observation, FormatError> {
    let Grid { dims, codes } = archived(bytes).map_err(|problem| error("npz", problem))?;
    Ok(Observation::from_bytes(dims, &codes)?)
}

/// Writes an observation as a three-dimensional u8 array: 0 empty, 1 filled, 255 unknown.
///
/// # Errors
/// Those of `out`.
pub fn write_npy_observation(out: &mut impl Write, observation: &Observation) -> std::io::Result<()> {
    let dims = observation.dims();
    let mut codes = vec![0; dims.voxels()];
    observation.write(&mut codes);
    write_npy_header::<u8>(out, &<[usize; 3]>::from(dims))?;
    out.write_all(&codes)
}

/// Writes a label image as a two-dimensional u16 array of `[height, width]`, little-endian.
///
/// # Errors
/// The writer's, or that the labels are not one for each pixel.
pub fn write_npy_labels(out: &mut impl Write, [width, height]: [usize; 2], labels: &[u16]) -> std::io::Result<()> {
    if labels.len() != width * height {
        let message = format!("{} labels for {width} × {height} pixels", labels.len());
        return Err(std::io::Error::new(std::io::ErrorKind::InvalidInput, message));
    }
    write_npy_header::<u16>(out, &[height, width])?;
    let bytes: Vec<u8> = labels.iter().flat_map(|label| label.to_le_bytes()).collect();
    out.write_all(&bytes)
}

/// A grid with a byte for each voxel, in C order.
struct Grid {
    dims: Dims,
    codes: Vec<u8>,
}

/// Size of the grid that a header describes: three axes, bool or u8.
fn dims_of(header: &NpyHeader, data: &[u8]) -> Result<Dims, String> {
    let &[x, y, z] = &header.shape[..] else {
        let shape = header.shape_name();
        return Err(format!("the array has shape {shape}: expected three axes x, y, z of 8 to {LONGEST_SIDE} voxels"));
    };
    // Before the size of the data: another type is the more likely fault.
    if !matches!((header.kind, header.width), (NpyKind::Bool | NpyKind::Unsigned, 1)) {
        let name = header.type_name();
        let values = match header.kind {
            NpyKind::Float if holds_shares(header, data) => ", numbers from 0 to 1 with fractions: these look like probabilities",
            _ => "",
        };
        let mend = match header.kind {
            NpyKind::Float => "choose a threshold, numpy.save(path, array >= 0.5)",
            _ => "convert it, numpy.save(path, array.astype(bool))",
        };
        return Err(format!("the array is of type {name}{values}; expected bool or uint8 of 0 and 1: {mend}"));
    }
    Dims::new(x, y, z).map_err(|error| format!("the array has shape {}: {error}", header.shape_name()))
}

/// Whether all numbers lie within 0 and 1, and some between.
fn holds_shares(header: &NpyHeader, data: &[u8]) -> bool {
    let number = |bytes: &[u8]| match header.width {
        4 => f64::from(f32::from_bytes(bytes, header.is_big_endian)),
        _ => f64::from_bytes(bytes, header.is_big_endian),
    };
    let mut numbers = data.chunks_exact(header.width).map(number);
    matches!(header.width, 4 | 8) && numbers.clone().all(|v| (0.0..=1.0).contains(&v)) && numbers.any(|v| v > 0.0 && v < 1.0)
}

impl Grid {
    /// The array of an `.npy` file.
    fn of(bytes: &[u8]) -> Result<Self, String> {
        let header = NpyHeader::parse(bytes)?;
        let dims = dims_of(&header, &bytes[header.start..])?;
        let length = bytes.len() - header.start;
        if length != dims.voxels() {
            return Err(format!("{length} bytes of data for {dims} voxels of one byte each: the file is incomplete or damaged"));
        }
        let codes = match header.kind {
            NpyKind::Bool => header.numbers::<bool>(bytes)?.into_iter().map(u8::from).collect(),
            _ => header.numbers::<u8>(bytes)?,
        };
        Ok(Self { dims, codes })
    }

    /// As a complete shape.
    fn shape(&self) -> Result<Occupancy, String> {
        let Self { dims, codes } = self;
        if let Some(index) = codes.iter().position(|code| *code > 1) {
            let ([i, j, k], code) = (dims.coordinates(index), codes[index]);
            let hint = match (codes.contains(&1), codes.iter().all(|code| matches!(code, 0 | 1 | 255))) {
                (true, true) => "; this is an observation, not a complete shape (--view none takes it)",
                (false, true) => "; all values are 0 and 255, as in a picture: write (array > 0).astype('uint8')",
                (_, false) => "; for numbers of other meaning choose a threshold, such as (array > 127)",
            };
            return Err(format!("voxel ({i}, {j}, {k}) of a shape holds {code}: expected 0 or 1{hint}"));
        }
        Ok(Occupancy::from_fn(*dims, |i, j, k| codes[dims.index(i, j, k)] == 1))
    }
}

/// The grid of an archive: that of its only array, or of the only one of three axes.
fn archived(bytes: &[u8]) -> Result<Grid, String> {
    let archive = Archive::open(bytes)?;
    let header = |member: &Member| -> Result<NpyHeader, String> { NpyHeader::parse(&archive.start_of(member, LONGEST_HEADER + 12)?) };
    let arrays: Vec<&Member> = archive.members.iter().filter(|member| member.name.ends_with(".npy")).collect();
    let member = match arrays[..] {
        [] => return Err(format!("the archive holds no array NAME.npy but {}: write it with numpy.savez", archive.names())),
        [only] => only,
        _ => {
            let is_grid = |member: &&&Member| header(member).is_ok_and(|header| header.shape.len() == 3);
            let grids: Vec<&&Member> = arrays.iter().filter(is_grid).collect();
            match grids[..] {
                [only] => only,
                _ => {
                    let count = grids.len();
                    return Err(format!("{count} of its arrays ({}) have three axes: keep the one that is meant", archive.names()));
                }
            }
        }
    };
    let in_member = |problem: String| format!("array `{}`: {problem}", member.name.trim_end_matches(".npy"));
    let header = header(member).map_err(in_member)?;
    // Only what is a grid is unpacked whole.
    let start = archive.start_of(member, header.start + (1 << 16)).map_err(in_member)?;
    let dims = dims_of(&header, start.get(header.start..).unwrap_or_default()).map_err(in_member)?;
    let whole = archive.whole(member, header.start + dims.voxels()).map_err(in_member)?;
    Grid::of(&whole).map_err(in_member)
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
        assert!(message(&file("<f4", "False", "(8, 9, 10)", &data)).contains("type float32"));
        assert!(message(&file("|u1", "False", "(720,)", &data)).contains("shape (720,): expected three axes"));
        assert!(message(&file("|u1", "False", "(8, 9, 11)", &data)).contains("720 bytes of data for 8×9×11"));
        assert!(message(&file("|u1", "False", "(4, 9, 10)", &data)).contains("8 to 256"));
        assert!(message(&file("|u1", "False", "(999999, 999999, 999999)", &data)).contains("8 to 256"));
        assert!(message(&file("|u1", "False", "(99999999999, 9, 9)", &data)).contains("from 8 to 256"));
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
