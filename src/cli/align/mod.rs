//! `beo align`: bring unaligned shapes to one pose, class by class.

mod figures;

use crate::cli::failure::{Failure, cannot_write};
use crate::cli::progress;
use crate::cli::shapes::UpArgument;
use beo_core::grid::{Dims, Occupancy, Rotation, to_xyzw};
use beo_core::whole_file::write_whole;
use beo_shapes::alignment::{self, AlignmentSettings, Congealed, ShapeSimilarity, Solid, grid_point};
use beo_shapes::library::{self, Library, ShapeFile};
use beo_shapes::{ALIGNMENT_FILE, AlignedClass, AlignedFile, Alignment, Content, Format, MeshError, ReadError, Up};
use beo_shapes::{read_content, usual_up, write_binvox, write_off};
use clap::Args;
use nalgebra::{Point3, Vector3};
use rayon::prelude::*;
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

/// Bring unaligned shapes to one pose, every class on its own: rotation, scale and place
///
/// Congealing (Learned-Miller 2006): shapes are turned, scaled and moved so that the entropy of their mean occupancy falls. They come to
/// lie in the unit cube about the origin, z up: the longest principal axis of the class along x, the shortest along z, the longest sides 0.8
/// on average. DIR is DIR/<class>/<split>/*, or DIR/* for one class named after the folder; the layout is kept. Meshes are written as .off,
/// voxel files as .binvox, and alignment.json says how each was placed; because of that file other commands take these meshes as they lie, at
/// any resolution: beo train OUT --out MODEL.
#[derive(Args)]
pub struct Align {
    /// Folder of shapes: .binvox, .npy, .npz, .off, .obj, .stl, .ply, .glb, .gltf
    dir: PathBuf,
    /// Folder to write to; it must be new or empty
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Turn shapes about the vertical only; for furniture and other things that stand
    #[arg(long)]
    keep_up: bool,
    /// The axis of shapes that points up, of meshes and voxel files [default: y for glTF and ShapeNet's files, else z]
    #[arg(long, value_enum)]
    up: Option<UpArgument>,
    /// Cells along the cube with which the shapes are compared
    #[arg(long, default_value_t = 40, value_name = "N")]
    resolution: usize,
    /// Seed of the choice of the shapes that the others of a large class are first laid to
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// Draw the mean and all shapes of each class, before and after, into this folder
    #[arg(long, value_name = "DIR")]
    png: Option<PathBuf>,
}

/// A shape of a class that is aligned.
struct Member<'a> {
    file: &'a ShapeFile,
    solid: Solid,
}

impl Align {
    /// Runs the command.
    pub fn run(self) -> Result<(), Failure> {
        if !(16..=120).contains(&self.resolution) {
            return Err(Failure::Usage(format!("--resolution {}: use 16 to 120", self.resolution)));
        }
        let splits = library::splits(&self.dir)?;
        let library = library::scan(&self.dir, &splits.iter().map(String::as_str).collect::<Vec<_>>())?;
        self.require_new()?;
        let members = self.read(&library)?;
        [Some(&self.out), self.png.as_ref()]
            .into_iter()
            .flatten()
            .try_for_each(|folder| std::fs::create_dir_all(folder).map_err(cannot_write(folder)))?;
        let settings = AlignmentSettings { resolution: self.resolution, keep_up: self.keep_up, seed: self.seed };
        let bar = progress::bar(100 * library.classes.len(), "aligning");
        let mut classes = BTreeMap::new();
        for (class, (name, members)) in library.classes.iter().zip(members).enumerate() {
            let (files, solids): (Vec<&ShapeFile>, Vec<Solid>) = members.into_iter().map(|member| (member.file, member.solid)).unzip();
            let found = alignment::congeal(&solids, &settings, |share| bar.set_position((100.0 * (class as f64 + share)) as u64));
            bar.suspend(|| {
                say!(
                    "{name}: {} shapes, entropy {:.1} bits as they came, {:.1} along principal axes, {:.1} aligned (of {}³ cells)",
                    solids.len(),
                    found.before.entropy,
                    found.normalised.entropy,
                    found.after.entropy,
                    self.resolution
                );
                Ok::<(), Failure>(())
            })?;
            if let Some(folder) = &self.png {
                let names: Vec<&str> = files.iter().map(|file| file.relative.rsplit('/').next().unwrap_or_default()).collect();
                figures::draw_means(name, &found, &settings)?.save(&folder.join(format!("{name}-mean.png")))?;
                figures::draw_shapes(name, &names, &solids, &found, &settings)?.save(&folder.join(format!("{name}-shapes.png")))?;
            }
            classes.insert(name.clone(), self.write_class(!splits.is_empty(), &files, &found)?);
        }
        bar.finish_and_clear();
        // Last, so that what was left half done is not taken for placed shapes.
        let path = self.out.join(ALIGNMENT_FILE);
        let text = serde_json::to_string_pretty(&Alignment::new(self.resolution, classes))?;
        write_whole(&path, (text + "\n").as_bytes()).map_err(cannot_write(&path))?;
        say!("wrote {} with {ALIGNMENT_FILE}", self.out.display());
        Ok(())
    }

