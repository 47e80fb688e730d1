//! Several views of objects that do not move, as one grid for each: every frame is carved in the place that the object's first one had in
//! the world, and the grids' log-odds are summed.

use super::grids::{BelowSupport, FrameGrids, GridOptions, NoGrid, ObjectGrid, lay_grids};
use crate::{Carver, Frame, Fusion, FusionError, Grid, GridError, Plane};
use nalgebra::{Isometry3, Point3};
use std::collections::BTreeMap;

/// What all frames so far know of each object.
#[derive(Debug, Default)]
pub struct FusedObjects {
    objects: BTreeMap<u16, FusedObject>,
}

#[derive(Debug)]
struct FusedObject {
    voxel_size_m: f64,
    grid_to_world: Isometry3<f64>,
    /// The support plane in the world.
    support: Option<Plane>,
    fusion: Fusion,
}

impl FusedObjects {
    /// As [`lay_grids`], but an object that had a grid before has it where it was. `camera_to_world` is where the camera is now.
    ///
    /// # Errors
    /// [`GridError`] if a grid is so far away that its place is not finite.
    pub fn lay_grids<'a>(
        &mut self,
        frame: Frame<'a>,
        camera_to_world: &Isometry3<f64>,
        options: &GridOptions,
    ) -> Result<FrameGrids<'a>, GridError> {
        let mut found = lay_grids(frame, options);
        for ObjectGrid { object, carver } in &mut found.objects {
            match (self.objects.get(object), &carver) {
                (Some(known), _) => *carver = Ok(known.carver(frame, *object, camera_to_world, options)?),
                (None, Ok(carver)) => drop(self.objects.insert(*object, FusedObject::new(carver, camera_to_world))),
                (None, Err(NoGrid::NoUp { .. } | NoGrid::NoPlace(_))) => {}
            }
        }
        Ok(found)
    }

    /// Adds what was carved of an object by the last [`Self::lay_grids`], and writes what all frames know in its place.
    ///
    /// # Errors
    /// [`FusionError`] if these are not the voxels of a grid of that object.
    pub fn fuse(&mut self, object: u16, voxels: &mut [u8]) -> Result<(), FusionError> {
        let fused = self.objects.get_mut(&object).ok_or(FusionError::Length { found: voxels.len(), expected: 0 })?;
        fused.fusion.add(voxels)?;
        fused.fusion.write(voxels)
    }

    /// Frames that an object's grid is made of.
    pub fn views(&self, object: u16) -> usize {
        self.objects.get(&object).map_or(0, |fused| fused.fusion.views())
    }
}

impl FusedObject {
    fn new(carver: &Carver<'_>, camera_to_world: &Isometry3<f64>) -> Self {
        Self {
            voxel_size_m: carver.grid.voxel_size_m(),
            grid_to_world: camera_to_world * carver.grid.grid_to_camera(),
            support: carver.support.map(|plane| moved(&plane, camera_to_world)),
            fusion: Fusion::new(carver.grid.voxels()),
        }
    }

    fn carver<'a>(
        &self,
        frame: Frame<'a>,
        object: u16,
        camera_to_world: &Isometry3<f64>,
        options: &GridOptions,
    ) -> Result<Carver<'a>, GridError> {
        let world_to_camera = camera_to_world.inverse();
        let grid = Grid::new(options.dims, self.voxel_size_m, world_to_camera * self.grid_to_world)?;
        let support = self.support.filter(|_| options.below_support == BelowSupport::Empty);
        Ok(Carver { frame, object, sensor: options.sensor, support: support.map(|plane| moved(&plane, &world_to_camera)), grid })
    }
}

/// A plane in another frame.
fn moved(plane: &Plane, motion: &Isometry3<f64>) -> Plane {
    let foot = Point3::from(-plane.normal().into_inner() * plane.height(&Point3::origin()));
    Plane::new(motion.rotation * plane.normal(), &(motion * foot))
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Translation3, Unit, UnitQuaternion, Vector3};

    #[test]
    fn a_moved_plane_keeps_its_distances() {
        let plane = Plane::new(Unit::new_normalize(Vector3::new(0.1, -0.8, -0.5)), &Point3::new(0.2, 0.3, 0.9));
        let motion = Isometry3::from_parts(Translation3::new(1.0, -2.0, 0.5), UnitQuaternion::from_euler_angles(0.3, -1.0, 2.0));
        for point in [Point3::origin(), Point3::new(0.4, -0.2, 1.3)] {
            assert!((moved(&plane, &motion).height(&(motion * point)) - plane.height(&point)).abs() < 1e-12);
        }
    }
}
