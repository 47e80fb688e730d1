//! TIFF images of one channel: floating-point metres, whole numbers of units, labels.
//!
//! The directory is checked before the decoder sees it: it takes memory for as many values as an entry claims.

use super::{Image, MOST_PIXELS, Raster, check_size, problem};
use beo_shapes::FormatError;
use std::io::Cursor;
use tiff::ColorType;
use tiff::decoder::{Decoder, DecodingResult, Limits};

const FORMAT: &str = "TIFF";

/// Reads the first image of a TIFF of one channel: float32, float64 or whole numbers of 8 or 16 bits; plain, LZW or deflate.
///
/// # Errors
/// [`FormatError`]: what is no TIFF, damaged, larger than [`MOST_PIXELS`], compressed in another way or has colours.
pub fn parse_tiff_image(bytes: &[u8]) -> Result<Raster, FormatError> {
    let error = |error: tiff::TiffError| problem(FORMAT, error.to_string());
    check_directory(bytes).map_err(|text| problem(FORMAT, text.into()))?;
    let mut limits = Limits::default();
    limits.decoding_buffer_size = 8 * MOST_PIXELS;
    limits.intermediate_buffer_size = 4 * bytes.len() + (1 << 20);
    let mut decoder = Decoder::new(Cursor::new(bytes)).map_err(error)?.with_limits(limits);
    let (width, height) = decoder.dimensions().map_err(error)?;
    let bits = match decoder.colortype().map_err(error)? {
        ColorType::Gray(bits @ (8 | 16 | 32 | 64)) => bits,
        other => return Err(problem(FORMAT, format!("{other:?}: expected one channel of 8, 16, 32 or 64 bits"))),
    };
    check_size(FORMAT, [width.into(), height.into()], usize::from(bits / 8), bytes.len())?;
    let raster = match decoder.read_image().map_err(error)? {
        DecodingResult::U8(values) => Image::new(width, height, values).map(Raster::Bytes),
        DecodingResult::U16(values) => Image::new(width, height, values).map(Raster::Words),
        DecodingResult::F32(values) => Image::new(width, height, values).map(Raster::Floats),
        DecodingResult::F64(values) => Image::new(width, height, values.into_iter().map(|v| v as f32).collect()).map(Raster::Floats),
        _ => return Err(problem(FORMAT, "expected floating-point numbers, or whole numbers of 8 or 16 bits without sign".into())),
    };
    raster.ok_or_else(|| problem(FORMAT, "fewer pixels than its header says".into()))
}

