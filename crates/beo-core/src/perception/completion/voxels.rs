//! Completion: from the posteriors of the likely classes to one probability and one deviation per voxel (eq. 6 and the
//! evidence's posterior mean).

use crate::lanes::{self, Kernel, LANES, Lanes};
use crate::model::CompletionCalibration;
use crate::perception::basis::columns::BlockScratch;
use crate::perception::evidence::prediction::Posterior;
use crate::perception::evidence::subspace::ClassSubspace;

/// A class that takes part in a completion.
#[derive(Clone, Copy)]
pub struct Part<'a> {
    /// Its share; the shares sum to one.
    pub weight: f32,
    /// The class.
    pub class: &'a ClassSubspace,
    /// Its posterior given the known voxels.
    pub posterior: &'a Posterior,
}

/// Values outside are clipped before their logit is taken.
const CLIP: f32 = 0.02;

#[inline(always)]
fn logit(value: f32) -> f32 {
    let value = value.clamp(CLIP, 1.0 - CLIP);
    lanes::ln(value / (1.0 - value))
}

/// Features of one voxel that the calibration reads; also used to fit it.
#[derive(Clone, Copy, Debug)]
pub struct VoxelFeatures {
    /// Posterior mean m of the occupancy, clamped to \[0, 1\].
    pub mean: f32,
    /// Its variance: within the classes and between them.
    pub variance: f32,
    /// Weighted class mean.
    pub class_mean: f32,
    /// Unknown voxels from the known one above down to this one, at least one.
    pub depth: f32,
}

impl VoxelFeatures {
    /// The regressors of the calibration, in the order of [`weights`].
    #[inline(always)]
    pub fn regressors(&self) -> [f32; 5] {
        let surface = if self.depth == 1.0 { 1.0 } else { 0.0 };
        [1.0, logit(self.mean), logit(self.class_mean), lanes::ln(self.depth), surface]
    }

    /// Probability that the voxel is filled, and the deviation of that probability by the delta method, at most ½.
    #[inline(always)]
    pub fn probability(&self, weights: &[f32; 5]) -> (f32, f32) {
        let [one, mean, class_mean, depth, surface] = self.regressors();
        let x = weights[0] * one + weights[1] * mean + weights[2] * class_mean + weights[3] * depth + weights[4] * surface;
        let p = 1.0 / (1.0 + lanes::exp(-x));
        let m = self.mean.clamp(CLIP, 1.0 - CLIP);
        let slope = weights[1].abs() * p * (1.0 - p) / (m * (1.0 - m));
        (p, (slope * self.variance.max(0.0).sqrt()).min(0.5))
    }
}

/// Unknown voxels that were predicted together: some of a stretch of one column.
#[derive(Clone, Copy, Debug)]
pub struct Block {
    /// Index of the voxel in the first lane.
    pub first: usize,
    mean: Lanes,
    variance: Lanes,
    class_mean: Lanes,
    depth: Lanes,
}

impl Block {
    /// Features of the voxel in a lane.
    #[inline(always)]
    pub fn features(&self, lane: usize) -> VoxelFeatures {
        VoxelFeatures { mean: self.mean[lane], variance: self.variance[lane], class_mean: self.class_mean[lane], depth: self.depth[lane] }
    }

    /// Lanes of unknown voxels.
    pub fn unknown(&self) -> impl Iterator<Item = usize> {
        (0..LANES).filter(|lane| self.depth[*lane] > 0.0)
    }
}

/// Unknown voxels of a grid, as vertical runs (start, end), ascending, which a mixture of classes predicts.
pub struct Unknown<'a, P> {
    /// Voxels of a column.
    pub height: usize,
    /// The runs.
    pub runs: &'a [(usize, usize)],
    /// The classes.
    pub parts: P,
    /// Memory for one block.
    pub scratch: &'a mut BlockScratch,
}

/// Takes the blocks of unknown voxels. A trait of its own beside `FnMut`: a closure cannot be told to become a part of its caller, and as a function
/// of its own it would lack the caller's vector instructions.
trait TakeBlock {
    fn take(&mut self, block: &Block);
}

impl<F: FnMut(&Block)> TakeBlock for F {
    #[inline(always)]
    fn take(&mut self, block: &Block) {
        self(block);
    }
}

