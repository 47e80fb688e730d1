//! Where a ray first meets an object: voxel by voxel along the ray (Amanatides and Woo, "A fast voxel traversal algorithm for ray
//! tracing", Eurographics 1987).

use super::Occupancy;
use nalgebra::{Point3, Vector3};

/// An object, ready for rays.
pub struct RayCaster<'a> {
    object: &'a Occupancy,
    /// The box about the filled voxels: lower corner and upper corner (exclusive), voxels.
    bounds: [[usize; 3]; 2],
}

impl<'a> RayCaster<'a> {
    /// `None` for an object without a filled voxel.
    pub fn new(object: &'a Occupancy) -> Option<Self> {
        object.bounds().map(|bounds| Self { object, bounds })
    }

    /// The box about the filled voxels: lower corner and upper corner (exclusive), voxels.
    pub fn bounds(&self) -> [[usize; 3]; 2] {
        self.bounds
    }

    /// The least t ≥ 0 at which origin + t · direction lies in a filled voxel; voxel (i, j, k) is the box from (i, j, k) to
    /// (i + 1, j + 1, k + 1). `None` where the ray meets none.
    pub fn hit(&self, origin: &Point3<f64>, direction: &Vector3<f64>) -> Option<f64> {
        let (mut near, mut far) = (0.0_f64, f64::INFINITY);
        for axis in 0..3 {
            let (low, high) = (self.bounds[0][axis] as f64, self.bounds[1][axis] as f64);
            if direction[axis] == 0.0 {
                if origin[axis] < low || origin[axis] >= high {
                    return None;
                }
                continue;
            }
            let (a, b) = ((low - origin[axis]) / direction[axis], (high - origin[axis]) / direction[axis]);
            (near, far) = (near.max(a.min(b)), far.min(a.max(b)));
        }
        if near > far {
            return None;
        }
        let mut voxel = [0_usize; 3];
        let (mut next, mut step) = ([f64::INFINITY; 3], [f64::INFINITY; 3]);
        for axis in 0..3 {
            let at = origin[axis] + near * direction[axis];
            voxel[axis] = (at.floor().max(0.0) as usize).clamp(self.bounds[0][axis], self.bounds[1][axis] - 1);
            if direction[axis] != 0.0 {
                let border = voxel[axis] as f64 + f64::from(u8::from(direction[axis] > 0.0));
                next[axis] = (border - origin[axis]) / direction[axis];
                step[axis] = 1.0 / direction[axis].abs();
            }
        }
        let mut t = near;
        loop {
            let [i, j, k] = voxel;
            if self.object.is_filled(i, j, k) {
                return Some(t);
            }
            let axis = if next[0] <= next[1] && next[0] <= next[2] {
                0
            } else if next[1] <= next[2] {
                1
            } else {
                2
            };
            t = next[axis];
            if direction[axis] > 0.0 {
                voxel[axis] += 1;
                if voxel[axis] >= self.bounds[1][axis] {
                    return None;
                }
            } else {
                if voxel[axis] <= self.bounds[0][axis] {
                    return None;
                }
                voxel[axis] -= 1;
            }
            next[axis] += step[axis];
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::Dims;
    use proptest::prelude::*;

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(200))]
        /// Against the nearest of the boxes of all filled voxels.
        #[test]
        fn the_first_voxel_is_the_nearest_box(
            voxels in prop::collection::vec(0..8_usize * 9 * 10, 1..30),
            from in prop::array::uniform3(-12.0..20.0_f64),
            towards in prop::array::uniform3(-1.0..11.0_f64),
        ) {
            let dims = Dims::new(8, 9, 10).unwrap();
            let object = Occupancy::from_fn(dims, |i, j, k| voxels.contains(&dims.index(i, j, k)));
            let (origin, direction) = (Point3::from(from), Vector3::from(towards) - Vector3::from(from));
            let enters = |voxel: &usize| {
                let corner = dims.coordinates(*voxel);
                let (mut near, mut far) = (0.0_f64, f64::INFINITY);
                for axis in 0..3 {
                    let (a, b) = ((corner[axis] as f64 - origin[axis]) / direction[axis], (corner[axis] as f64 + 1.0 - origin[axis]) / direction[axis]);
                    (near, far) = (near.max(a.min(b)), far.min(a.max(b)));
                }
                (near < far).then_some(near)
            };
            let expected = voxels.iter().filter_map(enters).reduce(f64::min);
            let found = RayCaster::new(&object).unwrap().hit(&origin, &direction);
            match (found, expected) {
                (Some(a), Some(b)) => prop_assert!((a - b).abs() < 1e-9, "{a} {b}"),
                (a, b) => prop_assert_eq!(a, b),
            }
        }
    }
}
