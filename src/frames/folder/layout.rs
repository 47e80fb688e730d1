//! Which files of a folder are the frames: the layouts in the table of the module above. Nothing is read but names and a scene's cameras.

use super::error::FolderError;
use crate::frames::{SceneCamera, parse_scene_camera};
use beo_shapes::{ReadError, read_bytes};
use std::cmp::Ordering;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Where the parts of one frame are.
#[derive(Clone, Debug)]
pub(super) struct FrameFiles {
    pub(super) name: String,
    pub(super) depth: Result<PathBuf, PathBuf>,
    pub(super) labels: Labels,
    pub(super) camera: Camera,
}

#[derive(Clone, Debug)]
pub(super) enum Labels {
    Image(PathBuf),
    /// Label and mask of each instance.
    Masks(Vec<(u16, PathBuf)>),
    /// The file that was looked for.
    Missing(PathBuf),
}

#[derive(Clone, Debug)]
pub(super) enum Camera {
    /// The file, if it is there.
    Info(PathBuf),
    Scene(SceneCamera),
    /// The folder that has none.
    Missing(PathBuf),
    /// The scene's file, and the number of the image that it does not have.
    Unlisted(PathBuf, u32),
}

/// A kind of image, told by the extension.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    Png,
    Npy,
    Tiff,
    Jpeg,
}

impl Kind {
    pub(super) fn of(path: &Path) -> Option<Self> {
        Some(match path.extension()?.to_str()?.to_ascii_lowercase().as_str() {
            "png" => Self::Png,
            "npy" => Self::Npy,
            "tif" | "tiff" => Self::Tiff,
            "jpg" | "jpeg" => Self::Jpeg,
            _ => return None,
        })
    }
}

/// Names of a camera's file, in the order in which they are looked for, without those that Kalibr makes up.
const CAMERA_FILES: [&str; 9] = [
    "camera_info.yaml",
    "camera_info.yml",
    "camera_info.json",
    "cam_K.txt",
    "camera_intrinsic.json",
    "intrinsics.json",
    "intrinsics.yaml",
    "intrinsics.txt",
    "camchain.yaml",
];

/// Label of a mask that is alone in its frame.
const ONLY: u16 = 1;

/// The frames of a folder, sorted by name, numbers in names by their value.
pub(super) fn frames(folder: &Path) -> Result<Vec<FrameFiles>, FolderError> {
    let files = list(folder)?;
    let mut frames = if files.iter().any(|file| file == "scene_camera.json") {
        scene(folder)?
    } else if folder.join("depth").is_dir() {
        subfolders(folder, &files)?
    } else {
        flat(folder, &files)
    };
    frames.sort_by(|a, b| by_number(&a.name, &b.name));
    if frames.is_empty() { Err(FolderError::NoFrames { path: folder.into() }) } else { Ok(frames) }
}

