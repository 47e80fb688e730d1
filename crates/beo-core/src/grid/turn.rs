//! Turning grids about their centre, nearest neighbour.
//!
//! A voxel of the turned grid takes the value of the voxel that its centre comes from; what comes from outside is [`Outside`]. Quarter
//! turns about an axis are exact permutations.

use super::rotation::{Rotation, yaw_of};
use super::{Dims, Observation, Occupancy, Similarity};
use crate::lanes::{Kernel, dispatch};
use fixedbitset::FixedBitSet;
use nalgebra::{Matrix3, Vector3};
use rayon::prelude::*;

/// Content of the space outside a grid.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Outside {
    /// The grid holds the whole object.
    #[default]
    Empty,
    /// Nothing is known.
    Unknown,
}

/// A source that lies outside the grid.
const NOWHERE: u32 = u32::MAX;

/// Where the voxels of a turned grid come from.
#[derive(Clone, Debug)]
pub struct Turn {
    dims: Dims,
    sources: Vec<u32>,
}

/// Voxels up to which a grid is worked on by one thread: waking another costs as much as it would save.
pub(crate) const ALONE: usize = 40 * 40 * 40;

impl Turn {
    /// A turn that is still to be set.
    pub fn unset(dims: Dims) -> Self {
        Self { dims, sources: Vec::new() }
    }

    /// The turn of grids of one size by `rotation`.
    pub fn new(dims: Dims, rotation: &Rotation) -> Self {
        let mut turn = Self::unset(dims);
        turn.set(rotation);
        turn
    }

    /// Becomes the turn by another rotation.
    pub fn set(&mut self, rotation: &Rotation) {
        if rotation.i == 0.0 && rotation.j == 0.0 {
            let Self { dims, sources } = self;
            sources.resize(dims.voxels(), NOWHERE);
            let height = dims.z();
            let mut columns = sources.chunks_exact_mut(height);
            for_each_column_source(*dims, yaw_of(rotation), |source| {
                let column = columns.next().expect("as many columns as there are");
                match source {
                    Some(source) => column.iter_mut().zip(source * height..).for_each(|(to, from)| *to = from as u32),
                    None => column.fill(NOWHERE),
                }
            });
            return;
        }
        let back = rotation.inverse().to_rotation_matrix();
        self.set_sources(back.matrix(), &Vector3::zeros());
    }

    /// Becomes the way from the grid to the object's canonical grid: what the object looks like there.
    pub fn set_to_object(&mut self, placed: &Similarity) {
        if placed.is_turned_only() {
            return self.set(&placed.rotation.inverse());
        }
        let (matrix, offset) = placed.map();
        self.set_sources(&matrix, &offset);
    }

    /// Becomes the way from the object's canonical grid to the grid in which it is placed.
    pub fn set_to_grid(&mut self, placed: &Similarity) {
        if placed.is_turned_only() {
            return self.set(&placed.rotation);
        }
        let (matrix, offset) = placed.inverse_map();
        self.set_sources(&matrix, &offset);
    }

    /// Every voxel p, from the centre, comes from matrix · p + offset.
    fn set_sources(&mut self, matrix: &Matrix3<f64>, offset: &Vector3<f64>) {
        let Self { dims, sources } = self;
        sources.resize(dims.voxels(), NOWHERE);
        let sides = <[usize; 3]>::from(*dims);
        let middle = sides.map(|side| (side as f64 - 1.0) / 2.0);
        let set_layer = |(i, layer): (usize, &mut [u32])| {
            let x = i as f64 - middle[0];
            dispatch(LayerSources { matrix, offset, sides, middle, x, layer });
        };
        let layer = sides[1] * sides[2];
        if dims.voxels() <= ALONE {
            sources.chunks_exact_mut(layer).enumerate().for_each(set_layer);
        } else {
            sources.par_chunks_exact_mut(layer).enumerate().for_each(set_layer);
        }
    }

    /// The turned object; what enters is empty.
    pub fn occupancy(&self, object: &Occupancy) -> Occupancy {
        assert_eq!(object.dims(), self.dims, "a turn belongs to one size of grid");
        let mut turned = FixedBitSet::with_capacity(self.dims.voxels());
        self.gather(object.bits(), false, &mut turned);
        Occupancy::from_bits(self.dims, turned)
    }

    /// The turned observation.
    pub fn observation(&self, observation: &Observation, outside: Outside) -> Observation {
        let mut turned = Observation::unknown(self.dims);
        self.observation_into(observation, outside, &mut turned);
        turned
    }

