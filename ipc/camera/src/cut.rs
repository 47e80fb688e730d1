//! Objects that are cut off in the image, by its border or by something nearer.

use crate::joining::Joint;
use crate::rays::Rays;
use crate::support::Plane;

/// The ways in which an object is cut off in the image.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Cut {
    /// It touches the border of the image, or of what the sensor sees of it.
    pub border: bool,
    /// Something nearer hides a part of it.
    pub occluder: bool,
}

/// A strip without readings along the border of the image is the border, up to this share of its side.
const BLIND: usize = 12;
/// Pixels beyond an object's edge from which on what hides it is looked for: readings at the edge itself fly.
const BEYOND: isize = 3;
/// A band without readings between an object and what hides it is at most so wide, metres at the object: the shadow of the one on the other.
const SHADOW_M: f32 = 0.03;
/// Readings no higher above the object's support, metres, are of the support and hide nothing: before an object whose side has no readings it
/// is nearer than what is seen of the object.
const SUPPORT_M: f64 = 0.012;
/// Share of an object's edge along which something nearer must lie.
const LEAST_SHARE: f64 = 0.08;

/// Finds whether the object with these `pixels` that stands on `support`, all of whose own have its label, is cut off.
pub fn cut(rays: &Rays, depth: &[f32], labels: &[u16], joint: &Joint, pixels: &[u32], support: Option<&Plane>) -> Cut {
    let (width, height) = (rays.width(), rays.height());
    let is_support = |pixel: usize| support.is_some_and(|plane| plane.height(&rays.point(pixel, depth[pixel]).cast().into()) < SUPPORT_M);
    let mut found = Cut::default();
    let (mut edge, mut hidden) = (0_usize, 0_usize);
    for pixel in pixels {
        let pixel = *pixel as usize;
        let (u, v) = ((pixel % width) as isize, (pixel / width) as isize);
        let (z, label) = (depth[pixel], labels[pixel]);
        for [down, right] in crate::joining::FOUR {
            let inside = |steps: isize| {
                let (u, v) = (u + steps * right, v + steps * down);
                (u >= 0 && v >= 0 && u < width as isize && v < height as isize).then(|| v as usize * width + u as usize)
            };
            let Some(beside) = inside(1) else {
                found.border = true;
                continue;
            };
            if labels[beside] == label {
                continue;
            }
            edge += 1;
            let widest = BEYOND.max((SHADOW_M / joint.pitch(z).max(1e-6)).min(width as f32) as isize);
            let beyond = (BEYOND..=widest).map_while(inside).find(|beyond| depth[*beyond] > 0.0);
            if let Some(beyond) = beyond {
                let is_nearer = labels[beyond] != label && z - depth[beyond] > 2.0 * joint.reach(z);
                hidden += usize::from(is_nearer && !is_support(beyond));
            }
            if !found.border && depth[beside] == 0.0 {
                let side = if right == 0 { height } else { width };
                let most = (side / BLIND) as isize;
                let end = (1..=most).find(|steps| inside(*steps).is_none_or(|other| depth[other] > 0.0));
                found.border = end.is_some_and(|end| inside(end).is_none());
            }
        }
    }
    found.occluder = edge > 0 && hidden as f64 >= LEAST_SHARE * edge as f64;
    found
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Intrinsics, SensorModel};

    #[test]
    fn what_is_nearer_hides_beyond_a_shadow_too() {
        let hidden_beyond = |shadow: usize| {
            let camera = Intrinsics::new(120, 90, [400.0; 2], [59.5, 44.5], [0.0; 5]).unwrap();
            let rays = Rays::new(&camera);
            let joint = Joint::new(&rays, &SensorModel::default());
            let mut depth = vec![1.3_f32; 120 * 90];
            let mut labels = vec![0_u16; depth.len()];
            for pixel in 0..depth.len() {
                match pixel % 120 {
                    30..60 if (30..60).contains(&(pixel / 120)) => (depth[pixel], labels[pixel]) = (1.0, 1),
                    60.. if pixel % 120 < 60 + shadow => depth[pixel] = 0.0,
                    60.. => depth[pixel] = 0.8,
                    _ => {}
                }
            }
            let pixels: Vec<u32> = (0..depth.len() as u32).filter(|pixel| labels[*pixel as usize] == 1).collect();
            cut(&rays, &depth, &labels, &joint, &pixels, None).occluder
        };
        assert!(hidden_beyond(0) && hidden_beyond(9), "9 pixels are 2.2 cm");
        assert!(!hidden_beyond(20), "5 cm away lies something else");
    }

    /// The cut of a square of label 1 at 1 m, from column `left` on, with something at `near` metres over its right half if that is above 0,
    /// and no reading in the first `blind` columns.
    fn of(left: usize, near: f32, blind: usize) -> Cut {
        standing(left, near, blind, None)
    }

    /// As [`of`], where the square stands on a support.
    fn standing(left: usize, near: f32, blind: usize, support: Option<&Plane>) -> Cut {
        let camera = Intrinsics::new(120, 90, [110.0; 2], [59.5, 44.5], [0.0; 5]).unwrap();
        let rays = Rays::new(&camera);
        let joint = Joint::new(&rays, &SensorModel::default());
        let mut depth = vec![1.3_f32; 120 * 90];
        let mut labels = vec![0_u16; depth.len()];
        for pixel in 0..depth.len() {
            let (u, v) = (pixel % 120, pixel / 120);
            if (30..60).contains(&v) && (left..left + 30).contains(&u) {
                (depth[pixel], labels[pixel]) = (1.0, 1);
            }
            if near > 0.0 && (20..70).contains(&v) && (left + 15..left + 40).contains(&u) {
                (depth[pixel], labels[pixel]) = (near, 2);
            }
            if u < blind {
                (depth[pixel], labels[pixel]) = (0.0, 0);
            }
        }
        let pixels: Vec<u32> = (0..depth.len() as u32).filter(|pixel| labels[*pixel as usize] == 1).collect();
        cut(&rays, &depth, &labels, &joint, &pixels, support)
    }

    #[test]
    fn the_border_and_what_is_nearer_cut_and_what_is_farther_does_not() {
        assert_eq!(of(40, 0.0, 0), Cut::default());
        assert_eq!(of(0, 0.0, 0), Cut { border: true, occluder: false });
        assert_eq!(of(4, 0.0, 6), Cut { border: true, occluder: false }, "a blind strip is the border");
        assert_eq!(of(40, 0.0, 6), Cut::default(), "a blind strip far away is not");
        assert_eq!(of(40, 0.8, 0), Cut { border: false, occluder: true });
        assert_eq!(of(40, 1.25, 0), Cut::default());
    }

    #[test]
    fn the_support_hides_nothing_and_what_stands_on_it_does() {
        let at = |z: f64| Plane::new(-nalgebra::Vector3::z_axis(), &nalgebra::Point3::new(0.0, 0.0, z));
        // What is at 0.8 m is the support, or rises 5 cm above it.
        assert_eq!(standing(40, 0.8, 0, Some(&at(0.8))), Cut::default());
        assert_eq!(standing(40, 0.8, 0, Some(&at(0.85))), Cut { border: false, occluder: true });
    }
}
