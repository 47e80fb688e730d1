//! JPEG images, for masks alone: the compression changes values, so that neither depth nor labels can be kept in one.

use super::{Image, Raster, check_size, problem};
use crate::shapes::FormatError;
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
    let data = decoder.decode().map_err(|e| error(e.to_string()))?;
    if data.len() != width * height * channels {
        return Err(error("fewer pixels than its header says".into()));
    }
    let values = data.chunks_exact(channels).map(|pixel| pixel.iter().copied().max().unwrap_or(0)).collect();
    let [width, height] = [width, height].map(|side| side as u32);
    Image::new(width, height, values).map(Raster::Lossy).ok_or_else(|| error("fewer pixels than its header says".into()))
}
