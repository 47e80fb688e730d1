//! The surface by the consensus of neighbouring readings.
//!
//! A reading is replaced by the mean inverse depth of itself and of pairs of readings that lie opposite each other around it, of the same
//! object and joined to it: on a plane such a mean is unbiased whatever the slope, and no pair reaches across an edge. Its deviation
//! shrinks with the root of the number of readings; those of structured light and stereo are correlated over a pixel or two, so half of
//! them count.

use crate::joining::Joint;

/// Half of the offsets (down, right) within two pixels; the others lie opposite.
const PAIRS: [[isize; 2]; 12] = [[0, 1], [1, -1], [1, 0], [1, 1], [0, 2], [1, -2], [1, 2], [2, -2], [2, -1], [2, 0], [2, 1], [2, 2]];

/// The consensus at `pixels` of one object in a raw depth image of that width: depths, and the median share that is left of a reading's
/// deviation.
pub fn consensus(depth: &[f32], labels: &[u16], width: usize, joint: &Joint, pixels: &[u32]) -> (Vec<f32>, f64) {
    let mut smooth = Vec::with_capacity(pixels.len());
    let mut counts = [0_usize; 2 * PAIRS.len() + 2];
    for pixel in pixels {
        let pixel = *pixel as usize;
        let (z, label) = (depth[pixel], labels[pixel]);
        let column = (pixel % width) as isize;
        let reach = 2.0 * joint.reach(z);
        let (mut sum, mut count) = (1.0 / z, 1_usize);
        for [down, right] in PAIRS {
            let step = down * width as isize + right;
            let (before, after) = (pixel as isize - step, pixel as isize + step);
            let inside = column - right.abs() >= 0 && column + right.abs() < width as isize && before >= 0 && after < depth.len() as isize;
            if !inside {
                continue;
            }
            let (a, b) = (before as usize, after as usize);
            if labels[a] != label || labels[b] != label {
                continue;
            }
            let (za, zb) = (depth[a], depth[b]);
            // On one surface, and not across a crease: what is before the middle on one side is behind it on the other.
            if za > 0.0 && zb > 0.0 && (za - z).abs() < reach && (zb - z).abs() < reach {
                sum += 1.0 / za + 1.0 / zb;
                count += 2;
            }
        }
        counts[count.min(counts.len() - 1)] += 1;
        smooth.push(count as f32 / sum);
    }
    let half = pixels.len() / 2;
    let mut below = 0;
    let median = counts.iter().position(|n| {
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
        let labels = vec![1; depth.len()];
        let pixels: Vec<u32> = (0..depth.len() as u32).collect();
        let (smooth, left) = consensus(&depth, &labels, 64, &joint, &pixels);
        let rms = |z: &[f32]| (z.iter().enumerate().map(|(p, z)| (z - truth(p)).powi(2)).sum::<f32>() / z.len() as f32).sqrt();
        assert!(rms(&smooth) < 0.45 * rms(&depth), "{} of {}", rms(&smooth), rms(&depth));
        assert!((left - (1.0_f64 / 12.5).sqrt()).abs() < 1e-9, "{left}");
    }

    #[test]
    fn nothing_is_mixed_across_an_edge_or_with_another_object() {
        let camera = Intrinsics::new(64, 48, [60.0; 2], [31.5, 23.5], [0.0; 5]).unwrap();
        let joint = Joint::new(&Rays::new(&camera), &SensorModel::default());
        let depth: Vec<f32> = (0..64 * 48).map(|pixel| if pixel % 64 < 20 { 0.8 } else { 1.2 }).collect();
        let labels: Vec<u16> = (0..64 * 48).map(|pixel| if pixel / 64 < 24 { 1 } else { 2 }).collect();
        let pixels: Vec<u32> = (0..depth.len() as u32).collect();
        let (smooth, _) = consensus(&depth, &labels, 64, &joint, &pixels);
        assert!(smooth.iter().zip(&depth).all(|(a, b)| (a - b).abs() < 1e-6));
    }
}
