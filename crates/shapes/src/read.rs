//! Reading a file as a shape or an observation, whatever its format.

use super::bytes::read_bytes;
use super::closing::{self, Close};
use super::content::Content;
use super::placing::Placing;
use super::resample::resample;
use super::voxelise::{Frame, fill_inside};
use super::{FormatError, Mesh, ReadError, Up, binvox_scale};
use super::{gltf, is_placed, longest_side, npy, obj, off, parse_binvox, ply, stl};
use beo_core::grid::{Dims, Observation, Occupancy};
use std::path::Path;

/// A file format of shapes, told by the extension.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Format {
    /// `.binvox`: run-length coded voxels.
    Binvox,
    /// `.npy`: a NumPy array of bool or u8.
    Npy,
    /// `.npz`: an archive with such an array.
    Npz,
    /// `.off`: ModelNet's and Princeton's meshes.
    Off,
    /// `.obj`: Wavefront meshes.
    Obj,
    /// `.stl`: triangles as CAD programs and scanners write them.
    Stl,
    /// `.ply`: Stanford's meshes and point clouds.
    Ply,
    /// `.glb`, `.gltf`: scenes of meshes, y up.
    Gltf,
}

impl Format {
    /// The extensions read, for messages.
    pub const KNOWN: &str = ".binvox, .npy, .npz, .off, .obj, .stl, .ply, .glb and .gltf";

    /// The format that the extension of `path` names, in whatever case.
    pub fn of(path: &Path) -> Option<Self> {
        Some(match path.extension()?.to_str()?.to_ascii_lowercase().as_str() {
            "binvox" => Self::Binvox,
            "npy" => Self::Npy,
            "npz" => Self::Npz,
            "off" => Self::Off,
            "obj" => Self::Obj,
            "stl" => Self::Stl,
            "ply" => Self::Ply,
            "glb" | "gltf" => Self::Gltf,
            _ => return None,
        })
    }

    /// Whether it holds voxels rather than meshes.
    pub fn is_voxels(self) -> bool {
        matches!(self, Self::Binvox | Self::Npy | Self::Npz)
    }
}

/// How files become shapes on a grid.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ReadOptions {
    /// Size of the grid, to which meshes are voxelised.
    pub dims: Dims,
    /// Where a shape comes to lie on the grid.
    pub placing: Placing,
    /// Which axis of the file points up; none for the one that its format names, y in glTF and in ShapeNet's files, z in all others.
    pub up: Option<Up>,
    /// How open meshes are filled.
    pub close: Close,
    /// Whether voxel files of another size are resampled. They are refused otherwise.
    pub resample: bool,
    /// Whether point clouds are read, as the voxels that hold a point. They are refused otherwise.
    pub point_clouds: bool,
}

impl ReadOptions {
    /// Shapes on a grid of `dims`, four fifths of it along the longest side, the upright axis that of the format; open meshes stay open, point
    /// clouds are read, voxel files of other sizes are not.
    pub fn new(dims: Dims) -> Self {
        let placing = Placing::LongestSide(longest_side(dims));
        Self { dims, placing, up: None, close: Close::Not, resample: false, point_clouds: true }
    }

    /// For meshes that `beo align` has placed.
    pub fn placed(self) -> Self {
        Self { placing: Placing::UnitCube, up: Some(Up::Z), ..self }
    }

    /// For one file: these, unless it lies in a folder that `beo align` has written.
    pub fn for_file(self, path: &Path) -> Result<Self, ReadError> {
        // DIR/<shape> or DIR/<class>/<split>/<shape>.
        for folder in [path.ancestors().nth(1), path.ancestors().nth(3)].into_iter().flatten() {
            let folder = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
            if is_placed(folder)? {
                return Ok(self.placed());
            }
        }
        Ok(self)
    }

    /// Voxels along the longest side of a shape; of those that were placed, on average.
    pub fn longest(&self) -> usize {
        match self.placing {
            Placing::LongestSide(longest) => longest,
            Placing::UnitCube => longest_side(self.dims),
        }
    }
}

