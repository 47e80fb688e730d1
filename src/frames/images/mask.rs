//! An image as the mask of one object, however it was saved: 0 and 1, 0 and 255, colours, a palette, opacity, with soft edges, as JPEG.
//!
//! The rule: the object is wherever the mask is not (nearly) 0. A mask that holds at most [`MOST_HARD_VALUES`] different values, or none
//! from [`DARK`] on, has hard edges, and every value but 0 is the object. Any other has soft edges or noise: there the object is what has
//! at least half of the largest value, which leaves the outline where it was before it was softened. Of colours the largest channel counts, and where the opacity varies it is the mask.

use super::{Image, Raster};

/// Most different values, 0 among them, of a mask with hard edges.
const MOST_HARD_VALUES: usize = 8;
/// Values below this are those of small labels, not of brightness.
const DARK: f32 = 64.0;
/// Share of the largest value from which on a pixel of a mask with soft edges is the object.
const INSIDE: f32 = 0.5;

impl Raster {
    /// Whether each pixel is the object.
    pub fn into_mask(self) -> Image<bool> {
        let is_lossy = matches!(self, Self::Lossy(_));
        let is_float = matches!(self, Self::Floats(_));
        let brightness = self.brightness();
        let largest = brightness.values().iter().copied().fold(0.0, f32::max);
        let is_hard = !is_lossy && ((largest < DARK && !is_float) || few_values(brightness.values()));
        // The noise of a black JPEG is no object.
        let largest = if is_lossy { largest.max(DARK) } else { largest };
        let least = if is_hard { f32::MIN_POSITIVE } else { (INSIDE * largest).max(f32::MIN_POSITIVE) };
        brightness.map(|value| value >= least)
    }

    /// One number for each pixel, not negative and finite, 0 where there is no object.
    fn brightness(self) -> Image<f32> {
        match self {
            Self::Bytes(image) | Self::Lossy(image) => image.map(f32::from),
            Self::Words(image) => image.map(f32::from),
            Self::Integers { image, .. } => image.map(|value| value.max(0) as f32),
            Self::Floats(image) => image.map(|value| if value.is_finite() { value.max(0.0) } else { 0.0 }),
            Self::Colours(image) => of_colours(image),
            Self::Indexed { image, palette } => {
                let colour = |index: u8| palette.get(usize::from(index)).copied();
                // A palette of greys as dark as the indices, or one that is missing, says less than the indices do.
                let is_seen =
                    image.values().iter().any(|index| colour(*index).is_some_and(|[r, g, b, _]| f32::from(r.max(g).max(b)) >= DARK));
                if is_seen { of_colours(image.map(|index| colour(index).unwrap_or_default())) } else { image.map(f32::from) }
            }
        }
    }
}

/// The opacity where it varies, otherwise the largest channel.
fn of_colours(image: Image<[u8; 4]>) -> Image<f32> {
    let first = image.values().first().map(|pixel| pixel[3]);
    if image.values().iter().any(|pixel| Some(pixel[3]) != first) {
        return image.map(|[_, _, _, opacity]| f32::from(opacity));
    }
    image.map(|[r, g, b, _]| f32::from(r.max(g).max(b)))
}

fn few_values(values: &[f32]) -> bool {
    let mut seen: Vec<f32> = Vec::with_capacity(MOST_HARD_VALUES + 1);
    for value in values {
        if !seen.contains(value) {
            seen.push(*value);
            if seen.len() > MOST_HARD_VALUES {
                return false;
            }
        }
    }
    true
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row<T>(values: Vec<T>) -> Image<T> {
        Image::new(values.len() as u32, 1, values).unwrap()
    }

    fn mask(raster: Raster) -> Vec<u8> {
        raster.into_mask().values().iter().map(|inside| u8::from(*inside)).collect()
    }

    /// The soft edge of a resampled mask.
    fn soft() -> Vec<u8> {
        vec![0, 3, 9, 20, 40, 90, 127, 128, 150, 200, 250, 255]
    }

    #[test]
    fn hard_masks_are_the_object_wherever_they_are_not_zero() {
        assert_eq!(mask(Raster::Bytes(row(vec![0, 1, 0]))), [0, 1, 0]);
        assert_eq!(mask(Raster::Bytes(row(vec![0, 255, 3]))), [0, 1, 1]);
        assert_eq!(mask(Raster::Bytes(row((0..40).collect())))[..3], [0, 1, 1]);
        assert_eq!(mask(Raster::Words(row(vec![0, 65535, 1]))), [0, 1, 1]);
        assert_eq!(mask(Raster::Integers { image: row(vec![0, -1, 7]), largest: 127 }), [0, 0, 1]);
        assert_eq!(mask(Raster::Floats(row(vec![0.0, 1.0, f32::NAN, -1.0]))), [0, 1, 0, 0]);
        assert_eq!(mask(Raster::Bytes(row(vec![0, 0]))), [0, 0]);
    }

    #[test]
    fn soft_edges_and_noise_are_cut_at_half_of_the_largest_value() {
        let expected = [0, 0, 0, 0, 0, 0, 0, 1, 1, 1, 1, 1];
        assert_eq!(mask(Raster::Bytes(row(soft()))), expected);
        assert_eq!(mask(Raster::Lossy(row(soft()))), expected);
        assert_eq!(mask(Raster::Floats(row(soft().iter().map(|v| f32::from(*v) / 255.0).collect()))), expected);
        assert_eq!(mask(Raster::Words(row(soft().iter().map(|v| u16::from(*v) * 257).collect()))), expected);
        // JPEG of nothing: what is left of rounding.
        assert_eq!(mask(Raster::Lossy(row(vec![0, 3, 1, 0]))), [0, 0, 0, 0]);
        assert_eq!(mask(Raster::Lossy(row(vec![0, 3, 254, 255]))), [0, 0, 1, 1]);
    }

    #[test]
    fn colours_count_by_their_largest_channel_unless_the_opacity_varies() {
        let of = |pixels: Vec<[u8; 4]>| mask(Raster::Colours(row(pixels)));
        assert_eq!(of(vec![[0, 0, 0, 255], [255, 255, 255, 255], [0, 0, 128, 255]]), [0, 1, 1]);
        // A cut-out: black is a colour of the object.
        assert_eq!(of(vec![[90, 90, 90, 0], [0, 0, 0, 255], [8, 9, 7, 255]]), [0, 1, 1]);
        // Some programs write no opacity at all.
        assert_eq!(of(vec![[0, 0, 0, 0], [255, 0, 0, 0]]), [0, 1]);
    }

    #[test]
    fn a_palette_counts_by_its_colours_where_they_can_be_seen() {
        let indexed = |palette: Vec<[u8; 4]>| mask(Raster::Indexed { image: row(vec![0, 1, 2]), palette });
        let [black, white, red] = [[0, 0, 0, 255], [255, 255, 255, 255], [128, 0, 0, 255]];
        assert_eq!(indexed(vec![black, red, white]), [0, 1, 1]);
        // Index 0 is white here.
        assert_eq!(indexed(vec![white, black, black]), [1, 0, 0]);
        assert_eq!(indexed(vec![black, [1, 1, 1, 255], [2, 2, 2, 255]]), [0, 1, 1]);
        assert_eq!(indexed(vec![]), [0, 1, 1]);
    }
}
