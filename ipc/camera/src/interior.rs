//! Low readings that are an object's own because the object encloses them: the floor of a bowl or a mug, the middle of a plate.
//!
//! They are near the support plane, as readings of the support in a mask that is too wide are, and are told from those in plan view, on the
//! plane: the floor of a vessel lies inside the convex hull of what is high, and either above the plane by more than the plane may be off
//! with walls on most sides, or with walls all around. The table that is seen through a handle lies on the plane and has the object on some sides only, or is small;
//! the table beside a foot lies outside of the hull.

use crate::joining::{FOUR, neighbours};
use crate::plan_view::{PlanView, Sides, convex_hull};
use crate::scene::{LocalSupport, Scene};
use nalgebra::Vector2;

/// A region lies this far above the plane, metres, or so many deviations of the support's readings, if it is a raised floor.
const RAISED_M: f32 = 0.0025;
const RAISED_DEVIATIONS: f32 = 0.75;
/// Share of the directions on the plane in which an object with walls all around lies, as seen from its floor.
const ALL_AROUND: f32 = 0.85;
/// Of a raised floor it may be less: a part of the walls may be cut off.
const MOSTLY_AROUND: f32 = 0.7;
/// Share of the object's readings that a floor on the plane has at least: more than what is seen through a handle.
const LARGE: f64 = 0.1;
/// How far below the plane a floor may seem to lie, in deviations of the support's readings: the plane is inferred from around it.
const SUNK_DEVIATIONS: f32 = 1.5;
/// Directions that are told apart.
const SECTORS: usize = 16;
/// High readings that the hull and the directions are found by, at most.
const MOST_HIGH: usize = 800;
/// Readings of a region that look around, at most.
const MOST_LOOKING: usize = 40;
/// Distance inside of the hull, in pixels, or in deviations of a reading: the foot of a wall seems to lie inside by its noise.
const INSIDE_PIXELS: f32 = 2.0;
const INSIDE_DEVIATIONS: f64 = 2.0;
/// Readings of a region at least.
const LEAST_READINGS: usize = 12;

/// Of the low readings of a mask, with their heights, those that the object with the `high` ones encloses. `state` is `wanted` at all the
/// low ones, and `done` at what was looked at afterwards.
pub fn enclosed(
    scene: &Scene<'_>,
    support: &LocalSupport,
    high: &[u32],
    low: &[(u32, f32)],
    state: &mut [u8],
    [wanted, done]: [u8; 2],
) -> Vec<u32> {
    let view = PlanView::of(&support.plane.normal().into_inner().cast());
    let at = |pixel: u32| view.see(&scene.rays.point(pixel as usize, scene.depth[pixel as usize]));
    let tops: Vec<Vector2<f32>> = high.iter().step_by(high.len().div_ceil(MOST_HIGH).max(1)).map(|pixel| at(*pixel)).collect();
    let hull = Sides::of(&convex_hull(tops.clone()));
    let is_inside = |pixel: u32| {
        let z = scene.depth[pixel as usize];
        let margin = (INSIDE_PIXELS * scene.rays.pitch(z)).max((INSIDE_DEVIATIONS * scene.sensor.deviation(f64::from(z))) as f32);
        hull.is_inside(&at(pixel), margin)
    };
    let candidates: Vec<(u32, f32)> = low.iter().copied().filter(|(pixel, _)| is_inside(*pixel)).collect();
    low.iter().for_each(|(pixel, _)| state[*pixel as usize] = done);
    candidates.iter().for_each(|(pixel, _)| state[*pixel as usize] = wanted);
    let deviation = support.deviation_m as f32;
    let mut own = Vec::new();
    for region in regions(scene, &candidates, state, [wanted, done]) {
        if region.len() < LEAST_READINGS {
            continue;
        }
        let mean = region.iter().map(|(_, h)| h).sum::<f32>() / region.len() as f32;
        let is_raised = mean > RAISED_M.max(RAISED_DEVIATIONS * deviation);
        let is_large = region.len() as f64 >= LARGE * (region.len() + high.len()) as f64;
        if !is_raised && (!is_large || mean < -SUNK_DEVIATIONS * deviation) {
            continue;
        }
        let some = region.iter().step_by(region.len().div_ceil(MOST_LOOKING)).map(|(pixel, _)| at(*pixel));
        if surrounded(&tops[..], some) >= if is_raised { MOSTLY_AROUND } else { ALL_AROUND } {
            own.extend(region.iter().map(|(pixel, _)| *pixel));
        }
    }
    own
}

/// The regions of pixels that are `wanted`: neighbours of four hang together.
fn regions(scene: &Scene<'_>, candidates: &[(u32, f32)], state: &mut [u8], [wanted, done]: [u8; 2]) -> Vec<Vec<(u32, f32)>> {
    let (width, height) = (scene.rays.width(), scene.rays.height());
    let mut found = Vec::new();
    for start in candidates {
        if state[start.0 as usize] != wanted {
            continue;
        }
        state[start.0 as usize] = done;
        let mut region = vec![*start];
        let mut next = 0;
        while let Some((pixel, _)) = region.get(next).copied() {
            next += 1;
            for other in neighbours(FOUR, pixel as usize, width, height) {
                if state[other] == wanted {
                    state[other] = done;
                    // Candidates are ascending.
                    let index = candidates.partition_point(|(candidate, _)| (*candidate as usize) < other);
                    region.push(candidates[index]);
                }
            }
        }
        found.push(region);
    }
    found
}

/// The mean share of the directions in which some of the `tops` lie, as seen from points on the plane.
fn surrounded(tops: &[Vector2<f32>], from: impl Iterator<Item = Vector2<f32>>) -> f32 {
    let (mut sum, mut count) = (0_u32, 0_u32);
    for place in from {
        let mut seen = 0_u32;
        for top in tops {
            let d = top - place;
            // As an angle, but along a square in place of a circle: from 0 to 4, without a trigonometric function.
            let along = d.y / (d.x.abs() + d.y.abs()).max(1e-12);
            let turn = match (d.x < 0.0, d.y < 0.0) {
                (true, _) => 2.0 - along,
                (false, true) => 4.0 + along,
                (false, false) => along,
            };
            seen |= 1 << ((turn * (SECTORS as f32 / 4.0)) as usize).min(SECTORS - 1);
        }
        sum += seen.count_ones();
        count += 1;
    }
    sum as f32 / (count.max(1) * SECTORS as u32) as f32
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_ring_surrounds_its_middle_and_half_a_ring_half_of_it() {
        let ring = |turns: f32| -> Vec<Vector2<f32>> {
            (0..200).map(|i| (i as f32 / 200.0 * turns - 0.5) * std::f32::consts::TAU).map(|a| Vector2::new(a.cos(), a.sin())).collect()
        };
        let middle = || std::iter::once(Vector2::zeros());
        assert_eq!(surrounded(&ring(1.0), middle()), 1.0);
        assert!((surrounded(&ring(0.5), middle()) - 0.5).abs() < 0.07);
    }
}
