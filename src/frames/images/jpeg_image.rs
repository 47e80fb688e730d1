//! JPEG images, for masks alone: the compression changes values, so that neither depth nor labels can be kept in one.

use super::{Image, Raster, check_size, problem};
use beo_shapes::FormatError;
use std::io::Cursor;
use zune_jpeg::JpegDecoder;
use zune_jpeg::zune_core::colorspace::ColorSpace;
use zune_jpeg::zune_core::options::DecoderOptions;

const FORMAT: &str = "JPEG";

/// Reads a JPEG, baseline or progressive, grey or in colours, as the largest channel of each pixel.
///
/// # Errors
/// [`FormatError`]: what is no JPEG, damaged, larger than [`super::MOST_PIXELS`], or of the four inks of print.
pub fn parse_jpeg_image(bytes: &[u8]) -> Result<Raster, FormatError> {
    let error = |text: String| problem(FORMAT, text);
    let options = DecoderOptions::default().set_strict_mode(true).jpeg_set_out_colorspace(ColorSpace::RGB);
    let mut decoder = JpegDecoder::new_with_options(Cursor::new(bytes), options);
    decoder.decode_headers().map_err(|e| error(e.to_string()))?;
    let (width, height) = decoder.dimensions().ok_or_else(|| error("there is no image in it".into()))?;
    let channels = match decoder.input_colorspace() {
        Some(ColorSpace::Luma) => 1,
        Some(ColorSpace::YCbCr | ColorSpace::RGB) => 3,
        other => return Err(error(format!("the colours are {other:?}: expected grey or YCbCr"))),
    };
    check_size(FORMAT, [width as u64, height as u64], channels, bytes.len())?;
    if channels == 1 {
        let options = (*decoder.options()).jpeg_set_out_colorspace(ColorSpace::Luma);
        decoder.set_options(options);
    }
    if !is_whole(bytes) {
        return Err(error("the file is cut short: its end marker is missing; copy or write it again".into()));
    }
    let data = decoder.decode().map_err(|e| error(e.to_string()))?;
    if data.len() != width * height * channels {
        return Err(error("fewer pixels than its header says".into()));
    }
    let values = data.chunks_exact(channels).map(|pixel| pixel.iter().copied().max().unwrap_or(0)).collect();
    let [width, height] = [width, height].map(|side| side as u32);
    Image::new(width, height, values).map(Raster::Lossy).ok_or_else(|| error("fewer pixels than its header says".into()))
}

/// Whether the last scan is followed by the end marker. The decoder takes what is missing of a scan for grey. In a scan every 0xFF is followed by
/// 0 or by a restart marker (ITU-T T.81, B.1.1.5), so that neither marker can be part of one.
fn is_whole(bytes: &[u8]) -> bool {
    const SCAN: [u8; 2] = [0xFF, 0xDA];
    const END: [u8; 2] = [0xFF, 0xD9];
    let last_scan = bytes.windows(2).rposition(|pair| pair == SCAN);
    last_scan.is_some_and(|start| bytes[start..].windows(2).any(|pair| pair == END))
}

#[cfg(test)]
mod tests {
    use super::*;

