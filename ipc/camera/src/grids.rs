//! From a frame to the grids of its objects: the support plane, what is up, and for each object where its grid lies, or why it has none.

use crate::{Carver, Frame, Placement, PlacementError, Plane, PlaneSearch, Segments, SensorModel};
use crate::{fit_support_in, place_in, up_axis};
use nalgebra::{Unit, Vector3};
#[cfg(feature = "parallel")]
use rayon::prelude::*;

/// How frames become grids.
#[derive(Clone, Copy, Debug)]
pub struct GridOptions {
    /// Voxels of the grids along x, y, z.
    pub dims: [usize; 3],
    /// How far readings may be from the surface.
    pub sensor: SensorModel,
    /// How a grid is laid about an object.
    pub placement: Placement,
    /// The label of the plane that objects stand on, which then is no object itself; where `None`, or where the frame has no such
    /// label, the plane is looked for in the pixels without label.
    pub support_label: Option<u16>,
    /// The direction in which things fall, in the camera frame; where it is not known, up is the support plane's normal.
    pub gravity: Option<Unit<Vector3<f64>>>,
    /// What is known of voxels below the support plane.
    pub below_support: BelowSupport,
}

/// What is known of voxels below the support plane.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum BelowSupport {
    /// Nothing of an object that stands on the plane is there.
    #[default]
    Empty,
    /// What the image says: mostly nothing.
    Unknown,
}

impl GridOptions {
    /// Grids of `dims`, everything else as by default.
    pub fn new(dims: [usize; 3]) -> Self {
        Self {
            dims,
            sensor: SensorModel::default(),
            placement: Placement::default(),
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
    /// There is no place for it.
    #[error(transparent)]
    NoPlace(#[from] PlacementError),
}

/// One object of a frame.
#[derive(Clone, Debug)]
pub struct ObjectGrid<'a> {
    /// Its label.
    pub object: u16,
    /// What carves its grid, or why there is none.
    pub carver: Result<Carver<'a>, NoGrid>,
}

/// What was found in a frame.
#[derive(Clone, Debug)]
pub struct FrameGrids<'a> {
    /// The plane that the objects stand on.
    pub support: Option<Plane>,
    /// Every object that has a pixel, ascending by label.
    pub objects: Vec<ObjectGrid<'a>>,
}

/// Finds the support plane and lays a grid about every object. Nothing is carved yet: see [`crate::carve`].
pub fn lay_grids<'a>(frame: Frame<'a>, options: &GridOptions) -> FrameGrids<'a> {
    let segments = Segments::new(&frame);
    let support = find_support(&frame, &segments, options);
    let up = up_axis(options.gravity.map(Unit::into_inner), support.as_ref());
    let objects: Vec<u16> = segments.objects(options.support_label).collect();
    let lay = |object: u16| {
        let up = up.as_ref().ok_or(NoGrid::NoUp { object })?;
        let grid = place_in(&frame, &segments, object, up, support.as_ref(), &options.sensor, options.dims, &options.placement)?;
        let support = support.filter(|_| options.below_support == BelowSupport::Empty);
        Ok(Carver { frame, object, sensor: options.sensor, support, grid })
    };
    #[cfg(feature = "parallel")]
    let objects = objects.into_par_iter();
    #[cfg(not(feature = "parallel"))]
    let objects = objects.into_iter();
    let objects = objects.map(|object| ObjectGrid { object, carver: lay(object) }).collect();
    FrameGrids { support, objects }
}

