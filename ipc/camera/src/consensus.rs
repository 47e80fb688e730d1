//! The surface by the consensus of neighbouring readings.
//!
//! A reading is replaced by the mean inverse depth of itself and of pairs of readings that lie opposite each other around it, of the same
//! object and joined to it: on a plane such a mean is unbiased whatever the slope, and no pair reaches across an edge. Its deviation
//! shrinks with the root of the number of readings; those of structured light and stereo are correlated over a pixel or two, so half of
//! them count.

use crate::joining::Joint;
use crate::patch::Patch;

/// Half of the offsets (down, right) within so many pixels; the others lie opposite.
const MARGIN: usize = 2;
const PAIRS: [[isize; 2]; 12] = [[0, 1], [1, -1], [1, 0], [1, 1], [0, 2], [1, -2], [1, 2], [2, -2], [2, -1], [2, 0], [2, 1], [2, 2]];

/// The consensus at all `pixels` of one object in a raw depth image of that width: depths, and the median share that is left of a reading's
/// deviation.
pub fn consensus(depth: &[f32], width: usize, joint: &Joint, pixels: &[u32]) -> (Vec<f32>, f64) {
    let patch = Patch::of(depth, width, pixels, MARGIN);
    let (z, width) = (patch.z(), patch.width());
    let inverse: Vec<f32> = z.iter().map(|z| 1.0 / z).collect();
    let (mut sums, mut counts) = (inverse.clone(), vec![1_u32; z.len()]);
    let mut reach = vec![0.0; width];
    // Row by row: what is not the object's is not a number, and near nothing.
    for first in (MARGIN * width..z.len().saturating_sub(MARGIN * width)).step_by(width.max(1)) {
        let [start, end] = [first + MARGIN, first + width - MARGIN];
        let (own, reach) = (&z[start..end], &mut reach[..end - start]);
        reach.iter_mut().zip(own).for_each(|(reach, z)| *reach = 2.0 * joint.reach(*z));
        let (sums, counts) = (&mut sums[start..end], &mut counts[start..end]);
        for [down, right] in PAIRS {
            let step = down * width as isize + right;
            let (before, after) = (start.wrapping_add_signed(-step), start.wrapping_add_signed(step));
            let [za, zb] = [&z[before..][..end - start], &z[after..][..end - start]];
            let [ia, ib] = [&inverse[before..][..end - start], &inverse[after..][..end - start]];
            for i in 0..end - start {
                // On one surface, and not across a crease: what is before the middle on one side is behind it on the other.
                let is_one = ((za[i] - own[i]).abs() < reach[i]) & ((zb[i] - own[i]).abs() < reach[i]);
                sums[i] += if is_one { ia[i] + ib[i] } else { 0.0 };
                counts[i] += if is_one { 2 } else { 0 };
            }
        }
    }
    let mut smooth = Vec::with_capacity(pixels.len());
    let mut shares = [0_usize; 2 * PAIRS.len() + 2];
    for pixel in pixels {
        let place = patch.place(*pixel);
        shares[(counts[place] as usize).min(2 * PAIRS.len() + 1)] += 1;
        smooth.push(counts[place] as f32 / sums[place]);
    }
    let half = pixels.len() / 2;
    let mut below = 0;
    let median = shares.iter().position(|n| {
        below += n;
        below > half
    });
    let median = median.unwrap_or(1).max(1) as f64;
    (smooth, (1.0 / (0.5 * median).max(1.0)).sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rays::Rays;
    use crate::{Intrinsics, SensorModel};

    #[test]
    fn a_slope_keeps_its_place_and_its_noise_shrinks() {
        let camera = Intrinsics::new(64, 48, [60.0; 2], [31.5, 23.5], [0.0; 5]).unwrap();
        let joint = Joint::new(&Rays::new(&camera), &SensorModel::default());
        // Inverse depth is linear on a plane: 1/z = 0.9 + 0.002 u. The noise is a fixed sequence of ± 2 mm without trend.
        let truth = |pixel: usize| 1.0 / (0.9 + 0.002 * (pixel % 64) as f32);
        let noise = |pixel: usize| 0.002 * ((pixel * 7919 % 101) as f32 / 50.0 - 1.0);
        let depth: Vec<f32> = (0..64 * 48).map(|pixel| truth(pixel) + noise(pixel)).collect();
        let pixels: Vec<u32> = (0..depth.len() as u32).collect();
        let (smooth, left) = consensus(&depth, 64, &joint, &pixels);
        let rms = |z: &[f32]| (z.iter().enumerate().map(|(p, z)| (z - truth(p)).powi(2)).sum::<f32>() / z.len() as f32).sqrt();
        assert!(rms(&smooth) < 0.45 * rms(&depth), "{} of {}", rms(&smooth), rms(&depth));
        assert!((left - (1.0_f64 / 12.5).sqrt()).abs() < 1e-9, "{left}");
    }

    #[test]
    fn nothing_is_mixed_across_an_edge_or_with_another_object() {
        let camera = Intrinsics::new(64, 48, [60.0; 2], [31.5, 23.5], [0.0; 5]).unwrap();
        let joint = Joint::new(&Rays::new(&camera), &SensorModel::default());
        let depth: Vec<f32> = (0..64 * 48).map(|pixel| if pixel % 64 < 20 { 0.8 } else { 1.2 }).collect();
        // Every other row is another object's, of which nothing counts.
        let pixels: Vec<u32> = (0..depth.len() as u32).filter(|pixel| pixel / 64 % 2 == 0).collect();
        let other: Vec<f32> = (0..64 * 48).map(|pixel| if pixel / 64 % 2 == 0 { depth[pixel] } else { depth[pixel] + 0.003 }).collect();
        let (smooth, left) = consensus(&other, 64, &joint, &pixels);
        assert!(smooth.iter().zip(&pixels).all(|(z, pixel)| (z - depth[*pixel as usize]).abs() < 1e-6));
        // Five readings of each of three rows.
        assert!((left - (1.0_f64 / 7.5).sqrt()).abs() < 1e-9, "{left}");
    }
}