    /// Nothing is overwritten, least of all what is read.
    fn require_new(&self) -> Result<(), Failure> {
        let refused = |why: &str| Err(Failure::Failed(format!("--out {}: {why}; name a new folder", self.out.display())));
        let Ok(metadata) = std::fs::metadata(&self.out) else { return Ok(()) };
        if !metadata.is_dir() {
            return refused("this is a file");
        }
        match (std::fs::canonicalize(&self.dir), std::fs::canonicalize(&self.out)) {
            (Ok(dir), Ok(out)) if dir == out => return refused("this is the folder of the shapes themselves"),
            _ => {}
        }
        let is_empty = std::fs::read_dir(&self.out).map_err(cannot_write(&self.out))?.next().is_none();
        if is_empty { Ok(()) } else { refused("it is not empty") }
    }

    /// The shapes of each class. What cannot be read is named on standard error.
    fn read<'a>(&self, library: &'a Library) -> Result<Vec<Vec<Member<'a>>>, Failure> {
        let bar = progress::bar(library.files.len(), "reading shapes");
        let read = |file: &'a ShapeFile| {
            let solid = self.content(file).map(|content| Solid::new(&content, self.resolution));
            bar.inc(1);
            match solid {
                Ok(Some(solid)) => Ok(Member { file, solid }),
                Ok(None) => Err(format!("{}: empty", file.relative)),
                Err(error) => Err(format!("{}: unreadable: {}", file.relative, error.without_path())),
            }
        };
        let all: Vec<Result<Member, String>> = library.files.par_iter().map(read).collect();
        bar.finish_and_clear();
        let mut classes: Vec<Vec<Member>> = library.classes.iter().map(|_| Vec::new()).collect();
        for member in all {
            match member {
                Ok(member) => classes[member.file.class].push(member),
                Err(skipped) => warn!("skipped {skipped}"),
            }
        }
        match library.classes.iter().zip(&classes).find(|(_, members)| members.len() < 2) {
            Some((name, members)) => {
                Err(Failure::Failed(format!("class `{name}` has {} usable shapes: at least 2 are needed to align them", members.len())))
            }
            None => Ok(classes),
        }
    }

    /// The axis of a file that points up.
    fn up_of(&self, file: &ShapeFile) -> Up {
        self.up.map_or_else(|| usual_up(&file.path), UpArgument::up)
    }

    /// The content of a file, with z up.
    fn content(&self, file: &ShapeFile) -> Result<Content, ReadError> {
        match read_content(&file.path)? {
            Content::Points(cloud) => {
                let source = MeshError::PointCloud(cloud.points().len()).into();
                Err(ReadError::Malformed { path: file.path.clone(), source })
            }
            content => Ok(content.turned_up(self.up_of(file))),
        }
    }

    /// Writes the shapes of a class, and says where.
    fn write_class(&self, has_splits: bool, files: &[&ShapeFile], found: &Congealed) -> Result<AlignedClass, Failure> {
        let inside = |file: &ShapeFile| match has_splits {
            true => file.relative.clone(),
            // Flat: without the class, which is the folder.
            false => file.relative.split_once('/').map_or(file.relative.clone(), |(_, name)| name.to_owned()),
        };
        let mut taken = BTreeSet::new();
        let outputs: Vec<String> = files.iter().map(|file| output_name(&inside(file), &mut taken)).collect();
        let write = |((file, output), placement): ((&&ShapeFile, &String), &ShapeSimilarity)| {
            let path = self.out.join(output);
            let content = self.content(file)?;
            let turned = self.up_of(file) == Up::Y;
            let bytes = match content {
                Content::Mesh(mesh) => {
                    let mut bytes = Vec::new();
                    write_off(&mut bytes, &mesh.mapped(|point| placement.place(point))?)?;
                    bytes
                }
                Content::Points(_) => return Err(Failure::Failed(format!("{}: a point cloud cannot be aligned", file.relative))),
                Content::Voxels(object) => {
                    let mut bytes = Vec::new();
                    write_binvox(&mut bytes, &resampled(&object, placement)?)?;
                    bytes
                }
            };
            if let Some(parent) = path.parent() {
                std::fs::create_dir_all(parent).map_err(cannot_write(parent))?;
            }
            write_whole(&path, &bytes).map_err(cannot_write(&path))?;
            // From the file's own coordinates.
            let up = if turned { Rotation::from_axis_angle(&Vector3::x_axis(), std::f64::consts::FRAC_PI_2) } else { Rotation::identity() };
            Ok(AlignedFile {
                input: inside(file),
                output: output.clone(),
                rotation_xyzw: to_xyzw(&(placement.rotation * up)),
                scale: placement.scale,
                translation: placement.translation.into(),
            })
        };
        let placed: Vec<_> = files.iter().zip(&outputs).zip(&found.after.placements).collect();
        let files = placed.into_par_iter().map(write).collect::<Result<Vec<AlignedFile>, Failure>>()?;
        Ok(AlignedClass {
            entropy_before: found.before.entropy,
            entropy_normalised: found.normalised.entropy,
            entropy_after: found.after.entropy,
            files,
        })
    }
}

