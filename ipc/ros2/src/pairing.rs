//! Depth images and their segmentations, which come on two topics, brought together by their stamps.

use crate::messages::Image;
use std::collections::VecDeque;
use std::time::Duration;

/// Images of each kind that wait for their partner.
const MOST_WAITING: usize = 8;

/// A depth image, with its segmentation where one is asked for.
#[derive(Clone, Debug, PartialEq)]
pub struct Pair {
    /// The depth image.
    pub depth: Image,
    /// The labels of the same time.
    pub labels: Option<Image>,
}

/// Brings images together.
#[derive(Debug)]
pub struct Pairing {
    tolerance_ns: u64,
    is_labelled: bool,
    depths: VecDeque<Image>,
    labels: VecDeque<Image>,
    unpaired: u64,
}

impl Pairing {
    /// Where `is_labelled`, each depth image waits for the segmentation whose stamp is within `tolerance` of its own.
    pub fn new(is_labelled: bool, tolerance: Duration) -> Self {
        let tolerance_ns = u64::try_from(tolerance.as_nanos()).unwrap_or(u64::MAX);
        Self { tolerance_ns, is_labelled, depths: VecDeque::new(), labels: VecDeque::new(), unpaired: 0 }
    }

    /// A depth image came.
    pub fn depth(&mut self, image: Image) -> Option<Pair> {
        if !self.is_labelled {
            return Some(Pair { depth: image, labels: None });
        }
        self.depths.push_back(image);
        self.meet()
    }

    /// A segmentation came.
    pub fn labels(&mut self, image: Image) -> Option<Pair> {
        self.labels.push_back(image);
        self.meet()
    }

    /// Images that were passed over: no partner came, or a later pair did.
    pub fn unpaired(&self) -> u64 {
        self.unpaired
    }

    /// The pair that the last image completes. What came before either of the two has no partner any more.
    fn meet(&mut self) -> Option<Pair> {
        let near = |depth: &Image, labels: &Image| {
            depth.header.stamp.nanoseconds().abs_diff(labels.header.stamp.nanoseconds()) <= self.tolerance_ns
        };
        let met = self.depths.iter().enumerate().rev().find_map(|(at, depth)| {
            let partner = self.labels.iter().rposition(|labels| near(depth, labels))?;
            Some((at, partner))
        });
        if let Some((depth, labels)) = met {
            self.unpaired += (depth + labels) as u64;
            let pair = (self.depths.drain(..=depth).next_back(), self.labels.drain(..=labels).next_back());
            let (Some(depth), Some(labels)) = pair else { return None };
            return Some(Pair { depth, labels: Some(labels) });
        }
        for waiting in [&mut self.depths, &mut self.labels] {
            while waiting.len() > MOST_WAITING {
                waiting.pop_front();
                self.unpaired += 1;
            }
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::messages::{Header, Time};

    fn at(ms: i32) -> Image {
        let stamp = Time { sec: ms / 1000, nanosec: (ms % 1000) as u32 * 1_000_000 };
        Image { header: Header { stamp, frame_id: String::new() }, ..Image::default() }
    }

    #[test]
    fn without_segmentation_every_image_goes_on() {
        let mut pairing = Pairing::new(false, Duration::ZERO);
        assert_eq!(pairing.depth(at(5)), Some(Pair { depth: at(5), labels: None }));
    }

    #[test]
    fn images_of_one_time_meet_in_whatever_order_they_come() {
        let mut pairing = Pairing::new(true, Duration::from_millis(3));
        assert_eq!(pairing.depth(at(100)), None);
        assert_eq!(pairing.depth(at(133)), None);
        let met = Some(Pair { depth: at(100), labels: Some(at(102)) });
        assert_eq!(pairing.labels(at(102)), met);
        assert_eq!(pairing.labels(at(166)), None);
        assert_eq!(pairing.depth(at(166)), Some(Pair { depth: at(166), labels: Some(at(166)) }));
        assert_eq!(pairing.unpaired(), 1, "the image of 133 ms has no partner");
        // A recording starts anew: stamps go back, and what belongs together still meets.
        assert_eq!(pairing.labels(at(100)), None);
        assert!(pairing.depth(at(100)).is_some());
    }

    #[test]
    fn what_never_finds_a_partner_is_counted_and_does_not_pile_up() {
        let mut pairing = Pairing::new(true, Duration::from_millis(1));
        for ms in 0..100 {
            assert_eq!(pairing.depth(at(10 * ms)), None);
        }
        assert_eq!((pairing.unpaired(), pairing.depths.len()), (92, MOST_WAITING));
    }
}
