//! The frames of a folder, in any of these layouts:
//!
//! | layout | depth | labels | camera |
//! | --- | --- | --- | --- |
//! | flat | `NAME_depth.EXT` | `NAME_label.EXT` or `NAME_mask.EXT` | `NAME_camera_info.yaml`, or one of the files below |
//! | subfolders (FoundationPose) | `depth/NAME.EXT` | `label/NAME.EXT`, `mask/NAME.EXT` or `masks/NAME.EXT` | one of the files below |
//! | BOP scene | `depth/000000.EXT` | `mask_visib/000000_000001.EXT` or `mask/…`, one for each instance | `scene_camera.json` |
//!
//! A label image holds the label of each pixel's object; a mask is one object. `EXT` is `png`, `npy`, `tif` or `tiff`, of masks also `jpg`.
//! The label of a mask is 1, of an instance of a BOP scene its number plus 1. The camera of all frames: `camera_info.yaml` (or `.json`),
//! `cam_K.txt`, `camera_intrinsic.json`, `intrinsics.json`, `.yaml` or `.txt`, `camchain.yaml`.

mod error;
mod instances;
mod layout;

pub use error::FolderError;

use super::images::{ColourLabels, DepthAlong, DepthUnit, Image, Raster, VoidLabels, limited, z_of_distances};
use super::{CameraChoice, CameraInfo, CapturedFrame, SizeError, parse_camera_info};
use super::{parse_jpeg_image, parse_npy_image, parse_png_image, parse_tiff_image};
use beo_shapes::{FormatError, ReadError, read_bytes};
use layout::{Camera, FrameFiles, Kind, Labels};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

/// Settings that a folder does not state itself.
#[derive(Clone, Debug)]
pub struct FolderOptions {
    /// Metres per unit of depth images of every type; otherwise what the scene says, or [`DepthUnit::default`].
    pub metres_per_unit: Option<f64>,
    /// The length that depth images hold.
    pub depth_along: DepthAlong,
    /// Values of depth images, in their own units, that are no reading, besides those that never are.
    pub no_reading: Vec<f64>,
    /// Nearest and farthest depth that is a reading, metres.
    pub range_m: [f64; 2],
    /// A camera's file in place of the folder's.
    pub camera_info: Option<PathBuf>,
    /// Which camera of a file that describes several.
    pub camera_name: Option<String>,
    /// The images are rectified: P of the `camera_info` holds, and there is no distortion.
    pub is_rectified: bool,
    /// Labels that are no object.
    pub void_labels: VoidLabels,
    /// Treatment of frames without label image or masks.
    pub unlabelled: Unlabelled,
}

/// Treatment of frames that have neither a label image nor masks.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Unlabelled {
    /// They cannot be read. Use this where objects come from labels alone.
    #[default]
    Missing,
    /// They are read with all labels 0 if no frame of the folder has labels: where some have, a frame without is one whose file is missing.
    TakenIfAllAre,
    /// They are read with all labels 0.
    Taken,
}

impl Default for FolderOptions {
    /// As the files say, with readings of any depth.
    fn default() -> Self {
        Self {
            metres_per_unit: None,
            depth_along: DepthAlong::default(),
            no_reading: Vec::new(),
            range_m: [0.0, f64::INFINITY],
            camera_info: None,
            camera_name: None,
            is_rectified: false,
            void_labels: VoidLabels::default(),
            unlabelled: Unlabelled::default(),
        }
    }
}

/// The frames of a folder, sorted by name, numbers in names by their value.
#[derive(Clone, Debug)]
pub struct FrameFolder {
    frames: Vec<FrameFiles>,
    options: FolderOptions,
    /// Colours are the same objects in all frames.
    colours: Arc<Mutex<ColourLabels>>,
}

