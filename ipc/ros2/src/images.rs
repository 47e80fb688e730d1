//! Images and cameras of ROS as the camera's library takes them: REP 118's depth images, label images, and calibrations.

use crate::messages::{CameraInfo, Image};
use beo_camera::{Intrinsics, IntrinsicsError, Lens};

/// An image or a camera that cannot be used.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ImageError {
    /// The encoding is none of those that are understood.
    #[error("the {what} image has the encoding `{found:.40}`: use {known}")]
    Encoding {
        /// Which image.
        what: &'static str,
        /// Its encoding.
        found: String,
        /// Those that are understood.
        known: &'static str,
    },
    /// The sizes contradict each other.
    #[error("the {what} image says {width} × {height} pixels, {step} bytes a row, and has {found} bytes")]
    Size {
        /// Which image.
        what: &'static str,
        /// Pixels of a row.
        width: u32,
        /// Rows.
        height: u32,
        /// Bytes of a row.
        step: u32,
        /// Bytes of all.
        found: usize,
    },
    /// A label that is too large.
    #[error("the segmentation has label {label} at pixel {pixel}: use 0 for no object, and at most 65535")]
    Label {
        /// The label.
        label: i32,
        /// Its pixel.
        pixel: usize,
    },
    /// An image that is not the camera's.
    #[error("the {what} image has {found:?} pixels, camera_info says {expected:?}")]
    OtherSize {
        /// Which image.
        what: &'static str,
        /// Its width and height.
        found: [u32; 2],
        /// The camera's.
        expected: [u32; 2],
    },
    /// The calibration.
    #[error("camera_info: {0}")]
    Camera(String),
}

impl From<IntrinsicsError> for ImageError {
    fn from(error: IntrinsicsError) -> Self {
        Self::Camera(error.to_string())
    }
}

/// The readings of a depth image, metres, row by row: 32FC1 in metres, where NaN, infinities and 0 are no reading, or 16UC1 in millimetres,
/// where 0 is none.
///
/// # Errors
/// [`ImageError`] of another encoding, or of sizes that contradict each other.
pub fn depth_of(image: &Image) -> Result<Vec<f32>, ImageError> {
    match image.encoding.as_str() {
        "32FC1" => {
            pixels(image, "depth", |bytes| if image.is_bigendian != 0 { f32::from_be_bytes(bytes) } else { f32::from_le_bytes(bytes) })
        }
        "16UC1" | "mono16" => pixels(image, "depth", |bytes| f32::from(sixteen(image, bytes)) * 0.001),
        _ => Err(ImageError::Encoding { what: "depth", found: image.encoding.clone(), known: "32FC1 (metres) or 16UC1 (millimetres)" }),
    }
}

/// The labels of a segmentation, row by row; 0, and what is below it, is no object.
///
/// # Errors
/// [`ImageError`] of another encoding, of sizes that contradict each other, or of a label that is too large.
pub fn labels_of(image: &Image) -> Result<Vec<u16>, ImageError> {
    match image.encoding.as_str() {
        "mono8" | "8UC1" => pixels(image, "segmentation", |[byte]: [u8; 1]| u16::from(byte)),
        "16UC1" | "mono16" => pixels(image, "segmentation", |bytes| sixteen(image, bytes)),
        "32SC1" => {
            let labels =
                pixels(
                    image,
                    "segmentation",
                    |bytes| if image.is_bigendian != 0 { i32::from_be_bytes(bytes) } else { i32::from_le_bytes(bytes) },
                )?;
            let checked = labels.into_iter().enumerate();
            checked.map(|(pixel, label)| u16::try_from(label.max(0)).map_err(|_| ImageError::Label { label, pixel })).collect()
        }
        _ => Err(ImageError::Encoding { what: "segmentation", found: image.encoding.clone(), known: "mono8, 16UC1 or 32SC1" }),
    }
}

fn sixteen(image: &Image, bytes: [u8; 2]) -> u16 {
    if image.is_bigendian != 0 { u16::from_be_bytes(bytes) } else { u16::from_le_bytes(bytes) }
}

