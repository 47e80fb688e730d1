//! Pose: what turns with the query, what cannot be told, what is expected, and what is followed from frame to frame.

use crate::client::Client;
use crate::harness::{RESOLUTION, answer, dims, instance, model, run, seen, serve, shape, text};
use beo_core::grid::{Observation, Occupancy, Outside, Rotation, Turn, View, yaw, yaw_of};
use beo_core::perception::{CompletionFrame, Method, PaperPose, PoseSearch, Query, RotationPrior};
use beo_ipc::ObservationHeader;
use beo_shapes::furniture;
use nalgebra::Quaternion;
use serde_json::Value;
use std::f64::consts::{FRAC_PI_2, PI};

fn yaw_query() -> Query {
    Query { pose: PoseSearch::YAW, completion: true, ..Query::default() }
}

/// A table as broad as long, that a quarter turn leaves as it is.
fn square_table() -> Occupancy {
    let (low, high) = (3, RESOLUTION - 4);
    let edge = move |i: usize| i == low || i == high;
    let inside = move |i: usize| (low..=high).contains(&i);
    Occupancy::from_fn(dims(), |i, j, k| inside(i) && inside(j) && (k == 9 || (edge(i) && edge(j) && (3..9).contains(&k))))
}

/// The angle between two directions, 0 to π.
fn apart(a: f64, b: f64) -> f64 {
    ((a - b + PI).rem_euclid(2.0 * PI) - PI).abs()
}

#[test]
fn the_four_quarter_turns_of_a_square_table_are_hypotheses() {
    let percept = answer(&seen(&square_table(), &yaw(0.4)), &yaw_query());
    let class = percept.hypotheses[0].class;
    let of_class: Vec<_> = percept.hypotheses.iter().filter(|h| h.class == class).take(4).collect();
    assert_eq!(of_class.len(), 4, "{:?}", percept.hypotheses);
    let total: f64 = of_class.iter().map(|h| h.probability).sum();
    for h in &of_class {
        assert!((h.probability / total - 0.25).abs() < 0.08, "{:?}", percept.hypotheses);
        let turns = (yaw_of(&h.rotation) - yaw_of(&of_class[0].rotation)) / FRAC_PI_2;
        assert!((turns - turns.round()).abs() < 0.1, "{turns}");
    }
    let mut quarters: Vec<i32> =
        of_class.iter().map(|h| ((yaw_of(&h.rotation) - yaw_of(&of_class[0].rotation)) / FRAC_PI_2).round() as i32 & 3).collect();
    quarters.sort_unstable();
    assert_eq!(quarters, [0, 1, 2, 3]);
    assert!(percept.rotation_spread_rad > 0.9 && percept.rotation_spread_rad < 1.8, "{}", percept.rotation_spread_rad);
}

#[test]
fn quarter_turns_of_the_query_turn_the_answer_exactly() {
    for (seed, class) in [(5, "chair"), (6, "sofa"), (7, "monitor")] {
        let object = furniture::make(class, dims(), seed).unwrap();
        let upright = answer(&seen(&object, &yaw(0.0)), &yaw_query());
        for quarter in 1..4 {
            let angle = f64::from(quarter) * FRAC_PI_2;
            let turned = answer(&seen(&object, &yaw(angle)), &yaw_query());
            for (a, b) in upright.posterior.iter().zip(&turned.posterior) {
                assert!((a - b).abs() < 1e-4, "{a} {b}");
            }
            assert!(apart(yaw_of(&turned.rotation_object_to_grid), yaw_of(&upright.rotation_object_to_grid) + angle) < 1e-6, "{class}");
            // The completion turns with it, in the grid; in the object's frame it stays.
            let turn = Turn::new(dims(), &yaw(angle));
            let mut expected = vec![0.0; upright.occupancy.len()];
            turn.values(&upright.occupancy, 0.0, &mut expected);
            let worst = expected.iter().zip(&turned.occupancy).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
            assert!(worst < 1e-3, "{class}: {worst}");
        }
        let object_frame = Query { frame: CompletionFrame::Object, ..yaw_query() };
        let (a, b) = (answer(&seen(&object, &yaw(0.0)), &object_frame), answer(&seen(&object, &yaw(PI)), &object_frame));
        let worst = a.occupancy.iter().zip(&b.occupancy).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        assert!(worst < 1e-3, "{class}: {worst}");
    }
}

