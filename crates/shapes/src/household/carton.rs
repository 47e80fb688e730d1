//! Boxes of cardboard, and books: standing on any side.

use super::random::Random;
use super::solid::Solid;

/// Typical boxes, metres, longest side first.
const TYPICAL: [[f64; 3]; 12] = [
    [0.210, 0.160, 0.060], // cereals, crackers
    [0.300, 0.195, 0.065], // cereals, large
    [0.175, 0.090, 0.040], // sugar
    [0.110, 0.085, 0.035], // pudding
    [0.085, 0.073, 0.028], // gelatin
    [0.150, 0.075, 0.065], // tea bags, lying
    [0.125, 0.080, 0.070], // tea bags
    [0.190, 0.120, 0.045], // tea, flat
    [0.240, 0.170, 0.025], // a book
    [0.200, 0.130, 0.035], // a paperback
    [0.100, 0.100, 0.100], // a cube
    [0.240, 0.120, 0.090], // tissues
];

/// A box: half of them near to typical ones, half of any proportions.
pub(super) fn carton(r: &mut Random) -> Solid {
    let mut sides = if r.chance(0.5) {
        r.one_of(&TYPICAL).map(|side| side * r.about(0.85, 1.18))
    } else {
        let longest = r.about(0.07, 0.32);
        let middle = longest * r.within(0.3, 1.0);
        [longest, middle, (middle * r.within(0.12, 1.0)).max(0.015)]
    };
    sides.sort_by(|a, b| b.total_cmp(a));
    let [long, middle, short] = sides;
    let [x, y, z] = match r.within(0.0, 1.0) {
        // Upright on its smallest face, on its long narrow side, flat.
        p if p < 0.4 => [middle, short, long],
        p if p < 0.65 => [long, short, middle],
        _ => [long, middle, short],
    };
    let mut solid = Solid::default();
    solid.cuboid([-x / 2.0, -y / 2.0, 0.0], [x / 2.0, y / 2.0, z]);
    solid
}
