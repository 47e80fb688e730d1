//! One suite that every search must pass: it recovers a planted pose, respects the priors, turns with what it is shown, answers the same on any
//! number of threads, and allocates nothing once its memory is warm.

use beo_core::furniture;
use beo_core::grid::{Dims, Observation, Occupancy, Outside, Rotation, Turn, View, longest_side, yaw, yaw_of};
use beo_core::learning::{Shape, ShapeSet, TrainOptions, train};
use beo_core::perception::{Method, Perceiver, Percept, PoseSearch, Query, RotationPrior, ScaleSearch};
use beo_core::simulation::{self, Eye};
use std::f64::consts::FRAC_PI_2;
use std::sync::{Arc, OnceLock};

const CLASSES: [&str; 3] = ["chair", "monitor", "sofa"];
const QUARTER: f64 = FRAC_PI_2;

fn learn(side: usize, count: u64) -> Perceiver {
    let dims = Dims::cube(side).unwrap();
    let make = |class: usize, seed: u64| Shape {
        object: furniture::make(CLASSES[class], dims, seed).unwrap(),
        class,
        file: format!("{class}/{seed}"),
    };
    let shapes = ShapeSet {
        classes: CLASSES.map(String::from).to_vec(),
        shapes: (0..CLASSES.len()).flat_map(|class| (0..count).map(move |seed| make(class, seed))).collect(),
        ..ShapeSet::default()
    };
    let options = TrainOptions {
        basis_range: [5, 20],
        camera_elevations_deg: vec![20.0, 50.0],
        longest_side: longest_side(dims),
        ..TrainOptions::default()
    };
    Perceiver::new(Arc::new(train(&shapes, &options, &|_| ()).unwrap())).unwrap()
}

/// A model that knows views from above and of cameras.
fn small() -> &'static Perceiver {
    static PERCEIVER: OnceLock<Perceiver> = OnceLock::new();
    PERCEIVER.get_or_init(|| learn(16, 24))
}

/// A model of a grid that is too large to be searched: that is done on smaller ones.
fn large() -> &'static Perceiver {
    static PERCEIVER: OnceLock<Perceiver> = OnceLock::new();
    PERCEIVER.get_or_init(|| {
        let perceiver = learn(66, 12);
        assert!(!perceiver.model().levels().is_empty());
        perceiver
    })
}

/// A way to be asked.
#[derive(Clone, Copy)]
struct Search {
    name: &'static str,
    /// Who is asked.
    perceiver: fn() -> &'static Perceiver,
    method: Method,
    pose: PoseSearch,
    /// Whether a camera sees the object; else it is seen from above.
    by_camera: bool,
    /// Whether the object is expected near its true pose.
    tracked: bool,
    /// A pose within this of the truth is recovered.
    tolerance_deg: f64,
    /// Planted poses, and how many of them are recovered at least.
    planted: u64,
    recovered: usize,
    /// A quarter turn changes the answer by no more than this: a search whose last steps are of a degree about three axes may end two of them away.
    turns_within_deg: f64,
    /// Whether a prior over rotations is heeded: the paper's coarse step, by distance transforms, knows none.
    heeds_rotation_prior: bool,
    /// Whether a query allocates nothing once the memory is warm.
    allocates_nothing: bool,
}

const YAW: Search = Search {
    name: "yaw",
    perceiver: small,
    method: Method::Auto,
    pose: PoseSearch::YAW,
    by_camera: false,
    tracked: false,
    tolerance_deg: 15.0,
    planted: 6,
    recovered: 4,
    turns_within_deg: 2.0,
    heeds_rotation_prior: true,
    allocates_nothing: true,
};