#[test]
fn turning_the_query_turns_the_answer_whatever_the_method() {
    let object = furniture::make("chair", dims(), 21).unwrap();
    for method in [Method::Auto, Method::Hull, Method::Evidence, Method::Mean, Method::Paper] {
        let query = Query { method, ..yaw_query() };
        for degrees in [0.0, 37.0, 200.0] {
            let angle = f64::to_radians(degrees);
            let percept = answer(&seen(&object, &yaw(angle)), &query);
            let found = yaw_of(&percept.rotation_object_to_grid);
            assert!(apart(found, angle) < 0.15, "{method}: {} for {degrees}", found.to_degrees());
            assert!(percept.posterior.iter().all(|p| p.is_finite()) && (percept.posterior.iter().sum::<f64>() - 1.0).abs() < 1e-9);
            assert!(percept.occupancy.iter().chain(&percept.deviation).all(|v| v.is_finite()));
        }
    }
}

#[test]
fn the_papers_estimators_find_a_turned_chair() {
    let object = furniture::make("chair", dims(), 22).unwrap();
    for paper_pose in [PaperPose::Edt, PaperPose::Density, PaperPose::Distance, PaperPose::Reprojection] {
        let query = Query { method: Method::Paper, pose: PoseSearch::Yaw { span: PI }, paper_pose, ..Query::default() };
        let found = answer(&seen(&object, &yaw(1.0)), &query);
        assert!(apart(yaw_of(&found.rotation_object_to_grid), 1.0) < 0.2, "{paper_pose:?}: {}", yaw_of(&found.rotation_object_to_grid));
    }
}

#[test]
fn what_says_nothing_of_the_pose_leaves_it_open() {
    // Nothing seen, and a body that is the same from all sides.
    let nothing = Observation::unknown(dims());
    let middle = (RESOLUTION as f64 - 1.0) / 2.0;
    let round = Occupancy::from_fn(dims(), |i, j, k| (i as f64 - middle).hypot(j as f64 - middle) < 5.2 && (3..11).contains(&k));
    for (observation, evenness) in [(nothing, 1.01), (View::Top.of(&round), 3.0)] {
        for (method, outside) in [Method::Auto, Method::Evidence].into_iter().flat_map(|m| [(m, Outside::Empty), (m, Outside::Unknown)]) {
            let percept = answer(&observation, &Query { method, outside, ..yaw_query() });
            assert!((percept.rotation_spread_rad - FRAC_PI_2).abs() < 0.5, "{method}: {}", percept.rotation_spread_rad);
            let of_class: Vec<f64> =
                percept.hypotheses.iter().filter(|h| h.class == percept.hypotheses[0].class).map(|h| h.probability).collect();
            let (most, least) = (of_class[0], *of_class.last().unwrap());
            assert!(most < evenness * least, "{method}: {of_class:?}");
        }
    }
}

#[test]
fn a_rotation_prior_decides_between_what_looks_alike_and_a_known_class_is_kept() {
    let observation = seen(&square_table(), &yaw(0.0));
    for quarter in 0..4 {
        let expected = f64::from(quarter) * FRAC_PI_2;
        let query = Query { rotation_prior: RotationPrior::around(yaw(expected + 0.1), 20.0), ..yaw_query() };
        let percept = answer(&observation, &query);
        assert!(
            apart(yaw_of(&percept.rotation_object_to_grid), expected) < 0.15,
            "{} {expected}",
            yaw_of(&percept.rotation_object_to_grid)
        );
        assert!(percept.rotation_spread_rad < 0.3);
    }
    let only = |class: usize| (0..10).map(|s| if s == class { 0.0 } else { f64::NEG_INFINITY }).collect();
    let percept = answer(&observation, &Query { log_prior: only(3), ..yaw_query() });
    assert_eq!((percept.class, percept.posterior[3]), (3, 1.0));
    assert!(percept.hypotheses.iter().all(|h| h.class == 3));
}

