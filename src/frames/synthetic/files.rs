//! Views as files of the kind that recorders of real cameras write: `NAME_depth.png` (16 bits, millimetres, 0 for no reading),
//! `NAME_label.png`, `camera_info.yaml` as ROS has it, `trajectory.txt` as the TUM RGB-D benchmark has it.

use super::DepthImage;
use beo_camera::{Intrinsics, Lens};
use beo_core::whole_file::write_whole;
use nalgebra::Isometry3;
use png::{BitDepth, ColorType, Compression, Encoder};
use std::path::{Path, PathBuf};

/// A file could not be written.
#[derive(Debug, thiserror::Error)]
#[error("cannot write {}: {problem}", path.display())]
pub struct WriteError {
    /// The file.
    path: PathBuf,
    /// The error of the operating system or of the encoder.
    problem: String,
}

/// Writes frames of one camera into a folder.
#[derive(Debug)]
pub struct FrameWriter {
    folder: PathBuf,
    trajectory: String,
}

fn write(path: PathBuf, bytes: &[u8]) -> Result<(), WriteError> {
    write_whole(&path, bytes).map_err(|error| WriteError { path, problem: error.to_string() })
}

impl FrameWriter {
    /// Makes the folder and writes the camera's numbers.
    ///
    /// # Errors
    /// [`WriteError`].
    pub fn new(folder: &Path, intrinsics: &Intrinsics) -> Result<Self, WriteError> {
        std::fs::create_dir_all(folder).map_err(|error| WriteError { path: folder.into(), problem: error.to_string() })?;
        write(folder.join("camera_info.yaml"), camera_info(intrinsics).as_bytes())?;
        Ok(Self { folder: folder.into(), trajectory: String::from("# stamp tx ty tz qx qy qz qw: camera to world\n") })
    }

    /// Writes one frame; names sort in the order in which frames are written.
    ///
    /// # Errors
    /// [`WriteError`].
    pub fn write(&mut self, name: &str, stamp_ns: u64, camera_to_world: &Isometry3<f64>, image: &DepthImage) -> Result<(), WriteError> {
        let size = [image.intrinsics().width(), image.intrinsics().height()];
        // Millimetres beyond 16 bits are no reading.
        let millimetres = image.depth().iter().map(|z| Some((z * 1000.0).round()).filter(|mm| *mm <= 65_535.0).unwrap_or(0.0) as u16);
        let depth: Vec<u8> = millimetres.flat_map(u16::to_be_bytes).collect();
        self.png(&format!("{name}_depth.png"), size, BitDepth::Sixteen, &depth)?;
        let labels: Result<Vec<u8>, _> = image.labels().iter().map(|label| u8::try_from(*label)).collect();
        let label_name = format!("{name}_label.png");
        match labels {
            Ok(labels) => self.png(&label_name, size, BitDepth::Eight, &labels)?,
            Err(_) => {
                let labels: Vec<u8> = image.labels().iter().flat_map(|label| label.to_be_bytes()).collect();
                self.png(&label_name, size, BitDepth::Sixteen, &labels)?;
            }
        }
        let (at, q) = (camera_to_world.translation, camera_to_world.rotation.coords);
        self.trajectory += &format!(
            "{}.{:09} {:.6} {:.6} {:.6} {:.9} {:.9} {:.9} {:.9}\n",
            stamp_ns / 1_000_000_000,
            stamp_ns % 1_000_000_000,
            at.x,
            at.y,
            at.z,
            q.x,
            q.y,
            q.z,
            q.w
        );
        Ok(())
    }

    /// Writes where the camera was; the file's path.
    ///
    /// # Errors
    /// [`WriteError`].
    pub fn finish(self) -> Result<PathBuf, WriteError> {
        let path = self.folder.join("trajectory.txt");
        write(path.clone(), self.trajectory.as_bytes())?;
        Ok(path)
    }

    fn png(&self, name: &str, [width, height]: [u32; 2], depth: BitDepth, data: &[u8]) -> Result<(), WriteError> {
        let path = self.folder.join(name);
        let mut bytes = Vec::new();
        let mut encoder = Encoder::new(&mut bytes, width, height);
        encoder.set_color(ColorType::Grayscale);
        encoder.set_depth(depth);
        encoder.set_compression(Compression::Fast);
        let written = encoder.write_header().and_then(|mut writer| writer.write_image_data(data));
        written.map_err(|error| WriteError { path: path.clone(), problem: error.to_string() })?;
        write(path, &bytes)
    }
}

/// ROS's `camera_info` of a camera.
fn camera_info(intrinsics: &Intrinsics) -> String {
    let ([fx, fy], [cx, cy]) = (intrinsics.focal(), intrinsics.centre());
    let lens = intrinsics.lens();
    let model = match lens {
        Lens::Straight | Lens::PlumbBob(_) => "plumb_bob",
        Lens::RationalPolynomial(_) => "rational_polynomial",
        Lens::ModifiedBrownConrady(_) => "modified_brown_conrady",
        Lens::Equidistant(_) => "equidistant",
    };
    let coefficients = if lens == Lens::Straight { &[0.0; 5] } else { lens.coefficients() };
    format!(
        "image_width: {}\nimage_height: {}\ncamera_name: synthetic\ncamera_matrix:\n  rows: 3\n  cols: 3\n  \
         data: [{fx:?}, 0.0, {cx:?}, 0.0, {fy:?}, {cy:?}, 0.0, 0.0, 1.0]\ndistortion_model: {model}\n\
         distortion_coefficients:\n  rows: 1\n  cols: {}\n  data: {coefficients:?}\n",
        intrinsics.width(),
        intrinsics.height(),
        coefficients.len()
    )
}
