//! Voxel files of another size or another upright axis, brought to a grid.

use super::placing::Placing;
use beo_core::grid::{Dims, Occupancy};

/// The grid turned by 90° about x, so that y becomes z and z becomes −y, as a mesh is turned whose y axis points up.
pub(super) fn stand_up(object: &Occupancy) -> Occupancy {
    let from = object.dims();
    let Ok(to) = Dims::new(from.x(), from.z(), from.y()) else { unreachable!("the sides are those of a grid") };
    Occupancy::from_fn(to, |i, j, k| object.is_filled(i, k, from.z() - 1 - j))
}

/// The shape on a grid of another size, by volume: a voxel is filled where at least half of it is. With [`Placing::LongestSide`] the filled
/// box is centred and scaled as a mesh is, with [`Placing::UnitCube`] the grids' unit cubes are laid onto each other. None if nothing is filled.
pub(super) fn resample(object: &Occupancy, dims: Dims, placing: Placing) -> Option<Occupancy> {
    let [low, high] = object.bounds()?;
    let (from, to) = (<[usize; 3]>::from(object.dims()), <[usize; 3]>::from(dims));
    // Voxels of the new grid along one of the file, and the place in the file that becomes the new grid's centre.
    let (scale, middle) = match placing {
        Placing::LongestSide(longest) => {
            let extent = (0..3).map(|axis| high[axis] - low[axis]).max()?;
            (longest as f64 / extent as f64, [0, 1, 2].map(|axis| (low[axis] + high[axis]) as f64 / 2.0))
        }
        Placing::UnitCube => {
            let (side, longest) = (to.iter().min()?, from.iter().max()?);
            (*side as f64 / *longest as f64, from.map(|side| side as f64 / 2.0))
        }
    };
    let parts = [0, 1, 2].map(|axis| shares(from[axis], to[axis], scale, middle[axis]));
    let sides = object.dims();
    let share = |i: usize, j: usize, k: usize| {
        let mut sum = 0.0;
        for (x, a) in &parts[0][i] {
            for (y, b) in &parts[1][j] {
                let row: f64 = parts[2][k].iter().filter(|(z, _)| object.bits().contains(sides.index(*x, *y, *z))).map(|(_, c)| c).sum();
                sum += a * b * row;
            }
        }
        sum
    };
    // Halves come out a little off.
    Some(Occupancy::from_fn(dims, |i, j, k| share(i, j, k) >= 0.5 - 1e-9))
}

/// Along one axis, for each new voxel the voxels of the file that it overlaps, each with its share of the new voxel's length.
fn shares(from: usize, to: usize, scale: f64, middle: f64) -> Vec<Vec<(usize, f64)>> {
    let back = |edge: f64| (edge - to as f64 / 2.0) / scale + middle;
    let part = |n: usize| {
        let (start, end) = (back(n as f64), back(n as f64 + 1.0));
        let (first, last) = (start.floor().max(0.0) as usize, end.ceil().clamp(0.0, from as f64) as usize);
        let overlap = |v: usize| (end.min(v as f64 + 1.0) - start.max(v as f64)).max(0.0) / (end - start);
        (first..last).map(|v| (v, overlap(v))).filter(|(_, share)| *share > 0.0).collect()
    };
    (0..to).map(part).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cube(side: usize) -> Dims {
        Dims::cube(side).unwrap()
    }

    #[test]
    fn y_becomes_z_and_z_becomes_minus_y() {
        let object = Occupancy::from_fn(Dims::new(8, 9, 10).unwrap(), |i, j, k| (i, j, k) == (1, 2, 3));
        let turned = stand_up(&object);
        assert_eq!(<[usize; 3]>::from(turned.dims()), [8, 10, 9]);
        assert!(turned.count() == 1 && turned.is_filled(1, 6, 2));
    }

    #[test]
    fn whole_factors_copy_voxels_and_come_back() {
        let small = Occupancy::from_fn(cube(10), |i, j, k| i < 6 && j < 4 + i / 3 && k < 8);
        let large = resample(&small, cube(20), Placing::UnitCube).unwrap();
        assert_eq!(large, Occupancy::from_fn(cube(20), |i, j, k| small.is_filled(i / 2, j / 2, k / 2)));
        assert_eq!(resample(&large, cube(10), Placing::UnitCube).unwrap(), small);
        // By volume: of a new voxel 8 of 27 are filled, or 18 of 27.
        let thin = |n: usize| Occupancy::from_fn(cube(30), |i, j, k| i % 3 < n && j % 3 < n && k < 30);
        assert!(resample(&thin(1), cube(10), Placing::UnitCube).unwrap().count() == 0);
        let most = Occupancy::from_fn(cube(30), |i, _, _| i % 3 < 2);
        assert_eq!(resample(&most, cube(10), Placing::UnitCube).unwrap().count(), 1000);
    }

    #[test]
    fn the_filled_box_comes_to_lie_as_a_mesh_does() {
        let object = Occupancy::from_fn(cube(64), |i, j, k| (3..51).contains(&i) && (10..34).contains(&j) && (40..56).contains(&k));
        let placed = resample(&object, cube(30), Placing::LongestSide(24)).unwrap();
        assert_eq!(placed.bounds().unwrap(), [[3, 9, 11], [27, 21, 19]]);
        assert_eq!(placed.count(), 24 * 12 * 8);
        assert!(resample(&Occupancy::empty(cube(9)), cube(30), Placing::LongestSide(24)).is_none());
    }
}
