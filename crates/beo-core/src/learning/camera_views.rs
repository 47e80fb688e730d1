//! Views of training shapes as cameras on tables have them: the components of each class, and shapes seen at rest.

use super::resting::{Resting, resting_poses};
use super::sizes::kinds;
use crate::grid::{Dims, Observation, Occupancy, Outside, Rotation, Similarity, Turn, yaw};
use crate::model::{Component, OFFSETS};
use crate::perception::camera::ViewFrame;
use crate::perception::{PoseSearch, Query, ScaleSearch};
use crate::simulation::{Eye, RenderedView, Sensing};
use nalgebra::{Point3, Vector3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use std::f64::consts::{PI, TAU};

/// Most voxels of grids that are carved for training; of bigger shapes the grids are smaller, and the evidence is not weighed.
const MOST_VOXELS: usize = 64 * 64 * 64;
/// Longest side of things on tables whose size is not known, metres: by it the grid's box reaches down to the table as that of a producer does.
const SUPPOSED_SIDE_M: f64 = 0.3;
/// Fewest readings of an object under real conditions: with fewer a producer has no grid for it.
const LEAST_READINGS: usize = 30;
/// Shapes that overlap by more when turned by an eighth about the vertical look the same from all sides.
const ROUND: f64 = 0.88;
/// Shapes that are looked at for that.
const LOOKED_AT: usize = 8;

/// The shapes of a class: complete, and their true lengths along the canonical axes, metres, where they are known.
pub struct ClassShapes<'a> {
    /// The shapes.
    pub objects: &'a [&'a Occupancy],
    /// Lengths of each; none where units are not known.
    pub lengths_m: Option<&'a [[f64; 3]]>,
    /// The shapes on finer grids, centred alike, for what cameras see of them; none where there are no such grids.
    pub fine: Option<&'a [&'a Occupancy]>,
}

/// How views are made.
#[derive(Clone, Copy, Debug)]
pub struct Views<'a> {
    /// Elevations of cameras, radians, ascending.
    pub elevations: &'a [f64],
    /// Faults of sensors and masks.
    pub sensing: Sensing,
    /// Whether objects lie as well as stand.
    pub lying: bool,
    /// Seed.
    pub seed: u64,
}

/// A shape as it rests.
pub struct AtRest {
    /// Its place among the shapes of its class.
    pub(super) shape: usize,
    /// Turned so that it rests on a horizontal plane.
    turned: Occupancy,
    /// The same on a finer grid, centred alike, if there is one.
    fine: Option<Occupancy>,
    /// The rotation that did that.
    rotation: Rotation,
    /// Longest side, metres, if it is known.
    pub(super) side_m: Option<f64>,
    /// Lengths of the box about the shape along its canonical axes, voxels.
    lengths: [f64; 3],
    /// Size of the canonical grid.
    dims: Dims,
}

/// A component and the shapes that are of it.
pub struct ComponentShapes {
    /// The component, as the model keeps it.
    pub component: Component,
    /// Its shapes.
    pub shapes: Vec<AtRest>,
    /// They look the same from all sides.
    pub is_round: bool,
}

