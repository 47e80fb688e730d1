//! `beo generate`: a folder of made-up shapes to learn from.

use super::failure::{Failure, cannot_write};
use super::progress;
use beo_core::grid::Dims;
use beo_core::whole_file::write_whole;
use beo_shapes::{Mesh, UNITS_FILE, Units, furniture, household, longest_side, write_binvox_scaled};
use clap::{Args, ValueEnum};
use rayon::prelude::*;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

/// Make up shapes to learn from, DIR/<class>/train/* and DIR/<class>/test/*
///
/// Household things (bottle, bowl, box, can, cutlery_box, mug, plate) stand upright, with their long side along x and handles towards +x,
/// in metres, as DIR/units.txt says (`beo train --units folder` learns true sizes from it); furniture has the ten classes of ModelNet10. Train on them with `beo train DIR --out MODEL`.
#[derive(Args)]
pub struct Generate {
    /// The kind of shapes to make up
    #[arg(value_enum)]
    kind: Kind,
    /// Folder to write to
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Shapes of each class to learn from
    #[arg(long, default_value_t = 300, value_name = "N")]
    count: u32,
    /// Further shapes of each class to test with
    #[arg(long, default_value_t = 0, value_name = "N")]
    test: u32,
    /// Voxels along each side of the grid
    #[arg(long, default_value_t = 30, value_name = "N")]
    resolution: usize,
    /// Seed of the shapes: the same one makes the same shapes
    #[arg(long, default_value_t = 0)]
    seed: u32,
    /// How the shapes are written
    #[arg(long, value_enum, default_value_t = Format::Binvox)]
    format: Format,
}

/// A family of classes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Kind {
    /// Things that stand on tables
    Household,
    /// The classes of ModelNet10
    Furniture,
}

/// How a shape is written.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Format {
    /// Voxels, solid, the longest side 24 of 30
    Binvox,
    /// The mesh in metres, z up (household only)
    Ply,
}

/// Most shapes of a class and split.
const MOST: u32 = 100_000;

impl Generate {
    /// Runs the command.
    pub fn run(self) -> Result<(), Failure> {
        let dims = Dims::cube(self.resolution).map_err(|error| Failure::Usage(format!("--resolution {}: {error}", self.resolution)))?;
        for (flag, n) in [("--count", self.count), ("--test", self.test)] {
            if n > MOST {
                return Err(Failure::Usage(format!("{flag} {n}: use up to {MOST}")));
            }
        }
        if self.count == 0 && self.test == 0 {
            return Err(Failure::Usage("--count 0: nothing to make; use 1 or more".into()));
        }
        if (self.kind, self.format) == (Kind::Furniture, Format::Ply) {
            return Err(Failure::Usage("--format ply: furniture has no meshes; use --format binvox".into()));
        }
        let classes: &[&str] = match self.kind {
            Kind::Household => &household::CLASSES,
            Kind::Furniture => &furniture::CLASSES,
        };
        let extension = match self.format {
            Format::Binvox => "binvox",
            Format::Ply => "ply",
        };
        let mut files = Vec::new();
        for class in classes {
            for (split, count, first) in [("train", self.count, 0), ("test", self.test, MOST)] {
                if count == 0 {
                    continue;
                }
                let folder = self.out.join(class).join(split);
                require_empty(&folder)?;
                std::fs::create_dir_all(&folder).map_err(cannot_write(&folder))?;
                files.extend((0..count).map(|n| (*class, self.seed_of(first + n), folder.join(format!("{:05}.{extension}", n + 1)))));
            }
        }
        let bar = progress::bar(files.len(), "making shapes");
        files.par_iter().try_for_each(|(class, seed, path)| {
            let bytes = self.encoded(class, *seed, dims)?;
            write_whole(path, &bytes).map_err(cannot_write(path))?;
            bar.inc(1);
            Ok::<(), Failure>(())
        })?;
        bar.finish_and_clear();
        let units = if self.kind == Kind::Household { Units::Metres } else { Units::None };
        let path = self.out.join(UNITS_FILE);
        write_whole(&path, format!("{}\n", units.name()).as_bytes()).map_err(cannot_write(&path))?;
        say!("wrote {} shapes of {} classes to {}", files.len(), classes.len(), self.out.display());
        Ok(())
    }

    /// Shapes of different runs and splits have different seeds.
    fn seed_of(&self, n: u32) -> u64 {
        u64::from(self.seed) << 32 | u64::from(n)
    }

    fn encoded(&self, class: &str, seed: u64, dims: Dims) -> Result<Vec<u8>, Failure> {
        let mesh = || household::mesh(class, seed).expect("its own class");
        let (object, scale) = match (self.kind, self.format) {
            (Kind::Household, Format::Ply) => return Ok(ply(&mesh()).into_bytes()),
            (Kind::Household, Format::Binvox) => {
                let [low, high] = mesh().bounds();
                let longest = <[usize; 3]>::from(dims).into_iter().fold(1, usize::max) as f64;
                (household::make(class, dims, seed), (high - low).max() * longest / longest_side(dims) as f64)
            }
            (Kind::Furniture, _) => (furniture::make(class, dims, seed), 1.0),
        };
        let mut bytes = Vec::new();
        write_binvox_scaled(&mut bytes, &object.expect("its own class"), scale)?;
        Ok(bytes)
    }
}

/// Shapes of an earlier run would be learned from as well.
fn require_empty(folder: &Path) -> Result<(), Failure> {
    let is_empty = std::fs::read_dir(folder).map_or(true, |mut entries| entries.next().is_none());
    if is_empty { Ok(()) } else { Err(Failure::Failed(format!("{} is not empty: remove it or name another --out", folder.display()))) }
}

/// A mesh as PLY text.
fn ply(mesh: &Mesh) -> String {
    let mut text = format!(
        "ply\nformat ascii 1.0\ncomment metres, z up\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\n\
         element face {}\nproperty list uchar int vertex_indices\nend_header\n",
        mesh.vertices().len(),
        mesh.triangles().len()
    );
    for p in mesh.vertices() {
        let _ = writeln!(text, "{:.7} {:.7} {:.7}", p.x, p.y, p.z);
    }
    for [a, b, c] in mesh.triangles() {
        let _ = writeln!(text, "3 {a} {b} {c}");
    }
    text
}
