//! Cutlery boxes: open trays with compartments.

use super::random::Random;
use super::solid::Solid;

/// A tray with walls, one to five compartments side by side along x, and sometimes one across at an end.
pub(super) fn cutlery_box(r: &mut Random) -> Solid {
    let x = r.within(0.22, 0.40) / 2.0;
    let y = (x * r.within(0.40, 0.95)).max(0.06);
    let z = r.within(0.040, 0.090);
    let wall = r.within(0.003, 0.007);
    let mut solid = Solid::default();
    solid.cuboid([-x, -y, 0.0], [x, y, wall]);
    // The walls overlap the floor and one another.
    for side in [-1.0, 1.0] {
        let (from, to) = ((side * x).min(side * (x - wall)), (side * x).max(side * (x - wall)));
        solid.cuboid([from, -y, 0.0], [to, y, z]);
        let (from, to) = ((side * y).min(side * (y - wall)), (side * y).max(side * (y - wall)));
        solid.cuboid([-x, from, 0.0], [x, to, z]);
    }
    let divider = z * r.within(0.75, 1.0);
    let mut end = x - wall / 2.0;
    if r.chance(0.5) {
        end = x * r.within(0.30, 0.65);
        solid.cuboid([end - wall / 2.0, wall - y, 0.0], [end + wall / 2.0, y - wall, divider]);
    }
    // Wide enough for spoons.
    let most = ((2.0 * y / 0.06) as u32).max(1);
    let compartments = r.one_of(&[1, 2, 3, 3, 4, 4, 5]).min(most);
    for n in 1..compartments {
        let at = -y + 2.0 * y * f64::from(n) / f64::from(compartments);
        solid.cuboid([-x + wall / 2.0, at - wall / 2.0, 0.0], [end, at + wall / 2.0, divider]);
    }
    solid
}
