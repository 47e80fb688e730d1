//! Bases and classes learned from some of the shapes.

use super::basis::{ClassBasis, shared_basis};
use super::error::TrainError;
use super::gram::overlaps;
use super::options::{FEWEST_SHAPES, TrainOptions};
use super::progress::Pass;
use super::shrinkage::centre;
use crate::grid::{Dims, Occupancy, View};
use crate::model::{Basis, ClassModel, Footprint, levels_of};
use crate::perception::{BasisRows, SharedRows};
use faer::Mat;
use fixedbitset::FixedBitSet;
use rand::SeedableRng;
use rand::seq::SliceRandom;
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

/// Least noise variance, relative to a voxel's variance about the class mean: as many components as there are shapes leave none, and
/// unseen shapes then seem impossible. Classes with shapes enough are far above it.
const LEAST_NOISE: f64 = 0.05;

/// The shapes by class, and their inner products.
pub(super) struct Data<'a> {
    pub dims: Dims,
    pub classes: Vec<Vec<&'a Occupancy>>,
    /// True lengths of the shapes, metres, if they are known.
    pub lengths_m: Option<Vec<Vec<[f64; 3]>>>,
    overlaps: Vec<Mat<f64>>,
}

/// Which shapes of each class a fold trains on, and which it holds out.
pub(super) struct Fold {
    pub kept: Vec<Vec<usize>>,
    pub held: Vec<(usize, usize)>,
}

impl<'a> Data<'a> {
    /// Shapes of one size, by class.
    pub fn new(dims: Dims, classes: Vec<Vec<&'a Occupancy>>) -> Self {
        let overlaps = classes.iter().map(|c| overlaps(c)).collect();
        Self { dims, classes, lengths_m: None, overlaps }
    }

    /// Stratified folds by a seeded shuffle of each class.
    pub fn folds(&self, options: &TrainOptions) -> Vec<Fold> {
        let count = options.folds.clamp(2, FEWEST_SHAPES);
        let mut rng = ChaCha8Rng::seed_from_u64(options.seed);
        let mut folds: Vec<Fold> = (0..count).map(|_| Fold { kept: vec![Vec::new(); self.classes.len()], held: Vec::new() }).collect();
        for (s, class) in self.classes.iter().enumerate() {
            let mut order: Vec<usize> = (0..class.len()).collect();
            order.shuffle(&mut rng);
            for (position, &i) in order.iter().enumerate() {
                for (f, fold) in folds.iter_mut().enumerate() {
                    if position % count == f { fold.held.push((s, i)) } else { fold.kept[s].push(i) }
                }
            }
        }
        for fold in &mut folds {
            fold.kept.iter_mut().for_each(|kept| kept.sort_unstable());
        }
        folds
    }
}

/// Bases and classes learned from some of the shapes.
pub(super) struct Fit {
    pub basis: Basis,
    /// Where W' is not zero, if it is read in place.
    pub footprint: Option<Footprint>,
    pub reading: BasisRows,
    pub classes: Vec<ClassFit>,
    pub noise: f64,
}

pub(super) struct ClassFit {
    /// Without covariance and hulls.
    pub model: ClassModel,
    /// The class's objects in W', n_s × a.
    pub projected: Mat<f32>,
    pub explained: f64,
    pub noise_variance: f64,
}

impl Fit {
    /// Learns from the shapes `kept` of each class. `pass` is told when a pass over all voxels begins.
    pub fn new(data: &Data<'_>, kept: &[Vec<usize>], options: &TrainOptions, pass: &dyn Fn(Pass)) -> Result<Self, TrainError> {
        let range = options.basis_range[0]..=options.basis_range[1];
        let bases: Vec<ClassBasis> = (0..kept.len())
            .into_par_iter()
            .map(|s| {
                let rows = &kept[s];
                let overlaps = Mat::from_fn(rows.len(), rows.len(), |i, j| data.overlaps[s][(rows[i], rows[j])]);
                ClassBasis::new(&overlaps, data.dims.voxels(), options.variance_share, range.clone())
            })
            .collect::<Result<_, _>>()?;
        let shapes: Vec<Vec<&Occupancy>> =
            kept.iter().enumerate().map(|(s, rows)| rows.iter().map(|i| data.classes[s][*i]).collect()).collect();
        let parts: Vec<_> = shapes.iter().map(Vec::as_slice).zip(&bases).collect();
        let basis = shared_basis(data.dims, &parts, pass)?;
        pass(Pass::Reading);
        // The same grids as those on which poses are not searched: tables would be several times the size of W'.
        let footprint = match levels_of(data.dims).is_empty() {
            true => None,
            false => Some(SharedRows::over(data.dims, basis.clone(), union(data.dims, &shapes)).expect("it is in memory").footprint()),
        };
        let reading = BasisRows::new(data.dims, &basis, footprint.as_ref());
        pass(Pass::Projecting);
        let objects: f64 = kept.iter().map(|rows| rows.len() as f64).sum();
        let mean = |of: fn(&ClassBasis) -> f64| bases.iter().zip(kept).map(|(b, rows)| of(b) * rows.len() as f64).sum::<f64>() / objects;
        let noise = mean(|b| b.vbpca.noise_variance).max(LEAST_NOISE * mean(|b| b.voxel_variance));
        let classes = bases
            .iter()
            .zip(&shapes)
            .map(|(class, shapes)| {
                let projected = project(&reading, basis.rank(), shapes.len(), |i| shapes[i].bits().clone());
                let directions = class.directions(projected.as_ref());
                let (mean, _) = centre(projected.as_ref());
                ClassFit {
                    model: ClassModel {
                        mean: mean.iter().map(|v| *v as f32).collect(),
                        covariance: Vec::new(),
                        directions: (0..directions.ncols()).flat_map(|h| directions.col_as_slice(h).to_vec()).collect(),
                        variances: class.vbpca.components.iter().map(|c| c.variance).collect(),
                        hulls: Vec::new(),
                    },
                    projected,
                    explained: class.explained,
                    noise_variance: class.vbpca.noise_variance,
                }
            })
            .collect();
        Ok(Self { basis, footprint, reading, classes, noise })
    }

    /// Projections of the hulls of some shapes of each class, n_s × a.
    pub fn project_hulls(&self, data: &Data<'_>, chosen: &[Vec<usize>], view: View) -> Vec<Mat<f32>> {
        let hull = |s: usize, i: usize| view.of(data.classes[s][chosen[s][i]]).hull().bits().clone();
        (0..chosen.len()).map(|s| project(&self.reading, self.basis.rank(), chosen[s].len(), |i| hull(s, i))).collect()
    }
}

/// Projects `count` binary vectors, one per row.
pub(super) fn project(reading: &BasisRows, rank: usize, count: usize, bits: impl Fn(usize) -> fixedbitset::FixedBitSet + Sync) -> Mat<f32> {
    let rows: Vec<Vec<f32>> = (0..count)
        .into_par_iter()
        .map(|i| {
            let mut row = vec![0.0; rank];
            reading.project(&bits(i), &mut row);
            row
        })
        .collect();
    Mat::from_fn(count, rank, |i, j| rows[i][j])
}

/// The voxels that any of these shapes fills.
fn union(dims: Dims, shapes: &[Vec<&Occupancy>]) -> FixedBitSet {
    let mut all = FixedBitSet::with_capacity(dims.voxels());
    shapes.iter().flatten().for_each(|shape| all.union_with(shape.bits()));
    all
}
