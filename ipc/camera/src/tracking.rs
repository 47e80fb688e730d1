//! Stable numbers for segments from frame to frame: by overlap in the image, then by place.

use crate::rays::Rays;
use nalgebra::Vector3;

/// Overlap over union from which a segment is the one of the frame before.
const LEAST_OVERLAP: f64 = 0.2;
/// Or it is no further away than this, metres.
const NEAR_M: f32 = 0.05;

/// The segments of the last frame, with their numbers.
#[derive(Clone, Debug, Default)]
pub struct SegmentTracks {
    labels: Vec<u16>,
    /// Number, pixels and middle of each segment.
    known: Vec<(u16, usize, Vector3<f32>)>,
    last: u16,
}

impl SegmentTracks {
    /// Renumbers `labels`: a segment has the number that it had in the frame before, new ones a number that none had.
    pub fn renumber(&mut self, rays: &Rays, depth: &[f32], labels: &mut [u16]) {
        let count = usize::from(labels.iter().copied().max().unwrap_or(0));
        let mut sums = vec![(0_usize, Vector3::zeros()); count + 1];
        let mut shared = std::collections::BTreeMap::<(u16, u16), usize>::new();
        let comparable = self.labels.len() == labels.len();
        // Neighbours mostly have the same label, and had the same one.
        let (mut pair, mut run) = ((0, 0), 0_usize);
        for (pixel, label) in labels.iter().enumerate().filter(|(_, label)| **label > 0) {
            let (n, sum) = &mut sums[usize::from(*label)];
            *n += 1;
            *sum += rays.point(pixel, depth[pixel]);
            let known = if comparable { self.labels[pixel] } else { 0 };
            if pair != (known, *label) {
                *shared.entry(pair).or_default() += run;
                (pair, run) = ((known, *label), 0);
            }
            run += 1;
        }
        *shared.entry(pair).or_default() += run;
        let middle = |label: u16| sums[usize::from(label)].1 / sums[usize::from(label)].0.max(1) as f32;
        // Best matches first: those by overlap before those by place.
        let mut matches: Vec<(bool, f64, u16, u16)> = Vec::new();
        for (number, pixels, place) in &self.known {
            for label in 1..=count as u16 {
                let both = shared.get(&(*number, label)).copied().unwrap_or(0);
                let overlap = both as f64 / (pixels + sums[usize::from(label)].0 - both).max(1) as f64;
                let distance = (middle(label) - place).norm();
                if overlap >= LEAST_OVERLAP {
                    matches.push((false, -overlap, *number, label));
                } else if distance < NEAR_M {
                    matches.push((true, f64::from(distance), *number, label));
                }
            }
        }
        matches.sort_by(|a, b| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)).then((a.2, a.3).cmp(&(b.2, b.3))));
        let mut numbers = vec![0_u16; count + 1];
        let mut taken = std::collections::BTreeSet::new();
        for (_, _, number, label) in matches {
            if numbers[usize::from(label)] == 0 && taken.insert(number) {
                numbers[usize::from(label)] = number;
            }
        }
        for label in 1..=count {
            if numbers[label] == 0 && sums[label].0 > 0 {
                // After 65535 segments the numbers begin again, past those that are in use.
                while {
                    self.last = self.last.checked_add(1).unwrap_or(1);
                    taken.contains(&self.last)
                } {}
                numbers[label] = self.last;
                taken.insert(self.last);
            }
        }
        self.known =
            (1..=count).filter(|label| sums[*label].0 > 0).map(|label| (numbers[label], sums[label].0, middle(label as u16))).collect();
        labels.iter_mut().for_each(|label| *label = numbers[usize::from(*label)]);
        self.labels.clear();
        self.labels.extend_from_slice(labels);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Intrinsics;

    #[test]
    fn a_segment_keeps_its_number_while_it_moves_and_others_come_and_go() {
        let camera = Intrinsics::new(40, 30, [40.0; 2], [19.5, 14.5], [0.0; 5]).unwrap();
        let (rays, depth) = (Rays::new(&camera), vec![1.0; 1200]);
        let mut tracks = SegmentTracks::default();
        // Segments of 5 × 5 pixels that begin at these columns, numbered in this order.
        let mut seen = |columns: &[usize]| {
            let mut labels = vec![0; 1200];
            for (number, column) in columns.iter().enumerate() {
                for pixel in (0..25).map(|i| (10 + i / 5) * 40 + column + i % 5) {
                    labels[pixel] = number as u16 + 1;
                }
            }
            tracks.renumber(&rays, &depth, &mut labels);
            columns.iter().map(|column| labels[10 * 40 + column]).collect::<Vec<_>>()
        };
        assert_eq!(seen(&[5, 20]), [1, 2]);
        assert_eq!(seen(&[21, 6]), [2, 1], "by overlap, whatever the order");
        assert_eq!(seen(&[7, 33]), [1, 3], "what is new has a new number");
        assert_eq!(seen(&[20]), [4], "numbers of those that went are not given again");
        assert_eq!(seen(&[20, 5]), [4, 5]);
    }
}
