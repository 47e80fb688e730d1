//! The pixels of each label, found in one pass over the image.

use crate::Frame;

/// Which pixels with a depth reading carry each label.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Segments {
    /// Of each label up to the largest: whether it has a pixel at all, with a reading or without.
    present: Vec<bool>,
    /// Label `l` has the pixels from `starts[l]` to `starts[l + 1] - 1`: one place more than it has readings.
    starts: Vec<u32>,
    pixels: Vec<u32>,
}

impl Segments {
    /// Of all labels of a frame.
    pub fn new(frame: &Frame<'_>) -> Self {
        let (labels, depths) = (frame.labels(), frame.depths());
        let size = usize::from(labels.iter().copied().max().unwrap_or(0)) + 1;
        let mut present = vec![false; size];
        let mut starts = vec![0; size + 1];
        // Neighbours mostly have the same label.
        let mut runs: Vec<(u16, u32)> = Vec::new();
        let mut start = 0;
        while let Some(label) = labels.get(start).copied() {
            let end = start + labels[start..].iter().take_while(|other| **other == label).count();
            let readings = depths[start..end].iter().map(|depth| u32::from(Frame::is_reading(*depth))).sum::<u32>();
            present[usize::from(label)] = true;
            starts[usize::from(label) + 1] += readings;
            runs.push((label, end as u32));
            start = end;
        }
        for label in 0..size {
            starts[label + 1] += starts[label] + 1;
        }
        let mut ends = starts.clone();
        // What is no reading is written too, and then written over, at last in the place more: no branch depends on the depth.
        let mut pixels = vec![0; starts[size] as usize];
        let mut start = 0;
        for (label, stop) in runs {
            let end = &mut ends[usize::from(label)];
            for pixel in start..stop {
                pixels[*end as usize] = pixel;
                *end += u32::from(Frame::is_reading(depths[pixel as usize]));
            }
            start = stop;
        }
        Self { present, starts, pixels }
    }

    /// The pixels of a label that have a reading, ascending.
    pub fn pixels(&self, label: u16) -> &[u32] {
        let label = usize::from(label);
        if label + 1 >= self.starts.len() {
            return &[];
        }
        &self.pixels[self.starts[label] as usize..self.starts[label + 1] as usize - 1]
    }

    /// Labels of objects that have a pixel, even if none with a reading: ascending, without 0 and without `support`.
    pub fn objects(&self, support: Option<u16>) -> impl Iterator<Item = u16> {
        (1..self.present.len()).filter(|label| self.present[*label]).map(|label| label as u16).filter(move |label| Some(*label) != support)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Intrinsics;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn every_reading_is_in_the_segment_of_its_label(
            pixels in prop::collection::vec((prop::sample::select(vec![0_u16, 1, 2, 7, 300, u16::MAX]), -1.0..1.0_f32), 6),
        ) {
            let camera = Intrinsics::new(3, 2, [5.0; 2], [1.0, 0.5], [0.0; 5]).unwrap();
            let (labels, depth): (Vec<u16>, Vec<f32>) = pixels.into_iter().unzip();
            let frame = Frame::new(&camera, &depth, &labels).unwrap();
            let segments = Segments::new(&frame);
            for label in [0, 1, 2, 3, 7, 300, u16::MAX] {
                let expected: Vec<u32> = (0..6).filter(|p| labels[*p as usize] == label && depth[*p as usize] > 0.0).collect();
                prop_assert_eq!(segments.pixels(label), &expected[..]);
            }
            prop_assert_eq!(segments.objects(Some(7)).collect::<Vec<_>>(), frame.objects(Some(7)));
        }
    }
}
