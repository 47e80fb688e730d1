//! Objects from frame to frame: by overlap in the image, then by place. Segments get stable numbers so; of labelled objects it is said which
//! object of the frame before each one continues.

use crate::rays::Rays;
use nalgebra::Vector3;
use std::collections::{BTreeMap, BTreeSet};

/// When an object is the one of the frame before.
#[derive(Clone, Copy, Debug)]
struct Likeness {
    /// Overlap over union from which it is.
    least_overlap: f64,
    /// Or its middle is no further away than this, metres, …
    near_m: f32,
    /// … and it has so many times the pixels at most, or so many times fewer.
    most_grown: f64,
}

/// Segments are found anew in each frame, and may lose or gain a part: any overlap tells.
const OF_SEGMENTS: Likeness = Likeness { least_overlap: 0.2, near_m: 0.05, most_grown: f64::INFINITY };
/// Labels are somebody's word. Frames that are no sequence have other objects at places that overlap by chance, so more is asked.
const OF_LABELS: Likeness = Likeness { least_overlap: 0.5, near_m: 0.05, most_grown: 1.4 };

/// The objects of the last frame.
#[derive(Clone, Debug, Default)]
pub struct ObjectTracks {
    labels: Vec<u16>,
    /// Number, pixels and middle of each object.
    known: Vec<(u16, usize, Vector3<f32>)>,
    last: u16,
}

/// Pixels and middle of the objects of a frame, and which of the frame before they are.
struct Matched {
    /// By label.
    objects: BTreeMap<u16, (usize, Vector3<f32>)>,
    /// The number in the frame before, by label.
    before: BTreeMap<u16, u16>,
}

