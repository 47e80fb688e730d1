//! Images in memory: what the readers of files give, and what they mean: depth in metres, or labels.

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

/// An image as its file holds it, one value a pixel.
#[derive(Clone, Debug, PartialEq)]
pub enum Raster {
    /// Up to 8 bits a pixel.
    Bytes(Image<u8>),
    /// Whole numbers up to 65535.
    Words(Image<u16>),
    /// Floating-point numbers.
    Floats(Image<f32>),
}

impl Raster {
    /// As depth along the optical axis in metres: floating-point numbers as they are, whole numbers times `metres_per_unit`.
    ///
    /// # Errors
    /// Images of 8 bits a pixel: 255 steps of depth are none.
    pub fn into_depth(self, metres_per_unit: f64) -> Result<Image<f32>, FormatError> {
        match self {
            Self::Bytes(_) => Err(problem("image", "8 bits a pixel: depth needs 16 bits, or floating-point metres".into())),
            Self::Words(image) => Ok(image.map(|units| (f64::from(units) * metres_per_unit) as f32)),
            Self::Floats(image) => Ok(image),
        }
    }

    /// As the label of the object of each pixel, 0 for none.
    ///
    /// # Errors
    /// Images of floating-point numbers.
    pub fn into_labels(self) -> Result<Image<u16>, FormatError> {
        match self {
            Self::Bytes(image) => Ok(image.map(u16::from)),
            Self::Words(image) => Ok(image),
            Self::Floats(_) => Err(problem("image", "floating-point numbers: labels are whole numbers from 0 to 65535".into())),
        }
    }
}

/// What is wrong with a file as a whole.
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
    fn whole_numbers_are_scaled_and_floats_are_metres() {
        let words = Raster::Words(Image::new(3, 1, vec![0, 1500, u16::MAX]).unwrap());
        assert_eq!(words.clone().into_depth(0.001).unwrap().values(), [0.0, 1.5, 65.535]);
        // The PrimeSense convention of 0.1 mm.
        assert_eq!(words.clone().into_depth(1e-4).unwrap().values(), [0.0, 0.15, 6.5535]);
        assert_eq!(words.into_labels().unwrap().values(), [0, 1500, u16::MAX]);
        let floats = Raster::Floats(Image::new(1, 2, vec![0.5, f32::NAN]).unwrap());
        assert_eq!(floats.clone().into_depth(0.001).unwrap().values()[0], 0.5);
        assert!(floats.into_labels().unwrap_err().to_string().contains("whole numbers"));
        let bytes = Raster::Bytes(Image::new(1, 1, vec![7]).unwrap());
        assert!(bytes.clone().into_depth(0.001).unwrap_err().to_string().contains("16 bits"));
        assert_eq!(bytes.into_labels().unwrap().values(), [7]);
        assert_eq!(Image::new(2, 2, vec![0; 3]), None);
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
