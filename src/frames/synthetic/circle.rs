//! A camera that circles an object on a table.

use super::{DepthImage, NoiseModel, Scene, SyntheticCamera, orbit};
use beo_shapes::Mesh;
use nalgebra::{Isometry3, Point3, Vector3};
use rayon::prelude::*;
use std::f64::consts::TAU;

/// How a camera circles an object.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Circle {
    /// Views, evenly spread, the first from +x of the world; default 8.
    pub views: usize,
    /// How far above the horizontal the camera stands, radians; default 35°.
    pub elevation_rad: f64,
    /// Distance from the middle of the object, metres; default 0.8.
    pub distance_m: f64,
    /// Sides of the table under the object, metres; default 1.2 and 0.9.
    pub table_m: [f64; 2],
    /// Label of the table; default 1.
    pub table_label: u16,
    /// The sensor's faults; default: those of structured light.
    pub noise: NoiseModel,
}

impl Default for Circle {
    fn default() -> Self {
        Self {
            views: 8,
            elevation_rad: 35_f64.to_radians(),
            distance_m: 0.8,
            table_m: [1.2, 0.9],
            table_label: 1,
            noise: NoiseModel::default(),
        }
    }
}

/// One view of the circle.
#[derive(Clone, Debug, PartialEq)]
pub struct CircleView {
    /// Where the camera stands: counter-clockwise from +x about the object, radians.
    pub azimuth_rad: f64,
    /// Takes the camera's frame to the world's: the object stands at its origin, z up.
    pub camera_to_world: Isometry3<f64>,
    /// The depth image as the sensor delivers it.
    pub image: DepthImage,
}

impl Circle {
    /// The views of a mesh (metres, z up, standing on z = 0) that is turned by `yaw_rad` about z and labelled `label`.
    pub fn views_of(&self, camera: &SyntheticCamera, mesh: &Mesh, yaw_rad: f64, label: u16, seed: u64) -> Vec<CircleView> {
        let [low, high] = mesh.bounds();
        let to_world = Isometry3::rotation(Vector3::z() * yaw_rad);
        let middle = to_world * Point3::from((low.coords + high.coords) / 2.0);
        let mut scene = Scene::new();
        scene.add_table(self.table_m, Isometry3::identity(), self.table_label);
        scene.add(mesh, to_world, label);
        let view = |n: usize| {
            let azimuth_rad = TAU * n as f64 / self.views as f64;
            let camera_to_world = orbit(&middle, self.distance_m, azimuth_rad, self.elevation_rad);
            let mut image = camera.render(&scene, &camera_to_world);
            self.noise.apply(camera, &mut image, seed.wrapping_mul(0x9e37_79b9_7f4a_7c15).wrapping_add(n as u64));
            CircleView { azimuth_rad, camera_to_world, image }
        };
        (0..self.views).into_par_iter().map(view).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use beo_camera::carve;
    use beo_camera::{Carver, FILLED, Intrinsics, Placement, PlaneSearch, SensorModel, fit_support, place, up_axis};
    use beo_shapes::household;

    /// The whole way of a frame: the table is found where it is, and what is carved as filled lies on the object.
    #[test]
    fn what_is_carved_of_a_noisy_view_lies_on_the_object() {
        let camera = SyntheticCamera::new(Intrinsics::new(640, 480, [525.0; 2], [319.5, 239.5], [0.05, -0.1, 0.0, 0.0, 0.0]).unwrap());
        let sensor = SensorModel::default();
        for class in ["box", "mug", "bowl"] {
            let mesh = household::mesh(class, 2).unwrap();
            let yaw = 0.6;
            for view in (Circle { views: 3, ..Circle::default() }).views_of(&camera, &mesh, yaw, 5, 1) {
                let frame = view.image.frame();
                let plane = fit_support(&frame, &PlaneSearch { label: Some(1), up: None, sensor }).unwrap();
                let world_up = view.camera_to_world.inverse_transform_vector(&Vector3::z());
                assert!(plane.normal().dot(&world_up) > 1_f64.to_radians().cos());
                assert!((plane.height(&Point3::origin()) - view.camera_to_world.translation.z).abs() < 0.003);
                let up = up_axis(None, Some(&plane)).unwrap();
                let grid = place(&frame, 5, &up, Some(&plane), &sensor, [30; 3], &Placement::default()).unwrap();
                let mut voxels = vec![0; grid.voxels()];
                carve(&Carver { frame, object: 5, sensor, support: Some(plane), grid }, &mut voxels).unwrap();
                let [low, high] = mesh.bounds();
                let (mut on, mut all) = (0, 0);
                for (n, _) in voxels.iter().enumerate().filter(|(_, code)| **code == FILLED) {
                    let world = view.camera_to_world * grid.centre([n / 900, n / 30 % 30, n % 30]);
                    let at = Isometry3::rotation(Vector3::z() * yaw).inverse_transform_point(&world);
                    let slack = 1.5 * grid.voxel_size_m();
                    all += 1;
                    on += usize::from((0..3).all(|axis| at[axis] > low[axis] - slack && at[axis] < high[axis] + slack));
                }
                assert!(all > 100 && on as f64 > 0.97 * f64::from(all), "{class}: {on} of {all}");
            }
        }
    }

    #[test]
    fn views_are_where_their_azimuths_say_and_reproducible() {
        let camera = SyntheticCamera::new(Intrinsics::new(64, 48, [52.0; 2], [31.5, 23.5], [0.0; 5]).unwrap());
        let mesh = household::mesh("can", 1).unwrap();
        let views = Circle::default().views_of(&camera, &mesh, 0.0, 2, 7);
        assert_eq!(views.len(), 8);
        assert_eq!(views, Circle::default().views_of(&camera, &mesh, 0.0, 2, 7));
        for (n, view) in views.iter().enumerate() {
            let at = view.camera_to_world.translation;
            assert!((view.azimuth_rad - TAU * n as f64 / 8.0).abs() < 1e-12);
            assert!((at.y.atan2(at.x).rem_euclid(TAU) - view.azimuth_rad).abs() < 0.02);
            assert_ne!(view.image.depth(), views[(n + 1) % 8].image.depth());
        }
    }
}