/// The axis of a file that points up by its format or data set: y in glTF and in ShapeNet's meshes, z in all else.
pub fn usual_up(path: &Path) -> Up {
    let name = |n: usize| path.ancestors().nth(n).and_then(Path::file_name).and_then(|name| name.to_str());
    // Version 2 is SYNSET/MODEL/models/model_normalized.obj, version 1 SYNSET/MODEL/model.obj; a synset has eight digits.
    let is_synset = |name: &str| name.len() == 8 && name.bytes().all(|b| b.is_ascii_digit());
    let is_shapenet = name(0) == Some("model_normalized.obj") || name(0) == Some("model.obj") && name(2).is_some_and(is_synset);
    if Format::of(path) == Some(Format::Gltf) || is_shapenet { Up::Y } else { Up::Z }
}

/// Reads bytes of a known format, without voxelising.
///
/// # Errors
/// [`FormatError`]; of a glTF document also that its buffers lie in other files, which only [`read_content`] reads.
pub fn parse(format: Format, bytes: &[u8]) -> Result<Content, FormatError> {
    match format {
        Format::Binvox => parse_binvox(bytes).map(Content::Voxels),
        Format::Npy => npy::parse_npy(bytes).map(Content::Voxels),
        Format::Npz => npy::parse_npz(bytes).map(Content::Voxels),
        Format::Off => off::read_off(bytes),
        Format::Obj => obj::read_obj(bytes),
        Format::Stl => stl::read_stl(bytes),
        Format::Ply => ply::read_ply(bytes),
        Format::Gltf => gltf::parse_gltf(bytes).map(Content::Mesh),
    }
}

/// Something about a shape that was read all the same, and that its user should know.
#[derive(Debug, Clone, PartialEq)]
pub enum Note {
    /// The mesh is open, and its inside is missing.
    Open {
        /// Voxels that are missing, as a share of those that would be filled.
        missing: f64,
    },
    /// The mesh was open and has been closed.
    Closed {
        /// Voxels that were added, as a share of those that are filled.
        added: f64,
    },
    /// The file is a point cloud.
    PointCloud {
        /// Number of its points.
        points: usize,
    },
    /// Voxels of another size were resampled.
    Resampled {
        /// The file's size.
        from: Dims,
    },
    /// A binary STL file holds more triangles than its header says.
    Count(String),
}

/// How open meshes can be closed, for messages.
pub const HOW_TO_CLOSE: &str = "--close holes fills what rays find inside, --close hull all of the visual hull";

impl std::fmt::Display for Note {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Open { missing } => write!(
                f,
                "the mesh is open, and so hollow: {:.0} % of its voxels are inside but not enclosed; {HOW_TO_CLOSE}",
                100.0 * missing
            ),
            Self::Closed { added } => write!(f, "the mesh was open and has been closed: {:.0} % of its voxels were added", 100.0 * added),
            Self::PointCloud { points } => {
                write!(
                    f,
                    "a point cloud of {points} points: the voxels that hold one are filled, and what they enclose (--close hull fills more)"
                )
            }
            Self::Resampled { from } => write!(f, "resampled from {from} voxels"),
            Self::Count(text) => f.write_str(text),
        }
    }
}

/// A shape, and what should be known about it.
#[derive(Debug, Clone, PartialEq)]
pub struct Reading {
    /// The shape.
    pub object: Occupancy,
    /// In the order of reading.
    pub notes: Vec<Note>,
    /// Its lengths along the axes in the unit of the file: of meshes and point clouds those of their box, of binvox files by the header's
    /// `scale`; `None` for what has no unit.
    pub lengths: Option<[f64; 3]>,
}

/// Reads a file without voxelising, its axes as in the file; the buffers of a glTF document are read from its folder.
///
/// # Errors
/// [`ReadError`]: a file that cannot be opened, of an unknown kind, or malformed.
pub fn read_content(path: &Path) -> Result<Content, ReadError> {
    Ok(read_noted(path)?.0)
}

fn read_noted(path: &Path) -> Result<(Content, Vec<Note>, Option<f64>), ReadError> {
    let format = Format::of(path).ok_or_else(|| ReadError::Extension { path: path.into(), known: Format::KNOWN })?;
    let bytes = read_bytes(path)?;
    let content = match format {
        Format::Gltf => {
            let folder = path.parent().unwrap_or(Path::new(""));
            gltf::read_gltf(&bytes, &|name| read_bytes(&folder.join(name)).map_err(|error| error.to_string()))
        }
        format => parse(format, &bytes),
    };
    let content = content.map_err(|source| ReadError::Malformed { path: path.into(), source })?;
    let count = (format == Format::Stl).then(|| stl::stl_count_note(&bytes)).flatten();
    let scale = if format == Format::Binvox { binvox_scale(&bytes).ok().filter(|scale| *scale > 0.0) } else { None };
    Ok((content, count.map(Note::Count).into_iter().collect(), scale))
}

