//! Pose over all rotations: what turns with the query, what cannot be told, what is expected.

use crate::harness::{answer, dims, seen};
use beo_core::grid::{Observation, Occupancy, Outside, Rotation, Turn, yaw};
use beo_core::perception::{Method, PoseSearch, Query, RotationPrior};
use beo_lab::evaluation::rotations::draw_rotation;
use beo_shapes::furniture;
use nalgebra::Vector3;
use std::f64::consts::{FRAC_PI_2, PI};

fn query() -> Query {
    Query { pose: PoseSearch::Full, completion: true, ..Query::default() }
}

/// The class is told.
fn told(class: &str) -> Query {
    let only = |c: &str| if c == class { 0.0 } else { f64::NEG_INFINITY };
    Query { log_prior: furniture::CLASSES.iter().map(|c| only(c)).collect(), ..query() }
}

fn chair(seed: u64) -> Occupancy {
    furniture::make("chair", dims(), seed).unwrap()
}

#[test]
fn a_turned_chair_is_found_where_it_is_and_not_turned_the_other_way() {
    let (mut right, mut inverse) = (0, 0);
    for place in 0..30 {
        let rotation = draw_rotation(PoseSearch::Full, 1, place);
        let percept = answer(&seen(&chair(100 + place as u64), &rotation), &told("chair"));
        assert_eq!(furniture::CLASSES[percept.class], "chair");
        right += usize::from(percept.rotation_object_to_grid.angle_to(&rotation) < 15_f64.to_radians());
        inverse += usize::from(percept.rotation_object_to_grid.angle_to(&rotation.inverse()) < 15_f64.to_radians());
        assert!(percept.hypotheses.iter().all(|h| h.class == percept.class));
    }
    assert!(right >= 20 && inverse <= 3, "{right} {inverse}");
}

#[test]
fn turning_the_query_turns_the_answer() {
    for place in 0..4 {
        let (object, rotation) = (chair(120 + place as u64), draw_rotation(PoseSearch::Full, 2, place));
        let first = answer(&seen(&object, &rotation), &query());
        for quarter in 1..4 {
            let turn = yaw(f64::from(quarter) * FRAC_PI_2);
            let percept = answer(&seen(&object, &(turn * rotation)), &query());
            assert!(percept.rotation_object_to_grid.angle_to(&(turn * first.rotation_object_to_grid)) < 6_f64.to_radians());
            for (a, b) in percept.posterior.iter().zip(&first.posterior) {
                assert!((a - b).abs() < 0.1, "{a} {b}");
            }
        }
    }
}

#[test]
fn every_method_answers_views_and_other_observations() {
    let rotation = draw_rotation(PoseSearch::Full, 3, 0);
    let view = seen(&chair(130), &rotation);
    // The same, seen from the side: no view from above.
    let quarter = Rotation::from_axis_angle(&Vector3::x_axis(), FRAC_PI_2);
    let side = Turn::new(dims(), &quarter).observation(&view, Outside::Empty);
    for (observation, truth) in [(view, rotation), (side, quarter * rotation)] {
        for outside in [Outside::Empty, Outside::Unknown] {
            for method in [Method::Auto, Method::Hull, Method::Evidence, Method::Mean, Method::Paper] {
                let percept = answer(&observation, &Query { method, outside, ..told("chair") });
                assert!((percept.posterior.iter().sum::<f64>() - 1.0).abs() < 1e-9, "{method}");
                assert!(percept.occupancy.iter().chain(&percept.deviation).all(|v| v.is_finite()), "{method}");
                assert!(!percept.hypotheses.is_empty() && percept.rotation_spread_rad.is_finite(), "{method}");
                let error = percept.rotation_object_to_grid.angle_to(&truth).to_degrees();
                assert!(![Method::Auto, Method::Evidence].contains(&method) || error < 15.0, "{method}, {outside:?}: {error}");
            }
        }
    }
}

#[test]
fn nothing_seen_leaves_the_pose_open() {
    let percept = answer(&Observation::unknown(dims()), &query());
    // Mean angle between rotations: π/2 + 2/π.
    assert!((percept.rotation_spread_rad - FRAC_PI_2 - 2.0 / PI).abs() < 0.1, "{}", percept.rotation_spread_rad);
    assert!(percept.hypotheses.iter().all(|h| h.probability < 0.01), "{:?}", percept.hypotheses);
    assert!(percept.posterior.iter().all(|p| (p - 0.1).abs() < 1e-9));
}

#[test]
fn a_rotation_prior_decides_between_what_looks_alike() {
    // A slab: its four quarter turns look alike, and so do its two faces.
    let slab = Occupancy::from_fn(dims(), |i, j, k| (3..13).contains(&i) && (3..13).contains(&j) && (6..10).contains(&k));
    let observation = seen(&slab, &yaw(0.0));
    for (quarter, concentration) in [(0, 20.0), (1, 20.0), (2, 400.0), (3, 1e5)] {
        let expected = yaw(f64::from(quarter) * FRAC_PI_2);
        let query = Query { rotation_prior: RotationPrior::around(expected, concentration), ..told("table") };
        let percept = answer(&observation, &query);
        let error = percept.rotation_object_to_grid.angle_to(&expected).to_degrees();
        assert!(error < if concentration > 100.0 { 6.0 } else { 20.0 }, "{quarter}, {concentration}: {error}");
        assert!(percept.rotation_spread_rad < 0.5, "{}", percept.rotation_spread_rad);
    }
    // With a floor, what contradicts the prior is still found.
    let rotation = draw_rotation(PoseSearch::Full, 4, 2);
    let object = chair(140);
    let wrong = rotation * Rotation::from_axis_angle(&Vector3::y_axis(), 2.0);
    let query = Query { rotation_prior: RotationPrior::mixture([(wrong, 1.0)], 400.0, 0.3), ..told("chair") };
    let percept = answer(&seen(&object, &rotation), &query);
    assert!(
        percept.rotation_object_to_grid.angle_to(&rotation) < 15_f64.to_radians(),
        "{}",
        percept.rotation_object_to_grid.angle_to(&rotation)
    );
}

#[test]
fn an_object_that_tumbles_is_followed() {
    let step = Rotation::from_scaled_axis(Vector3::new(0.05, 0.03, 0.04));
    let start = Rotation::from_scaled_axis(Vector3::new(0.4, 0.1, 0.2));
    // From frame to frame the answer should turn by `step`: how often does it do something else?
    let flips = |class: &str, followed: bool| {
        let object = furniture::make(class, dims(), 140).unwrap();
        let (mut query, mut rotation, mut last, mut flips) = (told(class), start, None, 0);
        for _ in 0..60 {
            let percept = answer(&seen(&object, &rotation), &query);
            flips += usize::from(
                last.is_some_and(|last: Rotation| (step * last).angle_to(&percept.rotation_object_to_grid) > 30_f64.to_radians()),
            );
            last = Some(percept.rotation_object_to_grid);
            if followed {
                query.rotation_prior = RotationPrior::continuing(&percept);
            }
            rotation = step * rotation;
        }
        flips
    };
    for class in ["bathtub", "dresser", "night_stand"] {
        let (alone, followed) = (flips(class, false), flips(class, true));
        assert!(alone >= 10 && followed <= 1, "{class}: {alone} alone, {followed} followed");
    }
}
