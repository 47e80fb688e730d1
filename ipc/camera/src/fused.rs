//! Several views of objects that do not move, as one grid for each: every frame is carved in the place that the object's first one had in
//! the world, and the grids' log-odds are summed.

use crate::grids::{FrameGrids, ObjectGrid, ObservedGrid, Quality};
use crate::{Fusion, FusionError, Grid, GridError, Plane, SensorModel};
use nalgebra::{Isometry3, Point3};
use std::collections::BTreeMap;

/// Every object's grid, fused over all frames so far.
#[derive(Debug, Default)]
pub struct FusedObjects {
    objects: BTreeMap<u16, FusedObject>,
}

#[derive(Debug)]
struct FusedObject {
    dims: [usize; 3],
    voxel_size_m: f64,
    grid_to_world: Isometry3<f64>,
    /// The support plane in the world.
    support: Option<Plane>,
    fusion: Fusion,
}

impl FusedObjects {
    /// Gives every object that had a grid in an earlier frame that grid again, where it was in the world, also where this frame alone
    /// has none for it. `camera_to_world` is where the camera is now.
    ///
    /// # Errors
    /// [`GridError`] if a grid is so far away that its place is not finite.
    pub fn keep_places(&mut self, found: &mut FrameGrids, camera_to_world: &Isometry3<f64>) -> Result<(), GridError> {
        let sensor = found.sensor();
        for ObjectGrid { object, grid, .. } in &mut found.objects {
            match (self.objects.get(object), &grid) {
                (Some(known), now) => {
                    let now = now.as_ref().ok().copied();
                    *grid = Ok(known.observed(now, sensor, camera_to_world)?);
                }
                (None, Ok(observed)) => drop(self.objects.insert(*object, FusedObject::new(observed, camera_to_world))),
                (None, Err(_)) => {}
            }
        }
        Ok(())
    }

    /// Adds what was carved of an object by the last [`Self::keep_places`], and writes what all frames know in its place.
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
    fn new(observed: &ObservedGrid, camera_to_world: &Isometry3<f64>) -> Self {
        Self {
            dims: observed.grid.dims(),
            voxel_size_m: observed.grid.voxel_size_m(),
            grid_to_world: camera_to_world * observed.grid.grid_to_camera(),
            support: observed.support.map(|plane| moved(&plane, camera_to_world)),
            fusion: Fusion::new(observed.grid.voxels()),
        }
    }

    /// Its grid in a frame; `now` is what that frame alone says.
    fn observed(
        &self,
        now: Option<ObservedGrid>,
        sensor: SensorModel,
        camera_to_world: &Isometry3<f64>,
    ) -> Result<ObservedGrid, GridError> {
        let world_to_camera = camera_to_world.inverse();
        let grid = Grid::new(self.dims, self.voxel_size_m, world_to_camera * self.grid_to_world)?;
        let support = self.support.map(|plane| moved(&plane, &world_to_camera));
        let (sensor, quality) = now.map_or((sensor, Quality::default()), |now| (now.sensor, now.quality));
        Ok(ObservedGrid { grid, support, sensor, quality })
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