    // Made with Pillow: 24 × 16 pixels, 0 but for 255, or the colour (0, 230, 20), in rows 4 to 11 of columns 5 to 16, at quality 60; grey and
    // baseline, YCbCr 4:2:0 and progressive, and CMYK at quality 10.
    const GREY: &str = "ffd8ffe000104a46494600010100000100010000ffdb0043000d090a0b0a080d0b0a0b0e0e0d0f13201513121213271c1e17202e2931302e292d2c33\
        3a4a3e333646372c2d405741464c4e525352323e5a615a50604a51524fffc0000b080010001801011100ffc400160001010100000000000000000000\
        000000060705ffc400281000000307010901000000000000000000010311000204051213140615161731415265a1a4e2ffda0008010100003f001da4\
        34e6f3cd4d81cbc5b6409d5dbad51e7411143bbd331e11f9ef93f6d3a9a41ecf9ac640dcb98c7be4d689552f082a74e4da9a4351eec4d4d8ec4cab84\
        09345ca115e7455507b7db31e2e781faff000d3a9a466d09ac6475bb7927be750ab4d4f08a2f5e6dffd9";
    const COLOURS: &str = "ffd8ffe000104a46494600010100000100010000ffdb0043000d090a0b0a080d0b0a0b0e0e0d0f13201513121213271c1e17202e2931302e292d2c33\
        3a4a3e333646372c2d405741464c4e525352323e5a615a50604a51524fffdb0043010e0e0e131113261515264f352d354f4f4f4f4f4f4f4f4f4f4f4f\
        4f4f4f4f4f4f4f4f4f4f4f4f4f4f4f4f4f4f4f4f4f4f4f4f4f4f4f4f4f4f4f4f4f4f4f4f4f4fffc20011080010001803012200021101031101ffc400\
        17000101010100000000000000000000000000040506ffc4001501010100000000000000000000000000000304ffda000c03010002100310000001e7\
        ed8ad09734353fffc4001a100002020300000000000000000000000002030001121314ffda00080101000105024af6971c2ac492cd45d90af22fffc4\
        001a110001050100000000000000000000000000010312133122ffda0008010301013f0176e9718261ffc40019110001050000000000000000000000\
        0000000102111322ffda0008010201013f017d93910fffc4001a1000030003010000000000000000000000000111213351a1ffda0008010100063f02\
        9660d9e0d71965c1afd1beb3ffc4001a10010001050000000000000000000000001100012131f0f1ffda0008010100013f2157192336ee5f7528c573\
        80936e65b712a4ffda000c03010002000300000010fc2fffc400181100020300000000000000000000000000001131c1f1ffda0008010301013f10c4\
        58c8e4ffc4001811000203000000000000000000000000000011017181ffda0008010201013f10aec19433ffc4001c10000200070000000000000000\
        00000000011100103141516171ffda0008010100013f10bfe9d801546641ab49268a717fd3b00ba1c48376926996a3ffd9";
    const PRINT: &str = "ffd8ffee000e41646f626500640000000000ffdb00430050373c463c32504641465a55505f78c882786e6e78f5afb991c8ffffffffffffffffffffff\
        ffffffffffffffffffffffffffffffffffffffffffffffffffffffffc000140800100018044311004d11005911004b1100ffc4001500010100000000\
        000000000000000000000402ffc4002010000201020701000000000000000000000211010012030413143163a2e1ffda000e0443004d0059004b0000\
        3f0046631b4420adb9cae5523318da21056dce572a9198c6d1082b6e72b9548cc63688415b7395caa3effabd7ca3effabd7ca3effabd7ca3effabd7c\
        a5815e02493889a5815e02493889a5815e02493889a5815e02493889a8cc60eb040dd6a97c3a8cc60eb040dd6a97c3a8cc60eb040dd6a97c3a8cc60e\
        b040dd6a97c3a3ec3b7cfda3ec3b7cfda3ec3b7cfda3ec3b7cfda580d8022da888a580d8022da888a580d8022da888a580d8022da888afffd9";

    fn bytes(hex: &str) -> Vec<u8> {
        hex.as_bytes().as_chunks::<2>().0.iter().map(|pair| u8::from_str_radix(std::str::from_utf8(pair).unwrap(), 16).unwrap()).collect()
    }

    fn message(bytes: &[u8]) -> String {
        parse_jpeg_image(bytes).unwrap_err().to_string()
    }

    #[test]
    fn grey_and_colours_baseline_and_progressive_are_read() {
        for hex in [GREY, COLOURS] {
            let raster = parse_jpeg_image(&bytes(hex)).unwrap();
            let Raster::Lossy(image) = &raster else { panic!("{raster:?}") };
            assert_eq!(image.size(), [24, 16]);
            let at = |column: usize, row: usize| image.values()[row * 24 + column];
            assert!(at(0, 0) < 30 && at(23, 15) < 30 && at(10, 8) > 200, "{} {} {}", at(0, 0), at(23, 15), at(10, 8));
            let mask = raster.into_mask();
            let expected = |pixel: usize| (5..17).contains(&(pixel % 24)) && (4..12).contains(&(pixel / 24));
            let wrong = mask.values().iter().enumerate().filter(|(pixel, inside)| **inside != expected(*pixel)).count();
            // Colours are kept in blocks of two by two.
            assert!(wrong <= 24, "{wrong} pixels");
        }
    }

    #[test]
    fn what_is_damaged_or_for_print_is_refused_with_the_reason() {
        assert!(message(&bytes(PRINT)).contains("expected grey or YCbCr"), "{}", message(&bytes(PRINT)));
        assert!(message(b"\x89PNG").starts_with("JPEG: "));
        let good = bytes(GREY);
        assert!((0..good.len() - 2).all(|length| parse_jpeg_image(&good[..length]).is_err()));
    }

    #[test]
    fn a_header_that_claims_a_huge_image_is_refused_before_memory_is_taken() {
        let mut bad = bytes(GREY);
        // Height and width after SOF0's marker, length and precision.
        let frame = bad.windows(2).position(|marker| marker == [0xff, 0xc0]).unwrap();
        for (size, part) in [([0xff, 0xff, 0xff, 0xff], "JPEG: "), ([0x10, 0, 0x0f, 0xff], "truncated or damaged")] {
            bad[frame + 5..frame + 9].copy_from_slice(&size);
            assert!(message(&bad).contains(part), "{}", message(&bad));
        }
    }
}
