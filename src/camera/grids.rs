//! From a frame to the grids of its objects: the support plane, what is up, and for each object where its grid lies, or why it has none.

use crate::grid::Dims;
use beo_camera::{Carver, Frame, Placement, PlacementError, Plane, PlaneSearch, Segments, SensorModel};
use beo_camera::{fit_support_in, place_in, up_axis};
use nalgebra::{Unit, Vector3};
use rayon::prelude::*;

/// How frames become grids.
#[derive(Clone, Copy, Debug)]
pub struct GridOptions {
    /// Size of the grids.
    pub dims: Dims,
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
    pub fn new(dims: Dims) -> Self {
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

/// Finds the support plane and lays a grid about every object. Nothing is carved yet: see [`super::carve`].
pub fn lay_grids<'a>(frame: Frame<'a>, options: &GridOptions) -> FrameGrids<'a> {
    let segments = Segments::new(&frame);
    let support = find_support(&frame, &segments, options);
    let up = up_axis(options.gravity.map(Unit::into_inner), support.as_ref());
    let objects: Vec<u16> = segments.objects(options.support_label).collect();
    let lay = |object: u16| {
        let up = up.as_ref().ok_or(NoGrid::NoUp { object })?;
        let dims = options.dims.into();
        let grid = place_in(&frame, &segments, object, up, support.as_ref(), &options.sensor, dims, &options.placement)?;
        let support = support.filter(|_| options.below_support == BelowSupport::Empty);
        Ok(Carver { frame, object, sensor: options.sensor, support, grid })
    };
    let objects = objects.into_par_iter().map(|object| ObjectGrid { object, carver: lay(object) }).collect();
    FrameGrids { support, objects }
}

fn find_support(frame: &Frame<'_>, segments: &Segments, options: &GridOptions) -> Option<Plane> {
    let label = options.support_label.filter(|label| !segments.pixels(*label).is_empty());
    let up = options.gravity.map(|gravity| -gravity);
    fit_support_in(frame, segments, &PlaneSearch { label, up, sensor: options.sensor })
}