const SEARCHES: [Search; 10] = [
    YAW,
    Search { name: "yaw by the hull", method: Method::Hull, ..YAW },
    Search { name: "yaw by the evidence", method: Method::Evidence, planted: 3, recovered: 2, ..YAW },
    Search { name: "yaw, tracked", tracked: true, recovered: 5, ..YAW },
    Search { name: "any rotation", pose: PoseSearch::Full, tolerance_deg: 25.0, recovered: 3, turns_within_deg: 3.5, ..YAW },
    Search { name: "a camera's view", by_camera: true, tolerance_deg: 20.0, recovered: 3, ..YAW },
    Search { name: "yaw on smaller grids", perceiver: large, planted: 3, recovered: 2, ..YAW },
    Search {
        name: "any rotation on smaller grids",
        perceiver: large,
        pose: PoseSearch::Full,
        tolerance_deg: 25.0,
        planted: 3,
        recovered: 1,
        turns_within_deg: 3.5,
        ..YAW
    },
    Search {
        name: "a camera's view on smaller grids",
        perceiver: large,
        by_camera: true,
        tolerance_deg: 20.0,
        planted: 3,
        recovered: 1,
        ..YAW
    },
    Search {
        name: "yaw by the paper",
        method: Method::Paper,
        tolerance_deg: 25.0,
        planted: 3,
        recovered: 1,
        heeds_rotation_prior: false,
        allocates_nothing: false,
        ..YAW
    },
];

/// An object of class `seed` modulo three that was not learned from, how it is turned, and what is seen of it.
struct Planted {
    class: usize,
    truth: Rotation,
    seen: Observation,
    eye: Eye,
}

impl Search {
    fn plant(&self, seed: u64) -> Planted {
        let dims = (self.perceiver)().model().dims();
        let class = seed as usize % CLASSES.len();
        let object = furniture::make(CLASSES[class], dims, 1000 + seed).unwrap();
        let angle = 0.7 + 1.1 * seed as f64;
        let truth = if self.pose == PoseSearch::Full { Rotation::from_euler_angles(0.4 * angle, 0.3, angle) } else { yaw(angle) };
        let turned: Occupancy = Turn::new(dims, &truth).occupancy(&object);
        let eye = Eye { azimuth: 0.4, elevation: 35_f64.to_radians(), distance: 50.0 / 16.0 * dims.x() as f64 };
        let seen = if self.by_camera { simulation::observe(&turned, &eye) } else { View::Top.of(&turned) };
        Planted { class, truth, seen, eye }
    }

    fn query(&self, planted: &Planted) -> Query {
        let mut query = Query { method: self.method, pose: self.pose, ..Query::default() };
        if self.by_camera {
            (query.camera, query.scale) = (Some(planted.eye.position()), ScaleSearch::Search { side: None });
            query.outside = Outside::Unknown;
        } else {
            query.view = Some(View::Top);
        }
        if self.tracked {
            query.rotation_prior = RotationPrior::mixture([(yaw(0.1) * planted.truth, 0.7), (yaw(2.0), 0.3)], 30.0, 0.02);
        }
        query
    }

    fn ask(&self, seen: &Observation, query: &Query) -> Percept {
        let perceiver = (self.perceiver)();
        let (mut work, mut percept) = (perceiver.workspace(), Percept::default());
        perceiver.classify(seen, query, &mut work, &mut percept).unwrap().complete().unwrap();
        percept
    }
}

#[test]
fn every_search_recovers_a_planted_pose() {
    for search in SEARCHES {
        let recovers = |seed: &u64| {
            let planted = search.plant(*seed);
            let query = search.query(&planted);
            // The class is told: whether it is found besides is not the question here.
            let told = (0..CLASSES.len()).map(|class| if class == planted.class { 0.0 } else { f64::NEG_INFINITY }).collect();
            let found = search.ask(&planted.seen, &Query { log_prior: told, ..query });
            assert_eq!(found.class, planted.class, "{}", search.name);
            assert!((found.posterior.iter().sum::<f64>() - 1.0).abs() < 1e-9, "{}", search.name);
            found.rotation_object_to_grid.angle_to(&planted.truth).to_degrees() < search.tolerance_deg
        };
        let recovered = (0..search.planted).filter(recovers).count();
        assert!(recovered >= search.recovered, "{}: {recovered} of {}", search.name, search.planted);
    }
}