impl ObjectTracks {
    fn matched(&self, rays: &Rays, depth: &[f32], labels: &[u16], likeness: &Likeness) -> Matched {
        // Pixels, and the sum of those that have a reading, with their number.
        let mut sums = BTreeMap::<u16, (usize, usize, Vector3<f32>)>::new();
        let mut shared = BTreeMap::<(u16, u16), usize>::new();
        let comparable = self.labels.len() == labels.len();
        // Neighbours mostly have the same label, and had the same one.
        let (mut pair, mut run, mut read, mut sum) = ((0, 0), 0_usize, 0_usize, Vector3::zeros());
        let mut end = |pair: (u16, u16), run: usize, read: usize, sum: Vector3<f32>| {
            if run > 0 {
                *shared.entry(pair).or_default() += run;
                let (pixels, readings, total) = sums.entry(pair.1).or_default();
                (*pixels, *readings, *total) = (*pixels + run, *readings + read, *total + sum);
            }
        };
        for (pixel, label) in labels.iter().enumerate().filter(|(_, label)| **label > 0) {
            let known = if comparable { self.labels[pixel] } else { 0 };
            if pair != (known, *label) {
                end(pair, run, read, sum);
                (pair, run, read, sum) = ((known, *label), 0, 0, Vector3::zeros());
            }
            run += 1;
            if depth[pixel] > 0.0 {
                read += 1;
                sum += rays.point(pixel, depth[pixel]);
            }
        }
        end(pair, run, read, sum);
        let objects: BTreeMap<u16, (usize, Vector3<f32>)> =
            sums.into_iter().map(|(label, (pixels, read, sum))| (label, (pixels, sum / read.max(1) as f32))).collect();
        // Best matches first: those by overlap before those by place.
        let mut matches: Vec<(bool, f64, u16, u16)> = Vec::new();
        for (number, pixels, place) in &self.known {
            for (label, (count, middle)) in &objects {
                let both = shared.get(&(*number, *label)).copied().unwrap_or(0);
                let overlap = both as f64 / (pixels + count - both).max(1) as f64;
                let distance = (middle - place).norm();
                let grown = (*count as f64 / *pixels as f64).max(*pixels as f64 / *count as f64);
                if overlap >= likeness.least_overlap {
                    matches.push((false, -overlap, *number, *label));
                } else if distance < likeness.near_m && grown <= likeness.most_grown {
                    matches.push((true, f64::from(distance), *number, *label));
                }
            }
        }
        matches.sort_by(|a, b| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)).then((a.2, a.3).cmp(&(b.2, b.3))));
        let (mut before, mut taken) = (BTreeMap::new(), BTreeSet::new());
        for (_, _, number, label) in matches {
            if !before.contains_key(&label) && taken.insert(number) {
                before.insert(label, number);
            }
        }
        Matched { objects, before }
    }

    fn remember(&mut self, objects: impl Iterator<Item = (u16, (usize, Vector3<f32>))>, labels: &[u16]) {
        self.known.clear();
        self.known.extend(objects.map(|(number, (pixels, middle))| (number, pixels, middle)));
        self.labels.clear();
        self.labels.extend_from_slice(labels);
    }

    /// Renumbers the segments of a frame: one has the number that it had in the frame before, new ones a number that none had. Gives the
    /// numbers of those that were there before.
    pub fn renumber(&mut self, rays: &Rays, depth: &[f32], labels: &mut [u16]) -> BTreeMap<u16, u16> {
        let Matched { objects, before } = self.matched(rays, depth, labels, &OF_SEGMENTS);
        let mut taken: BTreeSet<u16> = before.values().copied().collect();
        let mut numbers = before.clone();
        for label in objects.keys() {
            numbers.entry(*label).or_insert_with(|| {
                // After 65535 segments the numbers begin again, past those that are in use.
                while {
                    self.last = self.last.checked_add(1).unwrap_or(1);
                    !taken.insert(self.last)
                } {}
                self.last
            });
        }
        for label in labels.iter_mut().filter(|label| **label > 0) {
            *label = numbers[label];
        }
        self.remember(objects.into_iter().map(|(label, of)| (numbers[&label], of)), labels);
        before.into_values().map(|number| (number, number)).collect()
    }

    /// Which object of the frame before each labelled object is, by its label: those that lie where that one lay. Labels stay as they are.
    pub fn follow(&mut self, rays: &Rays, depth: &[f32], labels: &[u16]) -> BTreeMap<u16, u16> {
        let Matched { objects, before } = self.matched(rays, depth, labels, &OF_LABELS);
        self.remember(objects.into_iter(), labels);
        before
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
        let mut tracks = ObjectTracks::default();
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

    #[test]
    fn labelled_objects_are_followed_by_their_place_whatever_their_labels() {
        let camera = Intrinsics::new(40, 30, [40.0; 2], [19.5, 14.5], [0.0; 5]).unwrap();
        let (rays, depth) = (Rays::new(&camera), vec![1.0; 1200]);
        let mut tracks = ObjectTracks::default();
        // Blocks of so many columns from a column on, with a label.
        let mut seen = |blocks: &[(u16, usize, usize)]| {
            let mut labels = vec![0; 1200];
            for (label, column, width) in blocks {
                for row in 10..15 {
                    labels[row * 40 + column..][..*width].fill(*label);
                }
            }
            tracks.follow(&rays, &depth, &labels).into_iter().collect::<Vec<_>>()
        };
        assert_eq!(seen(&[(7, 5, 6), (3, 20, 6)]), []);
        assert_eq!(seen(&[(3, 5, 6), (9, 20, 6)]), [(3, 7), (9, 3)], "numbers that changed");
        assert_eq!(seen(&[(3, 20, 6), (9, 30, 6)]), [(3, 9)], "the same label elsewhere is another object");
        assert_eq!(seen(&[(3, 21, 6)]), [(3, 3)], "an object that moves a little");
        assert_eq!(seen(&[(3, 20, 14)]), [], "a much larger one at the same place");
        assert_eq!(seen(&[]), []);
        assert_eq!(seen(&[(3, 20, 14)]), [], "nothing was there in the frame before");
    }
}
