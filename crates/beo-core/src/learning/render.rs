//! Height maps of turned shapes, without turning the grids: a ray per column, from above, that leaps over empty space.
//!
//! At a voxel whose nearest filled one is D away (in the largest coordinate), the next D − 1 unit steps in any direction meet
//! none, so the ray leaps D steps at once. The result is that of turning the grid and taking its view from above.

use crate::grid::{Dims, HeightMap, Occupancy, Rotation};

/// A shape prepared for rendering from many sides.
pub struct Renderer {
    dims: Dims,
    /// Chebyshev distance of each voxel to the nearest filled one; 0 where filled.
    clearance: Vec<u8>,
    /// Bounding box of the filled voxels, half a voxel wider; empty for an empty shape.
    low: [f64; 3],
    high: [f64; 3],
}

impl Renderer {
    /// Prepares a shape.
    pub fn new(object: &Occupancy) -> Self {
        let dims = object.dims();
        let (mut low, mut high) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
        for voxel in object.bits().ones() {
            for (axis, at) in dims.coordinates(voxel).into_iter().enumerate() {
                low[axis] = low[axis].min(at as f64 - 0.5);
                high[axis] = high[axis].max(at as f64 + 0.5);
            }
        }
        Self { dims, clearance: chebyshev(object), low, high }
    }

    /// Heights of the `columns` (indices) of the shape turned by `rotation`, into `map`; its other columns are left as they are.
    pub fn render(&self, rotation: &Rotation, columns: impl IntoIterator<Item = usize>, map: &mut HeightMap) {
        let back = rotation.inverse().to_rotation_matrix();
        let back = back.matrix();
        let sides = <[usize; 3]>::from(self.dims);
        let middle = sides.map(|side| (side as f64 - 1.0) / 2.0);
        let up: [f64; 3] = std::array::from_fn(|axis| back[(axis, 2)]);
        let tops = map.tops_mut();
        for column in columns {
            let (x, y) = ((column / sides[1]) as f64 - middle[0], (column % sides[1]) as f64 - middle[1]);
            let start: [f64; 3] = std::array::from_fn(|axis| back[(axis, 0)] * x + back[(axis, 1)] * y + middle[axis]);
            tops[column] = self.march(start, up, middle[2]);
        }
    }

    /// The height at which the ray `start` + `up` · z first meets a filled voxel, from above; z is from −`middle` to `middle`.
    fn march(&self, start: [f64; 3], up: [f64; 3], middle: f64) -> u16 {
        let (mut from, mut to) = (-middle, middle);
        for axis in 0..3 {
            if up[axis].abs() < 1e-9 {
                if start[axis] < self.low[axis] - 1e-6 || start[axis] > self.high[axis] + 1e-6 {
                    return 0;
                }
                continue;
            }
            let (a, b) = ((self.low[axis] - start[axis]) / up[axis], (self.high[axis] - start[axis]) / up[axis]);
            from = from.max(a.min(b));
            to = to.min(a.max(b));
        }
        if from > to + 1e-6 {
            return 0;
        }
        let lowest = (from + middle - 1e-6).ceil().max(0.0) as i64;
        let mut k = (to + middle + 1e-6).floor().min(2.0 * middle) as i64;
        let padded = padded(self.dims);
        while k >= lowest {
            let z = k as f64 - middle;
            // Half a voxel to round, and one for the border; what is negative by rounding errors is on the border.
            let [i, j, l] = std::array::from_fn(|axis| (start[axis] + up[axis] * z + 1.5) as usize);
            let clear = self.clearance[(i * padded[1] + j) * padded[2] + l];
            if clear == 0 {
                return k as u16 + 1;
            }
            k -= i64::from(clear);
        }
        0
    }
}

/// Sides of a grid with a border of one voxel.
fn padded(dims: Dims) -> [usize; 3] {
    <[usize; 3]>::from(dims).map(|side| side + 2)
}

