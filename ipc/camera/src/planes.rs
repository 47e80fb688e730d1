//! The planes of a frame: sampling (RANSAC, Fischler and Bolles 1981) over the middles of flat squares, then weighted least squares.
//!
//! Every square weighs 1/σ² of its distance, so that a background far away neither tilts a near table nor wins over it, and counts as the
//! plane's only if its own normal agrees. Triples come from a fixed low-discrepancy sequence: the same frame gives the same planes.

use crate::SensorModel;
use crate::blocks::Block;
use crate::support::Plane;
use nalgebra::{Matrix3, Point3, SymmetricEigen, Unit, Vector3};

/// A plane with what speaks for it.
#[derive(Clone, Debug)]
pub struct FoundPlane {
    /// The plane; its normal towards the camera.
    pub plane: Plane,
    /// Sum of the weights of its squares: pixels, far ones less.
    pub weight: f64,
    /// Its squares, as indices.
    pub blocks: Vec<usize>,
    /// Median scatter of the readings within its squares, in standard deviations of the sensor model.
    pub scatter: f64,
}

/// Triples that are tried for each plane.
const TRIPLES: u32 = 400;
/// Squares that a triple is judged by, at most.
const JUDGES: usize = 1200;
/// Squares between two looks at whether a triple can still win.
const JUDGES_AT_ONCE: usize = 64;
/// Share of all weight that a plane must hold.
const LEAST_SHARE: f64 = 0.02;
/// Squares that a plane must have.
const LEAST_BLOCKS: usize = 6;
/// How far a square's middle may be from its plane: metres, or standard deviations of a reading, at most metres.
const NEAR_M: f64 = 0.004;
const NEAR_DEVIATIONS: f64 = 1.5;
const NEAR_MOST_M: f64 = 0.02;
/// How far a square's normal may be from its plane's: cosine of 35°.
const ALIKE: f64 = 0.82;

/// Up to `most` planes whose normals are allowed, the weightiest first.
pub fn find_planes(blocks: &[Block], sensor: &SensorModel, most: usize, allowed: impl Fn(&Vector3<f64>) -> bool) -> Vec<FoundPlane> {
    let total: f64 = blocks.iter().map(|block| block.weight).sum();
    let mut free: Vec<usize> = (0..blocks.len()).collect();
    let mut found = Vec::new();
    while found.len() < most && free.len() >= LEAST_BLOCKS {
        let Some(plane) = best_of_triples(blocks, &free, sensor, &allowed) else { break };
        let Some(plane) = refined(blocks, &free, sensor, plane) else { break };
        let near: Vec<usize> = free.iter().copied().filter(|i| is_near(&blocks[*i], &plane, sensor)).collect();
        let weight: f64 = near.iter().map(|i| blocks[*i].weight).sum();
        if near.len() < LEAST_BLOCKS || weight < LEAST_SHARE * total {
            break;
        }
        // What is left of a curved or stepped plane is no plane of its own.
        let own: Vec<usize> =
            free.iter().copied().filter(|i| plane.height(&blocks[*i].centre.into()).abs() < 2.0 * near_m(&blocks[*i], sensor)).collect();
        free.retain(|i| own.binary_search(i).is_err());
        if allowed(&plane.normal()) {
            let mut scatters: Vec<f64> = near.iter().map(|i| blocks[*i].scatter).collect();
            let middle = scatters.len() / 2;
            let scatter = *scatters.select_nth_unstable_by(middle, f64::total_cmp).1;
            found.push(FoundPlane { plane, weight, blocks: near, scatter });
        }
    }
    found.sort_by(|a, b| b.weight.total_cmp(&a.weight));
    found
}

fn near_m(block: &Block, sensor: &SensorModel) -> f64 {
    NEAR_M.max(NEAR_DEVIATIONS * sensor.deviation(block.centre.z)).min(NEAR_MOST_M)
}

/// Whether a square is a plane's.
pub fn is_near(block: &Block, plane: &Plane, sensor: &SensorModel) -> bool {
    plane.height(&block.centre.into()).abs() < near_m(block, sensor) && plane.normal().dot(&block.normal) > ALIKE
}

