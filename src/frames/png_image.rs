//! PNG images of one channel: depth in 16 bits, labels in up to 16.

use super::image::{check_size, problem};
use super::{Image, Raster};
use beo_shapes::FormatError;
use png::{BitDepth, ColorType, Decoder, Limits, Transformations};
use std::io::Cursor;

const FORMAT: &str = "PNG";

/// Reads a PNG of one channel: grey, or with a palette, whose indices are then the values (as in the label images of PASCAL VOC).
///
/// # Errors
/// [`FormatError`]: what is no PNG, damaged, larger than [`super::MOST_PIXELS`], or has colours.
pub fn parse_png_image(bytes: &[u8]) -> Result<Raster, FormatError> {
    let error = |error: png::DecodingError| problem(FORMAT, error.to_string());
    // For what the decoder keeps besides the image: chunks that nobody asked for.
    let mut decoder = Decoder::new_with_limits(Cursor::new(bytes), Limits { bytes: 4 * bytes.len() + (1 << 20) });
    decoder.set_transformations(Transformations::IDENTITY);
    decoder.set_ignore_text_chunk(true);
    decoder.set_ignore_iccp_chunk(true);
    let header = decoder.read_header_info().map_err(error)?;
    let (width, height, colour, depth) = (header.width, header.height, header.color_type, header.bit_depth);
    if !matches!(colour, ColorType::Grayscale | ColorType::Indexed) {
        return Err(problem(FORMAT, format!("{colour:?}: expected one channel, grey")));
    }
    check_size(FORMAT, [width.into(), height.into()], 1 + usize::from(depth == BitDepth::Sixteen), bytes.len())?;
    let mut reader = decoder.read_info().map_err(error)?;
    let size = reader.output_buffer_size().ok_or_else(|| problem(FORMAT, "too large".into()))?;
    let mut data = vec![0; size];
    let frame = reader.next_frame(&mut data).map_err(error)?;
    if (frame.width, frame.height) != (width, height) {
        return Err(problem(FORMAT, "an animation whose first picture is smaller than the image".into()));
    }
    let raster = match depth {
        BitDepth::Sixteen => {
            let words = data.as_chunks::<2>().0.iter().map(|pair| u16::from_be_bytes(*pair)).collect();
            Image::new(width, height, words).map(Raster::Words)
        }
        BitDepth::Eight => Image::new(width, height, data).map(Raster::Bytes),
        packed => Image::new(width, height, unpacked(&data, width as usize, frame.line_size, packed as u8)).map(Raster::Bytes),
    };
    raster.ok_or_else(|| problem(FORMAT, "fewer pixels than its header says".into()))
}

/// One byte for each pixel of rows of `bits` (1, 2 or 4) a pixel, the first in the highest bits.
fn unpacked(data: &[u8], width: usize, row: usize, bits: u8) -> Vec<u8> {
    let per_byte = usize::from(8 / bits);
    let pixel = |line: &[u8], x: usize| (line[x / per_byte] >> (8 - bits as usize * (x % per_byte + 1))) & ((1 << bits) - 1);
    data.chunks_exact(row.max(1)).flat_map(|line| (0..width).map(move |x| pixel(line, x))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    pub(crate) fn png(width: u32, height: u32, colour: ColorType, depth: BitDepth, data: &[u8]) -> Vec<u8> {
        let mut bytes = Vec::new();
        let mut encoder = png::Encoder::new(&mut bytes, width, height);
        encoder.set_color(colour);
        encoder.set_depth(depth);
        if colour == ColorType::Indexed {
            encoder.set_palette(vec![0; 12]);
        }
        encoder.write_header().unwrap().write_image_data(data).unwrap();
        bytes
    }

    #[test]
    fn values_of_every_depth_are_read_as_they_are() {
        let depth = png(3, 2, ColorType::Grayscale, BitDepth::Sixteen, &[0, 0, 0, 1, 3, 232, 1, 0, 255, 255, 0, 2]);
        assert_eq!(parse_png_image(&depth).unwrap(), Raster::Words(Image::new(3, 2, vec![0, 1, 1000, 256, 65535, 2]).unwrap()));
        let labels = Image::new(3, 2, vec![0, 1, 2, 3, 2, 1]).unwrap();
        for colour in [ColorType::Grayscale, ColorType::Indexed] {
            let eight = png(3, 2, colour, BitDepth::Eight, labels.values());
            assert_eq!(parse_png_image(&eight).unwrap(), Raster::Bytes(labels.clone()));
            let two = png(3, 2, colour, BitDepth::Two, &[0b00_01_10_00, 0b11_10_01_00]);
            assert_eq!(parse_png_image(&two).unwrap(), Raster::Bytes(labels.clone()));
        }
        let one = png(10, 1, ColorType::Grayscale, BitDepth::One, &[0b1010_0000, 0b0100_0000]);
        assert_eq!(parse_png_image(&one).unwrap().into_labels().unwrap().values(), [1, 0, 1, 0, 0, 0, 0, 0, 0, 1]);
    }

    #[test]
    fn what_is_no_image_of_one_channel_is_refused_with_the_reason() {
        let message = |bytes: &[u8]| parse_png_image(bytes).unwrap_err().to_string();
        assert!(message(&png(1, 1, ColorType::Rgb, BitDepth::Eight, &[1, 2, 3])).contains("Rgb: expected one channel"));
        assert!(message(&png(1, 1, ColorType::GrayscaleAlpha, BitDepth::Sixteen, &[1, 2, 3, 4])).contains("one channel"));
        assert!(message(b"P5 1 1 255 x").starts_with("PNG: "));
        let good = png(64, 64, ColorType::Grayscale, BitDepth::Sixteen, &[7; 8192]);
        for length in 0..good.len() - 12 {
            // Without its last chunk, IEND, it is read.
            assert!(parse_png_image(&good[..length]).is_err(), "{length} of {}", good.len());
        }
    }

    #[test]
    fn a_header_that_claims_a_huge_image_is_refused_before_memory_is_taken() {
        let mut bytes = png(8, 8, ColorType::Grayscale, BitDepth::Sixteen, &[7; 128]);
        for (width, part) in [(1_u32 << 31, "expected 1 to"), (1 << 20, "truncated or damaged")] {
            bytes[16..20].copy_from_slice(&width.to_be_bytes());
            let crc = crc32fast::hash(&bytes[12..29]);
            bytes[29..33].copy_from_slice(&crc.to_be_bytes());
            let message = parse_png_image(&bytes).unwrap_err().to_string();
            assert!(message.contains(part), "{message}");
        }
    }
}
