//! The one road from a depth frame to a grid for each of its objects:
//! supports, segments (the user's masks or the frame's own), own readings, places; carving follows in the caller's memory.

use crate::carving::{Carver, Grid};
use crate::consensus::consensus;
use crate::cut::{Cut, cut};
use crate::joining::Joint;
use crate::own_readings::{own_readings, percentile};
use crate::placement::{Placement, PlacementError, place_in};
use crate::rays::Rays;
use crate::scene::Scene;
use crate::segments::Segments;
use crate::supports::{SupportSearch, Supports, find_supports, find_table, local_support, only_up};
use crate::tables::{SegmentScratch, Segmentation, segment};
use crate::tracking::ObjectTracks;
use crate::{Frame, Intrinsics, Plane, SensorModel};
use nalgebra::{Unit, Vector3};
use std::collections::BTreeMap;

/// How frames become grids.
#[derive(Clone, Copy, Debug)]
pub struct GridOptions {
    /// Voxels of the grids along x, y, z.
    pub dims: [usize; 3],
    /// How far readings may be from the surface.
    pub sensor: SensorModel,
    /// How a grid is laid about an object.
    pub placement: Placement,
    /// Where the objects come from.
    pub segmentation: Segmentation,
    /// The label of the plane that objects stand on, which then is no object itself. Where it is not given, a label that is a large plane
    /// under the others is recognised.
    pub support_label: Option<u16>,
    /// The direction in which things fall, in the camera frame, where it is known; a plane within 15° of level corrects it.
    pub gravity: Option<Unit<Vector3<f64>>>,
    /// Content of the voxels below the support plane.
    pub below_support: BelowSupport,
}

/// Content of the voxels below the support plane.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum BelowSupport {
    /// Nothing of an object that stands on the plane is there.
    #[default]
    Empty,
    /// As carved from the image: mostly unknown.
    Unknown,
}

impl GridOptions {
    /// Grids of `dims`, everything else as by default.
    pub fn new(dims: [usize; 3]) -> Self {
        Self {
            dims,
            sensor: SensorModel::default(),
            placement: Placement::default(),
            segmentation: Segmentation::Labels,
            support_label: None,
            gravity: None,
            below_support: BelowSupport::default(),
        }
    }
}

/// Why an object has no grid.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum NoGrid {
    /// Neither gravity nor a plane says what is up.
    #[error(
        "object {object}: what is up is not known, as no plane that objects could stand on was found: give gravity (--gravity), or the label of the plane (--support-label)"
    )]
    NoUp {
        /// Label of the object.
        object: u16,
    },
    /// Most of its mask shows something else.
    #[error(
        "object {object}: {found} of the {masked} depth readings of its mask are its own, at least {least} are needed: the others lie at the support plane, between surfaces, or apart from it"
    )]
    TooFewOwn {
        /// Label of the object.
        object: u16,
        /// Readings that are its own.
        found: usize,
        /// Readings of its mask.
        masked: usize,
        /// Fewest readings.
        least: usize,
    },
    /// There is no place for it.
    #[error(transparent)]
    NoPlace(#[from] PlacementError),
}

/// Quality of an object's readings.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Quality {
    /// Readings that are the object's own.
    pub readings: usize,
    /// Share of the mask's readings that are the support plane's.
    pub share_support: f64,
    /// Share that flies between surfaces.
    pub share_edge: f64,
    /// Share in pieces that lie apart.
    pub share_far: f64,
    /// Standard deviation of the surface after consensus, metres.
    pub surface_deviation_m: f64,
    /// Whether the image's border or something nearer cuts it off.
    pub cut: Cut,
}

/// A grid about an object.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ObservedGrid {
    /// Where it lies.
    pub grid: Grid,
    /// The plane that the object stands on.
    pub support: Option<Plane>,
    /// How far the surface may be from the truth, after consensus.
    pub sensor: SensorModel,
    /// Quality of the readings.
    pub quality: Quality,
}

/// One object of a frame.
#[derive(Clone, Debug)]
pub struct ObjectGrid {
    /// Its label.
    pub object: u16,
    /// The label that it had in the frame before, where that frame had an object at this place.
    pub continues: Option<u16>,
    /// Its grid, or why there is none.
    pub grid: Result<ObservedGrid, NoGrid>,
}

/// The objects of a frame with their grids, and its supports.
#[derive(Clone, Debug)]
pub struct FrameGrids {
    intrinsics: Intrinsics,
    depth: Vec<f32>,
    labels: Vec<u16>,
    segments: Option<Vec<u16>>,
    sensor: SensorModel,
    below_support: BelowSupport,
    /// Direction of up in the camera frame.
    pub up: Option<Unit<Vector3<f64>>>,
    /// Planes that objects stand on, the main one first.
    pub supports: Vec<Plane>,
    /// Labels that are a support and no object.
    pub support_labels: Vec<u16>,
    /// How far the given direction up was from the plane's normal, radians, where one corrected it.
    pub corrected_rad: Option<f64>,
    /// Every object that has a pixel, ascending by label.
    pub objects: Vec<ObjectGrid>,
}

