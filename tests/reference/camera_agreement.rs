//! Answers to what a camera sees beside the plain ones.

use crate::agreement::{PERCEIVER, POSTERIOR, REFERENCE, largest, most_probable};
use crate::camera::{CameraQuery, Parameters, Told};
use crate::camera_view::{Frame, Placed};
use crate::observations::{furniture, real_shapes};
use beo_core::grid::{Observation, Occupancy, Outside};
use beo_core::model::YAWS;
use beo_core::perception::{Method, Percept, PoseSearch, Query, ScaleSearch};
use beo_core::simulation::{self, Eye};
use nalgebra::Vector3;
use rayon::prelude::*;
use std::f64::consts::TAU;

/// Of log evidence, as a share of itself: the perceiver keeps its rows in 16 bits.
const EVIDENCE: f64 = 2e-3;
/// Of probabilities of classes that differ by such evidence, some hundred nats of it, at the weight that it has beside the view.
const WITH_EVIDENCE: f64 = 5e-3;

fn answer(observation: &Observation, query: &Query) -> Percept {
    let (mut work, mut percept) = (PERCEIVER.workspace(), Percept::default());
    PERCEIVER.classify(observation, query, &mut work, &mut percept).unwrap();
    percept
}

/// Objects with the camera that sees each: all around them, from 12° to 78°, so that both ends of what was learned and what lies between take
/// part.
fn seen(objects: Vec<Occupancy>) -> Vec<(Observation, Vector3<f64>)> {
    let of = |(i, object): (usize, Occupancy)| {
        let share = |n: f64| (i as f64 * n).fract();
        let eye = Eye { azimuth: TAU * share(0.618), elevation: (12.0 + 66.0 * share(0.414)).to_radians(), distance: 90.0 };
        (simulation::observe(&object, &eye), eye.position())
    };
    objects.into_iter().enumerate().map(of).collect()
}

fn asked(seen: &(Observation, Vector3<f64>)) -> CameraQuery<'_> {
    CameraQuery { seen: &seen.0, camera: seen.1, outside: Outside::Unknown, lying: false, voxel_size_m: None }
}

fn nothing_told(_: &Frame) -> Told {
    [None; 5]
}

/// The object stands in the grid as the training shapes do.
fn all_told(frame: &Frame) -> Told {
    let (yaw, scale, place) = frame.parameters(&Default::default());
    [Some(yaw), Some(scale.ln()), Some(place.x), Some(place.y), Some(place.z)]
}

const SEARCH: ScaleSearch = ScaleSearch::Search { side: None };

fn query(camera: Vector3<f64>, method: Method, pose: PoseSearch, scale: ScaleSearch) -> Query {
    Query { method, pose, scale, camera: Some(camera), outside: Outside::Unknown, ..Query::default() }
}

/// Class, yaw, size and place unknown: the class by the densities of the view.
#[test]
fn classes_by_the_view_are_those_of_the_dense_mixture() {
    let views = seen(furniture(REFERENCE.model.dims(), 70..73));
    let worst = views.par_iter().map(|view| {
        let found = answer(&view.0, &query(view.1, Method::Hull, PoseSearch::YAW, SEARCH));
        let expected = REFERENCE.view(&asked(view), nothing_told).posterior();
        assert_eq!(found.class, most_probable(&expected));
        largest(&found.posterior, &expected)
    });
    let worst = worst.reduce(|| 0.0, f64::max);
    println!("{} views: {worst:.1e}", views.len());
    assert!(worst <= POSTERIOR, "{worst}");
}

/// Everything but the class is told: no search, so that the default method with the evidence of all classes is exact.
#[test]
fn classes_of_objects_that_lie_as_told_are_those_of_the_dense_evidence() {
    let views = seen(furniture(REFERENCE.model.dims(), 80..83));
    let worst = views.par_iter().map(|view| {
        let found = answer(&view.0, &query(view.1, Method::Auto, PoseSearch::Known, ScaleSearch::Known));
        let asked = asked(view);
        let view = REFERENCE.view(&asked, all_told);
        let forest = REFERENCE.ask_forest(&view.frame, asked.seen, asked.voxel_size_m);
        let expected = view.with_evidence(&forest, |_| Placed::as_it_came());
        assert_eq!(found.class, most_probable(&expected));
        largest(&found.posterior, &expected).max((found.none_probability.expect("of a model with a forest") - forest.none).abs())
    });
    let worst = worst.reduce(|| 0.0, f64::max);
    println!("{} views: {worst:.1e}", views.len());
    assert!(worst <= WITH_EVIDENCE, "{worst}");
}