/// The pixels of an image of `N` bytes each.
fn pixels<const N: usize, T>(image: &Image, what: &'static str, read: impl Fn([u8; N]) -> T) -> Result<Vec<T>, ImageError> {
    let (width, height, step) = (image.width as usize, image.height as usize, image.step as usize);
    let row = width.checked_mul(N);
    let all = step.checked_mul(height);
    // The sizes are another process's word: nothing is laid out by them before the bytes are there.
    let fits = row.is_some_and(|row| row > 0 && row <= step) && height > 0 && all == Some(image.data.len());
    if !fits {
        return Err(ImageError::Size { what, width: image.width, height: image.height, step: image.step, found: image.data.len() });
    }
    let rows = image.data.chunks_exact(step);
    Ok(rows.flat_map(|row| row[..width * N].as_chunks::<N>().0).map(|bytes| read(*bytes)).collect())
}

/// The camera of a calibration, after its region of interest and binning: K and the distortion, or P where the images are rectified.
///
/// # Errors
/// [`ImageError::Camera`] if it is not calibrated, or has a lens that is not known.
pub fn intrinsics_of(info: &CameraInfo, is_rectified: bool) -> Result<Intrinsics, ImageError> {
    // The left 3 × 3 of P's 3 × 4.
    let p = std::array::from_fn(|i| info.p[i + i / 3]);
    let (matrix, lens) = if is_rectified { (p, Lens::Straight) } else { (info.k, lens_of(&info.distortion_model, &info.d)?) };
    let (focal, centre) = ([matrix[0], matrix[4]], [matrix[2], matrix[5]]);
    if focal == [0.0; 2] {
        let which = if is_rectified { "P" } else { "K" };
        return Err(ImageError::Camera(format!("{which} is all zeros: the camera is not calibrated")));
    }
    let binning = [info.binning_x, info.binning_y].map(|by| by.max(1));
    let roi = &info.roi;
    // A region of 0 × 0 stands for the whole image.
    let (corner, size) = match [roi.width, roi.height] {
        [0, 0] => ([0; 2], [info.width, info.height]),
        size => ([roi.x_offset, roi.y_offset], size),
    };
    // A pixel covers `binning` pixels of the calibrated image, whose centres lie around its own.
    let scaled = |axis: usize| {
        let by = f64::from(binning[axis]);
        (focal[axis] / by, (centre[axis] - f64::from(corner[axis]) + 0.5) / by - 0.5)
    };
    let ((fx, cx), (fy, cy)) = (scaled(0), scaled(1));
    Ok(Intrinsics::with_lens(size[0] / binning[0], size[1] / binning[1], [fx, fy], [cx, cy], lens)?)
}

/// The lens by ROS's name for it.
fn lens_of(model: &str, coefficients: &[f64]) -> Result<Lens, ImageError> {
    let used = &coefficients[..coefficients.iter().rposition(|c| *c != 0.0).map_or(0, |last| last + 1)];
    match model {
        "equidistant" | "fisheye" => Ok(Lens::Equidistant(padded(model, used)?)),
        // Drivers of cameras without distortion name all sorts of models, or none.
        _ if used.is_empty() => Ok(Lens::Straight),
        "plumb_bob" => Ok(Lens::PlumbBob(padded(model, used)?)),
        "rational_polynomial" => Ok(Lens::RationalPolynomial(padded(model, used)?)),
        _ => Err(ImageError::Camera(format!(
            "the distortion model `{model:.40}` is not known: use plumb_bob, rational_polynomial or equidistant, or rectified images with the parameter rectified"
        ))),
    }
}

fn padded<const N: usize>(model: &str, used: &[f64]) -> Result<[f64; N], ImageError> {
    if used.len() > N {
        return Err(ImageError::Camera(format!("{model} with {} coefficients: at most {N} are known", used.len())));
    }
    Ok(std::array::from_fn(|i| used.get(i).copied().unwrap_or(0.0)))
}

