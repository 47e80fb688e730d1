//! The frames of a folder, in any of three layouts:
//!
//! | layout | depth | labels | camera |
//! | --- | --- | --- | --- |
//! | flat | `NAME_depth.EXT` | `NAME_label.EXT` or `NAME_mask.EXT` | `NAME_camera_info.yaml` or `camera_info.yaml` |
//! | subfolders | `depth/NAME.EXT` | `label/NAME.EXT` or `mask/NAME.EXT` | `camera_info.yaml` |
//! | BOP scene | `depth/000000.EXT` | `mask_visib/000000_000001.EXT`, one mask for each instance | `scene_camera.json` |
//!
//! `EXT` is `png`, `npy`, `tif` or `tiff`. The label of an instance of a BOP scene is its number plus 1.

use super::{CameraInfo, CapturedFrame, Image, Raster, SceneCamera, SizeError};
use super::{parse_camera_info, parse_npy_image, parse_png_image, parse_scene_camera, parse_tiff_image};
use beo_camera::IntrinsicsError;
use beo_shapes::{FormatError, ReadError, read_bytes};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Metres per unit of depth images of whole numbers, where nothing else is said: millimetres.
pub const MILLIMETRE: f64 = 0.001;

/// What a folder does not say itself.
#[derive(Clone, Debug, Default)]
pub struct FolderOptions {
    /// Metres per unit of depth images of whole numbers; otherwise what the scene says, or [`MILLIMETRE`].
    pub metres_per_unit: Option<f64>,
    /// A `camera_info` YAML in place of the folder's.
    pub camera_info: Option<PathBuf>,
}

/// The frames of a folder, sorted by name.
#[derive(Clone, Debug)]
pub struct FrameFolder {
    frames: Vec<FrameFiles>,
    options: FolderOptions,
}