impl FrameFolder {
    /// Finds the frames of a folder. What is wrong with a single one comes up when it is read.
    ///
    /// # Errors
    /// [`FolderError`]: a folder that cannot be listed or has no frames, a `scene_camera.json` that cannot be read.
    pub fn open(folder: &Path, options: FolderOptions) -> Result<Self, FolderError> {
        Ok(Self { frames: layout::frames(folder)?, options, colours: Arc::default() })
    }

    /// Number of frames, readable or not; at least one.
    pub fn count(&self) -> usize {
        self.frames.len()
    }

    /// Name of a frame.
    pub fn name(&self, frame: usize) -> &str {
        &self.frames[frame].name
    }

    /// Reads a frame.
    ///
    /// # Errors
    /// [`FolderError`] says what is missing, damaged or does not fit.
    pub fn read(&self, frame: usize) -> Result<CapturedFrame, FolderError> {
        let FrameFiles { name, depth, labels, camera } = &self.frames[frame];
        let depth = depth.as_ref().map_err(|expected| FolderError::Missing { expected: expected.clone() })?;
        let unit = match (self.options.metres_per_unit, camera) {
            (Some(metres), _) => DepthUnit::all(metres),
            (None, Camera::Scene(scene)) => DepthUnit::all(scene.metres_per_unit),
            (None, _) => DepthUnit::default(),
        };
        let (mut depth, metres_per_unit) = read_image(depth, |raster| {
            let metres_per_unit = unit.of(&raster);
            Ok((raster.into_depth(&unit, &self.options.no_reading)?, metres_per_unit))
        })?;
        let (info, camera_to_world) = self.camera(camera, depth.size())?;
        if self.options.depth_along == DepthAlong::Ray {
            z_of_distances(&mut depth, &info.intrinsics);
        }
        let is_labelled = !matches!(labels, Labels::Missing(_));
        let (labels, hidden) = self.labels(labels, &depth)?;
        let typical_depth_m = typical_depth(&depth, &labels);
        limited(&mut depth, self.options.range_m[0], self.options.range_m[1]);
        let mut captured = CapturedFrame::new(name.clone(), info.intrinsics, depth, labels)?;
        (captured.camera_to_world, captured.frame_id, captured.hidden) = (camera_to_world, info.frame_id, hidden);
        captured.is_labelled = is_labelled;
        (captured.metres_per_unit, captured.typical_depth_m) = (metres_per_unit, typical_depth_m);
        Ok(captured)
    }

    /// The camera of images of that size, and where it was.
    fn camera(&self, camera: &Camera, image: [u32; 2]) -> Result<(CameraInfo, Option<nalgebra::Isometry3<f64>>), FolderError> {
        let FolderOptions { camera_info, camera_name, is_rectified, .. } = &self.options;
        let choice = CameraChoice { image: Some(image), is_rectified: *is_rectified, name: camera_name.as_deref() };
        let read = |path: &Path| {
            parse_camera_info(&read_bytes(path)?, &choice).map_err(|source| ReadError::Malformed { path: path.into(), source })
        };
        match (camera_info, camera) {
            (Some(path), Camera::Scene(scene)) => Ok((read(path)?, scene.camera_to_world)),
            (Some(path), _) | (None, Camera::Info(path)) => Ok((read(path)?, None)),
            (None, Camera::Unlisted(path, image)) => Err(FolderError::NoCamera { path: path.clone(), image: *image }),
            (None, Camera::Missing(folder)) => Err(FolderError::Uncalibrated { folder: folder.clone() }),
            (None, Camera::Scene(_)) if *is_rectified => Err(FolderError::NotRectified { path: "scene_camera.json".into() }),
            (None, Camera::Scene(scene)) => {
                let intrinsics = scene.intrinsics(image[0], image[1])?;
                Ok((CameraInfo { intrinsics, frame_id: None }, scene.camera_to_world))
            }
        }
    }

    /// Whether frames without labels are read.
    fn takes_unlabelled(&self) -> bool {
        match self.options.unlabelled {
            Unlabelled::Missing => false,
            Unlabelled::Taken => true,
            Unlabelled::TakenIfAllAre => self.frames.iter().all(|frame| matches!(frame.labels, Labels::Missing(_))),
        }
    }