/// The components of all classes, in the order of the classes. `lying`: whether resting poses are looked for; else all stand upright.
pub fn parts(classes: &[ClassShapes<'_>], lying: bool) -> Vec<ComponentShapes> {
    classes.iter().enumerate().flat_map(|(class, shapes)| parts_of(class, shapes, lying)).collect()
}

fn parts_of(class: usize, shapes: &ClassShapes<'_>, lying: bool) -> Vec<ComponentShapes> {
    let count = shapes.objects.len();
    let (kinds, of) = match shapes.lengths_m {
        Some(lengths) => {
            let found = kinds(lengths);
            (found.kinds.into_iter().map(|(share, density)| (share, Some(density))).collect(), found.of)
        }
        None => (vec![(1.0, None)], vec![0; count]),
    };
    let mut parts = Vec::new();
    for (kind, (share, size)) in kinds.into_iter().enumerate() {
        let members: Vec<usize> = (0..count).filter(|shape| of[*shape] == kind).collect();
        let objects: Vec<&Occupancy> = members.iter().map(|shape| shapes.objects[*shape]).collect();
        let poses = match lying {
            true => resting_poses(&objects),
            false => {
                vec![Resting { rotation: Rotation::identity(), probability: 1.0, of: vec![Some(Rotation::identity()); objects.len()] }]
            }
        };
        for pose in poses {
            let at_rest = |(n, rotation): (usize, &Option<Rotation>)| -> Option<AtRest> {
                let side_m = shapes.lengths_m.map(|lengths| lengths[members[n]].into_iter().fold(0.0, f64::max));
                let fine = shapes.fine.map(|fine| fine[members[n]]);
                let at_rest = AtRest::new(objects[n], fine, (*rotation)?, side_m)?;
                Some(AtRest { shape: members[n], ..at_rest })
            };
            let shapes: Vec<AtRest> = pose.of.par_iter().enumerate().filter_map(at_rest).collect();
            let component =
                Component { class, probability: share * pose.probability, resting_rotation: crate::grid::to_xyzw(&pose.rotation), size };
            // Upright shapes of no known size are seen at every step of yaw.
            let is_round = (lying || size.is_some()) && are_round(&shapes);
            parts.push(ComponentShapes { component, shapes, is_round });
        }
    }
    parts
}

/// Whether shapes at rest look the same from all sides.
fn are_round(shapes: &[AtRest]) -> bool {
    let step = shapes.len().div_ceil(LOOKED_AT).max(1);
    let overlap = |shape: &AtRest| {
        let turned = Turn::new(shape.turned.dims(), &yaw(TAU / 8.0)).occupancy(&shape.turned);
        let both = shape.turned.overlap(&turned) as f64;
        both / (shape.turned.count() as f64 + turned.count() as f64 - both).max(1.0)
    };
    let overlaps: Vec<f64> = shapes.iter().step_by(step).map(overlap).collect();
    overlaps.iter().sum::<f64>() > ROUND * overlaps.len().max(1) as f64
}

/// Whether every class is one upright component without a size.
pub fn are_plain(parts: &[ComponentShapes]) -> bool {
    parts.iter().all(|part| part.component.is_upright() && part.component.size.is_none())
}

/// Random numbers for one view.
pub fn stream(seed: u64, group: u64, view: u64) -> ChaCha8Rng {
    let mut rng = ChaCha8Rng::seed_from_u64(seed ^ 0x6361_6d65_7261);
    rng.set_stream((group << 40) ^ view);
    rng
}

/// A view of a shape, and how the shape lies in it.
pub struct ViewSample {
    /// Where the camera was, in voxels from the grid's centre.
    pub camera: Vector3<f64>,
    /// The view's frame.
    pub(super) frame: ViewFrame,
    /// The observation.
    pub observation: Observation,
    /// How the shape's canonical grid truly lies.
    pub placed: Similarity,
    /// Edge of a voxel of the observation, metres, if the shape's size is known.
    pub voxel_m: Option<f64>,
    /// Lengths of the box about the shape along its canonical axes, voxels of its own grid.
    pub lengths: [f64; 3],
}

impl AtRest {
    /// A shape turned so that it rests on a horizontal plane; `fine` is the shape on a finer grid, centred alike, and `side_m` its longest side,
    /// metres. `None` where nothing is left of it.
    pub fn new(object: &Occupancy, fine: Option<&Occupancy>, rotation: Rotation, side_m: Option<f64>) -> Option<Self> {
        let turn = |object: &Occupancy| match rotation.angle() < 1e-9 {
            true => object.clone(),
            false => Turn::new(object.dims(), &rotation).occupancy(object),
        };
        let [low, high] = object.bounds()?;
        let lengths = std::array::from_fn(|axis| (high[axis] - low[axis]) as f64);
        let (turned, fine) = (turn(object), fine.map(turn));
        (turned.count() > 0).then_some(Self { shape: 0, turned, fine, rotation, side_m, lengths, dims: object.dims() })
    }

    /// The shape as it rests, on the finest grid that there is.
    pub(super) fn finest(&self) -> &Occupancy {
        self.fine.as_ref().unwrap_or(&self.turned)
    }

    /// The same of another true size.
    pub(super) fn resized(&self, factor: f64) -> Self {
        Self { turned: self.turned.clone(), fine: self.fine.clone(), side_m: self.side_m.map(|side| side * factor), ..*self }
    }

    /// Something else on a grid of that kind, as it lies; of no shape of the class.
    pub(super) fn like(&self, turned: Occupancy, side_m: Option<f64>) -> Self {
        let [low, high] = turned.bounds().unwrap_or_default();
        let lengths = std::array::from_fn(|axis| (high[axis] - low[axis]) as f64 / self.fineness(&turned));
        Self { turned, fine: None, side_m, lengths, rotation: Rotation::identity(), ..*self }
    }

    /// Voxels of a grid per voxel of the canonical one along an axis.
    fn fineness(&self, object: &Occupancy) -> f64 {
        object.dims().x() as f64 / self.dims.x() as f64
    }

    /// Sees the shape, on the finest grid that there is, turned by `turned` radians relative to the direction of looking, from an elevation in
    /// radians; `None` if too little is seen.
    pub fn see_finely(&self, turned: f64, elevation: f64, sensing: Sensing, rng: &mut ChaCha8Rng) -> Option<ViewSample> {
        self.see_on(self.finest(), turned, elevation, sensing, rng)
    }

    /// As [`Self::see_finely`], on the canonical grid: in a fraction of the time.
    pub(super) fn see(&self, turned: f64, elevation: f64, sensing: Sensing, rng: &mut ChaCha8Rng) -> Option<ViewSample> {
        self.see_on(&self.turned, turned, elevation, sensing, rng)
    }

    fn see_on(&self, object: &Occupancy, turned: f64, elevation: f64, sensing: Sensing, rng: &mut ChaCha8Rng) -> Option<ViewSample> {
        let fineness = self.fineness(object);
        let [low, high] = object.bounds()?;
        let size = (0..3).map(|a| high[a] - low[a]).max()? as f64;
        let (sides, conditions) = sensing.draw(self.side_m, rng);
        // The camera looks along +x of the frame; in the object's frame that direction is turned back.
        let eye = Eye { azimuth: PI - turned, elevation, distance: size * sides };
        let view = RenderedView::new(object, &eye, &conditions, rng)?;
        // The grid is laid about what is seen, as a producer does; the observation's frame then is that of the view but for details.
        let axes = yaw(-turned);
        let readings = view.points();
        if !matches!(sensing, Sensing::Ideal | Sensing::Mild) && readings.len() < LEAST_READINGS {
            return None;
        }
        let mut along_axes = readings.iter().map(|p| axes.inverse() * p.coords);
        let first = along_axes.next()?;
        let (mut low, high) = along_axes.fold((first, first), |(low, high), p| (low.inf(&p), high.sup(&p)));
        let foot = Point3::from(axes * Vector3::new((low.x + high.x) / 2.0, (low.y + high.y) / 2.0, low.z));
        low.z -= view.reach_down(&readings, &foot, high.z - low.z, size / self.side_m.unwrap_or(SUPPOSED_SIDE_M));
        let dims = if self.dims.voxels() <= MOST_VOXELS { self.dims } else { Dims::cube(30).ok()? };
        let shortest = dims.x().min(dims.y()).min(dims.z()) as f64;
        let edge = ((high - low).max() / (beo_camera::Placement::default().share * shortest)).max(1e-3);
        let centre = axes * ((low + high) / 2.0);
        let (mut bytes, mut observation) = (Vec::new(), Observation::unknown(dims));
        view.carve(dims, &axes, &centre, edge, &mut bytes, &mut observation);
        let grid_from_object = |point: Vector3<f64>| axes.inverse() * (point - centre) / edge;
        let rotation = yaw(turned) * self.rotation;
        let placed = Similarity { rotation, scale: fineness / edge, translation_voxels: grid_from_object(Vector3::zeros()) };
        let camera = grid_from_object(eye.position());
        let frame = ViewFrame::new(&observation, &camera, &mut Vec::new())?;
        let longest = self.lengths.into_iter().fold(0.0, f64::max);
        let voxel_m = self.side_m.map(|side| side / (longest * fineness) * edge);
        Some(ViewSample { camera, frame, observation, placed, voxel_m, lengths: self.lengths })
    }
}

impl ViewSample {
    /// The query that a daemon asks about it, class, pose, size and place unknown. `lying`: whether resting poses are searched, or all stand.
    pub fn query(&self, lying: bool) -> Query {
        Query {
            camera: Some(self.camera),
            pose: PoseSearch::YAW,
            lying,
            scale: ScaleSearch::Search { side: None },
            outside: Outside::Unknown,
            voxel_size_m: self.voxel_m,
            ..Query::default()
        }
    }

    /// The yaw in the view's frame, of an object whose component rests by `resting`.
    pub(super) fn yaw(&self, resting: &Rotation) -> f64 {
        let (rotation, ..) = self.frame.seen(&self.placed);
        crate::grid::yaw_of(&(rotation * resting.inverse()))
    }

    /// The offsets from a step of yaw.
    pub(super) fn offsets(&self, resting: &Rotation, step: f64) -> [f64; OFFSETS] {
        let (_, scale, place) = self.frame.seen(&self.placed);
        let length = |axis: usize| self.lengths[axis] * scale;
        [wrapped(self.yaw(resting) - step), scale.ln(), place.x, place.y, place.z, length(0), length(1), length(2)]
    }

    /// Metres per unit of the view's frame, if they are known.
    pub(super) fn unit_m(&self) -> Option<f64> {
        self.voxel_m.map(|voxel| voxel * self.frame.unit)
    }
}

fn wrapped(angle: f64) -> f64 {
    (angle + PI).rem_euclid(TAU) - PI
}

/// Uniform in ±`half`.
pub fn around(half: f64, rng: &mut ChaCha8Rng) -> f64 {
    half * rng.random_range(-1.0..1.0)
}
