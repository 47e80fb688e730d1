//! Images: what the readers of files give (`png_image`, `npy_image`, `tiff_image`, `jpeg_image`), and what it means: `depth` in metres,
//! `labels` of objects, or the `mask` of one.

mod depth;
mod jpeg_image;
mod labels;
mod mask;
mod npy_image;
mod png_image;
mod tiff_image;

pub use depth::{DepthAlong, DepthUnit, MILLIMETRE, farthest_m, limited, z_of_distances};
pub use jpeg_image::parse_jpeg_image;
pub use labels::{ColourLabels, VoidLabels};
pub use npy_image::parse_npy_image;
pub use png_image::parse_png_image;
pub use tiff_image::parse_tiff_image;

use beo_core::text::printable;
use beo_shapes::FormatError;

/// Most pixels of an image that is read.
pub const MOST_PIXELS: usize = 1 << 24;
/// A file of so many bytes cannot hold more than so many times as many bytes of pixels: LZW's longest string over its shortest code.
const DENSEST: usize = 4096;

/// Values of pixels, row by row.
#[derive(Clone, Debug, PartialEq)]
pub struct Image<T> {
    width: u32,
    height: u32,
    values: Vec<T>,
}

impl<T> Image<T> {
    /// `values` row by row; `None` unless there is one for each pixel.
    pub fn new(width: u32, height: u32, values: Vec<T>) -> Option<Self> {
        (values.len() == width as usize * height as usize).then_some(Self { width, height, values })
    }

    /// Pixels of a row and rows.
    pub fn size(&self) -> [u32; 2] {
        [self.width, self.height]
    }

    /// Row by row.
    pub fn values(&self) -> &[T] {
        &self.values
    }

    /// Row by row.
    pub fn into_values(self) -> Vec<T> {
        self.values
    }

    fn map<U>(self, convert: impl FnMut(T) -> U) -> Image<U> {
        Image { width: self.width, height: self.height, values: self.values.into_iter().map(convert).collect() }
    }
}

/// An image as its file holds it.
#[derive(Clone, Debug, PartialEq)]
pub enum Raster {
    /// One channel of up to 8 bits.
    Bytes(Image<u8>),
    /// One channel of 16 bits without sign.
    Words(Image<u16>),
    /// Whole numbers of another type, whose largest value is `largest`.
    Integers {
        /// The numbers.
        image: Image<i64>,
        /// Largest value that the file's type can hold.
        largest: i64,
    },
    /// Floating-point numbers.
    Floats(Image<f32>),
    /// Indices into a palette of red, green, blue and opacity; at most 256 colours, and an index may lie beyond them.
    Indexed {
        /// The indices.
        image: Image<u8>,
        /// The colours.
        palette: Vec<[u8; 4]>,
    },
    /// Red, green, blue and opacity, the higher 8 bits of each.
    Colours(Image<[u8; 4]>),
    /// The largest channel of an image whose compression changes values: JPEG.
    Lossy(Image<u8>),
}

impl Raster {
    /// Pixels of a row and rows.
    pub fn size(&self) -> [u32; 2] {
        match self {
            Self::Bytes(image) | Self::Lossy(image) | Self::Indexed { image, .. } => image.size(),
            Self::Words(image) => image.size(),
            Self::Integers { image, .. } => image.size(),
            Self::Floats(image) => image.size(),
            Self::Colours(image) => image.size(),
        }
    }
}

/// The error of a file as a whole.
pub(super) fn problem(format: &'static str, problem: String) -> FormatError {
    FormatError::File { format, problem: printable(&problem) }
}

/// Number of pixels of an image of `width` × `height`, if a file of `file_bytes` may hold it at `bytes_per_pixel`, however compressed:
/// asked before memory is taken for it.
pub(super) fn check_size(
    format: &'static str,
    [width, height]: [u64; 2],
    bytes_per_pixel: usize,
    file_bytes: usize,
) -> Result<usize, FormatError> {
    let pixels = width.saturating_mul(height);
    if pixels == 0 || pixels > MOST_PIXELS as u64 {
        return Err(problem(format, format!("{width} × {height} pixels: expected 1 to {MOST_PIXELS}")));
    }
    if pixels as usize * bytes_per_pixel > file_bytes.saturating_mul(DENSEST) {
        return Err(problem(format, format!("{width} × {height} pixels in {file_bytes} bytes: the file is truncated or damaged")));
    }
    Ok(pixels as usize)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_image_has_a_value_for_each_pixel() {
        assert_eq!(Image::new(2, 2, vec![0; 3]), None);
        assert_eq!(Image::new(2, 1, vec![0; 2]).unwrap().size(), [2, 1]);
    }

    #[test]
    fn sizes_that_a_file_cannot_hold_are_refused_before_memory_is_taken() {
        assert_eq!(check_size("PNG", [640, 480], 2, 1000), Ok(307_200));
        assert!(check_size("PNG", [640, 480], 2, 100).unwrap_err().to_string().contains("truncated"));
        for size in [[0, 480], [u64::MAX, 2], [1 << 13, 1 << 12]] {
            assert!(check_size("PNG", size, 2, usize::MAX).unwrap_err().to_string().contains("expected 1 to"), "{size:?}");
        }
    }
}