    /// The labels of images of the depth image's size, and the labels of masks without a pixel.
    fn labels(&self, labels: &Labels, depth: &Image<f32>) -> Result<(Image<u16>, Vec<u16>), FolderError> {
        let masks = match labels {
            Labels::Image(path) => {
                let mut colours = self.colours.lock().unwrap_or_else(PoisonError::into_inner);
                let labels = read_image(path, |raster| raster.into_labels(&self.options.void_labels, &mut colours))?;
                return Ok((labels, Vec::new()));
            }
            Labels::Missing(_) if self.takes_unlabelled() => {
                let [width, height] = depth.size();
                let none = vec![0; depth.values().len()];
                return Ok((Image::new(width, height, none).expect("one label for each pixel"), Vec::new()));
            }
            Labels::Missing(expected) => return Err(FolderError::Missing { expected: expected.clone() }),
            Labels::Masks(masks) => masks,
        };
        let mut read = Vec::with_capacity(masks.len());
        let mut hidden = Vec::new();
        for (label, path) in masks {
            let mask = read_image(path, |raster| Ok(raster.into_mask()))?;
            if mask.size() != depth.size() {
                return Err(SizeError { what: "mask", found: mask.size(), camera: depth.size() }.into());
            }
            if mask.values().contains(&true) {
                read.push((*label, mask));
            } else {
                hidden.push(*label);
            }
        }
        let merged = instances::merged(&read, depth);
        hidden.extend(read.iter().map(|(label, _)| *label).filter(|label| !merged.contains(label)));
        hidden.sort_unstable();
        let [width, height] = depth.size();
        Ok((Image::new(width, height, merged).expect("one label for each pixel"), hidden))
    }
}

/// Median depth of the labelled pixels with a reading, or of all where none has a label.
fn typical_depth(depth: &Image<f32>, labels: &Image<u16>) -> Option<f64> {
    let readings = |labelled: bool| -> Vec<f32> {
        let pixels = depth.values().iter().zip(labels.values());
        pixels.filter(|(depth, label)| **depth > 0.0 && (!labelled || **label != 0)).map(|(depth, _)| *depth).collect()
    };
    let mut found = readings(true);
    if found.is_empty() {
        found = readings(false);
    }
    let middle = found.len() / 2;
    (!found.is_empty()).then(|| f64::from(*found.select_nth_unstable_by(middle, f32::total_cmp).1))
}

