//! The pixels of each label, found in one pass over the image.

use crate::Frame;
use std::ops::Range;

/// Which pixels with a depth reading carry each label.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Segments {
    /// Of each label up to the largest: whether it has a pixel at all, with a reading or without.
    present: Vec<bool>,
    /// Label `l` has the pixels from `starts[l]` to `starts[l + 1] - 1`: one place more than it has readings.
    starts: Vec<u32>,
    pixels: Vec<u32>,
}

/// Labels that are compared at once.
const ALIKE: usize = 32;

impl Segments {
    /// Of all labels of a frame.
    pub fn new(frame: &Frame<'_>) -> Self {
        Self::from_label(frame, 0)
    }

    /// As [`Self::new`], but no pixel is said to have the label 0: most have.
    pub(crate) fn of_objects(frame: &Frame<'_>) -> Self {
        Self::from_label(frame, 1)
    }

    /// Of pixels that are at hand, ascending for each label, labels ascending; of labels without a reading none are present.
    pub(crate) fn of_pixels(lists: &[(u16, Vec<u32>)]) -> Self {
        let size = lists.last().map_or(0, |(label, _)| usize::from(*label)) + 1;
        let mut segments = Self { present: vec![false; size], starts: vec![0; size + 1], pixels: Vec::new() };
        let mut lists = lists.iter().peekable();
        for label in 0..size {
            if let Some((_, pixels)) = lists.next_if(|(own, _)| usize::from(*own) == label) {
                segments.present[label] = !pixels.is_empty();
                segments.pixels.extend_from_slice(pixels);
            }
            // The place more that each label has.
            segments.pixels.push(0);
            segments.starts[label + 1] = segments.pixels.len() as u32;
        }
        segments
    }

    fn from_label(frame: &Frame<'_>, least: u16) -> Self {
        let (labels, depths) = (frame.labels(), frame.depths());
        let size = usize::from(labels.iter().copied().max().unwrap_or(0)) + 1;
        let mut present = vec![false; size];
        let mut starts = vec![0; size + 1];
        // Neighbours mostly have the same label.
        let mut runs: Vec<(u16, Range<usize>)> = Vec::new();
        for (label, pixels) in runs_of(labels) {
            present[usize::from(label)] = true;
            if label >= least {
                starts[usize::from(label) + 1] +=
                    depths[pixels.clone()].iter().map(|depth| u32::from(Frame::is_reading(*depth))).sum::<u32>();
                runs.push((label, pixels));
            }
        }
        for label in 0..size {
            starts[label + 1] += starts[label] + 1;
        }
        let mut ends = starts.clone();
        // What is no reading is written too, and then written over, at last in the place more: no branch depends on the depth.
        let mut pixels = vec![0; starts[size] as usize];
        for (label, run) in runs {
            let end = &mut ends[usize::from(label)];
            for pixel in run {
                pixels[*end as usize] = pixel as u32;
                *end += u32::from(Frame::is_reading(depths[pixel]));
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
        &self.pixels[self.starts[label] as usize..self.starts[label + 1] as usize - 1]
    }

    /// Labels of objects that have a pixel, even if none with a reading: ascending, without 0 and without `support`.
    pub fn objects(&self, support: Option<u16>) -> impl Iterator<Item = u16> {
        (1..self.present.len()).filter(|label| self.present[*label]).map(|label| label as u16).filter(move |label| Some(*label) != support)
    }
}

/// The runs of pixels with the same label, in order.
pub fn runs_of(labels: &[u16]) -> impl Iterator<Item = (u16, Range<usize>)> {
    let mut start = 0;
    std::iter::from_fn(move || {
        let label = *labels.get(start)?;
        let run = start..start + alike(&labels[start..]);
        start = run.end;
        Some((label, run))
    })
}

/// How many values at the start of some are alike.
fn alike(values: &[u16]) -> usize {
    let Some(first) = values.first().copied() else { return 0 };
    // Many at a time, as long as all are.
    let together = values.chunks_exact(ALIKE).take_while(|chunk| chunk.iter().fold(0, |differ, value| differ | (value ^ first)) == 0);
    let known = ALIKE * together.count();
    known + values[known..].iter().take_while(|value| **value == first).count()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Intrinsics;
    use proptest::prelude::*;

    #[test]
    fn values_that_are_alike_are_counted_to_the_first_that_differs() {
        for count in [1, 31, 32, 33, 64, 200] {
            let mut values = vec![7_u16; 200];
            values[count.min(199)..].fill(6);
            assert_eq!(alike(&values), count.min(199));
        }
        assert_eq!((alike(&[]), alike(&[3; 64])), (0, 64));
    }

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
            let lists: Vec<(u16, Vec<u32>)> = [1, 2, 7, 300].map(|label| (label, segments.pixels(label).to_vec())).into();
            let (of_objects, of_pixels) = (Segments::of_objects(&frame), Segments::of_pixels(&lists));
            for label in [1, 2, 3, 7, 300] {
                prop_assert_eq!(of_objects.pixels(label), segments.pixels(label));
                prop_assert_eq!(of_pixels.pixels(label), segments.pixels(label));
            }
            prop_assert!(of_objects.pixels(0).is_empty() && of_objects.objects(None).eq(segments.objects(None)));
            prop_assert_eq!(segments.objects(Some(7)).collect::<Vec<_>>(), frame.objects(Some(7)));
        }
    }
}