/// A robot's camera that follows one object.
struct Camera(Client);

impl Camera {
    fn new(name: &str) -> Self {
        Self(Client::new(name))
    }

    /// The yaw that is answered.
    fn ask(&self, observation: &Observation, change: impl FnOnce(&mut ObservationHeader)) -> f64 {
        let percept = self.0.ask(|header, voxels| {
            observation.write(voxels);
            header.pose_search = beo_ipc::PoseSearch::Yaw.code();
            header.view = beo_ipc::View::TopDown.code();
            change(header);
        });
        assert_eq!(percept.status, 0);
        let of_class = percept.hypotheses[..percept.hypothesis_count as usize].iter().find(|h| h.class_index == percept.class_index);
        let [x, y, z, w] = of_class.unwrap().rotation_object_to_grid.map(f64::from);
        yaw_of(&Rotation::from_quaternion(Quaternion::new(w, x, y, z)))
    }
}

#[test]
fn a_tracked_object_does_not_flip_and_is_found_again_after_a_jump() {
    let name = instance();
    let _daemon = serve(&name);
    let camera = Camera::new(&name);
    let follow = |header: &mut ObservationHeader| (header.object_id, header.continued_object_id, header.continues) = (7, 7, 1);
    // A square table turning by 3.6° a frame: each frame fits four poses alike.
    let table = square_table();
    let mut last = None;
    for frame in 0..100 {
        let found = camera.ask(&seen(&table, &yaw((3.6 * f64::from(frame)).to_radians())), follow);
        if let Some(last) = last {
            let step: f64 = apart(found, last);
            assert!(step < 15_f64.to_radians(), "frame {frame}: a step of {}°", step.to_degrees());
        }
        last = Some(found);
    }
    // A chair that jumps: its back says where it is.
    let chair = furniture::make("chair", dims(), 21).unwrap();
    let other = |header: &mut ObservationHeader| (header.object_id, header.continued_object_id, header.continues) = (8, 8, 1);
    for frame in 0..20 {
        let angle: f64 = if frame < 10 { 0.3 } else { 0.3 + 2.0 };
        let found = camera.ask(&seen(&chair, &yaw(angle)), other);
        assert!(frame == 10 || apart(found, angle) < 0.15, "frame {frame}: {found}");
    }
}

#[test]
fn the_header_says_which_rotation_is_expected() {
    let name = instance();
    let _daemon = serve(&name);
    let camera = Camera::new(&name);
    for quarter in 0..4 {
        let expected = f64::from(quarter) * FRAC_PI_2;
        let found = camera.ask(&seen(&square_table(), &yaw(0.2)), |header| {
            let rotation = yaw(expected);
            header.rotation_prior = [rotation.i, rotation.j, rotation.k, rotation.w].map(|v| v as f32);
            header.rotation_prior_concentration = 20.0;
        });
        assert!(apart(found, expected + 0.2) < 0.15, "{found} {expected}");
    }
}

/// Of an object that continues, the producer's own word goes before the last answer.
#[test]
fn a_rotation_that_the_header_expects_goes_before_the_last_answer() {
    let name = instance();
    let _daemon = serve(&name);
    let camera = Camera::new(&name);
    for quarter in 0..4 {
        let expected = f64::from(quarter) * FRAC_PI_2;
        let found = camera.ask(&seen(&square_table(), &yaw(0.2)), |header| {
            (header.object_id, header.continued_object_id, header.continues) = (7, 7, 1);
            let rotation = yaw(expected);
            header.rotation_prior = [rotation.i, rotation.j, rotation.k, rotation.w].map(|v| v as f32);
            header.rotation_prior_concentration = 20.0;
        });
        assert!(apart(found, expected + 0.2) < 0.15, "{found} {expected}");
    }
}

