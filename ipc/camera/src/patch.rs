//! A rectangle of the depth image about some of its pixels, in memory of its own: rows are looked at as a whole, several readings at once,
//! and there is no border to ask about.

/// The readings of some pixels; what else lies in the rectangle, and a margin about it, is not a number.
pub struct Patch {
    left: usize,
    top: usize,
    margin: usize,
    width: usize,
    image_width: usize,
    z: Vec<f32>,
}

impl Patch {
    /// Of some pixels of an image `image_width` pixels wide, with a margin in pixels.
    pub fn of(depth: &[f32], image_width: usize, pixels: &[u32], margin: usize) -> Self {
        let [left, right, top, bottom] = pixels.iter().fold([usize::MAX, 0, usize::MAX, 0], |[l, r, t, b], pixel| {
            let (u, v) = (*pixel as usize % image_width, *pixel as usize / image_width);
            [l.min(u), r.max(u), t.min(v), b.max(v)]
        });
        let side = |low: usize, high: usize| if pixels.is_empty() { 0 } else { high - low + 1 + 2 * margin };
        let (width, height) = (side(left, right), side(top, bottom));
        let mut patch = Self { left, top, margin, width, image_width, z: vec![f32::NAN; width * height] };
        for pixel in pixels {
            let place = patch.place(*pixel);
            patch.z[place] = depth[*pixel as usize];
        }
        patch
    }

    /// The place of a pixel in the patch.
    #[inline]
    pub fn place(&self, pixel: u32) -> usize {
        let (u, v) = (pixel as usize % self.image_width, pixel as usize / self.image_width);
        (v - self.top + self.margin) * self.width + u - self.left + self.margin
    }

    /// The pixel at a place; the order of both is the same.
    #[inline]
    pub fn pixel(&self, place: u32) -> u32 {
        let (u, v) = (place as usize % self.width, place as usize / self.width);
        ((v + self.top - self.margin) * self.image_width + u + self.left - self.margin) as u32
    }

    /// Places of a row.
    pub fn width(&self) -> usize {
        self.width
    }

    /// The readings, row by row.
    pub fn z(&self) -> &[f32] {
        &self.z
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_patch_holds_its_pixels_and_nothing_else() {
        let depth: Vec<f32> = (0..70).map(|pixel| pixel as f32).collect();
        let pixels = [23, 32, 34, 45];
        for margin in [0, 2] {
            let patch = Patch::of(&depth, 10, &pixels, margin);
            assert_eq!((patch.width(), patch.z().len()), (4 + 2 * margin, (4 + 2 * margin) * (3 + 2 * margin)));
            let held: Vec<(u32, f32)> =
                (0..patch.z().len() as u32).map(|place| (place, patch.z()[place as usize])).filter(|(_, z)| !z.is_nan()).collect();
            assert_eq!(held.iter().map(|(_, z)| *z as u32).collect::<Vec<_>>(), pixels);
            assert!(held.iter().all(|(place, z)| patch.pixel(*place) == *z as u32 && patch.place(*z as u32) == *place as usize));
        }
        assert!(Patch::of(&depth, 10, &[], 2).z().is_empty());
    }
}
