//! Reading a file as a shape or an observation, whatever its format.

use super::{
    FormatError, Mesh, ReadError, Up, binvox_scale, parse_binvox, parse_npy, parse_npy_observation, parse_obj, parse_off, parse_ply,
    parse_stl,
};
use super::{is_placed, longest_side, voxelise, voxelise_unit_cube};
use beo_core::grid::{Dims, Observation, Occupancy};
use std::io::Read;
use std::path::Path;

/// Largest file that is read.
const LARGEST: u64 = 1 << 30;

/// A file format of shapes, told by the extension.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Format {
    /// `.binvox`: run-length coded voxels.
    Binvox,
    /// `.npy`: a NumPy array of bool or u8.
    Npy,
    /// `.off`: ModelNet's and Princeton's meshes.
    Off,
    /// `.obj`: Wavefront meshes.
    Obj,
    /// `.stl`: triangles as CAD programs and scanners write them.
    Stl,
    /// `.ply`: Stanford's meshes.
    Ply,
}

impl Format {
    /// The extensions read, for messages.
    pub const KNOWN: &str = ".binvox, .npy, .off, .obj, .stl and .ply";

    /// The format that the extension of `path` names, in whatever case.
    pub fn of(path: &Path) -> Option<Self> {
        Some(match path.extension()?.to_str()?.to_ascii_lowercase().as_str() {
            "binvox" => Self::Binvox,
            "npy" => Self::Npy,
            "off" => Self::Off,
            "obj" => Self::Obj,
            "stl" => Self::Stl,
            "ply" => Self::Ply,
            _ => return None,
        })
    }
}

/// How files become shapes on a grid.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ReadOptions {
    /// Size of the grid. Voxel files must have it, meshes are voxelised to it.
    pub dims: Dims,
    /// Where a mesh comes to lie on the grid.
    pub placing: Placing,
    /// Which axis of a mesh points up. Voxel files have z up.
    pub up: Up,
}

/// Where a mesh comes to lie on the grid.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Placing {
    /// Its bounding box in the middle, so many voxels along the longest side; 24 on a grid of 30. Use this for meshes from anywhere.
    LongestSide(usize),
    /// As it lies in the unit cube about the origin, of which the grid is a picture. Use this for what has been aligned, whose sizes and places
    /// are meant.
    UnitCube,
}

impl ReadOptions {
    /// Shapes on a grid of `dims`, four fifths of it along the longest side, z up.
    pub fn new(dims: Dims) -> Self {
        Self { dims, placing: Placing::LongestSide(longest_side(dims)), up: Up::Z }
    }

