//! One camera as a file describes it, and the choice of it for images: which of several, rectified or raw, binned or cut out.

use super::error::wrong;
use beo_camera::{Intrinsics, Lens};
use beo_shapes::FormatError;

/// A camera as its file has it.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Description {
    /// Its name, where the file may hold several.
    pub(super) name: Option<String>,
    /// Columns and rows of the calibrated image, where the file says them.
    pub(super) size: Option<[u32; 2]>,
    /// fx, fy, cx, cy of the raw image.
    pub(super) matrix: [f64; 4],
    /// Its lens.
    pub(super) lens: Lens,
    /// fx, fy, cx, cy of the rectified image, if they are given; an error matters only to those who want them.
    pub(super) projection: Option<Result<[f64; 4], FormatError>>,
    /// Pixels of the calibrated image that are one of the image, along a row and a column.
    pub(super) binning: [u32; 2],
    /// The part of the calibrated image that was kept, before binning: first column, first row, columns, rows.
    pub(super) region: Option<[u32; 4]>,
    /// Name of the camera's frame.
    pub(super) frame_id: Option<String>,
}

/// Knowledge of the images that chooses between the cameras of a file.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct CameraChoice<'a> {
    /// Columns and rows of the images; for files that say no size, or hold the cameras of several.
    pub image: Option<[u32; 2]>,
    /// The images are rectified: the projection matrix P holds for them, and there is no distortion.
    pub is_rectified: bool,
    /// Which of several cameras.
    pub name: Option<&'a str>,
}

/// Finds the one camera that is meant.
pub(super) fn choose<'a>(cameras: &'a [Description], choice: &CameraChoice<'_>) -> Result<&'a Description, FormatError> {
    let name = |camera: &Description| camera.name.clone().unwrap_or_else(|| "a camera without a name".into());
    let names = || {
        let mut names: Vec<String> = cameras.iter().map(name).collect();
        names.dedup();
        names.truncate(12);
        names.join(", ")
    };
    let mut left: Vec<&Description> = cameras.iter().collect();
    if let Some(wanted) = choice.name {
        left.retain(|camera| camera.name.as_deref().is_some_and(|name| name.eq_ignore_ascii_case(wanted)));
        if left.is_empty() {
            return Err(wrong(format!("there is no camera `{wanted:.40}` (--camera-name); there is {}", names())));
        }
    }
    if left.len() > 1
        && let Some(image) = choice.image
    {
        left.retain(|camera| camera.image_size() == Ok(Some(image)));
        if left.is_empty() {
            return Err(wrong(format!("no camera of {} × {} pixels; there is {}", image[0], image[1], names())));
        }
    }
    // Of the streams of one sensor, that of the depth image.
    if left.len() > 1 && left.iter().filter(|camera| camera.is_depth()).count() > 0 {
        left.retain(|camera| camera.is_depth());
    }
    match left[..] {
        [] => Err(wrong("there is no camera in it")),
        [one] => Ok(one),
        // The same stream in several formats.
        [first, ..] if left.iter().all(|camera| (&camera.matrix, &camera.lens) == (&first.matrix, &first.lens)) => Ok(first),
        _ => Err(wrong(format!("it describes {}: say which one took the depth images (--camera-name)", names()))),
    }
}

impl Description {
    fn is_depth(&self) -> bool {
        self.name.as_deref().is_some_and(|name| name.eq_ignore_ascii_case("depth"))
    }

    /// Columns and rows of the images, after region and binning.
    fn image_size(&self) -> Result<Option<[u32; 2]>, FormatError> {
        let Some(full) = self.size else { return Ok(None) };
        let [x, y, width, height] = self.region.unwrap_or([0, 0, full[0], full[1]]);
        if u64::from(x) + u64::from(width) > full[0].into() || u64::from(y) + u64::from(height) > full[1].into() {
            return Err(wrong(format!(
                "the region of interest, {width} × {height} from {x}, {y}, does not lie in the image of {} × {}",
                full[0], full[1]
            )));
        }
        Ok(Some([width / self.binning[0].max(1), height / self.binning[1].max(1)]))
    }