fn best_of_triples(blocks: &[Block], free: &[usize], sensor: &SensorModel, allowed: &impl Fn(&Vector3<f64>) -> bool) -> Option<Plane> {
    // Fractional parts of multiples of these are spread evenly over a cube (the R₃ sequence: powers of the root of x⁴ = x + 1).
    const STEPS: [f64; 3] = [0.819_172_513_396_164_4, 0.671_043_606_703_789_2, 0.549_700_477_901_97];
    let judges: Vec<&Block> = free.iter().step_by(free.len().div_ceil(JUDGES)).map(|i| &blocks[*i]).collect();
    let judged: Vec<(Vector3<f32>, Vector3<f32>, f32, f32)> =
        judges.iter().map(|block| (block.centre.cast(), block.normal.cast(), near_m(block, sensor) as f32, block.weight as f32)).collect();
    let all: f32 = judged.iter().map(|(.., weight)| weight).sum();
    let pick = |i: u32, axis: usize| {
        let share = ((f64::from(i) + 1.0) * STEPS[axis]).fract();
        &blocks[free[((share * free.len() as f64) as usize).min(free.len() - 1)]]
    };
    let mut best: Option<(f32, Plane)> = None;
    for i in 0..TRIPLES {
        let triple = [pick(i, 0), pick(i, 1), pick(i, 2)];
        let [a, b, c] = triple.map(|block| block.centre);
        let Some(normal) = Unit::try_new((b - a).cross(&(c - a)), 1e-6) else { continue };
        let normal = if normal.dot(&a) > 0.0 { -normal } else { normal };
        if triple.iter().any(|block| block.normal.dot(&normal) < ALIKE) || !allowed(&normal) {
            continue;
        }
        let plane = Plane::new(normal, &Point3::from(a));
        let (n, offset) = (normal.into_inner().cast::<f32>(), plane.height(&Point3::origin()) as f32);
        let most = best.map_or(0.0, |(most, _)| most);
        let (mut weight, mut left) = (0.0, all);
        for some in judged.chunks(JUDGES_AT_ONCE) {
            for (centre, own, near, own_weight) in some {
                let is_near = ((n.dot(centre) + offset).abs() < *near) & (n.dot(own) > ALIKE as f32);
                weight += if is_near { *own_weight } else { 0.0 };
                left -= own_weight;
            }
            // With all that is left, it would not be the best.
            if weight + left < most {
                break;
            }
        }
        if weight > most {
            best = Some((weight, plane));
        }
    }
    best.map(|(_, plane)| plane)
}

fn refined(blocks: &[Block], free: &[usize], sensor: &SensorModel, mut plane: Plane) -> Option<Plane> {
    for _ in 0..4 {
        let near = free.iter().map(|i| &blocks[*i]).filter(|block| is_near(block, &plane, sensor));
        plane = least_squares(near.map(|block| (block.centre, block.weight)))?;
    }
    Some(plane)
}

/// The plane with the least weighted squared distances from points, its normal towards the camera; `None` for fewer than three points.
pub fn least_squares(points: impl Iterator<Item = (Vector3<f64>, f64)>) -> Option<Plane> {
    let points: Vec<(Vector3<f64>, f64)> = points.collect();
    let total: f64 = points.iter().map(|(_, weight)| weight).sum();
    if points.len() < 3 || total.is_nan() || total <= 0.0 {
        return None;
    }
    let mean = points.iter().fold(Vector3::zeros(), |sum, (p, weight)| sum + p * *weight) / total;
    let scatter = points.iter().fold(Matrix3::zeros(), |sum, (p, weight)| {
        let d = p - mean;
        sum + d * d.transpose() * (*weight / total)
    });
    // Points beyond all measure have no scatter; without a limit, the iteration would not end on what is not a number.
    let eigen = SymmetricEigen::try_new(scatter, f64::EPSILON, 100)?;
    let least = eigen.eigenvalues.imin();
    let normal = Unit::try_new(eigen.eigenvectors.column(least).into_owned(), 1e-12)?;
    let plane = Plane::new(normal, &Point3::from(mean));
    Some(if plane.height(&Point3::origin()) < 0.0 { Plane::new(-normal, &Point3::from(mean)) } else { plane })
}