impl FrameGrids {
    /// Pixels of a row and rows.
    pub fn size(&self) -> [usize; 2] {
        [self.intrinsics.width(), self.intrinsics.height()].map(|side| side as usize)
    }

    /// The frame's own label image, where it was segmented by what stands on a table, before anything was taken away.
    pub fn segments(&self) -> Option<&[u16]> {
        self.segments.as_deref()
    }

    /// How far single readings may be from the surface.
    pub fn sensor(&self) -> SensorModel {
        self.sensor
    }

    /// The readings that the grids are carved from, metres, row by row: without those that fly between surfaces.
    pub fn depth(&self) -> &[f32] {
        &self.depth
    }

    /// The object that each of these readings belongs to; 0: none.
    pub fn labels(&self) -> &[u16] {
        &self.labels
    }

    /// Every object with what carves its grid, or why it has none; ascending by label.
    pub fn carvers(&self) -> impl Iterator<Item = (u16, Result<Carver<'_>, &NoGrid>)> {
        self.objects.iter().map(|object| (object.object, object.grid.as_ref().map(|observed| self.carver(object.object, observed))))
    }

    /// The carver of a grid of this frame.
    pub fn carver(&self, object: u16, observed: &ObservedGrid) -> Carver<'_> {
        let frame = Frame::new(&self.intrinsics, &self.depth, &self.labels).expect("the images have the camera's size");
        let support = observed.support.filter(|_| self.below_support == BelowSupport::Empty);
        Carver { frame, object, sensor: observed.sensor, support, grid: observed.grid }
    }
}

/// The grids of one frame by itself: see [`Observer::observe`], which keeps what lasts from frame to frame.
pub fn lay_grids(frame: Frame<'_>, options: &GridOptions) -> FrameGrids {
    Observer::new(*options).observe(&frame)
}

/// Of what is cut off, the visible part takes so much less of its grid.
const CUT_SHARE: f64 = 0.75;

/// Gives readings that fly between two surfaces the depth of the nearer one: what lies in front of it is empty, and no more is known there.
fn in_front_of_edges(depth: &mut [f32], width: usize, flying: &[u32]) {
    flying.iter().for_each(|pixel| depth[*pixel as usize] = 0.0);
    let nearest = |depth: &[f32], pixel: usize| {
        let (u, v) = (pixel % width, pixel / width);
        let rows = v.saturating_sub(1)..(v + 2).min(depth.len() / width);
        let around = rows.flat_map(|v| (u.saturating_sub(1)..(u + 2).min(width)).map(move |u| v * width + u));
        around.map(|pixel| depth[pixel]).filter(|z| *z > 0.0).fold(f32::INFINITY, f32::min)
    };
    let found: Vec<f32> = flying.iter().map(|pixel| nearest(depth, *pixel as usize)).collect();
    for (pixel, z) in flying.iter().zip(found) {
        depth[*pixel as usize] = if z.is_finite() { z } else { 0.0 };
    }
}

/// The middle depth of some pixels, metres.
fn middle_depth(depth: &[f32], pixels: &[u32]) -> f64 {
    let some: Vec<f32> = pixels.iter().step_by(pixels.len().div_ceil(400).max(1)).map(|pixel| depth[*pixel as usize]).collect();
    f64::from(percentile(&some, 0.5))
}

/// What stands on the table of a frame: its labels, its supports, and what the frame before had of it.
struct Segmented {
    labels: Vec<u16>,
    supports: Option<Supports>,
    before: BTreeMap<u16, u16>,
}

/// Turns frames into grids; keeps what lasts from frame to frame.
#[derive(Clone, Debug)]
pub struct Observer {
    options: GridOptions,
    rays: Option<Rays>,
    state: Vec<u8>,
    segments: SegmentScratch,
    tracks: ObjectTracks,
}

impl Observer {
    /// With these options.
    pub fn new(options: GridOptions) -> Self {
        Self { options, rays: None, state: Vec::new(), segments: SegmentScratch::default(), tracks: ObjectTracks::default() }
    }

    /// The options.
    pub fn options(&self) -> &GridOptions {
        &self.options
    }

    /// Where the objects of the next frames come from.
    pub fn segment_by(&mut self, segmentation: Segmentation) {
        self.options.segmentation = segmentation;
    }

    fn prepare(&mut self, intrinsics: &Intrinsics) -> Rays {
        match self.rays.take() {
            Some(rays) if rays.intrinsics() == intrinsics => rays,
            _ => Rays::new(intrinsics),
        }
    }

