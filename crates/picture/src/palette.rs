//! A perceptually uniform colour map, for depths and deviations.

use super::Colour;

/// Nine colours of viridis (Smith & van der Walt, matplotlib 2.0), evenly spaced.
const VIRIDIS: [[u8; 3]; 9] = [
    [68, 1, 84],
    [71, 44, 122],
    [59, 81, 139],
    [44, 113, 142],
    [33, 144, 141],
    [39, 173, 129],
    [92, 200, 99],
    [170, 220, 50],
    [253, 231, 37],
];

/// The colour of a value from 0 (dark blue) to 1 (yellow), equal steps looking equal; values outside are taken as these, and what is
/// not a number as 0.
pub fn viridis(value: f32) -> Colour {
    let last = VIRIDIS.len() - 1;
    let place = if value.is_nan() { 0.0 } else { value.clamp(0.0, 1.0) * last as f32 };
    let below = (place as usize).min(last - 1);
    let colour = |n: usize| Colour::rgb(VIRIDIS[n][0], VIRIDIS[n][1], VIRIDIS[n][2]);
    colour(below).mix(colour(below + 1), place - below as f32)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_map_has_the_published_colours_and_takes_every_number() {
        // matplotlib.colormaps["viridis"](x) at 0, ½, 1.
        for (value, rgb) in [(0.0, [68, 1, 84]), (0.5, [33, 144, 141]), (1.0, [253, 231, 37])] {
            assert_eq!(viridis(value).rgb, rgb);
        }
        assert_eq!((viridis(-3.0), viridis(9.0), viridis(f32::NAN)), (viridis(0.0), viridis(1.0), viridis(0.0)));
        let light = |c: Colour| 0.2126 * f32::from(c.rgb[0]) + 0.7152 * f32::from(c.rgb[1]) + 0.0722 * f32::from(c.rgb[2]);
        assert!((0..100).all(|n| light(viridis(n as f32 / 100.0)) <= light(viridis((n + 1) as f32 / 100.0)) + 0.5));
    }
}
