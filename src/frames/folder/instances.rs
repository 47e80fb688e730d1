//! Several masks as one label image. Where masks overlap, as those do that hold the hidden part too, a pixel is the instance's whose own
//! depth is nearer to what is read there.

use crate::frames::Image;

/// Writes the labels of instances, each with its mask of the image's size, over nothing. `depth` is 0 where there is no reading.
pub(super) fn merged(masks: &[(u16, Image<bool>)], depth: &Image<f32>) -> Vec<u16> {
    let mut count = vec![0_u8; depth.values().len()];
    for (_, mask) in masks {
        count.iter_mut().zip(mask.values()).for_each(|(count, inside)| *count = count.saturating_add(u8::from(*inside)));
    }
    let overlap = count.iter().any(|count| *count > 1);
    let own: Vec<Option<f32>> = masks.iter().map(|(_, mask)| if overlap { own_depth(mask, &count, depth) } else { None }).collect();
    let mut labels = vec![0; count.len()];
    let mut nearest = vec![f32::INFINITY; if overlap { count.len() } else { 0 }];
    for ((label, mask), own) in masks.iter().zip(own) {
        for (pixel, _) in mask.values().iter().enumerate().filter(|(_, inside)| **inside) {
            if count[pixel] <= 1 {
                labels[pixel] = *label;
                continue;
            }
            let reading = depth.values()[pixel];
            let away = own.filter(|_| reading > 0.0).map_or(f32::MAX, |own| (own - reading).abs());
            if away < nearest[pixel] {
                (labels[pixel], nearest[pixel]) = (*label, away);
            }
        }
    }
    labels
}

/// Median depth of the pixels that are an instance's alone, or of all where none is.
fn own_depth(mask: &Image<bool>, count: &[u8], depth: &Image<f32>) -> Option<f32> {
    let readings = |alone: bool| -> Vec<f32> {
        let pixels = mask.values().iter().zip(count).zip(depth.values());
        pixels.filter(|((inside, count), depth)| **inside && **depth > 0.0 && (!alone || **count == 1)).map(|(_, depth)| *depth).collect()
    };
    let mut found = readings(true);
    if found.is_empty() {
        found = readings(false);
    }
    let middle = found.len() / 2;
    (!found.is_empty()).then(|| *found.select_nth_unstable_by(middle, f32::total_cmp).1)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn mask(pixels: &[u8]) -> Image<bool> {
        Image::new(pixels.len() as u32, 1, pixels.iter().map(|p| *p != 0).collect()).unwrap()
    }

    #[test]
    fn where_masks_overlap_the_one_whose_depth_is_read_has_the_pixel() {
        // The third is hidden behind the first in two pixels, and goes on; the first and the second do not touch.
        let masks = [(1, mask(&[1, 1, 1, 0, 0, 0, 0])), (2, mask(&[0, 0, 0, 0, 0, 0, 1])), (3, mask(&[0, 1, 1, 1, 1, 0, 0]))];
        let depth = Image::new(7, 1, vec![0.5, 0.5, 0.9, 0.9, 0.9, 1.5, 0.7]).unwrap();
        assert_eq!(merged(&masks, &depth), [1, 1, 3, 3, 3, 0, 2]);
        // Without a reading the first one has it.
        let depth = Image::new(7, 1, vec![0.5, 0.0, 0.9, 0.9, 0.9, 1.5, 0.7]).unwrap();
        assert_eq!(merged(&masks, &depth), [1, 1, 3, 3, 3, 0, 2]);
        // A small thing in front of the whole mask of another.
        let masks = [(1, mask(&[1, 1, 1, 1])), (2, mask(&[0, 1, 0, 0]))];
        assert_eq!(merged(&masks, &Image::new(4, 1, vec![0.9, 0.5, 0.9, 0.9]).unwrap()), [1, 2, 1, 1]);
    }
}
