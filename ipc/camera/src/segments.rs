//! The pixels of each label, found in one pass over the image.

use crate::Frame;

/// Which pixels with a depth reading carry each label.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Segments {
    /// Of each label up to the largest: whether it has a pixel at all, with a reading or without.
    present: Vec<bool>,
    /// Label `l` has the pixels from `starts[l]` to `starts[l + 1]`.
    starts: Vec<u32>,
    pixels: Vec<u32>,
}

impl Segments {
    /// Of all labels of a frame.
    pub fn new(frame: &Frame<'_>) -> Self {
        let labels = frame.labels();
        let readings = || labels.iter().zip(frame.depths()).map(|(label, depth)| (usize::from(*label), Frame::is_reading(*depth)));
        let size = usize::from(labels.iter().copied().max().unwrap_or(0)) + 1;
        let mut present = vec![false; size];
        let mut starts = vec![0; size + 1];
        // Neighbours mostly have the same label: it is counted in a register until it changes.
        let (mut last, mut count) = (0, 0);
        for (label, is_reading) in readings() {
            if label != last {
                starts[last + 1] += count;
                (last, count) = (label, 0);
                present[label] = true;
            }
            count += u32::from(is_reading);
        }
        starts[last + 1] += count;
        present[usize::from(labels[0])] = true;
        for label in 0..size {
            starts[label + 1] += starts[label];
        }
        let mut ends = starts.clone();
        let mut pixels = vec![0; starts[size] as usize];
        for (pixel, (label, is_reading)) in readings().enumerate() {
            if is_reading {
                pixels[ends[label] as usize] = pixel as u32;
                ends[label] += 1;
            }
        }
        Self { present, starts, pixels }
    }

    /// The pixels of a label that have a reading, ascending.
    pub fn pixels(&self, label: u16) -> &[u32] {
        let label = usize::from(label);
        if label + 1 >= self.starts.len() {
            return &[];
        }
        &self.pixels[self.starts[label] as usize..self.starts[label + 1] as usize]
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
