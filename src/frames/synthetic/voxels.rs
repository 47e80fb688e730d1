//! Objects of voxels, each an exact cube.

use super::{DepthImage, SyntheticCamera};
use beo_camera::Grid;
use beo_core::grid::{Occupancy, RayCaster};
use nalgebra::{Point3, Vector3};
use rayon::prelude::*;

/// Depth and label of an object whose filled voxels are cubes of the grid; `grid` says where it lies in the camera frame. No reading
/// where nothing is met, and where the camera is within a filled voxel.
///
/// # Panics
/// If the object's size is not the grid's.
pub fn depth_of_occupancy(camera: &SyntheticCamera, object: &Occupancy, grid: &Grid, label: u16) -> DepthImage {
    assert_eq!(<[usize; 3]>::from(object.dims()), grid.dims(), "the object's grid");
    let mut image = DepthImage::empty(*camera.intrinsics());
    let Some(caster) = RayCaster::new(object) else { return image };
    // The camera frame in voxels, from the grid's corner.
    let half = Vector3::from(grid.dims().map(|side| side as f64 / 2.0));
    let eye = Point3::from(grid.camera().coords / grid.voxel_size_m() + half);
    let turn = grid.grid_to_camera().rotation.inverse().to_rotation_matrix().into_inner() / grid.voxel_size_m();
    let width = camera.intrinsics().width() as usize;
    let (depth, labels) = image.parts_mut();
    let rows = depth.par_chunks_exact_mut(width).zip(labels.par_chunks_exact_mut(width)).zip(camera.rays().par_chunks_exact(width));
    rows.for_each(|((depth, labels), rays)| {
        for (n, [x, y]) in rays.iter().enumerate() {
            // In lengths of the ray, whose z is 1 in the camera frame.
            if let Some(hit) = caster.hit(&eye, &(turn * Vector3::new(*x, *y, 1.0))).filter(|hit| *hit > 0.0) {
                (depth[n], labels[n]) = (hit as f32, label);
            }
        }
    });
    image
}

#[cfg(test)]
mod tests {
    use super::super::orbit;
    use super::*;
    use beo_camera::Intrinsics;
    use beo_core::grid::Dims;
    use proptest::prelude::*;

    /// Nearest entry among all filled voxels, each tested as a box.
    fn brute_force(object: &Occupancy, grid: &Grid, ray: &Vector3<f64>) -> Option<f64> {
        let to_grid = grid.grid_to_camera().inverse();
        let (eye, ray) = (to_grid * Point3::origin(), to_grid * ray);
        let dims = object.dims();
        let half = <[usize; 3]>::from(dims).map(|side| side as f64 / 2.0);
        let entry = |voxel: [usize; 3]| {
            let (mut enter, mut leave) = (f64::NEG_INFINITY, f64::INFINITY);
            for axis in 0..3 {
                let low = (voxel[axis] as f64 - half[axis]) * grid.voxel_size_m();
                let (a, b) = ((low - eye[axis]) / ray[axis], (low + grid.voxel_size_m() - eye[axis]) / ray[axis]);
                (enter, leave) = (enter.max(a.min(b)), leave.min(a.max(b)));
            }
            (enter < leave && enter > 0.0).then_some(enter)
        };
        object.bits().ones().filter_map(|v| entry(dims.coordinates(v))).min_by(f64::total_cmp)
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(24))]

        #[test]
        fn the_walk_finds_the_first_voxel_of_all(
            seed in any::<u64>(), share in 0.002..0.4_f64, azimuth in 0.0..6.3_f64, elevation in -1.5..1.5_f64, distance in 0.3..1.5_f64,
        ) {
            let dims = Dims::new(9, 12, 10).unwrap();
            let mut state = seed | 1;
            let object = Occupancy::from_fn(dims, |_, _, _| {
                state ^= state << 13;
                state ^= state >> 7;
                state ^= state << 17;
                (state >> 11) as f64 / (1_u64 << 53) as f64 <= share
            });
            let intrinsics = Intrinsics::new(32, 24, [30.0, 31.0], [15.3, 11.8], [-0.2, 0.05, 0.001, 0.002, 0.0]).unwrap();
            let camera = SyntheticCamera::new(intrinsics);
            let pose = orbit(&Point3::new(0.02, 0.01, 0.03), distance, azimuth, elevation).inverse();
            let grid = Grid::new([9, 12, 10], 0.02, pose).unwrap();
            let image = depth_of_occupancy(&camera, &object, &grid, 5);
            for (n, depth) in image.depth().iter().enumerate() {
                let expected = brute_force(&object, &grid, &intrinsics.ray([(n % 32) as f64, (n / 32) as f64]));
                prop_assert!((f64::from(*depth) - expected.unwrap_or(0.0)).abs() < 1e-5, "{depth} {expected:?}");
                prop_assert_eq!(image.labels()[n], if expected.is_some() { 5 } else { 0 });
            }
        }
    }

    #[test]
    fn a_camera_among_the_voxels_sees_what_is_ahead() {
        // The camera is in the empty middle of a hollow cube: its walls are 0.5 m away; axis-parallel rays have zero components.
        let dims = Dims::cube(12).unwrap();
        let object = Occupancy::from_fn(dims, |i, j, k| [i, j, k].iter().any(|v| *v == 0 || *v == 11));
        let grid = Grid::new([12; 3], 0.1, nalgebra::Isometry3::identity()).unwrap();
        let camera = SyntheticCamera::new(Intrinsics::new(9, 9, [20.0; 2], [4.0; 2], [0.0; 5]).unwrap());
        let image = depth_of_occupancy(&camera, &object, &grid, 1);
        assert!(image.depth().iter().all(|depth| (depth - 0.5).abs() < 1e-6), "{:?}", image.depth());
        // Nothing is seen from within a filled voxel, and of nothing.
        let full = Occupancy::from_fn(dims, |_, _, _| true);
        assert!(depth_of_occupancy(&camera, &full, &grid, 1).depth().iter().all(|depth| *depth == 0.0));
        assert!(depth_of_occupancy(&camera, &Occupancy::empty(dims), &grid, 1).depth().iter().all(|depth| *depth == 0.0));
    }
}
