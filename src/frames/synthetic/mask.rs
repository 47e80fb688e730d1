//! What the masks of people and of detectors do: they are some pixels too wide or too narrow, lie beside the object, or are boxes.

use super::DepthImage;

/// Faults of instance masks, in pixels. [`MaskFaults::NONE`], the default, has none.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct MaskFaults {
    /// By how many pixels a mask is too wide to all sides, corners included; negative where it is too narrow.
    pub growth_px: i32,
    /// How far it lies to the right and below.
    pub shift_px: [i32; 2],
    /// Whether it is the box about what it would be otherwise.
    pub is_box: bool,
    /// Side of a square beside the object, away from it by as much again as it is wide, that is in its mask as well; 0 for none.
    pub speck_px: i32,
}

/// Columns and rows, both ends included.
#[derive(Clone, Copy)]
struct Bounds {
    low: [i32; 2],
    high: [i32; 2],
}

impl Bounds {
    fn of(pixels: impl Iterator<Item = [i32; 2]>) -> Option<Self> {
        pixels.fold(None, |found: Option<Self>, [u, v]| {
            let Self { low, high } = found.unwrap_or(Self { low: [u, v], high: [u, v] });
            Some(Self { low: [low[0].min(u), low[1].min(v)], high: [high[0].max(u), high[1].max(v)] })
        })
    }

    fn pixels(self) -> impl Iterator<Item = [i32; 2]> {
        (self.low[1]..=self.high[1]).flat_map(move |v| (self.low[0]..=self.high[0]).map(move |u| [u, v]))
    }
}

impl MaskFaults {
    /// Masks as they should be.
    pub const NONE: Self = Self { growth_px: 0, shift_px: [0; 2], is_box: false, speck_px: 0 };

    /// Puts masks with these faults in the place of an image's labels. `background`, the label of a table or 0, and 0 itself have no mask;
    /// where masks overlap, a pixel is the object's that is labelled there, or else the one's with the smaller label.
    pub fn apply(&self, image: &mut DepthImage, background: u16) {
        if *self == Self::NONE {
            return;
        }
        let size = [image.intrinsics().width() as i32, image.intrinsics().height() as i32];
        let truth = image.labels().to_vec();
        let label_at = |[u, v]: [i32; 2]| {
            let is_inside = u >= 0 && v >= 0 && u < size[0] && v < size[1];
            is_inside.then(|| truth[(v * size[0] + u) as usize])
        };
        let is_object = |label: u16| label != 0 && label != background;
        let mut objects: Vec<u16> = truth.iter().copied().filter(|label| is_object(*label)).collect();
        objects.sort_unstable();
        objects.dedup();
        let (_, labels) = image.parts_mut();
        labels.iter_mut().filter(|label| is_object(**label)).for_each(|label| *label = background);
        let all = Bounds { low: [0; 2], high: [size[0] - 1, size[1] - 1] };
        for object in objects {
            let mut mask: Vec<[i32; 2]> = match self.is_box {
                true => {
                    self.bounds(all.pixels().filter(|at| label_at(*at) == Some(object))).map_or_else(Vec::new, |b| b.pixels().collect())
                }
                false => all.pixels().filter(|at| self.is_masked(*at, object, &label_at)).collect(),
            };
            if let Some(Bounds { low, high }) = Bounds::of(mask.iter().copied()).filter(|_| self.speck_px > 0) {
                let left = low[0] - (high[0] - low[0]);
                mask.extend(Bounds { low: [left - self.speck_px, high[1] - self.speck_px], high: [left - 1, high[1] - 1] }.pixels());
            }
            let [right, down] = self.shift_px;
            for [u, v] in mask.into_iter().map(|[u, v]| [u + right, v + down]) {
                if label_at([u, v]).is_some_and(|own| own == object || !is_object(own)) {
                    let label = &mut labels[(v * size[0] + u) as usize];
                    *label = if is_object(*label) { *label } else { object };
                }
            }
        }
    }

    /// The box about some pixels, as much wider as the mask is.
    fn bounds(&self, pixels: impl Iterator<Item = [i32; 2]>) -> Option<Bounds> {
        let Bounds { low, high } = Bounds::of(pixels)?;
        Some(Bounds { low: low.map(|v| v - self.growth_px), high: high.map(|v| v + self.growth_px) })
    }

    /// Whether a pixel is in an object's mask before it is shifted: some pixel around it is the object's, or, of a narrow mask, all are.
    fn is_masked(&self, [u, v]: [i32; 2], object: u16, label_at: &impl Fn([i32; 2]) -> Option<u16>) -> bool {
        let reach = self.growth_px.abs();
        let mut around = Bounds { low: [u - reach, v - reach], high: [u + reach, v + reach] }.pixels();
        match self.growth_px < 0 {
            true => around.all(|at| label_at(at).is_none_or(|label| label == object)) && label_at([u, v]) == Some(object),
            false => around.any(|at| label_at(at) == Some(object)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use beo_camera::Intrinsics;

    /// A triangle of label 2 on a table of label 1, with faults, as text.
    fn drawn(faults: MaskFaults) -> String {
        let mut image = DepthImage::empty(Intrinsics::new(9, 7, [9.0; 2], [4.0, 3.0], [0.0; 5]).unwrap());
        let (_, labels) = image.parts_mut();
        labels.fill(1);
        for (row, columns) in [(2, 3..4), (3, 3..5), (4, 3..6)] {
            columns.for_each(|column| labels[row * 9 + column] = 2);
        }
        faults.apply(&mut image, 1);
        let row = |row: &[u16]| row.iter().map(|label| if *label == 2 { '#' } else { '.' }).collect::<String>();
        assert!(image.labels().iter().all(|label| (1..=2).contains(label)));
        image.labels().chunks_exact(9).map(row).collect::<Vec<_>>().join(" ")
    }

    #[test]
    fn masks_grow_shrink_move_and_become_boxes() {
        let none = "......... ......... ...#..... ...##.... ...###... ......... .........";
        assert_eq!(drawn(MaskFaults::NONE), none);
        let wide = MaskFaults { growth_px: 1, ..MaskFaults::NONE };
        assert_eq!(drawn(wide), "......... ..###.... ..####... ..#####.. ..#####.. ..#####.. .........");
        let moved = MaskFaults { shift_px: [-1, 2], ..MaskFaults::NONE };
        assert_eq!(drawn(moved), "......... ......... ......... ......... ..#...... ..##..... ..###....");
        let boxed = MaskFaults { is_box: true, ..MaskFaults::NONE };
        assert_eq!(drawn(boxed), "......... ......... ...###... ...###... ...###... ......... .........");
        let speck = MaskFaults { speck_px: 1, ..MaskFaults::NONE };
        assert_eq!(drawn(speck), "......... ......... ...#..... #..##.... ...###... ......... .........");
        assert_eq!(drawn(MaskFaults { growth_px: -1, ..MaskFaults::NONE }).matches('#').count(), 0);
    }

    #[test]
    fn a_mask_does_not_reach_over_another_object() {
        let mut image = DepthImage::empty(Intrinsics::new(8, 8, [9.0; 2], [4.0, 3.0], [0.0; 5]).unwrap());
        let (_, labels) = image.parts_mut();
        for row in 0..8 {
            labels[row * 8 + 2] = 3;
            labels[row * 8 + 4] = 5;
        }
        MaskFaults { growth_px: 2, ..MaskFaults::NONE }.apply(&mut image, 0);
        assert_eq!(&image.labels()[..8], [3, 3, 3, 3, 5, 5, 5, 0]);
    }
}