    /// Writes the turned observation into one of the same size.
    pub fn observation_into(&self, observation: &Observation, outside: Outside, turned: &mut Observation) {
        assert_eq!([observation.dims(), turned.dims()], [self.dims; 2], "a turn belongs to one size of grid");
        let (known, filled) = turned.parts_mut();
        self.gather(observation.known(), outside == Outside::Empty, known);
        self.gather(observation.filled(), false, filled);
    }

    /// One value per voxel, turned; what enters is `outside`.
    pub fn values<V: Copy + Send + Sync>(&self, from: &[V], outside: V, to: &mut [V]) {
        assert_eq!([from.len(), to.len()], [self.dims.voxels(); 2], "one value per voxel");
        let value = |source: &u32| from.get(*source as usize).copied().unwrap_or(outside);
        if self.dims.voxels() <= ALONE {
            to.iter_mut().zip(&self.sources).for_each(|(to, source)| *to = value(source));
        } else {
            to.par_iter_mut().zip(&self.sources).with_min_len(1 << 16).for_each(|(to, source)| *to = value(source));
        }
    }

    fn gather(&self, from: &FixedBitSet, outside: bool, to: &mut FixedBitSet) {
        const WORD: usize = usize::BITS as usize;
        let gather = |(word, sources): (&mut usize, &[u32])| {
            *word = 0;
            for (bit, source) in sources.iter().enumerate() {
                let set = if *source == NOWHERE { outside } else { from.contains(*source as usize) };
                *word |= usize::from(set) << bit;
            }
        };
        if self.dims.voxels() <= ALONE {
            to.as_mut_slice().iter_mut().zip(self.sources.chunks(WORD)).for_each(gather);
        } else {
            to.as_mut_slice().par_iter_mut().zip(self.sources.par_chunks(WORD)).with_min_len(1 << 10).for_each(gather);
        }
    }
}

/// The sources of the voxels of one layer, at x from the centre; see [`Turn::set_sources`].
struct LayerSources<'a> {
    matrix: &'a Matrix3<f64>,
    offset: &'a Vector3<f64>,
    sides: [usize; 3],
    middle: [f64; 3],
    x: f64,
    layer: &'a mut [u32],
}

impl Kernel for LayerSources<'_> {
    type Output = ();

    #[inline(always)]
    fn run<const FUSED: bool>(self) {
        let Self { matrix, offset, sides, middle, x, layer } = self;
        let [nx, ny, nz] = sides.map(|side| side as f64);
        let [a, b, c] = [matrix[(0, 2)], matrix[(1, 2)], matrix[(2, 2)]];
        for (j, column) in layer.chunks_exact_mut(sides[2]).enumerate() {
            let y = j as f64 - middle[1];
            let start = |axis: usize| matrix[(axis, 0)] * x + matrix[(axis, 1)] * y + offset[axis] + middle[axis];
            let (at_x, at_y, at_z) = (start(0), start(1), start(2));
            for (k, source) in column.iter_mut().enumerate() {
                let z = k as f64 - middle[2];
                let (i, j, k) = (nearest(at_x + a * z), nearest(at_y + b * z), nearest(at_z + c * z));
                let inside = (i >= 0.0) & (i < nx) & (j >= 0.0) & (j < ny) & (k >= 0.0) & (k < nz);
                let index = whole((i * ny + j) * nz + k);
                *source = if inside { index } else { NOWHERE };
            }
        }
    }
}

/// A whole number from 0 to 2³² − 1, in a way that many are converted at once.
#[inline(always)]
fn whole(x: f64) -> u32 {
    (x + ROUND).to_bits() as u32
}

/// For a turn about z by `angle`: calls the function with the column that each column of the turned grid comes from, one after the
/// other; `None` for outside.
#[inline]
pub fn for_each_column_source(dims: Dims, angle: f64, mut each: impl FnMut(Option<usize>)) {
    let (sin, cos) = snapped(angle);
    let (mx, my) = ((dims.x() as f64 - 1.0) / 2.0, (dims.y() as f64 - 1.0) / 2.0);
    for i in 0..dims.x() {
        let x = i as f64 - mx;
        for j in 0..dims.y() {
            let y = j as f64 - my;
            let (i, j) = (nearest(cos * x + sin * y + mx), nearest(cos * y - sin * x + my));
            let inside = i >= 0.0 && j >= 0.0 && i < dims.x() as f64 && j < dims.y() as f64;
            each(inside.then(|| i as usize * dims.y() + j as usize));
        }
    }
}

/// The nearest whole number, ties to even, as [`f64::round_ties_even`] gives it for |x| < 2⁵¹; that one calls a library where
/// the CPU is not known to round.
#[inline(always)]
pub(crate) fn nearest(x: f64) -> f64 {
    (x + ROUND) - ROUND
}