/// Chebyshev distance of every voxel to the nearest filled one, at most 255, on the grid with a border; 1 on the border.
///
/// In this metric the distance is one more than the least of the neighbours', so a sweep in either direction finds it.
fn chebyshev(object: &Occupancy) -> Vec<u8> {
    let dims = object.dims();
    let sides = padded(dims);
    let index = |i: usize, j: usize, l: usize| (i * sides[1] + j) * sides[2] + l;
    let mut out = vec![u8::MAX; sides.iter().product()];
    for voxel in object.bits().ones() {
        let [i, j, l] = dims.coordinates(voxel);
        out[index(i + 1, j + 1, l + 1)] = 0;
    }
    // How far back the 13 neighbours are that come before a voxel in C order.
    let back: [usize; 13] = std::array::from_fn(|n| index(1, 1, 1) - index(n / 9, n / 3 % 3, n % 3));
    for i in 1..=dims.x() {
        for j in 1..=dims.y() {
            for l in 1..=dims.z() {
                let at = index(i, j, l);
                let nearest = back.iter().fold(u8::MAX, |least, by| least.min(out[at - by]));
                out[at] = out[at].min(nearest.saturating_add(1));
            }
        }
    }
    for i in (1..=dims.x()).rev() {
        for j in (1..=dims.y()).rev() {
            for l in (1..=dims.z()).rev() {
                let at = index(i, j, l);
                let nearest = back.iter().fold(u8::MAX, |least, by| least.min(out[at + by]));
                out[at] = out[at].min(nearest.saturating_add(1));
            }
        }
    }
    let border = |at: usize, side: usize| at == 0 || at + 1 == side;
    for (at, clear) in out.iter_mut().enumerate() {
        let [i, j, l] = [at / (sides[1] * sides[2]), at / sides[2] % sides[1], at % sides[2]];
        if border(i, sides[0]) || border(j, sides[1]) || border(l, sides[2]) {
            *clear = 1;
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::furniture;
    use crate::grid::{Observation, Turn};
    use nalgebra::Quaternion;
    use proptest::prelude::*;

    fn rendered(object: &Occupancy, rotation: &Rotation) -> HeightMap {
        let mut map = HeightMap::new(object.dims());
        Renderer::new(object).render(rotation, 0..object.dims().columns(), &mut map);
        map
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(48))]
        #[test]
        fn heights_are_those_of_the_turned_grid(q in prop::array::uniform4(-1.0..1.0_f64), seed in 0..1000_u64, cubic: bool) {
            prop_assume!(q.iter().map(|v| v * v).sum::<f64>() > 0.01);
            let rotation = Rotation::from_quaternion(Quaternion::new(q[0], q[1], q[2], q[3]));
            let dims = if cubic { Dims::cube(17).unwrap() } else { Dims::new(16, 11, 14).unwrap() };
            let class = furniture::CLASSES[seed as usize % 10];
            let object = furniture::make(class, dims, seed).unwrap();
            let turned = Turn::new(dims, &rotation).occupancy(&object);
            prop_assert_eq!(rendered(&object, &rotation), HeightMap::of(&Observation::complete(&turned)));
        }
    }

    #[test]
    fn the_rotations_of_the_cube_are_exact() {
        let dims = Dims::cube(12).unwrap();
        let object = furniture::make("chair", dims, 5).unwrap();
        let quarter = |axis| Rotation::from_axis_angle(&axis, std::f64::consts::FRAC_PI_2);
        let (x, z) = (quarter(nalgebra::Vector3::x_axis()), quarter(nalgebra::Vector3::z_axis()));
        for rotation in [Rotation::identity(), x, x * x, z * x, x * z, z * z * x * z] {
            let turned = Turn::new(dims, &rotation).occupancy(&object);
            assert_eq!(rendered(&object, &rotation), HeightMap::of(&Observation::complete(&turned)));
        }
    }

    #[test]
    fn an_empty_shape_has_no_height() {
        let dims = Dims::cube(8).unwrap();
        assert_eq!(rendered(&Occupancy::empty(dims), &crate::grid::yaw(0.3)), HeightMap::new(dims));
    }

    #[test]
    fn clearances_are_chebyshev_distances() {
        let dims = Dims::new(8, 9, 10).unwrap();
        let object = Occupancy::from_fn(dims, |i, j, k| [(1, 2, 3), (6, 7, 1), (3, 8, 9)].contains(&(i, j, k)));
        let (clearance, sides) = (chebyshev(&object), padded(dims));
        for voxel in 0..dims.voxels() {
            let [i, j, k] = dims.coordinates(voxel);
            let distance = |other: usize| {
                let [a, b, c] = dims.coordinates(other);
                i.abs_diff(a).max(j.abs_diff(b)).max(k.abs_diff(c))
            };
            let expected = object.bits().ones().map(distance).min().unwrap();
            assert_eq!(usize::from(clearance[((i + 1) * sides[1] + j + 1) * sides[2] + k + 1]), expected);
        }
    }
}