/// Whether an image is as large as the camera says.
///
/// # Errors
/// [`ImageError::OtherSize`].
pub fn check_size(what: &'static str, image: &Image, intrinsics: &Intrinsics) -> Result<(), ImageError> {
    let (found, expected) = ([image.width, image.height], [intrinsics.width(), intrinsics.height()]);
    if found == expected { Ok(()) } else { Err(ImageError::OtherSize { what, found, expected }) }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn image(encoding: &str, [width, height]: [u32; 2], step: u32, data: Vec<u8>) -> Image {
        Image { encoding: encoding.into(), width, height, step, data, ..Image::default() }
    }

    #[test]
    fn depth_is_metres_whatever_the_encoding_the_byte_order_and_the_padding() {
        let floats: Vec<u8> = [0.5_f32, f32::NAN, 2.0].iter().flat_map(|metres| metres.to_le_bytes()).collect();
        let read = depth_of(&image("32FC1", [3, 1], 12, floats)).unwrap();
        assert!(read[0] == 0.5 && read[1].is_nan() && read[2] == 2.0);
        // Two rows of one pixel, each with two bytes behind it.
        assert_eq!(depth_of(&image("16UC1", [1, 2], 4, vec![0xe8, 3, 9, 9, 0, 0, 9, 9])), Ok(vec![1.0, 0.0]));
        let big = Image { is_bigendian: 1, ..image("16UC1", [1, 1], 2, vec![3, 0xe8]) };
        assert_eq!(depth_of(&big), Ok(vec![1.0]));
    }

    #[test]
    fn labels_of_every_width_are_read_and_those_below_0_are_none() {
        assert_eq!(labels_of(&image("mono8", [3, 1], 3, vec![0, 1, 255])), Ok(vec![0, 1, 255]));
        assert_eq!(labels_of(&image("16UC1", [1, 1], 2, vec![1, 1])), Ok(vec![257]));
        let words: Vec<u8> = [-1_i32, 7].iter().flat_map(|label| label.to_le_bytes()).collect();
        assert_eq!(labels_of(&image("32SC1", [2, 1], 8, words)), Ok(vec![0, 7]));
        let large = image("32SC1", [1, 1], 4, 65_536_i32.to_le_bytes().to_vec());
        assert_eq!(labels_of(&large), Err(ImageError::Label { label: 65_536, pixel: 0 }));
    }

    #[test]
    fn sizes_that_lie_and_other_encodings_are_one_line() {
        let most = u32::MAX;
        for (size, step, bytes) in
            [([2, 2], 4, 7), ([2, 2], 3, 6), ([most, most], most, 4), ([0, 5], 4, 20), ([2, 0], 4, 0), ([2, 2], 4, 9)]
        {
            let text = depth_of(&image("16UC1", size, step, vec![0; bytes])).unwrap_err().to_string();
            assert!(text.contains("the depth image says") && !text.contains('\n'), "{text}");
        }
        assert!(depth_of(&image("rgb8", [1, 1], 3, vec![0; 3])).unwrap_err().to_string().contains("32FC1"));
        assert!(labels_of(&image("32FC1", [1, 1], 4, vec![0; 4])).unwrap_err().to_string().contains("mono8"));
    }

    fn info() -> CameraInfo {
        CameraInfo {
            width: 640,
            height: 480,
            distortion_model: "plumb_bob".into(),
            d: vec![0.1, -0.2, 0.0, 0.0, 0.0],
            k: [600.0, 0.0, 320.0, 0.0, 610.0, 240.0, 0.0, 0.0, 1.0],
            p: [500.0, 0.0, 310.0, 0.0, 0.0, 510.0, 230.0, 0.0, 0.0, 0.0, 1.0, 0.0],
            ..CameraInfo::default()
        }
    }

    #[test]
    fn the_camera_is_k_with_its_lens_or_p_where_images_are_rectified() {
        let raw = intrinsics_of(&info(), false).unwrap();
        assert_eq!((raw.focal(), raw.centre(), raw.lens()), ([600.0, 610.0], [320.0, 240.0], Lens::PlumbBob([0.1, -0.2, 0.0, 0.0, 0.0])));
        let rectified = intrinsics_of(&info(), true).unwrap();
        assert_eq!((rectified.focal(), rectified.centre(), rectified.lens()), ([500.0, 510.0], [310.0, 230.0], Lens::Straight));
        let mut half = CameraInfo { binning_x: 2, binning_y: 2, ..info() };
        (half.roi.x_offset, half.roi.width, half.roi.height) = (20, 600, 480);
        let half = intrinsics_of(&half, true).unwrap();
        assert_eq!((half.width(), half.height(), half.centre()), (300, 240, [144.75, 114.75]));
    }

    #[test]
    fn a_camera_that_is_none_says_why() {
        let cases: [(CameraInfo, bool, &str); 4] = [
            (CameraInfo { k: [0.0; 9], ..info() }, false, "not calibrated"),
            (CameraInfo { distortion_model: "foo".into(), ..info() }, false, "`foo` is not known"),
            (CameraInfo { d: vec![1.0; 8], ..info() }, false, "8 coefficients"),
            (CameraInfo { width: 0, ..info() }, true, "0 × 480"),
        ];
        for (info, is_rectified, word) in cases {
            let text = intrinsics_of(&info, is_rectified).unwrap_err().to_string();
            assert!(text.contains(word), "{word}: {text}");
        }
    }
}
