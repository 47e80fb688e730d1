//! Which of its eight neighbours each reading lies on one surface with: found once for each pair of neighbours, row by row, and then kept
//! as bits, so that what hangs together is found without looking at depths again.

use crate::joining::{EIGHT, Joint, Piece};

/// For every pixel a bit for each neighbour, in the order of [`EIGHT`]; the opposite of bit `i` is bit `7 - i`. No bit leads out of the
/// image.
#[derive(Clone, Debug, Default)]
pub struct Links {
    bits: Vec<u8>,
    width: usize,
}

impl Links {
    /// Of an image `width` pixels wide, in which what is not looked at is not a number.
    pub fn find(&mut self, depth: &[f32], width: usize, joint: &Joint) {
        self.width = width;
        self.bits.clear();
        self.bits.resize(depth.len(), 0);
        let height = depth.len() / width.max(1);
        // A row of answers at a time, so that several are found at once.
        let mut joined = vec![0_u8; width];
        for v in 0..height {
            let (above, rest) = self.bits.split_at_mut((v + 1) * width);
            let own = &mut above[v * width..];
            let readings = &depth[v * width..][..width];
            ask(joint, readings, &readings[1..], &mut joined);
            set(own, &joined, 4);
            set(&mut own[1..], &joined, 3);
            if v + 1 == height {
                break;
            }
            let (below, next) = (&mut rest[..width], &depth[(v + 1) * width..][..width]);
            ask(joint, readings, next, &mut joined);
            set(own, &joined, 6);
            set(below, &joined, 1);
            ask(joint, readings, &next[1..], &mut joined);
            set(own, &joined, 7);
            set(&mut below[1..], &joined, 0);
            ask(joint, &readings[1..], next, &mut joined);
            set(&mut own[1..], &joined, 5);
            set(below, &joined, 2);
        }
    }

    /// Whether a pixel has eight neighbours and lies on one surface with all of them.
    #[inline]
    pub fn are_all(&self, pixel: usize) -> bool {
        self.bits[pixel] == u8::MAX
    }

    /// How many neighbours a pixel lies on one surface with.
    #[inline]
    pub fn count(&self, pixel: usize) -> u32 {
        self.bits[pixel].count_ones()
    }

    /// The neighbours that a pixel lies on one surface with.
    #[inline]
    pub fn of(&self, pixel: usize) -> impl Iterator<Item = usize> {
        let (mut bits, width) = (self.bits[pixel], self.width as isize);
        std::iter::from_fn(move || {
            let [down, right] = *EIGHT.get(bits.trailing_zeros() as usize)?;
            bits &= bits - 1;
            Some(pixel.wrapping_add_signed(down * width + right))
        })
    }

    /// The pieces of those of the `pixels` whose `state` is `wanted`: neighbours hang together where they lie on one surface. Their state
    /// becomes `done`. The largest piece comes first.
    pub fn pieces(&self, pixels: &[u32], state: &mut [u8], wanted: u8, done: u8) -> Vec<Piece> {
        pieces(pixels, state, wanted, done, |pixel| self.of(pixel))
    }
}

/// The pieces of those of the `pixels` whose `state` is `wanted`, where each hangs together with those `beside` it; see [`Links::pieces`].
fn pieces<I: Iterator<Item = usize>>(pixels: &[u32], state: &mut [u8], wanted: u8, done: u8, beside: impl Fn(usize) -> I) -> Vec<Piece> {
    let mut found = Vec::new();
    for start in pixels {
        if state[*start as usize] != wanted {
            continue;
        }
        state[*start as usize] = done;
        let mut piece = vec![*start];
        let mut next = 0;
        while let Some(pixel) = piece.get(next).copied() {
            next += 1;
            for other in beside(pixel as usize) {
                if state[other] == wanted {
                    state[other] = done;
                    piece.push(other as u32);
                }
            }
        }
        found.push(Piece { pixels: piece });
    }
    found.sort_by_key(|piece| (usize::MAX - piece.pixels.len(), piece.pixels[0]));
    found
}

/// Whether readings of two rows lie on one surface, pair by pair; where one row ends, they do not.
fn ask(joint: &Joint, a: &[f32], b: &[f32], joined: &mut [u8]) {
    for ((joined, a), b) in joined.iter_mut().zip(a).zip(b) {
        *joined = u8::from(joint.joins(*a, *b));
    }
    let end = joined.len().min(a.len()).min(b.len());
    joined[end..].fill(0);
}

/// Sets a bit of each pixel by the answers.
fn set(bits: &mut [u8], joined: &[u8], bit: u32) {
    bits.iter_mut().zip(joined).for_each(|(bits, joined)| *bits |= joined << bit);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::joining::neighbours;
    use crate::rays::Rays;
    use crate::{Intrinsics, SensorModel};

    #[test]
    fn links_lead_to_the_neighbours_on_the_same_surface_and_make_the_same_pieces() {
        let (width, height) = (37, 23);
        let camera = Intrinsics::new(width as u32, height as u32, [40.0; 2], [18.0, 11.0], [0.0; 5]).unwrap();
        let rays = Rays::new(&camera);
        let joint = Joint::new(&rays, &SensorModel::default());
        // Steps of four heights in a fixed disorder, and pixels that are not looked at.
        let depth: Vec<f32> = (0..width * height)
            .map(|pixel| match pixel * 7919 % 101 {
                0..12 => f32::NAN,
                n => 0.6 + 0.15 * (n / 24) as f32 + 0.001 * (pixel % 5) as f32,
            })
            .collect();
        let mut links = Links::default();
        links.find(&depth, width, &joint);
        for pixel in 0..depth.len() {
            let expected: Vec<usize> =
                neighbours(EIGHT, pixel, width, height).filter(|other| joint.joins(depth[pixel], depth[*other])).collect();
            assert_eq!(links.of(pixel).collect::<Vec<_>>(), expected, "pixel {pixel}");
            assert_eq!(links.are_all(pixel), expected.len() == 8);
        }
        let looked_at: Vec<u32> = (0..depth.len() as u32).filter(|pixel| !depth[*pixel as usize].is_nan()).collect();
        let mut states = [vec![0_u8; depth.len()], vec![0_u8; depth.len()]];
        states.iter_mut().for_each(|state| looked_at.iter().for_each(|pixel| state[*pixel as usize] = 1));
        let [a, b] = &mut states;
        let (z, joint) = (&depth, &joint);
        let joined = |pixel: usize| neighbours(EIGHT, pixel, width, height).filter(move |other| joint.joins(z[pixel], z[*other]));
        let (slow, quick) = (pieces(&looked_at, a, 1, 2, joined), links.pieces(&looked_at, b, 1, 2));
        assert!(slow.len() > 3 && slow.iter().map(|piece| &piece.pixels).eq(quick.iter().map(|piece| &piece.pixels)));
        assert_eq!(a, b);
    }
}
