//! The scene of the load `camera`: blocks on a table, rendered from their planes.

use beo_camera::{Frame, Intrinsics};
use nalgebra::{Matrix3, Point3, Vector3};

/// Pixels of a row, and rows.
const SIZE: [u32; 2] = [640, 480];
/// Focal length, pixels.
const FOCAL: f64 = 525.0;
/// Where the camera is; it looks at the middle of the table, metres.
const CAMERA: [f64; 3] = [-0.6, 0.0, 0.55];
/// Readings are whole millimetres.
const STEP: f64 = 0.001;

/// Middle of the foot, half the lengths of the sides, height: metres.
const BLOCKS: [Block; 6] = [
    ([-0.12, -0.20], [0.03, 0.05], 0.10),
    ([-0.15, 0.00], [0.04, 0.04], 0.12),
    ([-0.12, 0.19], [0.05, 0.03], 0.08),
    ([0.10, -0.24], [0.04, 0.06], 0.20),
    ([0.12, 0.03], [0.06, 0.04], 0.16),
    ([0.10, 0.26], [0.03, 0.03], 0.22),
];

/// Blocks that the table has room for.
pub const MOST_ON_TABLE: u32 = 20;
/// Blocks of a row where there are more than six, and the distances of rows and of blocks in a row, metres.
const ROW: u32 = 5;
const APART: [f64; 2] = [0.22, 0.2];

/// A rendered depth image with the label of the object of each pixel, and the camera that sees it.
#[derive(Clone, Debug)]
pub struct Scene {
    intrinsics: Intrinsics,
    /// Along the optical axis, metres; 0 for no reading.
    depth_m: Vec<f32>,
    labels: Vec<u16>,
}

impl Scene {
    /// The images and the camera.
    pub fn frame(&self) -> Frame<'_> {
        Frame::new(&self.intrinsics, &self.depth_m, &self.labels).expect("one value for each pixel")
    }
}

/// Middle of the foot, half the lengths of the sides, height: metres.
type Block = ([f64; 2], [f64; 2], f64);

/// The blocks of a scene: of up to six the first ones; of more, rows of low ones, so that none hides another.
fn blocks(count: u32) -> Vec<Block> {
    if count as usize <= BLOCKS.len() {
        return BLOCKS[..count as usize].to_vec();
    }
    let place = |n: u32| [f64::from(n / ROW) * APART[0] - 0.25, (f64::from(n % ROW) - 2.0) * APART[1]];
    (0..count).map(|n| (place(n), [0.03, 0.02 + 0.005 * f64::from(n % 4)], 0.06 + 0.01 * f64::from(n % 3))).collect()
}

/// A frame of 640 × 480 pixels that shows so many objects, at most [`MOST_ON_TABLE`], and the table that they stand on.
pub fn objects_on_table(count: u32) -> Scene {
    let blocks = blocks(count.min(MOST_ON_TABLE));
    let from = Point3::from(CAMERA);
    let z = -from.coords.normalize();
    let x = z.cross(&Vector3::z()).normalize();
    let camera_to_world = Matrix3::from_columns(&[x, z.cross(&x), z]);
    let centre = SIZE.map(|side| (f64::from(side) - 1.0) / 2.0);
    let (mut depth, mut labels) = (Vec::new(), Vec::new());
    for pixel in 0..SIZE[0] * SIZE[1] {
        let [u, v] = [pixel % SIZE[0], pixel / SIZE[0]].map(f64::from);
        let ray = camera_to_world * Vector3::new((u - centre[0]) / FOCAL, (v - centre[1]) / FOCAL, 1.0);
        let table = (ray.z < 0.0).then(|| (-from.z / ray.z, 0)).filter(|(t, _)| (from + ray * *t).coords.xy().abs().max() < 0.7);
        let blocks = blocks.iter().zip(1..).filter_map(|(block, label)| Some((enters(block, &from, &ray)?, label)));
        let (metres, label) = blocks.chain(table).fold((f64::INFINITY, 0), |near, hit| if hit.0 < near.0 { hit } else { near });
        depth.push(if metres.is_finite() { ((metres / STEP).round() * STEP) as f32 } else { 0.0 });
        labels.push(label);
    }
    let intrinsics = Intrinsics::new(SIZE[0], SIZE[1], [FOCAL; 2], centre, [0.0; 5]).expect("a camera");
    Scene { intrinsics, depth_m: depth, labels }
}

/// Where a ray enters a block, in its lengths.
fn enters((middle, half, height): &Block, from: &Point3<f64>, ray: &Vector3<f64>) -> Option<f64> {
    let low = [middle[0] - half[0], middle[1] - half[1], 0.0];
    let high = [middle[0] + half[0], middle[1] + half[1], *height];
    let (mut near, mut far) = (0.0_f64, f64::INFINITY);
    for axis in 0..3 {
        let [a, b] = [low, high].map(|corner| (corner[axis] - from[axis]) / ray[axis]);
        (near, far) = (near.max(a.min(b)), far.min(a.max(b)));
    }
    (near <= far).then_some(near)
}

#[cfg(test)]
mod tests {
    use super::*;
    use beo_camera::{GridOptions, lay_grids};

    #[test]
    fn all_objects_get_a_grid() {
        for count in [1, 6, 7, MOST_ON_TABLE] {
            let scene = objects_on_table(count);
            let laid = lay_grids(scene.frame(), &GridOptions::new([30; 3]));
            let objects: Vec<u32> = laid.objects.iter().map(|object| u32::from(object.object)).collect();
            assert_eq!(objects, (1..=count).collect::<Vec<_>>());
            assert!(laid.objects.iter().all(|object| object.grid.is_ok()), "{count}");
            assert!((laid.supports[0].height(&Point3::origin()) - CAMERA[2]).abs() < 2e-3);
        }
    }
}