/// The order of names in which digits that stand together count as a number: frame_9 comes before frame_10, as it was captured. Names that are
/// the same then, as 07 and 7, are in the order of their characters.
fn by_number(a: &str, b: &str) -> Ordering {
    let digits = |text: &str| text.len() - text.trim_start_matches(|c: char| c.is_ascii_digit()).len();
    let (mut rest_a, mut rest_b) = (a, b);
    while let (Some(next_a), Some(next_b)) = (rest_a.chars().next(), rest_b.chars().next()) {
        let lengths = [digits(rest_a), digits(rest_b)];
        let (order, taken) = if lengths[0] > 0 && lengths[1] > 0 {
            let [value_a, value_b] = [&rest_a[..lengths[0]], &rest_b[..lengths[1]]].map(|digits| digits.trim_start_matches('0'));
            (value_a.len().cmp(&value_b.len()).then_with(|| value_a.cmp(value_b)), lengths)
        } else {
            (next_a.cmp(&next_b), [next_a.len_utf8(), next_b.len_utf8()])
        };
        if order.is_ne() {
            return order;
        }
        (rest_a, rest_b) = (&rest_a[taken[0]..], &rest_b[taken[1]..]);
    }
    rest_a.len().cmp(&rest_b.len()).then_with(|| a.cmp(b))
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

/// Images in a folder by their stem, of several with one stem the one that is no JPEG; none if there is no such folder.
fn images(folder: &Path) -> Result<BTreeMap<String, PathBuf>, FolderError> {
    if !folder.is_dir() {
        return Ok(BTreeMap::new());
    }
    let mut images = BTreeMap::new();
    for name in list(folder)? {
        let path = folder.join(&name);
        if let (Some(_), Some(stem)) = (Kind::of(&path), path.file_stem().and_then(|stem| stem.to_str())) {
            keep_better(images.entry(stem.to_owned()).or_default(), path.clone());
        }
    }
    Ok(images.into_iter().filter_map(|(stem, path)| Some((stem, path?))).collect())
}

/// The first image that is no JPEG, or the first one.
fn keep_better(kept: &mut Option<PathBuf>, path: PathBuf) {
    if kept.as_deref().is_none_or(|kept| Kind::of(kept) == Some(Kind::Jpeg) && Kind::of(&path) != Some(Kind::Jpeg)) {
        *kept = Some(path);
    }
}

/// `NAME_depth.EXT` and its companions. A frame whose depth or labels are missing is one that cannot be read, not none.
fn flat(folder: &Path, files: &[String]) -> Vec<FrameFiles> {
    let mut parts: BTreeMap<&str, [Option<PathBuf>; 3]> = BTreeMap::new();
    for file in files {
        let path = folder.join(file);
        let Some((stem, _)) = file.rsplit_once('.').filter(|_| Kind::of(&path).is_some()) else { continue };
        let part = ["_depth", "_label", "_mask"].iter().enumerate().find_map(|(part, end)| Some((part, stem.strip_suffix(end)?)));
        if let Some((part, name)) = part {
            keep_better(&mut parts.entry(name).or_default()[part], path);
        }
    }
    let frame = |(name, [depth, label, mask]): (&str, [Option<PathBuf>; 3])| FrameFiles {
        name: name.to_owned(),
        depth: depth.ok_or_else(|| folder.join(format!("{name}_depth.png"))),
        labels: labels(label, mask, || folder.join(format!("{name}_label.png"))),
        camera: camera(folder, files, Some(name)),
    };
    parts.into_iter().map(frame).collect()
}

fn labels(label: Option<PathBuf>, mask: Option<PathBuf>, expected: impl FnOnce() -> PathBuf) -> Labels {
    match (label, mask) {
        (Some(label), _) => Labels::Image(label),
        (None, Some(mask)) => Labels::Masks(vec![(ONLY, mask)]),
        (None, None) => Labels::Missing(expected()),
    }
}

/// The first file of a camera that is there: of the frame of that name, or of all.
fn camera(folder: &Path, files: &[String], name: Option<&str>) -> Camera {
    let is_there = |file: &str| files.iter().any(|other| other == file);
    let own = name.into_iter().flat_map(|name| CAMERA_FILES[..3].iter().map(move |file| format!("{name}_{file}")));
    let common = CAMERA_FILES.iter().map(|file| (*file).to_owned());
    let is_kalibr = |file: &&String| file.contains("camchain") && (file.ends_with(".yaml") || file.ends_with(".yml"));
    match own.chain(common).find(|file| is_there(file)).or_else(|| files.iter().find(is_kalibr).cloned()) {
        Some(file) => Camera::Info(folder.join(file)),
        None => Camera::Missing(folder.into()),
    }
}

/// `depth/NAME.EXT` with `label/NAME.EXT`, `mask/NAME.EXT` or `masks/NAME.EXT`.
fn subfolders(folder: &Path, files: &[String]) -> Result<Vec<FrameFiles>, FolderError> {
    let mut depths = images(&folder.join("depth"))?;
    let mut label_images = images(&folder.join("label"))?;
    let mut masks = images(&folder.join("masks"))?;
    masks.append(&mut images(&folder.join("mask"))?);
    let camera = camera(folder, files, None);
    let mut names: Vec<String> = depths.keys().chain(label_images.keys()).chain(masks.keys()).cloned().collect();
    names.sort();
    names.dedup();
    let labelled = if folder.join("masks").is_dir() && !folder.join("label").is_dir() { "masks" } else { "label" };
    let frame = |name: String| FrameFiles {
        depth: depths.remove(&name).ok_or_else(|| folder.join(format!("depth/{name}.png"))),
        labels: labels(label_images.remove(&name), masks.remove(&name), || folder.join(format!("{labelled}/{name}.png"))),
        camera: camera.clone(),
        name,
    };
    Ok(names.into_iter().map(frame).collect())
}

/// `depth/000000.EXT` with `mask_visib/000000_000001.EXT` or, where there is no such folder, `mask/000000_000001.EXT`; and
/// `scene_camera.json`.
fn scene(folder: &Path) -> Result<Vec<FrameFiles>, FolderError> {
    let path = folder.join("scene_camera.json");
    let cameras = parse_scene_camera(&read_bytes(&path)?).map_err(|source| ReadError::Malformed { path: path.clone(), source })?;
    let masks_in = if folder.join("mask_visib").is_dir() { "mask_visib" } else { "mask" };
    let mut masks: BTreeMap<u32, Vec<(u16, PathBuf)>> = BTreeMap::new();
    for (stem, mask) in images(&folder.join(masks_in))? {
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
            None => Labels::Missing(folder.join(format!("{masks_in}/{name}_000000.png"))),
        },
        camera: cameras.get(&number).copied().map_or_else(|| Camera::Unlisted(path.clone(), number), Camera::Scene),
        name,
    };
    Ok(depths.into_iter().map(frame).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_in_names_count_by_their_value() {
        let sorted =
            ["1_1", "1_2", "1_10", "2_0", "10_0", "a", "a0", "a00", "a1", "a1b", "a01c", "a2", "frame_9", "frame_10", "frame_010x", "é1"];
        for (i, a) in sorted.iter().enumerate() {
            for (j, b) in sorted.iter().enumerate() {
                assert_eq!(by_number(a, b), i.cmp(&j), "{a} {b}");
            }
        }
    }
}