/// The evidence alone, in places that are told: log evidence of every class for an object that lies so, and the posterior; in one pose, and
/// summed over all steps of yaw.
#[test]
fn evidence_of_placed_objects_is_that_of_the_dense_gaussian() {
    let longest = REFERENCE.model.metadata.settings.longest_side as f64;
    let views = seen(furniture(REFERENCE.model.dims(), 90..91));
    let compared = views.par_iter().enumerate().map(|(i, view)| {
        let side = 17.0 + i as f64;
        let pose = if i % 4 == 0 { PoseSearch::YAW } else { PoseSearch::Known };
        let scale = ScaleSearch::Search { side: Some(side) };
        let found = answer(&view.0, &query(view.1, Method::Evidence, pose, scale));
        let frame = Frame::new(&view.0, &view.1);
        let steps: Vec<f64> = (0..YAWS).map(|step| step as f64 * TAU / YAWS as f64).collect();
        let angles = if pose == PoseSearch::Known { vec![-frame.azimuth] } else { steps };
        // Without densities of views, the hidden part is expected one unit behind what is seen.
        let behind = Vector3::new(1.0, 0.0, 0.0);
        let (posterior, scores) = REFERENCE.posterior_of_angles(&asked(view), side / (longest * frame.unit), &behind, &angles);
        let relative = found.scores.iter().zip(&scores).map(|(a, b)| (a - b).abs() / b.abs().max(1.0)).fold(0.0, f64::max);
        (largest(&found.posterior, &posterior), relative)
    });
    let (posterior, evidence) = compared.reduce(|| (0.0, 0.0), |a, b| (f64::max(a.0, b.0), f64::max(a.1, b.1)));
    println!("{} views: posterior {posterior:.1e}, log evidence {evidence:.1e} of itself", views.len());
    assert!(posterior <= POSTERIOR && evidence <= EVIDENCE, "{posterior} {evidence}");
}

/// Class, yaw, size and place unknown, by the default method. Both climb from where the densities expect the object: the search on a lattice of
/// voxels, and among two modes of the likeliest class; the plain one on all voxels, from one. Which voxels are nearest changes with every
/// step, by some nats, so that they do not end in the same place. Measured: on 114 views of real shapes the search ended lower by 0.4 nats
/// (median), by 4.1 for one of twenty, and 11 were of another class. With lattices three times as fine it was 0.0 and 3.3 nats and 10 others, by an
/// earlier model, for 1.7 times the time: they name no more rightly. Of 40 views of made-up furniture, which the model expects elsewhere, the
/// second lowest was 10.3 nats lower.
struct Climbed {
    /// Log density, on all voxels, of where the search ended, less that of where the climb did.
    higher: f64,
    /// Largest difference of the posteriors.
    posterior: f64,
    is_same_class: bool,
}

impl Climbed {
    fn of(view: &(Observation, Vector3<f64>)) -> Self {
        let found = answer(&view.0, &query(view.1, Method::Auto, PoseSearch::YAW, SEARCH));
        let asked = asked(view);
        let view = REFERENCE.view(&asked, nothing_told);
        let cells = view.likeliest(found.class);
        // By whichever cell expects this placement most.
        let log_density = |at: &Parameters| {
            let cell = cells.iter().max_by(|a, b| view.log_expectation(a, at).total_cmp(&view.log_expectation(b, at)));
            view.log_density(cell.unwrap(), at)
        };
        let (angle, scale, place) = view.frame.parameters(&found.placed);
        let higher = log_density(&[angle, scale.ln(), place.x, place.y, place.z]) - log_density(&view.climb(cells[0]).0);
        let forest = REFERENCE.ask_forest(&view.frame, asked.seen, asked.voxel_size_m);
        let expected = view.with_evidence(&forest, |class| {
            let cell = view.likeliest(class)[0];
            view.placed(cell, &view.climb(cell).0)
        });
        let posterior = largest(&found.posterior, &expected);
        Self { higher, posterior, is_same_class: found.class == most_probable(&expected) }
    }
}

/// `low_nats`: what one search of twenty may end lower by, at most.
fn agree_on_placement(objects: Vec<Occupancy>, low_nats: f64) {
    let compared: Vec<Climbed> = seen(objects).par_iter().map(Climbed::of).collect();
    let count = compared.len();
    let others = compared.iter().filter(|c| !c.is_same_class).count();
    let sorted = |of: &dyn Fn(&Climbed) -> f64| {
        let mut values: Vec<f64> = compared.iter().map(of).collect();
        values.sort_by(f64::total_cmp);
        values
    };
    let (higher, posteriors) = (sorted(&|c| c.higher), sorted(&|c| c.posterior));
    let (median, low, lowest) = (higher[count / 2], higher[count / 20], higher[0]);
    let (posterior, far) = (posteriors[count / 2], posteriors[count * 9 / 10]);
    println!(
        "{count} views: {others} of another class, posterior {posterior:.1e} (median) {far:.2} (one of ten), higher by {median:.2} nats (median), \
         {low:.2} (one of twenty), {lowest:.2} (least)"
    );
    assert!(others * 8 <= count && posterior <= 4e-3 && median >= -0.7 && low >= -low_nats, "{others} {posterior} {median} {low}");
}

#[test]
fn the_search_before_a_camera_ends_about_as_high_as_a_climb_on_all_voxels() {
    agree_on_placement(furniture(REFERENCE.model.dims(), 100..104), 12.0);
    if let Some(objects) = real_shapes(REFERENCE.model.dims()) {
        agree_on_placement(objects.into_iter().step_by(4).collect(), 6.0);
    }
}
