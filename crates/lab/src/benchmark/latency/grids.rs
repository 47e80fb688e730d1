//! The grids that are sent: views from above of some shapes in some rotations, made before the measurement.

use super::Pose;
use crate::evaluation::rotations::draw_rotation;
use beo_core::grid::{Dims, Occupancy, Rotation, Turn, View, yaw};
use beo_core::perception::PoseSearch;
use beo_shapes::furniture;
use std::io::{Read, Write};

/// Rotations in which each shape is seen where the pose is searched.
const TURNS: usize = 12;
/// Frames of a full turn where it is tracked: three degrees each.
const TRACKED: usize = 120;

/// Grids as they are sent, one byte per voxel.
pub struct Grids {
    voxels: usize,
    shapes: usize,
    /// `[shape][turn]`.
    bytes: Vec<u8>,
}

impl Grids {
    /// One made-up piece of furniture of each class.
    pub fn furniture(dims: Dims) -> Vec<Occupancy> {
        furniture::CLASSES.iter().filter_map(|class| furniture::make(class, dims, 1)).collect()
    }

    /// Views of `shapes`, all of one size, turned as `pose` says.
    pub fn new(shapes: &[Occupancy], pose: Pose) -> Self {
        let voxels = shapes.first().map_or(0, |shape| shape.dims().voxels());
        let mut bytes = vec![0; voxels * shapes.len() * turns(pose)];
        let places = bytes.chunks_mut(voxels.max(1));
        for (place, bytes) in places.enumerate() {
            let (shape, turn) = (&shapes[place / turns(pose)], place % turns(pose));
            let turned = Turn::new(shape.dims(), &rotation(pose, turn, place)).occupancy(shape);
            View::Top.of(&turned).write(bytes);
        }
        Self { voxels, shapes: shapes.len(), bytes }
    }

    /// The grid of object `object` in frame `frame`: always the same shape where it is tracked, else one after the other.
    pub fn of(&self, pose: Pose, object: u64, frame: u64) -> &[u8] {
        let turns = (self.bytes.len() / (self.voxels * self.shapes).max(1)) as u64;
        let shapes = self.shapes as u64;
        let (shape, turn) = match pose {
            Pose::Track => (object % shapes, frame % turns),
            _ => ((object + frame) % shapes, (frame / shapes + object) % turns),
        };
        &self.bytes[(shape * turns + turn) as usize * self.voxels..][..self.voxels]
    }

    /// Number of shapes.
    pub fn shapes(&self) -> usize {
        self.shapes
    }

    /// Hands the grids to another process.
    ///
    /// # Errors
    /// The error if the other end vanishes.
    pub fn write(&self, out: &mut impl Write) -> std::io::Result<()> {
        out.write_all(&self.bytes)
    }

    /// Takes them over: the rest of the input.
    ///
    /// # Errors
    /// The error of reading, or one if they do not fit `shapes` grids of `voxels`.
    pub fn read(input: &mut impl Read, voxels: usize, shapes: usize) -> std::io::Result<Self> {
        let mut bytes = Vec::new();
        input.read_to_end(&mut bytes)?;
        let unit = voxels * shapes;
        if unit == 0 || bytes.is_empty() || bytes.len() % unit != 0 {
            let what = format!("{} bytes of grids are not {shapes} shapes of {voxels} voxels", bytes.len());
            return Err(std::io::Error::new(std::io::ErrorKind::InvalidData, what));
        }
        Ok(Self { voxels, shapes, bytes })
    }
}

fn turns(pose: Pose) -> usize {
    match pose {
        Pose::Known => 1,
        Pose::Yaw | Pose::Rest | Pose::Full => TURNS,
        Pose::Track => TRACKED,
    }
}

fn rotation(pose: Pose, turn: usize, place: usize) -> Rotation {
    match pose {
        Pose::Known => Rotation::identity(),
        Pose::Yaw | Pose::Rest => draw_rotation(PoseSearch::YAW, 1, place),
        Pose::Full => draw_rotation(PoseSearch::Full, 1, place),
        Pose::Track => yaw(turn as f64 / TRACKED as f64 * std::f64::consts::TAU),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn grids_survive_being_handed_over_and_are_what_was_asked_for() {
        let dims = Dims::cube(8).unwrap();
        let shapes = Grids::furniture(dims);
        let grids = Grids::new(&shapes, Pose::Track);
        let mut wire = Vec::new();
        grids.write(&mut wire).unwrap();
        let taken = Grids::read(&mut &wire[..], 512, shapes.len()).unwrap();
        assert_eq!(taken.bytes, grids.bytes);
        // Tracked, an object keeps its shape and turns: a quarter after 30 frames, round after 120.
        let quarter = Turn::new(dims, &yaw(std::f64::consts::FRAC_PI_2)).occupancy(&shapes[3]);
        let mut expected = vec![0; 512];
        View::Top.of(&quarter).write(&mut expected);
        assert_eq!(taken.of(Pose::Track, 3, 30), expected);
        assert_eq!(taken.of(Pose::Track, 3, 120), taken.of(Pose::Track, 3, 0));
        let known = Grids::new(&shapes, Pose::Known);
        assert_eq!(known.of(Pose::Known, 2, 1), known.of(Pose::Known, 3, 0));
        View::Top.of(&shapes[3]).write(&mut expected);
        assert_eq!(known.of(Pose::Known, 3, 0), expected);
        assert!(Grids::read(&mut &wire[1..], 512, shapes.len()).is_err());
    }
}