/// A pose that was told and not found says nothing of the next one.
#[test]
fn an_answer_at_a_known_pose_narrows_no_later_search() {
    let name = instance();
    let _daemon = serve(&name);
    let client = Client::new(&name);
    let table = square_table();
    let ask = |search: beo_ipc::PoseSearch, angle: f64, continues: u32| {
        client.ask(|header, voxels| {
            header.pose_search = search.code();
            header.view = beo_ipc::View::TopDown.code();
            (header.object_id, header.continued_object_id, header.continues) = (7, 7, continues);
            seen(&table, &yaw(angle)).write(voxels);
        })
    };
    let alone = ask(beo_ipc::PoseSearch::Yaw, 0.2, 0);
    assert_eq!(ask(beo_ipc::PoseSearch::Known, 0.0, 0).status, 0);
    let after = ask(beo_ipc::PoseSearch::Yaw, 0.2, 1);
    assert_eq!((after.hypotheses, after.posterior), (alone.hypotheses, alone.posterior));
}

#[test]
fn perceive_and_eval_say_how_objects_are_turned() {
    let folder = tempfile::tempdir().unwrap();
    let file = shape(folder.path(), "chair", 21);
    let (file, model) = (file.to_str().unwrap(), model().to_str().unwrap());
    let output = run(["perceive", file, "--model", model, "--pose", "yaw", "--turn", "30"]);
    assert!(text(&output.stdout).contains("turned by "), "{}", text(&output.stdout));
    let output = run(["perceive", file, "--model", model, "--pose", "yaw", "--turn", "30", "--json"]);
    let line: Value = serde_json::from_str(&text(&output.stdout)).unwrap();
    let [x, y, z, w] = [0, 1, 2, 3].map(|i| line["hypotheses"][0]["rotation"][i].as_f64().unwrap());
    let rotation = Rotation::from_quaternion(Quaternion::new(w, x, y, z));
    assert!(apart(yaw_of(&rotation), 30_f64.to_radians()) < 0.15, "{line}");
    assert!(line["rotation_spread_rad"].as_f64().unwrap() >= 0.0);

    let root = folder.path().join("shapes");
    for class in ["chair", "sofa"] {
        let split = root.join(class).join("validation");
        std::fs::create_dir_all(&split).unwrap();
        (100..104).for_each(|seed| drop(shape(&split, class, seed)));
    }
    let out = folder.path().join("out.json");
    let arguments = ["eval", root.to_str().unwrap(), "--split", "validation", "--model", model, "--json", out.to_str().unwrap()];
    for (extra, most) in [(["--pose", "yaw", "--yaw-span", "180"], 180.0), (["--pose", "full", "--seed", "3"], 180.0)] {
        let output = run(arguments.into_iter().chain(extra));
        assert!(output.status.success(), "{}", text(&output.stderr));
        let outcome: Value = serde_json::from_str(&std::fs::read_to_string(&out).unwrap()).unwrap();
        assert_eq!(outcome["pose"], extra[1]);
        let figures = ["median", "mean", "p90", "symmetry_aware_median"].map(|f| outcome["pose_error_deg"][f].as_f64().unwrap());
        assert!(figures.iter().all(|f| (0.0..=most).contains(f)), "{figures:?}");
        assert!(figures[3] <= figures[0] + 1e-6);
    }
    let usage = run(["eval", "x", "--model", "y", "--split", "z", "--pose", "yaw", "--yaw-span", "400"]);
    assert_eq!(usage.status.code(), Some(2));
    assert!(text(&usage.stderr).contains("--yaw-span 400"));
}