fn find_support(frame: &Frame<'_>, segments: &Segments, options: &GridOptions) -> Option<Plane> {
    let label = options.support_label.filter(|label| !segments.pixels(*label).is_empty());
    let up = options.gravity.map(|gravity| -gravity);
    fit_support_in(frame, segments, &PlaneSearch { label, up, sensor: options.sensor })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Intrinsics;

    /// A camera that looks straight down on a table at 0.8 m, with a slab of label 1 that is 0.01 m high, seen in 20 × 20 pixels, three
    /// pixels of label 2, and label 9 on the table.
    fn images() -> (Intrinsics, Vec<f32>, Vec<u16>) {
        let camera = Intrinsics::new(80, 60, [70.0; 2], [39.5, 29.5], [0.0; 5]).unwrap();
        let inside = |pixel: usize| (30..50).contains(&(pixel % 80)) && (20..40).contains(&(pixel / 80));
        let depth = (0..4800).map(|pixel| if inside(pixel) { 0.79 } else { 0.8 }).collect();
        let labels = (0..4800).map(|pixel| if inside(pixel) { 1 } else { u16::from(pixel < 3) * 2 }).collect();
        (camera, depth, labels)
    }

    fn options() -> GridOptions {
        GridOptions::new([16; 3])
    }

    #[test]
    fn every_object_has_a_grid_or_a_reason() {
        let (camera, depth, labels) = images();
        let laid = lay_grids(Frame::new(&camera, &depth, &labels).unwrap(), &options());
        assert!((laid.support.unwrap().height(&nalgebra::Point3::origin()) - 0.8).abs() < 1e-6);
        let [block, few] = &laid.objects[..] else { panic!("{:?}", laid.objects) };
        assert_eq!((block.object, few.object), (1, 2));
        // Between 0.79 and 0.8 m, as wide as 19 pixels at 0.79 m, of which the grid is 3/2.
        let grid = block.carver.as_ref().unwrap().grid;
        assert!((grid.grid_to_camera().translation.vector - Vector3::new(0.0, 0.0, 0.795)).norm() < 1e-6);
        assert!((grid.voxel_size_m() - 0.79 * 19.0 / 70.0 * 1.5 / 16.0).abs() < 1e-6);
        assert!(matches!(few.carver, Err(NoGrid::NoPlace(PlacementError::TooFew { object: 2, found: 3, least: 40 }))));
    }

    #[test]
    fn the_support_label_is_the_plane_and_no_object() {
        let (camera, depth, mut labels) = images();
        labels.iter_mut().filter(|label| **label == 0).for_each(|label| *label = 9);
        let frame = Frame::new(&camera, &depth, &labels).unwrap();
        let laid = lay_grids(frame, &options());
        assert_eq!((laid.support, laid.objects.len()), (None, 3));
        let reasons: Vec<String> = laid.objects.iter().map(|o| o.carver.as_ref().unwrap_err().to_string()).collect();
        assert!(reasons.iter().all(|reason| reason.contains("--gravity") && reason.contains("--support-label")), "{reasons:?}");
        let laid = lay_grids(frame, &GridOptions { support_label: Some(9), ..options() });
        assert!(laid.support.is_some() && laid.objects.len() == 2 && laid.objects[0].carver.is_ok());
        // Gravity alone says what is up; below the plane, nothing is known then.
        let gravity = Some(Vector3::z_axis());
        let laid = lay_grids(frame, &GridOptions { gravity, ..options() });
        assert!(laid.support.is_none() && laid.objects[0].carver.as_ref().is_ok_and(|carver| carver.support.is_none()));
    }

    #[test]
    fn what_is_below_the_plane_is_empty_unless_it_is_asked_to_be_unknown() {
        let (camera, depth, labels) = images();
        let frame = Frame::new(&camera, &depth, &labels).unwrap();
        let below = |below_support| {
            let laid = lay_grids(frame, &GridOptions { below_support, ..options() });
            let mut voxels = vec![9; 4096];
            crate::carve(laid.objects[0].carver.as_ref().unwrap(), &mut voxels).unwrap();
            // The middle of the lowest layer, under the block.
            voxels[(8 * 16 + 8) * 16]
        };
        assert_eq!((below(BelowSupport::Empty), below(BelowSupport::Unknown)), (crate::EMPTY, crate::UNKNOWN));
    }
}