#[test]
fn every_search_respects_the_priors() {
    for search in SEARCHES {
        let planted = search.plant(1);
        let query = search.query(&planted);
        let without = (0..CLASSES.len()).map(|class| if class == planted.class { f64::NEG_INFINITY } else { 0.0 }).collect();
        let found = search.ask(&planted.seen, &Query { log_prior: without, ..query.clone() });
        assert_eq!(found.posterior[planted.class], 0.0, "{}", search.name);
        assert!(found.class != planted.class && found.hypotheses.iter().all(|h| h.class != planted.class), "{}", search.name);
        if !search.heeds_rotation_prior {
            continue;
        }
        // A prior that is nearly certain decides, even if it is wrong.
        let elsewhere = yaw(1.5) * planted.truth;
        let certain = Query { rotation_prior: RotationPrior::around(elsewhere, 3e4), ..query };
        let found = search.ask(&planted.seen, &certain);
        let apart = found.rotation_object_to_grid.angle_to(&elsewhere).to_degrees();
        assert!(apart < 20.0, "{}: {apart} degrees from where the object is said to be", search.name);
    }
}

/// A quarter turn is a permutation of the voxels: what is turned by it is answered as before, but turned.
#[test]
fn every_search_turns_with_what_it_is_shown() {
    for search in SEARCHES {
        let planted = search.plant(2);
        let before = search.ask(&planted.seen, &search.query(&planted));
        let turned = Planted {
            truth: yaw(QUARTER) * planted.truth,
            seen: Turn::new(planted.seen.dims(), &yaw(QUARTER)).observation(&planted.seen, Outside::Unknown),
            eye: Eye { azimuth: planted.eye.azimuth + QUARTER, ..planted.eye },
            ..planted
        };
        let mut query = search.query(&turned);
        if search.tracked {
            // Both of its places turn.
            let places = [(yaw(0.1) * turned.truth, 0.7), (yaw(2.0 + QUARTER), 0.3)];
            query.rotation_prior = RotationPrior::mixture(places, 30.0, 0.02);
        }
        let after = search.ask(&turned.seen, &query);
        assert_eq!(before.class, after.class, "{}", search.name);
        let apart = (yaw(QUARTER) * before.rotation_object_to_grid).angle_to(&after.rotation_object_to_grid).to_degrees();
        assert!(apart < search.turns_within_deg, "{}: {apart} degrees", search.name);
        for (a, b) in before.posterior.iter().zip(&after.posterior) {
            assert!((a - b).abs() < 5e-3, "{}: {a} {b}", search.name);
        }
    }
}

#[test]
fn every_search_answers_the_same_on_any_number_of_threads() {
    for search in SEARCHES {
        let planted = search.plant(0);
        let query = search.query(&planted);
        let on = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| search.ask(&planted.seen, &query))
        };
        let (one, three) = (on(1), on(3));
        assert_eq!(
            (&one.posterior, &one.scores, one.rotation_object_to_grid),
            (&three.posterior, &three.scores, three.rotation_object_to_grid),
            "{}",
            search.name
        );
        assert_eq!((one.hypotheses, one.placed), (three.hypotheses, three.placed), "{}", search.name);
        assert!(one.occupancy == three.occupancy && one.deviation == three.deviation, "{}", search.name);
    }
}

/// On one thread, as it is counted there; on more, the same is computed by more pieces of the same memory.
#[test]
fn every_search_that_says_so_allocates_nothing_once_warm() {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    for search in SEARCHES.into_iter().filter(|search| search.allocates_nothing) {
        let perceiver = (search.perceiver)();
        let planted: Vec<Planted> = (0..search.planted).map(|seed| search.plant(seed)).collect();
        let queries: Vec<Query> = planted.iter().map(|planted| search.query(planted)).collect();
        let counted = pool.install(|| {
            let (mut work, mut percept) = (perceiver.workspace(), Percept::default());
            let mut answer_all = || {
                for (planted, query) in planted.iter().zip(&queries) {
                    perceiver.classify(&planted.seen, query, &mut work, &mut percept).unwrap().complete().unwrap();
                }
            };
            answer_all();
            answer_all();
            allocation_counter::measure(answer_all)
        });
        assert_eq!((counted.count_total, counted.bytes_total), (0, 0), "{}", search.name);
    }
}

/// The suite says something only if its observations are of turned objects.
#[test]
fn planted_poses_differ() {
    let angles: Vec<f64> = (0..6).map(|seed| yaw_of(&YAW.plant(seed).truth)).collect();
    assert!(angles.iter().enumerate().all(|(i, a)| angles[..i].iter().all(|b| (a - b).abs() > 0.1)));
}