/// Reads a file as a complete shape. What [`read_shape_noted`] notes is left out.
///
/// # Errors
/// [`ReadError`]: as of [`read_shape_noted`].
pub fn read_shape(path: &Path, options: &ReadOptions) -> Result<Occupancy, ReadError> {
    Ok(read_shape_noted(path, options)?.object)
}

/// Reads a file as a complete shape, with what should be known about it.
///
/// # Errors
/// [`ReadError`]: a file that cannot be opened, of an unknown kind, or malformed; voxels of another size or a point cloud, unless the options
/// take them; a point cloud whose holes are to be closed.
pub fn read_shape_noted(path: &Path, options: &ReadOptions) -> Result<Reading, ReadError> {
    let (content, mut notes, scale) = read_noted(path)?;
    let up = options.up.unwrap_or_else(|| usual_up(path));
    let content = content.turned_up(up);
    let lengths = lengths_of(&content, scale, options);
    let object = match content {
        Content::Voxels(object) if object.dims() == options.dims => object,
        Content::Voxels(object) if options.resample => {
            notes.push(Note::Resampled { from: object.dims() });
            resample(&object, options.dims, options.placing).unwrap_or_else(|| Occupancy::empty(options.dims))
        }
        Content::Voxels(object) => {
            return Err(ReadError::OtherDims { path: path.into(), found: object.dims(), expected: options.dims });
        }
        Content::Mesh(mesh) => {
            let (object, note) = solid(&mesh, options);
            notes.extend(note);
            object
        }
        Content::Points(_) if options.close == Close::Holes => return Err(ReadError::NoSurface { path: path.into() }),
        Content::Points(cloud) if options.point_clouds => {
            notes.push(Note::PointCloud { points: cloud.points().len() });
            let mut object = frame(cloud.bounds(), options).points(&cloud);
            match options.close {
                Close::Hull => closing::fill_hull(&mut object),
                // Points that lie close enough enclose an inside without any closing.
                Close::Holes | Close::Not => fill_inside(&mut object),
            }
            object
        }
        Content::Points(cloud) => return Err(ReadError::PointCloud { path: path.into(), points: cloud.points().len() }),
    };
    Ok(Reading { object, notes, lengths })
}

/// The lengths of what was read, in the unit of its file; aligned shapes have been scaled to one cube and have none.
fn lengths_of(content: &Content, scale: Option<f64>, options: &ReadOptions) -> Option<[f64; 3]> {
    if options.placing == Placing::UnitCube {
        return None;
    }
    match content {
        Content::Voxels(object) => {
            let longest = <[usize; 3]>::from(object.dims()).into_iter().fold(1, usize::max) as f64;
            let [low, high] = object.bounds()?;
            scale.map(|scale| std::array::from_fn(|axis| (high[axis] - low[axis]) as f64 * scale / longest))
        }
        Content::Mesh(mesh) => Some((mesh.bounds()[1] - mesh.bounds()[0]).into()),
        Content::Points(cloud) => Some((cloud.bounds()[1] - cloud.bounds()[0]).into()),
    }
}

fn frame(bounds: [nalgebra::Point3<f64>; 2], options: &ReadOptions) -> Frame {
    match options.placing {
        Placing::LongestSide(longest) => Frame::fitted(bounds, options.dims, longest),
        Placing::UnitCube => Frame::unit_cube(options.dims),
    }
}

/// A mesh with its inside, and whether it is open.
fn solid(mesh: &Mesh, options: &ReadOptions) -> (Occupancy, Option<Note>) {
    let frame = frame(mesh.bounds(), options);
    let mut object = frame.surface(mesh);
    fill_inside(&mut object);
    let Some(missing) = closing::missing_inside(mesh, &frame, &object) else { return (object, None) };
    let before = object.count();
    match options.close {
        Close::Not => {
            let missing = missing.count_ones(..) as f64;
            (object, Some(Note::Open { missing: missing / (missing + before as f64) }))
        }
        Close::Holes | Close::Hull => {
            if options.close == Close::Hull {
                closing::fill_hull(&mut object);
            } else {
                let mut bits = object.bits().clone();
                bits.union_with(&missing);
                object = Occupancy::from_bits(options.dims, bits);
                fill_inside(&mut object);
            }
            let added = (object.count() - before) as f64 / object.count() as f64;
            (object, Some(Note::Closed { added }))
        }
    }
}