impl<'a, P: Iterator<Item = Part<'a>> + Clone> Unknown<'_, P> {
    /// Hands over all blocks, ascending.
    #[inline(always)]
    fn for_each_block<const FUSED: bool>(&mut self, mut to: impl TakeBlock) {
        let mut runs = self.runs.iter().peekable();
        while let Some(&&(start, _)) = runs.peek() {
            // All runs that touch this block: the last of them may go on in the next.
            let column = start / self.height;
            let mut z = (start % self.height) / LANES * LANES;
            while z < self.height {
                let first = column * self.height + z;
                let mut depth = [0.0; LANES];
                let mut goes_on = false;
                while let Some(&&(start, end)) = runs.peek().filter(|run| run.0 < (first + LANES).min((column + 1) * self.height)) {
                    for voxel in start.max(first)..end.min(first + LANES) {
                        depth[voxel - first] = (end - voxel) as f32;
                    }
                    goes_on = end > first + LANES;
                    if goes_on {
                        break;
                    }
                    runs.next();
                }
                to.take(&self.block::<FUSED>(column, z, depth));
                if !goes_on {
                    break;
                }
                z += LANES;
            }
        }
    }

    #[inline(always)]
    fn block<const FUSED: bool>(&mut self, column: usize, z: usize, depth: Lanes) -> Block {
        let zero = [0.0; LANES];
        let mut block = Block { first: column * self.height + z, mean: zero, variance: zero, class_mean: zero, depth };
        for part in self.parts.clone() {
            let predicted = part.class.predict::<FUSED>(part.posterior, column, z, self.scratch);
            for l in 0..LANES {
                let mean = predicted.mean[l].clamp(0.0, 1.0);
                block.mean[l] += part.weight * mean;
                // Second moment for now: the spread between the classes is what remains of it.
                block.variance[l] += part.weight * (predicted.variance[l] + mean * mean);
                block.class_mean[l] += part.weight * predicted.class_mean[l];
            }
        }
        for l in 0..LANES {
            block.variance[l] = (block.variance[l] - block.mean[l] * block.mean[l]).max(0.0);
        }
        block
    }
}

/// Calls the function for every block of unknown voxels, ascending.
pub struct ForEachBlock<'a, P, F>(pub Unknown<'a, P>, pub F);

impl<'a, P: Iterator<Item = Part<'a>> + Clone, F: FnMut(&Block)> Kernel for ForEachBlock<'_, P, F> {
    type Output = ();

    #[inline(always)]
    fn run<const FUSED: bool>(mut self) {
        self.0.for_each_block::<FUSED>(self.1);
    }
}

/// How probabilities and deviations, 0 to 1, are written.
pub trait Value: Copy + Default + PartialOrd + Send + Sync {
    /// One.
    const ONE: Self;

    /// A value in \[0, 1\].
    fn from_unit(value: f32) -> Self;
}

impl Value for f32 {
    const ONE: Self = 1.0;

    #[inline(always)]
    fn from_unit(value: f32) -> Self {
        value
    }
}

/// As in messages: times 255, rounded.
impl Value for u8 {
    const ONE: Self = 255;

    #[inline(always)]
    fn from_unit(value: f32) -> Self {
        lanes::to_byte(value)
    }
}

/// Writes probability and deviation of unknown voxels by a calibration with these weights.
pub struct Complete<'a, P, V> {
    /// The voxels.
    pub unknown: Unknown<'a, P>,
    /// See [`weights`].
    pub weights: [f32; 5],
    /// Index of the voxel that the first values of the outputs are of.
    pub first: usize,
    /// Probabilities.
    pub occupancy: &'a mut [V],
    /// Deviations.
    pub deviation: &'a mut [V],
}

impl<'a, P: Iterator<Item = Part<'a>> + Clone, V: Value> Kernel for Complete<'_, P, V> {
    type Output = ();

    #[inline(always)]
    fn run<const FUSED: bool>(self) {
        let Self { mut unknown, weights, first, occupancy, deviation } = self;
        unknown.for_each_block::<FUSED>(Writing { weights, first, occupancy, deviation });
    }
}

/// Where a completion goes: see [`Complete`].
struct Writing<'a, V> {
    weights: [f32; 5],
    first: usize,
    occupancy: &'a mut [V],
    deviation: &'a mut [V],
}

impl<V: Value> TakeBlock for Writing<'_, V> {
    #[inline(always)]
    fn take(&mut self, block: &Block) {
        let (mut p, mut sd) = ([0.0; LANES], [0.0; LANES]);
        for l in 0..LANES {
            // Lanes of known voxels are computed too, and dropped.
            let features = VoxelFeatures { depth: block.depth[l].max(1.0), ..block.features(l) };
            (p[l], sd[l]) = features.probability(&self.weights);
        }
        let (p, sd) = (p.map(V::from_unit), sd.map(V::from_unit));
        for lane in block.unknown() {
            let voxel = block.first - self.first + lane;
            (self.occupancy[voxel], self.deviation[voxel]) = (p[lane], sd[lane]);
        }
    }
}

/// The weights of a calibration in the order of [`VoxelFeatures::regressors`].
pub fn weights(c: &CompletionCalibration) -> [f32; 5] {
    [c.constant, c.mean, c.class_mean, c.log_depth, c.surface].map(|w| w as f32)
}
