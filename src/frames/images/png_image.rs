//! PNG images: depth in 16 bits, labels in up to 16, masks in whatever a program writes.

use super::{Image, Raster, check_size, problem};
use beo_shapes::FormatError;
use png::{BitDepth, ColorType, Decoder, Limits, Transformations};
use std::io::Cursor;

const FORMAT: &str = "PNG";

/// Reads a PNG: grey, with a palette, or in colours, with opacity or without.
///
/// # Errors
/// [`FormatError`]: what is no PNG, damaged or larger than [`super::MOST_PIXELS`].
pub fn parse_png_image(bytes: &[u8]) -> Result<Raster, FormatError> {
    let error = |error: png::DecodingError| problem(FORMAT, error.to_string());
    // For what the decoder keeps besides the image: chunks that nobody asked for.
    let mut decoder = Decoder::new_with_limits(Cursor::new(bytes), Limits { bytes: 4 * bytes.len() + (1 << 20) });
    decoder.set_transformations(Transformations::IDENTITY);
    decoder.set_ignore_text_chunk(true);
    decoder.set_ignore_iccp_chunk(true);
    let header = decoder.read_header_info().map_err(error)?;
    let (width, height, colour, depth) = (header.width, header.height, header.color_type, header.bit_depth);
    let bytes_per_sample = 1 + usize::from(depth == BitDepth::Sixteen);
    check_size(FORMAT, [width.into(), height.into()], colour.samples() * bytes_per_sample, bytes.len())?;
    let mut reader = decoder.read_info().map_err(error)?;
    let size = reader.output_buffer_size().ok_or_else(|| problem(FORMAT, "too large".into()))?;
    let mut data = vec![0; size];
    let frame = reader.next_frame(&mut data).map_err(error)?;
    if (frame.width, frame.height) != (width, height) {
        return Err(problem(FORMAT, "an animation whose first picture is smaller than the image".into()));
    }
    let raster = match (colour, depth) {
        (ColorType::Grayscale, BitDepth::Sixteen) => {
            let words = data.as_chunks::<2>().0.iter().map(|pair| u16::from_be_bytes(*pair)).collect();
            Image::new(width, height, words).map(Raster::Words)
        }
        (ColorType::Grayscale | ColorType::Indexed, _) => {
            let values = match depth {
                BitDepth::Eight => data,
                packed => unpacked(&data, width as usize, frame.line_size, packed as u8),
            };
            let palette = (colour == ColorType::Indexed).then(|| palette(reader.info()));
            Image::new(width, height, values).map(|image| match palette {
                Some(palette) => Raster::Indexed { image, palette },
                None => Raster::Bytes(image),
            })
        }
        (ColorType::Rgb | ColorType::Rgba | ColorType::GrayscaleAlpha, _) => {
            let pixel = |samples: &[u8]| {
                // The higher byte of each sample.
                let at = |channel: usize| samples[channel * bytes_per_sample];
                match colour {
                    ColorType::Rgb => [at(0), at(1), at(2), 255],
                    ColorType::Rgba => [at(0), at(1), at(2), at(3)],
                    _ => [at(0), at(0), at(0), at(1)],
                }
            };
            let pixels = data.chunks_exact(colour.samples() * bytes_per_sample).map(pixel).collect();
            Image::new(width, height, pixels).map(Raster::Colours)
        }
    };
    raster.ok_or_else(|| problem(FORMAT, "fewer pixels than its header says".into()))
}

/// The colours of a palette, opaque where nothing else is said.
fn palette(info: &png::Info<'_>) -> Vec<[u8; 4]> {
    let opacity = info.trns.as_deref().unwrap_or_default();
    let colours = info.palette.as_deref().unwrap_or_default().as_chunks::<3>().0;
    colours.iter().enumerate().map(|(i, [r, g, b])| [*r, *g, *b, opacity.get(i).copied().unwrap_or(255)]).collect()
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
        let palette = vec![[0, 0, 0, 255]; 4];
        for (colour, expected) in [
            (ColorType::Grayscale, Raster::Bytes(labels.clone())),
            (ColorType::Indexed, Raster::Indexed { image: labels.clone(), palette }),
        ] {
            let eight = png(3, 2, colour, BitDepth::Eight, labels.values());
            assert_eq!(parse_png_image(&eight).unwrap(), expected);
            let two = png(3, 2, colour, BitDepth::Two, &[0b00_01_10_00, 0b11_10_01_00]);
            assert_eq!(parse_png_image(&two).unwrap(), expected);
        }
        let one = png(10, 1, ColorType::Grayscale, BitDepth::One, &[0b1010_0000, 0b0100_0000]);
        assert_eq!(parse_png_image(&one).unwrap(), Raster::Bytes(Image::new(10, 1, vec![1, 0, 1, 0, 0, 0, 0, 0, 0, 1]).unwrap()));
    }

    #[test]
    fn colours_are_read_with_their_opacity_of_8_or_16_bits() {
        let colours = |values: Vec<[u8; 4]>| Raster::Colours(Image::new(values.len() as u32, 1, values).unwrap());
        let rgb = png(2, 1, ColorType::Rgb, BitDepth::Eight, &[1, 2, 3, 4, 5, 6]);
        assert_eq!(parse_png_image(&rgb).unwrap(), colours(vec![[1, 2, 3, 255], [4, 5, 6, 255]]));
        let rgba = png(1, 1, ColorType::Rgba, BitDepth::Sixteen, &[1, 9, 2, 9, 3, 9, 4, 9]);
        assert_eq!(parse_png_image(&rgba).unwrap(), colours(vec![[1, 2, 3, 4]]));
        let grey = png(2, 1, ColorType::GrayscaleAlpha, BitDepth::Eight, &[7, 0, 8, 255]);
        assert_eq!(parse_png_image(&grey).unwrap(), colours(vec![[7, 7, 7, 0], [8, 8, 8, 255]]));
    }

    #[test]
    fn what_is_damaged_is_refused_with_the_reason() {
        let message = |bytes: &[u8]| parse_png_image(bytes).unwrap_err().to_string();
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