/// A folder or a frame of it cannot be read. One line, with the name of what is wrong.
#[derive(Debug, thiserror::Error)]
pub enum FolderError {
    /// The folder cannot be listed.
    #[error("cannot list {}: {source}", path.display())]
    List {
        /// The folder.
        path: PathBuf,
        /// What the operating system said.
        source: std::io::Error,
    },
    /// There is no frame in it.
    #[error(
        "no frames in {}: expected NAME_depth.png with NAME_label.png or NAME_mask.png, or folders depth and label or mask, or a BOP scene",
        path.display()
    )]
    NoFrames {
        /// The folder.
        path: PathBuf,
    },
    /// A frame lacks something.
    #[error("there is no {}", expected.display())]
    Missing {
        /// What was looked for.
        expected: PathBuf,
    },
    /// The scene does not describe the camera of an image.
    #[error("there is no camera for image {image} in {}", path.display())]
    NoCamera {
        /// The scene's file.
        path: PathBuf,
        /// The image's number.
        image: u32,
    },
    /// A file of the frame cannot be read.
    #[error(transparent)]
    Read(#[from] ReadError),
    /// Images and camera do not fit together.
    #[error(transparent)]
    Size(#[from] SizeError),
    /// The camera is none for these images.
    #[error(transparent)]
    Camera(#[from] IntrinsicsError),
}

/// Where the parts of one frame are.
#[derive(Clone, Debug)]
struct FrameFiles {
    name: String,
    depth: Result<PathBuf, PathBuf>,
    labels: Labels,
    camera: Camera,
}

#[derive(Clone, Debug)]
enum Labels {
    Image(PathBuf),
    /// Label and mask of each instance.
    Masks(Vec<(u16, PathBuf)>),
    /// What was looked for.
    Missing(PathBuf),
}

#[derive(Clone, Debug)]
enum Camera {
    /// The file, if it is there.
    Info(PathBuf),
    Scene(SceneCamera),
    /// What was looked for.
    Missing(PathBuf),
    /// The scene's file, and the number of the image that it does not have.
    Unlisted(PathBuf, u32),
}

impl FrameFolder {
    /// Finds the frames of a folder. What is wrong with a single one comes up when it is read.
    ///
    /// # Errors
    /// [`FolderError`]: a folder that cannot be listed or has no frames, a `scene_camera.json` that cannot be read.
    pub fn open(folder: &Path, options: FolderOptions) -> Result<Self, FolderError> {
        let files = list(folder)?;
        let is_there = |name: &str| files.iter().any(|file| file == name);
        let frames = if is_there("scene_camera.json") {
            scene(folder)?
        } else if folder.join("depth").is_dir() {
            subfolders(folder)?
        } else {
            flat(folder, &files)
        };
        if frames.is_empty() {
            return Err(FolderError::NoFrames { path: folder.into() });
        }
        Ok(Self { frames, options })
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
            (Some(unit), _) => unit,
            (None, Camera::Scene(scene)) => scene.metres_per_unit,
            (None, _) => MILLIMETRE,
        };
        let depth = read_image(depth, |raster| raster.into_depth(unit))?;
        let labels = labels.read(depth.size())?;
        let (info, camera_to_world) = match (&self.options.camera_info, camera) {
            (Some(path), Camera::Scene(scene)) => (read_info(path)?, scene.camera_to_world),
            (Some(path), _) | (None, Camera::Info(path)) => (read_info(path)?, None),
            (None, Camera::Unlisted(path, image)) => return Err(FolderError::NoCamera { path: path.clone(), image: *image }),
            (None, Camera::Missing(expected)) => return Err(FolderError::Missing { expected: expected.clone() }),
            (None, Camera::Scene(scene)) => {
                let [width, height] = depth.size();
                (CameraInfo { intrinsics: scene.intrinsics(width, height)?, frame_id: None }, scene.camera_to_world)
            }
        };
        let mut captured = CapturedFrame::new(name.clone(), info.intrinsics, depth, labels)?;
        (captured.camera_to_world, captured.frame_id) = (camera_to_world, info.frame_id);
        Ok(captured)
    }
}

impl Labels {
    fn read(&self, size: [u32; 2]) -> Result<Image<u16>, FolderError> {
        match self {
            Self::Image(path) => Ok(read_image(path, Raster::into_labels)?),
            Self::Missing(expected) => Err(FolderError::Missing { expected: expected.clone() }),
            Self::Masks(masks) => {
                let mut labels = vec![0; size[0] as usize * size[1] as usize];
                for (label, path) in masks {
                    let mask = read_image(path, Raster::into_labels)?;
                    if mask.size() != size {
                        return Err(SizeError { what: "mask", found: mask.size(), camera: size }.into());
                    }
                    labels.iter_mut().zip(mask.values()).filter(|(_, inside)| **inside != 0).for_each(|(pixel, _)| *pixel = *label);
                }
                Ok(Image::new(size[0], size[1], labels).expect("one label for each pixel"))
            }
        }
    }
}

/// Reads an image by its extension.
fn read_image<T>(path: &Path, convert: impl Fn(Raster) -> Result<T, FormatError>) -> Result<T, ReadError> {
    let parse = match Kind::of(path) {
        Some(Kind::Png) => parse_png_image,
        Some(Kind::Npy) => parse_npy_image,
        Some(Kind::Tiff) => parse_tiff_image,
        None => return Err(ReadError::Extension { path: path.into(), known: ".png, .npy, .tif and .tiff" }),
    };
    parse(&read_bytes(path)?).and_then(convert).map_err(|source| ReadError::Malformed { path: path.into(), source })
}

fn read_info(path: &Path) -> Result<CameraInfo, ReadError> {
    parse_camera_info(&read_bytes(path)?).map_err(|source| ReadError::Malformed { path: path.into(), source })
}

/// A kind of image, told by the extension.
enum Kind {
    Png,
    Npy,
    Tiff,
}

impl Kind {
    fn of(path: &Path) -> Option<Self> {
        Some(match path.extension()?.to_str()?.to_ascii_lowercase().as_str() {
            "png" => Self::Png,
            "npy" => Self::Npy,
            "tif" | "tiff" => Self::Tiff,
            _ => return None,
        })
    }
}

/// Names in a folder, sorted. Those that are no text are none of ours.
fn list(folder: &Path) -> Result<Vec<String>, FolderError> {
    let failed = |source| FolderError::List { path: folder.into(), source };
    let mut names = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(failed)? {
        names.extend(entry.map_err(failed)?.file_name().into_string());
    }
    names.sort();
    Ok(names)
}

/// Images in a folder by their stem; none if there is no such folder.
fn images(folder: &Path) -> Result<BTreeMap<String, PathBuf>, FolderError> {
    if !folder.is_dir() {
        return Ok(BTreeMap::new());
    }
    let mut images = BTreeMap::new();
    for name in list(folder)? {
        let path = folder.join(&name);
        if let (Some(_), Some(stem)) = (Kind::of(&path), path.file_stem().and_then(|stem| stem.to_str())) {
            images.insert(stem.to_owned(), path.clone());
        }
    }
    Ok(images)
}

/// `NAME_depth.EXT` and its companions. A frame whose depth or labels are missing is one that cannot be read, not none.
fn flat(folder: &Path, files: &[String]) -> Vec<FrameFiles> {
    let mut parts: BTreeMap<&str, [Option<PathBuf>; 3]> = BTreeMap::new();
    for file in files {
        let path = folder.join(file);
        let Some((stem, _)) = file.rsplit_once('.').filter(|_| Kind::of(&path).is_some()) else { continue };
        let part = ["_depth", "_label", "_mask"].iter().enumerate().find_map(|(part, end)| Some((part, stem.strip_suffix(end)?)));
        if let Some((part, name)) = part {
            parts.entry(name).or_default()[part].get_or_insert(path);
        }
    }
    let frame = |(name, [depth, label, mask]): (&str, [Option<PathBuf>; 3])| FrameFiles {
        name: name.to_owned(),
        depth: depth.ok_or_else(|| folder.join(format!("{name}_depth.png"))),
        labels: label.or(mask).map_or_else(|| Labels::Missing(folder.join(format!("{name}_label.png"))), Labels::Image),
        camera: camera_info(folder, &[&format!("{name}_camera_info"), "camera_info"]),
    };
    parts.into_iter().map(frame).collect()
}

/// The first of these files that is there.
fn camera_info(folder: &Path, stems: &[&str]) -> Camera {
    let candidates = stems.iter().flat_map(|stem| ["yaml", "yml"].map(|end| folder.join(format!("{stem}.{end}"))));
    match candidates.into_iter().find(|path| path.is_file()) {
        Some(path) => Camera::Info(path),
        None => Camera::Missing(folder.join("camera_info.yaml")),
    }
}

/// `depth/NAME.EXT` with `label/NAME.EXT` or `mask/NAME.EXT`.
fn subfolders(folder: &Path) -> Result<Vec<FrameFiles>, FolderError> {
    let mut depths = images(&folder.join("depth"))?;
    let mut labels = images(&folder.join("mask"))?;
    labels.append(&mut images(&folder.join("label"))?);
    let camera = camera_info(folder, &["camera_info"]);
    let mut names: Vec<String> = depths.keys().chain(labels.keys()).cloned().collect();
    names.sort();
    names.dedup();
    let frame = |name: String| FrameFiles {
        depth: depths.remove(&name).ok_or_else(|| folder.join(format!("depth/{name}.png"))),
        labels: labels.remove(&name).map_or_else(|| Labels::Missing(folder.join(format!("label/{name}.png"))), Labels::Image),
        camera: camera.clone(),
        name,
    };
    Ok(names.into_iter().map(frame).collect())
}

/// `depth/000000.EXT` with `mask_visib/000000_000001.EXT` and `scene_camera.json`.
fn scene(folder: &Path) -> Result<Vec<FrameFiles>, FolderError> {
    let path = folder.join("scene_camera.json");
    let cameras = parse_scene_camera(&read_bytes(&path)?).map_err(|source| ReadError::Malformed { path: path.clone(), source })?;
    let mut masks: BTreeMap<u32, Vec<(u16, PathBuf)>> = BTreeMap::new();
    for (stem, mask) in images(&folder.join("mask_visib"))? {
        let numbers = stem.split_once('_').and_then(|(image, instance)| Some((image.parse().ok()?, instance.parse::<u16>().ok()?)));
        if let Some((image, instance)) = numbers
            && let Some(label) = instance.checked_add(1)
        {
            masks.entry(image).or_default().push((label, mask));
        }
    }
    let mut depths: BTreeMap<u32, (String, PathBuf)> = BTreeMap::new();
    for (stem, path) in images(&folder.join("depth"))? {
        if let Ok(number) = stem.parse() {
            depths.insert(number, (stem, path));
        }
    }
    let frame = |(number, (name, depth)): (u32, (String, PathBuf))| FrameFiles {
        depth: Ok(depth),
        labels: match masks.remove(&number) {
            Some(masks) => Labels::Masks(masks),
            None => Labels::Missing(folder.join(format!("mask_visib/{name}_000000.png"))),
        },
        camera: cameras.get(&number).copied().map_or_else(|| Camera::Unlisted(path.clone(), number), Camera::Scene),
        name,
    };
    Ok(depths.into_iter().map(frame).collect())
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
        assert_eq!((b.frame().labels(), b.frame().intrinsics().focal()), (&[255; 6][..], [20.0; 2]));
        assert_eq!(a.frame().intrinsics().focal(), [10.0; 2]);
        for (frame, part) in [(2, "c_label.npy: npy: does not start"), (3, "no "), (3, "d_label.png"), (4, "e_depth.png")] {
            let message = frames.read(frame).unwrap_err().to_string();
            assert!(message.contains(part), "{message}");
        }
        write(at("other.yaml"), info(30)).unwrap();
        let options = FolderOptions { metres_per_unit: Some(1e-4), camera_info: Some(at("other.yaml")) };
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
        assert_eq!([frames.name(0), frames.name(1)], ["10", "2"]);
        assert!(frames.read(0).unwrap_err().to_string().ends_with("camera_info.yaml"));
        write(at("camera_info.yaml"), info(10)).unwrap();
        let frames = open(folder.path());
        assert_eq!(frames.read(0).unwrap().frame().depths(), [0.25; 6]);
        assert_eq!(frames.read(1).unwrap().frame().labels(), [1; 6]);
        write(at("camera_info.yaml"), info(10).replace("width: 3\nheight: 2", "width: 2\nheight: 3")).unwrap();
        assert_eq!(frames.read(0).unwrap_err().to_string(), "the depth image has 3 × 2 pixels, the camera 2 × 3");
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
        assert!(frames.read(1).unwrap().camera_to_world.is_none());
        assert!(frames.read(2).unwrap_err().to_string().starts_with("there is no camera for image 2 in"));
        write(at("mask_visib/000001_000000.npy"), npy("|u1", &[0; 6]).replace_shape("(2, 3)", "(3, 2)")).unwrap();
        assert_eq!(frames.read(1).unwrap_err().to_string(), "the mask image has 2 × 3 pixels, the camera 3 × 2");
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
}