/// Adding it rounds to the nearest whole number, which is left in the low bits.
const ROUND: f64 = 1.5 * (1_u64 << 52) as f64;

/// Sine and cosine, exact for quarter turns.
fn snapped(angle: f64) -> (f64, f64) {
    let (sin, cos) = angle.sin_cos();
    let snap = |v: f64| if (v - v.round()).abs() < 1e-12 { v.round() } else { v };
    (snap(sin), snap(cos))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::{View, yaw};
    use proptest::prelude::*;
    use std::f64::consts::{FRAC_PI_2, PI};

    fn asymmetric() -> Occupancy {
        let dims = Dims::cube(9).unwrap();
        Occupancy::from_fn(dims, |i, j, k| (i == 7 && j < 6 && k == 2) || (i > 2 && j == 5 && k == 2) || (i == 3 && j == 4 && k < 6))
    }

    #[test]
    fn the_nearest_whole_number_is_that_of_the_standard_library() {
        for x in (-4000..4000).map(|i| f64::from(i) / 16.0).chain([0.499_999_999_999_999_94, 1e6 + 0.5]) {
            assert_eq!(nearest(x), x.round_ties_even(), "{x}");
        }
    }

    #[test]
    fn positive_yaw_is_counter_clockwise_seen_from_above() {
        let dims = Dims::cube(8).unwrap();
        // A voxel on the +x side goes to the +y side.
        let object = Occupancy::from_fn(dims, |i, j, k| (i, j, k) == (7, 3, 1));
        let turned = Turn::new(dims, &yaw(FRAC_PI_2)).occupancy(&object);
        // (x, y) = (3.5, −0.5) becomes (0.5, 3.5)
        assert_eq!(turned.bits().ones().map(|v| dims.coordinates(v)).collect::<Vec<_>>(), [[4, 7, 1]]);
    }

    #[test]
    fn quarter_turns_are_permutations_and_four_of_them_are_none() {
        for dims in [Dims::cube(8).unwrap(), Dims::cube(9).unwrap(), Dims::cube(30).unwrap()] {
            for axis in [Vector3::x_axis(), Vector3::y_axis(), Vector3::z_axis()] {
                let turn = Turn::new(dims, &Rotation::from_axis_angle(&axis, FRAC_PI_2));
                let mut seen = turn.sources.clone();
                seen.sort_unstable();
                assert!(seen.iter().copied().eq(0..dims.voxels() as u32));
                let back = |v: u32| turn.sources[v as usize];
                assert!((0..dims.voxels() as u32).all(|v| back(back(back(back(v)))) == v));
            }
        }
    }

    #[test]
    fn what_enters_is_empty_or_unknown_as_asked() {
        let dims = Dims::cube(8).unwrap();
        let turn = Turn::new(dims, &yaw(PI / 4.0));
        let view = View::Top.of(&Occupancy::empty(dims));
        assert_eq!(turn.observation(&view, Outside::Empty).known().count_ones(..), dims.voxels());
        let entering = turn.sources.iter().filter(|s| **s == NOWHERE).count();
        assert!(entering > 0);
        assert_eq!(turn.observation(&view, Outside::Unknown).known().count_ones(..), dims.voxels() - entering);
    }

    #[test]
    fn a_turn_about_z_turns_every_layer_alike() {
        // The formula of beo_numpy.py's `rotate`, layer by layer.
        let object = asymmetric();
        let turned = Turn::new(object.dims(), &yaw(30_f64.to_radians())).occupancy(&object);
        let (sin, cos) = 30_f64.to_radians().sin_cos();
        let expected = Occupancy::from_fn(object.dims(), |i, j, k| {
            let (x, y) = (i as f64 - 4.0, j as f64 - 4.0);
            let (a, b) = ((cos * x + sin * y + 4.0).round_ties_even(), (cos * y - sin * x + 4.0).round_ties_even());
            a >= 0.0 && b >= 0.0 && object.is_filled(a as usize, b as usize, k)
        });
        assert_eq!(turned, expected);
    }

    proptest! {
        #[test]
        fn turning_columns_is_turning_voxels(angle in -7.0..7.0_f64) {
            let dims = Dims::new(9, 12, 8).unwrap();
            let turn = Turn::new(dims, &yaw(angle));
            let mut columns = Vec::new();
            for_each_column_source(dims, angle, |source| columns.push(source));
            prop_assert_eq!(columns.len(), dims.columns());
            for (column, source) in columns.into_iter().enumerate() {
                for k in 0..dims.z() {
                    let expected = source.map_or(NOWHERE, |source| (source * dims.z() + k) as u32);
                    prop_assert_eq!(turn.sources[column * dims.z() + k], expected);
                }
            }
        }
    }
}