/// Reads an image by its extension.
fn read_image<T>(path: &Path, convert: impl FnOnce(Raster) -> Result<T, FormatError>) -> Result<T, ReadError> {
    let parse = match Kind::of(path) {
        Some(Kind::Png) => parse_png_image,
        Some(Kind::Npy) => parse_npy_image,
        Some(Kind::Tiff) => parse_tiff_image,
        Some(Kind::Jpeg) => parse_jpeg_image,
        None => return Err(ReadError::Extension { path: path.into(), known: ".png, .npy, .tif, .tiff, and of masks .jpg" }),
    };
    parse(&read_bytes(path)?).and_then(convert).map_err(|source| ReadError::Malformed { path: path.into(), source })
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs::{create_dir_all, write};

    fn npy(descr: &str, data: &[u8]) -> Vec<u8> {
        let header = format!("{{'descr': '{descr}', 'fortran_order': False, 'shape': (2, 3), }}\n");
        [b"\x93NUMPY\x01\x00", &(header.len() as u16).to_le_bytes()[..], header.as_bytes(), data].concat()
    }

    fn depth(units: u16) -> Vec<u8> {
        npy("<u2", &units.to_le_bytes().repeat(6))
    }

    fn info(focal: u32) -> String {
        format!("width: 3\nheight: 2\nK: [{focal}, 0, 1, 0, {focal}, 0.5, 0, 0, 1]\nD: []\ndistortion_model: plumb_bob\n")
    }

    fn open(folder: &Path) -> FrameFolder {
        FrameFolder::open(folder, FolderOptions::default()).unwrap()
    }

    #[test]
    fn a_flat_folder_gives_its_frames_by_name_with_their_own_camera_or_the_common_one() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        for name in ["b", "a", "c", "d"] {
            write(at(&format!("{name}_depth.npy")), depth(1500)).unwrap();
        }
        write(at("a_label.npy"), npy("|u1", &[0, 1, 2, 3, 4, 5])).unwrap();
        write(at("a_mask.npy"), npy("|u1", &[9; 6])).unwrap();
        write(at("b_mask.NPY"), npy("|u1", &[255; 6])).unwrap();
        write(at("c_label.npy"), b"no array").unwrap();
        write(at("e_label.npy"), npy("|u1", &[1; 6])).unwrap();
        write(at("camera_info.yaml"), info(10)).unwrap();
        write(at("b_camera_info.yaml"), info(20)).unwrap();
        write(at("a_rgb.png"), b"whatever").unwrap();
        let frames = open(folder.path());
        assert_eq!((0..frames.count()).map(|frame| frames.name(frame)).collect::<Vec<_>>(), ["a", "b", "c", "d", "e"]);
        let (a, b) = (frames.read(0).unwrap(), frames.read(1).unwrap());
        assert_eq!((a.frame().labels(), a.frame().depths()), (&[0, 1, 2, 3, 4, 5][..], &[1.5; 6][..]));
        assert_eq!((b.frame().labels(), b.frame().intrinsics().focal()), (&[1; 6][..], [20.0; 2]));
        assert_eq!(a.frame().intrinsics().focal(), [10.0; 2]);
        for (frame, part) in [(2, "c_label.npy: npy: does not start"), (3, "no "), (3, "d_label.png"), (4, "e_depth.png")] {
            let message = frames.read(frame).unwrap_err().to_string();
            assert!(message.contains(part), "{message}");
        }
        write(at("other.yaml"), info(30)).unwrap();
        let options = FolderOptions { metres_per_unit: Some(1e-4), camera_info: Some(at("other.yaml")), ..FolderOptions::default() };
        let other = FrameFolder::open(folder.path(), options).unwrap().read(1).unwrap();
        assert_eq!((other.frame().intrinsics().focal(), other.frame().depths()[0]), ([30.0; 2], 0.15));
    }

    #[test]
    fn subfolders_are_matched_by_stem() {
        let folder = tempfile::tempdir().unwrap();
        for part in ["depth", "label", "mask", "rgb"] {
            create_dir_all(folder.path().join(part)).unwrap();
        }
        let at = |name: &str| folder.path().join(name);
        write(at("depth/2.npy"), depth(1)).unwrap();
        write(at("depth/10.npy"), npy("<f4", &0.25_f32.to_le_bytes().repeat(6))).unwrap();
        write(at("label/2.npy"), npy("|u1", &[1; 6])).unwrap();
        write(at("mask/10.npy"), npy("|b1", &[1; 6])).unwrap();
        write(at("mask/2.npy"), npy("|u1", &[7; 6])).unwrap();
        let frames = open(folder.path());
        assert_eq!([frames.name(0), frames.name(1)], ["2", "10"]);
        assert!(frames.read(0).unwrap_err().to_string().contains("there is no camera in"));
        write(at("camera_info.yaml"), info(10)).unwrap();
        let frames = open(folder.path());
        assert_eq!(frames.read(1).unwrap().frame().depths(), [0.25; 6]);
        assert_eq!(frames.read(0).unwrap().frame().labels(), [1; 6]);
        write(at("camera_info.yaml"), info(10).replace("width: 3\nheight: 2", "width: 2\nheight: 3")).unwrap();
        assert!(frames.read(0).unwrap_err().to_string().starts_with("the depth image has 3 × 2 pixels, the camera 2 × 3"));
    }

    #[test]
    fn a_bop_scene_has_a_mask_for_each_instance_and_a_camera_for_each_image() {
        let folder = tempfile::tempdir().unwrap();
        for part in ["depth", "mask", "mask_visib"] {
            create_dir_all(folder.path().join(part)).unwrap();
        }
        let at = |name: &str| folder.path().join(name);
        let place = r#", "cam_R_w2c": [1, 0, 0, 0, 1, 0, 0, 0, 1], "cam_t_w2c": [0, 0, 500]"#;
        let camera = |more: &str| format!("{{\"cam_K\": [10, 0, 1, 0, 10, 0.5, 0, 0, 1], \"depth_scale\": 0.1{more}}}");
        write(at("scene_camera.json"), format!("{{\"0\": {}, \"1\": {}}}", camera(place), camera(""))).unwrap();
        for image in 0..3 {
            write(at(&format!("depth/00000{image}.npy")), depth(5000)).unwrap();
        }
        write(at("mask_visib/000000_000000.npy"), npy("|u1", &[255, 0, 0, 0, 0, 0])).unwrap();
        write(at("mask_visib/000000_000004.npy"), npy("|u1", &[0, 0, 255, 255, 0, 0])).unwrap();
        write(at("mask_visib/000001_000000.npy"), npy("|u1", &[0; 6])).unwrap();
        write(at("mask_visib/000002_000000.npy"), npy("|u1", &[0; 6])).unwrap();
        write(at("mask/000000_000000.npy"), npy("|u1", &[255; 6])).unwrap();
        let frames = open(folder.path());
        let first = frames.read(0).unwrap();
        assert_eq!((first.name(), first.frame().labels()), ("000000", &[1, 0, 5, 5, 0, 0][..]));
        assert_eq!(first.frame().depths(), [0.5; 6]);
        assert_eq!(first.camera_to_world.unwrap().translation.z, -0.5);
        let second = frames.read(1).unwrap();
        assert!(second.camera_to_world.is_none() && second.hidden == [1] && first.hidden.is_empty());
        assert!(frames.read(2).unwrap_err().to_string().starts_with("there is no camera for image 2 in"));
        write(at("mask_visib/000001_000000.npy"), npy("|u1", &[0; 6]).replace_shape("(2, 3)", "(3, 2)")).unwrap();
        assert!(frames.read(1).unwrap_err().to_string().starts_with("the mask image has 2 × 3 pixels, the camera 3 × 2"));
    }

    trait ReplaceShape {
        fn replace_shape(self, from: &str, to: &str) -> Vec<u8>;
    }

    impl ReplaceShape for Vec<u8> {
        fn replace_shape(mut self, from: &str, to: &str) -> Vec<u8> {
            let place = self.windows(from.len()).position(|window| window == from.as_bytes()).unwrap();
            self[place..place + to.len()].copy_from_slice(to.as_bytes());
            self
        }
    }

    #[test]
    fn a_folder_without_frames_says_what_is_expected() {
        let folder = tempfile::tempdir().unwrap();
        let message = |path: &Path| FrameFolder::open(path, FolderOptions::default()).unwrap_err().to_string();
        assert!(message(folder.path()).contains("NAME_depth.png"));
        assert!(message(&folder.path().join("absent")).starts_with("cannot list"));
        write(folder.path().join("scene_camera.json"), "{").unwrap();
        assert!(message(folder.path()).contains("scene_camera.json: scene_camera: EOF"));
    }

    #[test]
    fn foundationpose_has_one_mask_for_the_first_frame_and_a_matrix_alone() {
        let folder = tempfile::tempdir().unwrap();
        for part in ["depth", "masks", "rgb"] {
            create_dir_all(folder.path().join(part)).unwrap();
        }
        let at = |name: &str| folder.path().join(name);
        write(at("depth/1.npy"), depth(500)).unwrap();
        write(at("depth/2.npy"), depth(500)).unwrap();
        write(at("masks/1.npy"), npy("|u1", &[0, 255, 255, 0, 0, 0])).unwrap();
        write(at("cam_K.txt"), "10 0 1\n0 10 0.5\n0 0 1\n").unwrap();
        let frames = open(folder.path());
        let first = frames.read(0).unwrap();
        assert_eq!((first.frame().labels(), first.frame().intrinsics().focal()), (&[0, 1, 1, 0, 0, 0][..], [10.0; 2]));
        assert!(frames.read(1).unwrap_err().to_string().ends_with("masks/2.png"));
    }

    #[test]
    fn a_bop_scene_without_visible_masks_has_whole_ones() {
        let folder = tempfile::tempdir().unwrap();
        for part in ["depth", "mask"] {
            create_dir_all(folder.path().join(part)).unwrap();
        }
        let at = |name: &str| folder.path().join(name);
        write(at("scene_camera.json"), "{\"000004\": {\"cam_K\": [10, 0, 1, 0, 10, 0.5, 0, 0, 1], \"depth_scale\": 1000}}").unwrap();
        // Metres in floating-point numbers, by the scene's scale.
        let metres: Vec<u8> = [0.5_f32, 0.5, 0.9, 0.9, 0.9, 2.0].iter().flat_map(|metres| metres.to_le_bytes()).collect();
        write(at("depth/000004.npy"), npy("<f4", &metres)).unwrap();
        write(at("mask/000004_000000.npy"), npy("|u1", &[1, 1, 0, 0, 0, 0])).unwrap();
        write(at("mask/000004_000001.npy"), npy("|u1", &[0, 1, 1, 1, 1, 0])).unwrap();
        write(at("mask/000004_000002.npy"), npy("|u1", &[0; 6])).unwrap();
        let frame = open(folder.path()).read(0).unwrap();
        assert_eq!((frame.frame().labels(), &frame.hidden[..]), (&[1, 1, 2, 2, 2, 0][..], &[3][..]));
        assert_eq!((frame.frame().depths()[5], frame.typical_depth_m, frame.metres_per_unit), (2.0, Some(f64::from(0.9_f32)), 1.0));
        let rectified = FolderOptions { is_rectified: true, ..FolderOptions::default() };
        let error = FrameFolder::open(folder.path(), rectified).unwrap().read(0).unwrap_err().to_string();
        assert!(error.contains("--rectified") && error.contains("--camera-info"), "{error}");
    }

    #[test]
    fn readings_out_of_range_and_codes_are_none_and_distances_become_depths() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        let units: Vec<u8> = [65535_u16, 9999, 100, 1000, 5000, 20000].iter().flat_map(|units| units.to_le_bytes()).collect();
        write(at("a_depth.npy"), npy("<u2", &units)).unwrap();
        write(at("a_depth.jpg"), b"a picture of it").unwrap();
        write(at("a_label.npy"), npy("|u1", &[1; 6])).unwrap();
        write(at("camera_info.yaml"), info(1)).unwrap();
        let options = FolderOptions { no_reading: vec![9999.0], range_m: [0.2, 10.0], ..FolderOptions::default() };
        let read = |options: FolderOptions| FrameFolder::open(folder.path(), options).unwrap().read(0).unwrap();
        assert_eq!(read(options.clone()).frame().depths(), [0.0, 0.0, 0.0, 1.0, 5.0, 0.0]);
        // Focal length 1 and centre (1, 0.5): the rays of the second row are (−1, ½, 1), (0, ½, 1), (1, ½, 1).
        let along = read(FolderOptions { depth_along: DepthAlong::Ray, ..options });
        let expected = [1.0 / 1.5, 5.0 / 1.25_f32.sqrt(), 0.0];
        // 20 m along the last ray are 13.3 m of depth: too far.
        assert!(along.frame().depths()[3..].iter().zip(expected).all(|(found, expected)| (found - expected).abs() < 1e-6));
    }
}