/// Refuses a first directory with an entry that has more values than the file has room for.
fn check_directory(bytes: &[u8]) -> Result<(), &'static str> {
    const TRUNCATED: &str = "the file is truncated";
    let is_little = match bytes {
        [b'I', b'I', ..] => true,
        [b'M', b'M', ..] => false,
        _ => return Err("does not start as a TIFF does"),
    };
    let number = |at: u64, length: u64| -> Result<u64, &'static str> {
        let (start, end) = (usize::try_from(at), usize::try_from(at.saturating_add(length)));
        let digits = start.ok().zip(end.ok()).and_then(|(start, end)| bytes.get(start..end)).ok_or(TRUNCATED)?;
        let add = |sum: u64, digit: &u8| sum << 8 | u64::from(*digit);
        Ok(if is_little { digits.iter().rev().fold(0, add) } else { digits.iter().fold(0, add) })
    };
    // Lengths of an offset, of the number of entries, and of an entry.
    let (offset, entries, entry) = match number(2, 2)? {
        42 => (4, 2, 12),
        43 => (8, 8, 20),
        _ => return Err("neither a TIFF nor a BigTIFF"),
    };
    let directory = number(offset, offset)?;
    let count = number(directory, entries)?;
    if count > bytes.len() as u64 / entry {
        return Err(TRUNCATED);
    }
    for index in 0..count {
        let at = directory.saturating_add(entries + index * entry);
        let width = match number(at + 2, 2)? {
            3 | 8 => 2,
            4 | 9 | 11 | 13 => 4,
            5 | 10 | 12 | 16..=18 => 8,
            _ => 1,
        };
        if number(at + 4, offset)?.saturating_mul(width) > bytes.len() as u64 {
            return Err("an entry of its directory has more values than the file has room for");
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use tiff::encoder::{Compression, DeflateLevel, TiffEncoder, colortype};

    fn tiff<C: colortype::ColorType>(compression: Compression, width: u32, height: u32, values: &[C::Inner]) -> Vec<u8>
    where
        [C::Inner]: tiff::encoder::TiffValue,
    {
        let mut bytes = Cursor::new(Vec::new());
        let mut encoder = TiffEncoder::new(&mut bytes).unwrap().with_compression(compression);
        encoder.write_image::<C>(width, height, values).unwrap();
        bytes.into_inner()
    }

    #[test]
    fn floats_and_whole_numbers_are_read_however_compressed() {
        let metres = [0.0_f32, 0.5, 1.25, f32::MAX, -1.0, 2.0];
        for compression in [Compression::Uncompressed, Compression::Lzw, Compression::Deflate(DeflateLevel::Fast)] {
            let file = tiff::<colortype::Gray32Float>(compression, 3, 2, &metres);
            assert_eq!(parse_tiff_image(&file).unwrap(), Raster::Floats(Image::new(3, 2, metres.to_vec()).unwrap()));
        }
        let mut big = Cursor::new(Vec::new());
        TiffEncoder::new_big(&mut big).unwrap().write_image::<colortype::Gray32Float>(3, 2, &metres).unwrap();
        assert_eq!(parse_tiff_image(&big.into_inner()).unwrap(), Raster::Floats(Image::new(3, 2, metres.to_vec()).unwrap()));
        let file = tiff::<colortype::Gray64Float>(Compression::Lzw, 2, 1, &[0.5, 2.0]);
        assert_eq!(parse_tiff_image(&file).unwrap(), Raster::Floats(Image::new(2, 1, vec![0.5, 2.0]).unwrap()));
        let file = tiff::<colortype::Gray16>(Compression::Lzw, 2, 1, &[500, 2000]);
        assert_eq!(parse_tiff_image(&file).unwrap(), Raster::Words(Image::new(2, 1, vec![500, 2000]).unwrap()));
        let file = tiff::<colortype::Gray8>(Compression::Uncompressed, 2, 1, &[0, 3]);
        assert_eq!(parse_tiff_image(&file).unwrap(), Raster::Bytes(Image::new(2, 1, vec![0, 3]).unwrap()));
    }

    #[test]
    fn what_is_no_image_of_one_channel_is_refused_with_the_reason() {
        let message = |bytes: &[u8]| parse_tiff_image(bytes).unwrap_err().to_string();
        assert!(message(&tiff::<colortype::RGB8>(Compression::Uncompressed, 1, 1, &[1, 2, 3])).contains("one channel"));
        assert!(message(&tiff::<colortype::GrayI16>(Compression::Uncompressed, 1, 1, &[1])).contains("without sign"));
        assert!(message(b"MM").starts_with("TIFF: "));
        let good = tiff::<colortype::Gray32Float>(Compression::Lzw, 16, 16, &[0.5; 256]);
        assert!((0..good.len()).all(|length| parse_tiff_image(&good[..length]).is_err()));
        // Found by fuzzing: memory was taken for as many values as an entry claimed, whatever the file's size.
        let directory = u32::from_le_bytes(good[4..8].try_into().unwrap()) as usize;
        for entry in 0..usize::from(u16::from_le_bytes(good[directory..directory + 2].try_into().unwrap())) {
            let mut bad = good.clone();
            let count = directory + 2 + 12 * entry + 4;
            bad[count..count + 4].copy_from_slice(&0x7fff_0000_u32.to_le_bytes());
            assert!(message(&bad).contains("more values than the file has room for"));
        }
    }
}