    /// The label image of a frame without masks: each object that stands on a plane has a label from 1 on, the one that it had in the
    /// frame before; all are 0 where there is no plane. `depth` has a value for each pixel of the camera, metres.
    pub fn segment_table(&mut self, intrinsics: &Intrinsics, depth: &[f32]) -> Vec<u16> {
        let rays = self.prepare(intrinsics);
        let Segmented { labels, .. } = self.segmented(&rays, &rays.readings(depth));
        self.rays = Some(rays);
        labels
    }

    /// What stands on the table of a frame.
    fn segmented(&mut self, rays: &Rays, depth: &[f32]) -> Segmented {
        let search = SupportSearch { up: self.options.gravity.map(|gravity| -gravity), label: None };
        let supports = find_table(rays, depth, &self.options.sensor, &search);
        let mut labels = match &supports {
            Some(supports) => segment(rays, depth, &self.options.sensor, supports, &mut self.segments),
            None => vec![0; depth.len()],
        };
        let before = self.tracks.renumber(rays, depth, &mut labels);
        Segmented { labels, supports, before }
    }

    /// Finds the supports, the objects and their own readings, and lays a grid about each. Nothing is carved yet: see
    /// [`FrameGrids::carver`].
    pub fn observe(&mut self, frame: &Frame<'_>) -> FrameGrids {
        let options = self.options;
        let rays = self.prepare(frame.intrinsics());
        let mut depth = rays.readings(frame.depths());
        let (segments, table, before) = match options.segmentation {
            Segmentation::Labels => (None, None, self.tracks.follow(&rays, &depth, frame.labels())),
            Segmentation::Table => {
                let Segmented { labels, supports, before } = self.segmented(&rays, &depth);
                (Some(labels), supports, before)
            }
        };
        let labels = segments.as_deref().unwrap_or(frame.labels());
        self.state.resize(depth.len(), 0);
        let masked = Segments::of_objects(&Frame::new(frame.intrinsics(), &depth, labels).expect("the images have the camera's size"));
        let scene = Scene { rays: &rays, depth: &depth, labels, sensor: &options.sensor, joint: Joint::new(&rays, &options.sensor) };
        let search = SupportSearch {
            up: options.gravity.map(|gravity| -gravity),
            label: options.support_label.filter(|label| !masked.pixels(*label).is_empty()),
        };
        let masks: Vec<(u16, &[u32])> = masked.objects(search.label).map(|object| (object, masked.pixels(object))).collect();
        // Labels without any reading say nothing of where things stand.
        let read: Vec<(u16, &[u32])> = masks.iter().filter(|(_, mask)| !mask.is_empty()).copied().collect();
        // Segments have their supports already.
        let supports = table.or_else(|| find_supports(&scene, &read, &search)).or_else(|| only_up(&search));
        let support_labels = supports.as_ref().map_or_else(Vec::new, |supports| supports.labels.clone());
        let mut cleaned = vec![0; depth.len()];
        let mut flying = Vec::new();
        let mut found = Vec::new();
        let mut own: Vec<(u16, Vec<u32>)> = Vec::new();
        for (object, mask) in masks.iter().filter(|(object, _)| support_labels.binary_search(object).is_err()) {
            if mask.is_empty() {
                found.push((*object, 0, None, Quality::default()));
                continue;
            }
            let local = supports.as_ref().and_then(|supports| local_support(&scene, mask, supports));
            let readings = own_readings(&scene, mask, local.as_ref(), options.placement.least_readings.max(1), &mut self.state);
            readings.pixels.iter().for_each(|pixel| cleaned[*pixel as usize] = *object);
            flying.extend_from_slice(&readings.flying);
            let quality = Quality {
                readings: readings.pixels.len(),
                share_support: readings.share_support,
                share_edge: readings.share_edge,
                share_far: readings.share_far,
                ..Quality::default()
            };
            found.push((*object, mask.len(), local, quality));
            own.push((*object, readings.pixels));
        }
        in_front_of_edges(&mut depth, rays.width(), &flying);
        let up = supports.as_ref().map(|supports| supports.up);
        let joint = Joint::new(&rays, &options.sensor);
        let mut objects = Vec::with_capacity(found.len());
        let own = Segments::of_pixels(&own);
        let mut smooth = depth.clone();
        for (object, masked, local, mut quality) in found {
            let clean = Frame::new(frame.intrinsics(), &depth, &cleaned).expect("the images have the camera's size");
            quality.cut = cut(&rays, &depth, &cleaned, &joint, own.pixels(object), local.as_ref().map(|local| &local.plane));
            let lay = |up: Option<Unit<Vector3<f64>>>| -> Result<Grid, NoGrid> {
                let least = options.placement.least_readings.max(1);
                if masked < least {
                    return Err(PlacementError::TooFew { object, found: masked, least }.into());
                }
                if quality.readings < least {
                    return Err(NoGrid::TooFewOwn { object, found: quality.readings, masked, least });
                }
                let up = up.ok_or(NoGrid::NoUp { object })?;
                let support = local.as_ref().map(|local| &local.plane);
                // What is cut off continues by an unknown length: there is room for it.
                let share = options.placement.share * if quality.cut == Cut::default() { 1.0 } else { CUT_SHARE };
                let placement = Placement { share, ..options.placement };
                Ok(place_in(&clean, &own, object, &up, support, &options.sensor, options.dims, &placement)?)
            };
            let grid = lay(up).map(|grid| {
                let pixels = own.pixels(object);
                let middle = middle_depth(&depth, pixels);
                let mut sensor = options.sensor;
                // Where the voxels are coarser than the noise, there is nothing to gain.
                if sensor.half_band(middle) > 0.5 * grid.voxel_size_m() {
                    let (z, left) = consensus(&depth, rays.width(), &joint, pixels);
                    pixels.iter().zip(z).for_each(|(pixel, z)| smooth[*pixel as usize] = z);
                    (sensor.constant_m, sensor.quadratic_per_m) = (sensor.constant_m * left, sensor.quadratic_per_m * left);
                }
                quality.surface_deviation_m = sensor.deviation(middle);
                ObservedGrid { grid, support: local.map(|local| local.plane), sensor, quality }
            });
            objects.push(ObjectGrid { object, continues: before.get(&object).copied(), grid });
        }
        let depth = smooth;
        let (supports, corrected_rad) = supports
            .map_or_else(|| (Vec::new(), None), |found: Supports| (found.planes.iter().map(|p| p.plane).collect(), found.corrected_rad));
        let grids = FrameGrids {
            intrinsics: *frame.intrinsics(),
            depth,
            labels: cleaned,
            segments,
            sensor: options.sensor,
            below_support: options.below_support,
            up,
            supports,
            support_labels,
            corrected_rad,
            objects,
        };
        self.rays = Some(rays);
        grids
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_scene::{TestScene, Thing};

    #[test]
    fn what_flies_takes_the_nearest_depth_around_it_and_nothing_from_afar() {
        let (width, height) = (6, 5);
        let at = |u: usize, v: usize| v * width + u;
        for (u, v) in (0..height).flat_map(|v| (0..width).map(move |u| (u, v))) {
            for (other, row) in (0..height).flat_map(|v| (0..width).map(move |u| (u, v))).filter(|place| *place != (u, v)) {
                // One reading, and what flies at 9 m.
                let mut depth = vec![0.0; width * height];
                (depth[at(other, row)], depth[at(u, v)]) = (1.5, 9.0);
                in_front_of_edges(&mut depth, width, &[at(u, v) as u32]);
                let is_beside = u.abs_diff(other) <= 1 && v.abs_diff(row) <= 1;
                assert_eq!(depth[at(u, v)], if is_beside { 1.5 } else { 0.0 }, "({u}, {v}) beside ({other}, {row})");
            }
        }
        // Of two, the nearer; what flies too says nothing.
        let mut depth = vec![1.5, 0.5, 9.0, 0.25];
        in_front_of_edges(&mut depth, 4, &[1, 2]);
        assert_eq!(depth, [1.5, 1.5, 0.25, 0.25]);
    }

    /// Of 25 readings of a flat side, half count: the deviation is that of the mean of 12.5.
    #[test]
    fn the_consensus_shrinks_all_of_a_sensors_deviation_alike() {
        let scene = TestScene::new(&[Thing::Box([0.0, 0.5], [0.05, 0.05], 0.1)], 0.2);
        let frame = Frame::new(scene.rays.intrinsics(), &scene.depth, &scene.labels).unwrap();
        let found = lay_grids(frame, &GridOptions::new([64; 3]));
        let observed = found.objects[0].grid.as_ref().unwrap();
        let raw = SensorModel::default();
        let left = observed.sensor.constant_m / raw.constant_m;
        assert!((left - 12.5_f64.sqrt().recip()).abs() < 1e-9, "{left}");
        assert!((observed.sensor.quadratic_per_m / raw.quadratic_per_m - left).abs() < 1e-9);
        assert_eq!(observed.sensor.deviations, raw.deviations);
        let depths = scene.pixels(&scene.labels, 1).into_iter().map(|pixel| f64::from(scene.depth[pixel as usize]));
        let [low, high] = depths.fold([f64::INFINITY, 0.0], |[low, high], z| [low.min(z), high.max(z)]);
        let deviation = observed.quality.surface_deviation_m / left;
        assert!((raw.deviation(low)..raw.deviation(high)).contains(&deviation), "{deviation}");
    }
}