/// The name with the extension of what is written; where two files would get one name, the later keeps its own before it.
fn output_name(input: &str, taken: &mut BTreeSet<String>) -> String {
    let extension = match Format::of(Path::new(input)) {
        Some(format) if format.is_voxels() => "binvox",
        _ => "off",
    };
    let stem = input.rsplit_once('.').map_or(input, |(stem, _)| stem);
    let mut name = format!("{stem}.{extension}");
    if taken.contains(&name) {
        name = format!("{input}.{extension}");
    }
    taken.insert(name.clone());
    name
}

/// Voxels as they lie in the unit cube, on a cube of as many voxels as the longest side had: filled where at least half of the eight points in a
/// voxel come from filled ones.
fn resampled(object: &Occupancy, placement: &ShapeSimilarity) -> Result<Occupancy, Failure> {
    let dims = object.dims();
    let side = dims.x().max(dims.y()).max(dims.z());
    let to = Dims::cube(side)?;
    let origin = grid_point(dims, [0.0; 3]);
    let is_filled = |point: Point3<f64>| {
        let at = (placement.place_back(&point) - origin) * side as f64;
        at.min() >= 0.0 && object.is_filled(at.x as usize, at.y as usize, at.z as usize)
    };
    let points = |i: usize, j: usize, k: usize| {
        (0..8_usize).map(move |corner| {
            let at = |axis: usize, at: usize| at as f64 + if corner >> axis & 1 == 1 { 0.75 } else { 0.25 };
            grid_point(to, [at(0, i), at(1, j), at(2, k)])
        })
    };
    Ok(Occupancy::from_fn(to, |i, j, k| points(i, j, k).filter(|point| is_filled(*point)).count() >= 4))
}