    /// For meshes that `beo align` has placed.
    pub fn placed(self) -> Self {
        Self { placing: Placing::UnitCube, up: Up::Z, ..self }
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

/// What a file of a given format holds.
#[derive(Debug, Clone, PartialEq)]
pub enum Content {
    /// Voxels.
    Voxels(Occupancy),
    /// A mesh, its axes as in the file.
    Mesh(Mesh),
}

/// Reads bytes of a known format, without voxelising.
pub fn parse(format: Format, bytes: &[u8]) -> Result<Content, FormatError> {
    match format {
        Format::Binvox => parse_binvox(bytes).map(Content::Voxels),
        Format::Npy => parse_npy(bytes).map(Content::Voxels),
        Format::Off => parse_off(bytes).map(Content::Mesh),
        Format::Obj => parse_obj(bytes).map(Content::Mesh),
        Format::Stl => parse_stl(bytes).map(Content::Mesh),
        Format::Ply => parse_ply(bytes).map(Content::Mesh),
    }
}

/// Reads a file as a complete shape.
pub fn read_shape(path: &Path, options: &ReadOptions) -> Result<Occupancy, ReadError> {
    read_sized_shape(path, options).map(|(object, _)| object)
}

/// Reads a file as a complete shape, and its lengths along the axes in the unit of the file: of meshes those of their box, of binvox files
/// by the header's `scale`; `None` for what has no unit.
pub fn read_sized_shape(path: &Path, options: &ReadOptions) -> Result<(Occupancy, Option<[f64; 3]>), ReadError> {
    let format = Format::of(path).ok_or_else(|| ReadError::Extension { path: path.into(), known: Format::KNOWN })?;
    let bytes = read_bytes(path)?;
    match parse(format, &bytes) {
        Ok(Content::Voxels(object)) if object.dims() == options.dims => {
            let scale = if format == Format::Binvox { binvox_scale(&bytes).ok().filter(|scale| *scale > 0.0) } else { None };
            let lengths = scale.zip(object.bounds()).map(|(scale, [low, high])| {
                let longest = <[usize; 3]>::from(object.dims()).into_iter().fold(1, usize::max) as f64;
                std::array::from_fn(|axis| (high[axis] - low[axis]) as f64 * scale / longest)
            });
            Ok((object, lengths))
        }
        Ok(Content::Voxels(object)) => Err(ReadError::OtherDims { path: path.into(), found: object.dims(), expected: options.dims }),
        Ok(Content::Mesh(mesh)) => {
            let mesh = mesh.turned_up(options.up);
            let [low, high] = mesh.bounds();
            let lengths = (high - low).into();
            Ok(match options.placing {
                Placing::LongestSide(longest) => (voxelise(&mesh, options.dims, longest), Some(lengths)),
                // Aligned shapes have been scaled to one cube.
                Placing::UnitCube => (voxelise_unit_cube(&mesh, options.dims), None),
            })
        }
        Err(source) => Err(ReadError::Malformed { path: path.into(), source }),
    }
}

/// Reads an `.npy` file of u8 (0 empty, 1 filled, 255 unknown) as an observation, as it is, of whatever size.
pub fn read_observation(path: &Path) -> Result<Observation, ReadError> {
    if Format::of(path) != Some(Format::Npy) {
        return Err(ReadError::Extension { path: path.into(), known: ".npy files of u8: 0 empty, 1 filled, 255 unknown" });
    }
    parse_npy_observation(&read_bytes(path)?).map_err(|source| ReadError::Malformed { path: path.into(), source })
}

/// The content of a file that is not too large.
pub fn read_bytes(path: &Path) -> Result<Vec<u8>, ReadError> {
    let open = |source| ReadError::Open { path: path.into(), source };
    // Asked before opening: opening a pipe waits for its writer.
    let metadata = std::fs::metadata(path).map_err(open)?;
    if !metadata.is_file() {
        return Err(ReadError::NotAFile { path: path.into() });
    }
    let too_large = |bytes| ReadError::TooLarge { path: path.into(), bytes, limit: LARGEST };
    if metadata.len() > LARGEST {
        return Err(too_large(metadata.len()));
    }
    let mut bytes = Vec::with_capacity(metadata.len() as usize);
    std::fs::File::open(path).and_then(|file| file.take(LARGEST + 1).read_to_end(&mut bytes)).map_err(open)?;
    if bytes.len() as u64 > LARGEST { Err(too_large(bytes.len() as u64)) } else { Ok(bytes) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn extensions_are_told_in_any_case() {
        assert_eq!(Format::of(Path::new("a/b.OFF")), Some(Format::Off));
        assert_eq!(Format::of(Path::new("b.BinVox")), Some(Format::Binvox));
        assert_eq!(Format::of(Path::new("b.off.txt")), None);
        assert_eq!(Format::of(Path::new("off")), None);
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
        assert!(message.contains("a.binvox is a grid of 8×9×10 voxels where 30×30×30 are needed"), "{message}");

        std::fs::write(&path, b"#binvox 3\n").unwrap();
        assert!(read_shape(&path, &options).unwrap_err().to_string().ends_with("a.binvox: binvox, line 1: expected `#binvox 1`"));
        assert!(read_observation(&path).unwrap_err().to_string().contains("known are .npy files of u8"));
        assert!(read_shape(&folder.path().join("none.off"), &options).unwrap_err().to_string().starts_with("cannot read"));
        let directory = folder.path().join("directory.off");
        std::fs::create_dir(&directory).unwrap();
        assert!(matches!(read_shape(&directory, &options), Err(ReadError::NotAFile { .. })));
    }
}
