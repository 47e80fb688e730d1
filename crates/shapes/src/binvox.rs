//! The binvox format (Min, <https://www.patrickmin.com/binvox/binvox.html>): a text header, then runs of equal voxels.
//!
//! On disk y runs fastest, then z, then x; the header's `dim` gives depth (x), height (z) and width (y). ModelNet's voxel
//! files store z up that way.

use super::FormatError;
use super::lines::without_mark;
use beo_core::grid::{Dims, Occupancy};
use beo_core::text::printable;
use std::io::Write;

const FORMAT: &str = "binvox";
const LONGEST_RUN: usize = 255;

fn line_error(line: usize, problem: impl Into<String>) -> FormatError {
    FormatError::Line { format: FORMAT, line, problem: problem.into() }
}

/// Reads a binvox file's bytes. `translate` and `scale` are checked to be numbers; see [`binvox_scale`].
pub fn parse_binvox(bytes: &[u8]) -> Result<Occupancy, FormatError> {
    let (dims, start, _) = header(bytes)?;
    let runs = &bytes[start..];
    let byte_error = |byte: usize, problem: String| FormatError::Byte { format: FORMAT, byte: start + byte, problem };
    if runs.len() / 2 * LONGEST_RUN < dims.voxels() {
        return Err(byte_error(runs.len(), format!("the file ends before its {} voxels do", dims.voxels())));
    }
    let mut object = Occupancy::empty(dims);
    let mut voxel = 0;
    for (r, run) in runs.chunks(2).enumerate() {
        let &[value, length] = run else {
            return Err(byte_error(2 * r, "a run without its length".into()));
        };
        let end = voxel + usize::from(length);
        if end > dims.voxels() {
            return Err(byte_error(2 * r, format!("more than the {} voxels of a grid of {dims}", dims.voxels())));
        }
        match value {
            0 => {}
            1 => (voxel..end).for_each(|v| {
                let (y, z, x) = (v % dims.y(), v / dims.y() % dims.z(), v / (dims.y() * dims.z()));
                object.fill(x, y, z);
            }),
            _ => return Err(byte_error(2 * r, format!("voxel value {value}: expected 0 or 1"))),
        }
        voxel = end;
    }
    if voxel < dims.voxels() {
        return Err(byte_error(runs.len(), format!("{voxel} voxels for a grid of {dims}, which has {}", dims.voxels())));
    }
    Ok(object)
}

/// The length of the grid's longest side in the units of the shape that was voxelised, which the header's `scale` says; 1 where it does
/// not.
pub fn binvox_scale(bytes: &[u8]) -> Result<f64, FormatError> {
    header(bytes).map(|(_, _, scale)| scale)
}

/// The grid's size, where the runs start, and the scale.
fn header(bytes: &[u8]) -> Result<(Dims, usize, f64), FormatError> {
    // All lines end as the first does: what comes after `data` may look like part of a line end.
    let mut start = bytes.len() - without_mark(bytes).len();
    let first_end = bytes.iter().position(|b| matches!(b, b'\n' | b'\r')).unwrap_or(bytes.len());
    let line_end: &[u8] = match &bytes[first_end..] {
        [b'\r', b'\n', ..] => b"\r\n",
        [b'\r', ..] => b"\r",
        _ => b"\n",
    };
    let mut dims = None;
    let mut scale = 1.0;
    let mut line = 0;
    loop {
        line += 1;
        let end = bytes[start..].windows(line_end.len()).position(|window| window == line_end).map(|n| start + n);
        let Some(end) = end else {
            return Err(line_error(line, "the header ends without a line `data`: the file is incomplete"));
        };
        let text = std::str::from_utf8(&bytes[start..end]).map_err(|_| line_error(line, "not text; is this a binvox file?"))?;
        start = end + line_end.len();
        let mut words = text.split_ascii_whitespace();
        let keyword = words.next();
        if line == 1 {
            match (keyword, words.next()) {
                (Some("#binvox"), Some("1")) => continue,
                (found, _) => {
                    let found = found.map_or("nothing".into(), |word| printable(word).chars().take(20).collect::<String>());
                    return Err(line_error(1, format!("expected `#binvox 1`, found `{found}`: is this a binvox file?")));
                }
            }
        }
        match keyword {
            Some("dim") => {
                let sides: Vec<usize> = words.map_while(|w| w.parse().ok()).collect();
                let &[x, z, y] = &sides[..] else {
                    return Err(line_error(line, "expected `dim` and three whole numbers"));
                };
                dims = Some(Dims::new(x, y, z)?);
            }
            Some(name @ ("translate" | "scale")) => {
                let numbers = if name == "scale" { 1 } else { 3 };
                let values: Vec<f64> = words.filter_map(|w| w.parse::<f64>().ok().filter(|v| v.is_finite())).collect();
                if values.len() != numbers {
                    return Err(line_error(line, format!("expected `{name}` and {numbers} numbers")));
                }
                if name == "scale" {
                    scale = values[0];
                }
            }
            Some("data") => {
                let dims = dims.ok_or_else(|| line_error(line, "`data` comes before `dim`"))?;
                return Ok((dims, start, scale));
            }
            None => {}
            Some(comment) if comment.starts_with('#') => {}
            Some(other) => {
                let other: String = printable(other).chars().take(20).collect();
                return Err(line_error(line, format!("unknown keyword `{other}`: expected dim, translate, scale or data")));
            }
        }
    }
}