/// Reads an `.npy` or `.npz` file of u8 (0 empty, 1 filled, 255 unknown) as an observation, as it is, of whatever size.
///
/// # Errors
/// [`ReadError`]: another kind of file, or malformed; values of 0 and 255 alone, which are a picture's and not an observation's.
pub fn read_observation(path: &Path) -> Result<Observation, ReadError> {
    let parse = match Format::of(path) {
        Some(Format::Npy) => npy::parse_npy_observation,
        Some(Format::Npz) => npy::parse_npz_observation,
        _ => return Err(ReadError::Extension { path: path.into(), known: ".npy and .npz files of u8: 0 empty, 1 filled, 255 unknown" }),
    };
    let observation = parse(&read_bytes(path)?).map_err(|source| ReadError::Malformed { path: path.into(), source })?;
    let (known, filled) = (observation.known().count_ones(..), observation.filled().count_ones(..));
    if filled == 0 && known > 0 && known < observation.dims().voxels() {
        return Err(ReadError::NothingFilled { path: path.into() });
    }
    Ok(observation)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn extensions_are_told_in_any_case() {
        assert_eq!(Format::of(Path::new("a/b.OFF")), Some(Format::Off));
        assert_eq!(Format::of(Path::new("b.BinVox")), Some(Format::Binvox));
        assert_eq!(Format::of(Path::new("b.GLB")), Some(Format::Gltf));
        assert_eq!(Format::of(Path::new("b.off.txt")), None);
        assert_eq!(Format::of(Path::new("off")), None);
    }

    #[test]
    fn the_upright_axis_is_that_of_the_format_or_data_set() {
        for (path, up) in [
            ("a.glb", Up::Y),
            ("a.gltf", Up::Y),
            ("02691156/1a04/models/model_normalized.obj", Up::Y),
            ("02691156/1a04/model.obj", Up::Y),
            ("chairs/1a04/model.obj", Up::Z),
            ("model.obj", Up::Z),
            ("a.ply", Up::Z),
        ] {
            assert_eq!(usual_up(Path::new(path)), up, "{path}");
        }
    }

    #[test]
    fn errors_name_the_file_and_both_sizes() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.binvox");
        let mut bytes = Vec::new();
        super::super::write_binvox(&mut bytes, &Occupancy::empty(Dims::new(8, 9, 10).unwrap())).unwrap();
        std::fs::write(&path, &bytes).unwrap();
        let options = ReadOptions::new(Dims::cube(30).unwrap());
        let message = read_shape(&path, &options).unwrap_err().to_string();
        assert!(message.contains("a.binvox is a grid of 8×9×10 voxels where 30×30×30 are needed: --resample"), "{message}");
        let reading = read_shape_noted(&path, &ReadOptions { resample: true, ..options }).unwrap();
        assert_eq!((reading.object.count(), reading.notes[0].to_string().as_str()), (0, "resampled from 8×9×10 voxels"));

        std::fs::write(&path, b"#binvox 3\n").unwrap();
        assert!(read_shape(&path, &options).unwrap_err().to_string().contains("a.binvox: binvox, line 1: expected `#binvox 1`"));
        assert!(read_observation(&path).unwrap_err().to_string().contains("known are .npy and .npz files of u8"));
        assert!(read_shape(&folder.path().join("none.off"), &options).unwrap_err().to_string().starts_with("cannot read"));
        let directory = folder.path().join("directory.off");
        std::fs::create_dir(&directory).unwrap();
        assert!(matches!(read_shape(&directory, &options), Err(ReadError::NotAFile { .. })));
    }

    #[test]
    fn a_picture_is_no_observation() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.npy");
        let write = |codes: &dyn Fn(usize) -> u8| {
            let mut bytes = Vec::new();
            npy::write_npy_header::<u8>(&mut bytes, &[8, 8, 8]).unwrap();
            bytes.extend((0..512).map(codes));
            std::fs::write(&path, bytes).unwrap();
        };
        write(&|n| if n % 3 == 0 { 255 } else { 0 });
        let message = read_observation(&path).unwrap_err().to_string();
        assert!(message.contains("values 0 and 255 alone") && message.contains("(array > 0)"), "{message}");
        write(&|n| [0, 1, 255][n % 3]);
        assert!(read_observation(&path).is_ok());
        write(&|_| 255);
        assert!(read_observation(&path).is_ok());
    }
}