    /// The camera of the images.
    ///
    /// A pixel of the image covers `binning` pixels of the calibrated one, whose centres lie around its own: u = (u′ − x₀ + ½) / b − ½.
    pub(super) fn intrinsics(&self, choice: &CameraChoice<'_>) -> Result<Intrinsics, FormatError> {
        let ([fx, fy, cx, cy], lens) = match (choice.is_rectified, self.projection.clone()) {
            (false, _) => (self.matrix, self.lens),
            (true, Some(projection)) => (projection?, Lens::Straight),
            (true, None) if self.lens == Lens::Straight => (self.matrix, Lens::Straight),
            (true, None) => {
                return Err(wrong("--rectified: there is no projection_matrix (P), which describes the rectified images"));
            }
        };
        if [fx, fy] == [0.0; 2] {
            let what = if choice.is_rectified { "the projection matrix P" } else { "the camera matrix K" };
            let hint = match &self.projection {
                Some(Ok([fx, ..])) if *fx > 0.0 && !choice.is_rectified => {
                    "; P is given: if the images are rectified, say so with --rectified"
                }
                _ => ": calibrate it, or give its intrinsics with --camera-info",
            };
            return Err(wrong(format!("{what} is all zeros, which says that the camera is not calibrated{hint}")));
        }
        let size = match (self.image_size()?, choice.image) {
            (Some(size), _) | (None, Some(size)) => size,
            (None, None) => return Err(wrong("it says no image size")),
        };
        let binning = self.binning.map(|b| f64::from(b.max(1)));
        let corner = self.region.map_or([0.0; 2], |[x, y, ..]| [x, y].map(f64::from));
        let centre = [0, 1].map(|axis| ([cx, cy][axis] - corner[axis] + 0.5) / binning[axis] - 0.5);
        let focal = [fx / binning[0], fy / binning[1]];
        Intrinsics::with_lens(size[0], size[1], focal, centre, lens).map_err(|error| wrong(error.to_string()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Point3;

    fn camera(name: &str, size: [u32; 2], focal: f64) -> Description {
        Description { name: Some(name.into()), size: Some(size), matrix: [focal, focal, 20.0, 10.0], ..Description::default() }
    }

    #[test]
    fn the_region_and_the_binning_keep_the_picture_where_it_is() {
        // A point seen at (u, v) of the calibrated image lies in pixel ((u − x₀ + ½) / b − ½) of what is left of it.
        let full = camera("a", [640, 480], 500.0);
        let part = Description { binning: [2, 4], region: Some([100, 80, 400, 240]), ..full.clone() };
        let (whole, part) = (full.intrinsics(&CameraChoice::default()).unwrap(), part.intrinsics(&CameraChoice::default()).unwrap());
        assert_eq!([part.width(), part.height()], [200, 60]);
        let point = Point3::new(0.3, 0.2, 1.0);
        let ([u, v], [s, t]) = (whole.project(&point).unwrap(), part.project(&point).unwrap());
        assert!((s - ((u - 100.0 + 0.5) / 2.0 - 0.5)).abs() < 1e-12 && (t - ((v - 80.0 + 0.5) / 4.0 - 0.5)).abs() < 1e-12);
        let outside = Description { region: Some([300, 0, 400, 240]), ..full };
        assert!(outside.intrinsics(&CameraChoice::default()).unwrap_err().to_string().contains("does not lie in the image"));
    }

    #[test]
    fn of_several_cameras_the_one_named_or_of_the_right_size_or_of_depth_is_taken() {
        let cameras = [camera("cam0", [640, 480], 1.0), camera("cam1", [640, 480], 2.0), camera("cam2", [320, 240], 3.0)];
        let chosen = |cameras: &[Description], image, name| {
            choose(cameras, &CameraChoice { image, name, is_rectified: false }).map(|camera| camera.matrix[0]).map_err(|e| e.to_string())
        };
        assert_eq!(chosen(&cameras, None, Some("CAM1")), Ok(2.0));
        assert_eq!(chosen(&cameras, Some([320, 240]), None), Ok(3.0));
        assert!(chosen(&cameras, Some([640, 480]), None).unwrap_err().contains("--camera-name"));
        assert!(chosen(&cameras, Some([9, 9]), None).unwrap_err().contains("no camera of 9 × 9 pixels; there is cam0, cam1, cam2"));
        assert!(chosen(&cameras, None, Some("cam7")).unwrap_err().contains("there is cam0, cam1, cam2"));
        let streams = [camera("Color", [640, 480], 1.0), camera("Depth", [640, 480], 2.0), camera("Depth", [640, 480], 2.0)];
        assert_eq!(chosen(&streams, Some([640, 480]), None), Ok(2.0));
    }
}