/// Writes `object` as binvox, without a unit.
pub fn write_binvox(out: &mut impl Write, object: &Occupancy) -> std::io::Result<()> {
    write_binvox_scaled(out, object, 1.0)
}

/// Writes `object` as binvox; the grid's longest side measures `scale`.
pub fn write_binvox_scaled(out: &mut impl Write, object: &Occupancy, scale: f64) -> std::io::Result<()> {
    let dims = object.dims();
    write!(out, "#binvox 1\ndim {} {} {}\ntranslate 0 0 0\nscale {scale}\ndata\n", dims.x(), dims.z(), dims.y())?;
    let mut runs: Vec<u8> = Vec::new();
    for x in 0..dims.x() {
        for z in 0..dims.z() {
            for y in 0..dims.y() {
                let value = u8::from(object.is_filled(x, y, z));
                match runs.last_chunk_mut::<2>() {
                    Some([last, length]) if *last == value && usize::from(*length) < LONGEST_RUN => *length += 1,
                    _ => runs.extend([value, 1]),
                }
            }
        }
    }
    out.write_all(&runs)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn file(dim: &str, runs: &[u8]) -> Vec<u8> {
        let mut bytes = format!("#binvox 1\ndim {dim}\ntranslate -0.5 0 1e-3\nscale 2.5\ndata\n").into_bytes();
        bytes.extend_from_slice(runs);
        bytes
    }

    #[test]
    fn y_runs_fastest_then_z_then_x() {
        // Size x 8, z 9, y 10. Filled: voxels 95, 96 and 97 of the disk's order, that is x 1, z 0, y 5, 6, 7 (1·90 + 0·10 + 5),
        // and voxel 128: x 1, z 3, y 8.
        let runs = [0, 95, 1, 3, 0, 30, 1, 1, 0, 255, 0, 255, 0, 81];
        let object = parse_binvox(&file("8 9 10", &runs)).unwrap();
        assert_eq!(<[usize; 3]>::from(object.dims()), [8, 10, 9]);
        assert_eq!(object.count(), 4);
        for (x, y, z) in [(1, 5, 0), (1, 6, 0), (1, 7, 0), (1, 8, 3)] {
            assert!(object.is_filled(x, y, z), "{x} {y} {z}");
        }
    }

    #[test]
    fn line_ends_and_a_mark_change_nothing() {
        let runs = [1, 10, 0, 255, 0, 247];
        let good = file("8 8 8", &runs);
        let header = String::from_utf8(good[..good.len() - runs.len()].to_vec()).unwrap();
        let object = parse_binvox(&good).unwrap();
        for header in [header.replace('\n', "\r"), header.replace('\n', "\r\n"), format!("\u{feff}{header}")] {
            assert_eq!(parse_binvox(&[header.as_bytes(), &runs].concat()).as_ref(), Ok(&object), "{header:?}");
        }
    }

    #[test]
    fn malformed_files_are_refused_with_the_place() {
        let message = |bytes: &[u8]| parse_binvox(bytes).unwrap_err().to_string();
        assert!(message(b"#binvox 2\n").starts_with("binvox, line 1: expected `#binvox 1`"));
        assert_eq!(message(b""), "binvox, line 1: the header ends without a line `data`: the file is incomplete");
        assert!(message(&file("8 8", &[])).contains("line 2: expected `dim`"));
        assert!(message(&file("99999999999 1 1", &[])).contains("every side must be from 8 to 256"));
        assert!(message(b"#binvox 1\ndata\n").contains("line 2: `data` comes before `dim`"));
        assert!(message(&file("256 256 256", &[0, 255])).contains("ends before its 16777216 voxels"));
        assert!(message(&file("8 8 8", &[0, 255, 0, 255, 0, 1])).contains("511 voxels"));
        assert!(message(&file("8 8 8", &[0, 255, 0, 255, 0, 3])).contains("more than the 512 voxels"));
        let two = file("8 8 8", &[0, 255, 2, 255, 0, 2]);
        assert_eq!(message(&two), format!("binvox, byte {}: voxel value 2: expected 0 or 1", two.len() - 4));
        assert!(message(&file("8 8 8", &[0, 255, 0, 255, 0, 2, 0])).contains("without its length"));
    }

    proptest! {
        #[test]
        fn what_is_written_is_read(voxels in prop::collection::vec(prop::bool::weighted(0.1), 8 * 9 * 11)) {
            let dims = Dims::new(8, 9, 11).unwrap();
            let object = Occupancy::from_fn(dims, |i, j, k| voxels[dims.index(i, j, k)]);
            let mut bytes = Vec::new();
            write_binvox(&mut bytes, &object).unwrap();
            prop_assert_eq!(parse_binvox(&bytes).unwrap(), object.clone());
            prop_assert_eq!(binvox_scale(&bytes).unwrap(), 1.0);
            bytes.clear();
            write_binvox_scaled(&mut bytes, &object, 0.15).unwrap();
            prop_assert_eq!((binvox_scale(&bytes).unwrap(), parse_binvox(&bytes).unwrap()), (0.15, object));
        }

        #[test]
        fn arbitrary_bytes_do_not_panic(bytes in prop::collection::vec(any::<u8>(), 0..400)) {
            let _ = parse_binvox(&bytes);
            let _ = parse_binvox(&file("8 8 8", &bytes));
        }
    }
}
