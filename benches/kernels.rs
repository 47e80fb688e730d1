//! The kernels of a query one by one, and whole queries, with the shipped model on made-up furniture: one piece of each class in
//! turn, so that no figure is that of one object. `cargo bench --bench kernels -- --test` runs each once.

use beo_camera::{GridOptions, carve, lay_grids};
use beo_core::grid::{Dims, Observation, Outside, Rotation, Turn, View, distance_transform, yaw};
use beo_core::lanes::dispatch;
use beo_core::learning::{AtRest, ViewSample};
use beo_core::linear;
use beo_core::model::{CAMERA_MEASURES, Model, load};
use beo_core::perception::kernels::row_gram::{AddGram, packed_len, span};
use beo_core::perception::{
    ClassSubspace, ColumnSums, Conditional, Gaussian, Known, Method, Perceiver, Percept, PoseSearch, Query, RotationPrior,
};
use beo_core::simulation::Sensing;
use beo_lab::benchmark::latency::objects_on_table;
use beo_shapes::{furniture, household};
use criterion::{BenchmarkId, Criterion, criterion_group, criterion_main};
use faer::Mat;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use std::hint::black_box;
use std::sync::Arc;

/// How far the furniture is turned where its pose is to be found, in radians.
const TURN: f64 = 0.7;

fn shipped() -> Model {
    load(concat!(env!("CARGO_MANIFEST_DIR"), "/models/modelnet10.safetensors").as_ref()).expect("the shipped model")
}

/// One piece of furniture of each class, turned about z and seen from above.
fn seen(dims: Dims, angle: f64) -> Vec<Observation> {
    let turn = Turn::new(dims, &yaw(angle));
    let of_class = |class: &&str| View::Top.of(&turn.occupancy(&furniture::make(class, dims, 1).expect("its own class")));
    furniture::CLASSES.iter().map(of_class).collect()
}

fn known(observations: &[Observation]) -> Vec<Known> {
    let read = |observation: &Observation| {
        let mut known = Known::new(observation.dims());
        known.read(observation);
        known
    };
    observations.iter().map(read).collect()
}

/// One after the other, without end.
fn in_turn<T>(of: &[T]) -> impl Iterator<Item = &T> {
    of.iter().cycle()
}

/// Each class given what is known: the Gram matrix of the unknown voxels, the solve, the completion of all voxels.
fn class(criterion: &mut Criterion) {
    let model = shipped();
    let chair = model.class_names().position(|name| name == "chair").expect("a class of the model");
    let subspace = ClassSubspace::new(model.dims(), &model.basis, &model.classes[chair]);
    let mut conditional = Conditional::new(subspace.size());
    let noise = model.metadata.noise_variance * model.metadata.calibration.noise_inflation;
    let known = known(&seen(model.dims(), 0.0));
    let mut group = criterion.benchmark_group("class");
    let mut next = in_turn(&known);
    group.bench_function("gram of unknown voxels", |b| b.iter(|| subspace.gather(next.next().unwrap(), &mut conditional)));
    group.bench_function("solve", |b| b.iter(|| subspace.solve(noise, &mut conditional).unwrap()));
    let mut sum = 0.0;
    group.bench_function("reconstruct", |b| b.iter(|| subspace.reconstruct(&conditional, |value| sum += value)));
    group.finish();
    black_box(sum);
}

/// Density of the hull's projection: prefix sums of W' over the hull's runs, then one whitening.
fn hull(criterion: &mut Criterion) {
    let model = shipped();
    let sums = ColumnSums::new(model.dims(), &model.basis);
    let learned = &model.classes[0].hulls[0];
    let density = Gaussian::new(&learned.mean, &learned.covariance).unwrap();
    let known = known(&seen(model.dims(), 0.0));
    let (mut projected, mut centred) = (vec![0.0; model.rank()], vec![0.0; model.rank()]);
    let mut group = criterion.benchmark_group("hull");
    let mut next = in_turn(&known);
    group.bench_function("projection", |b| b.iter(|| sums.project(&next.next().unwrap().hull, &mut projected)));
    let nu = model.metadata.calibration.degrees_of_freedom;
    group.bench_function("density", |b| b.iter(|| density.log_student(&projected, nu, &mut centred)));
    group.finish();
}

/// Cholesky factorisation and solve, at the sizes of a class basis and of the shared one.
fn cholesky(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("cholesky");
    for size in [32, 318] {
        let matrix = Mat::from_fn(size, size, |i, j| if i == j { 2.0 } else { 1.0 / (1.0 + i.abs_diff(j) as f64).powi(2) });
        let mut factor = matrix.clone();
        group.bench_function(BenchmarkId::new("factor", size), |b| {
            b.iter(|| {
                factor.copy_from(&matrix);
                linear::cholesky(&mut factor).unwrap();
            })
        });
        let mut x = vec![1.0; size];
        group.bench_function(BenchmarkId::new("solve", size), |b| {
            b.iter(|| {
                x.fill(1.0);
                linear::solve_cholesky(&factor, &mut x);
            })
        });
    }
    group.finish();
}

/// Distance transforms and turned grids.
fn grids(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("grid");
    for side in [30, 64] {
        let dims = Dims::cube(side).unwrap();
        let observations = seen(dims, 0.0);
        let mut out = Vec::new();
        let mut next = in_turn(&observations);
        group.bench_function(BenchmarkId::new("distance transform", side), |b| {
            b.iter(|| distance_transform(dims, next.next().unwrap().filled(), &mut out))
        });
        let rotation = Rotation::from_euler_angles(0.4, -0.2, TURN);
        group.bench_function(BenchmarkId::new("turn, prepared", side), |b| b.iter(|| Turn::new(dims, black_box(&rotation))));
        let turn = Turn::new(dims, &rotation);
        let mut next = in_turn(&observations);
        group
            .bench_function(BenchmarkId::new("turn, applied", side), |b| b.iter(|| turn.observation(next.next().unwrap(), Outside::Empty)));
    }
    group.finish();
}

/// Whole queries, and of those in known pose the parts: the class alone, and by the lasso of the paper.
fn query(criterion: &mut Criterion) {
    let perceiver = Perceiver::new(Arc::new(shipped())).unwrap();
    let dims = perceiver.model().dims();
    let (mut work, mut percept) = (perceiver.workspace(), Percept::default());
    let (upright, turned) = (seen(dims, 0.0), seen(dims, TURN));
    let tracked = RotationPrior::around(yaw(TURN), 32.8);
    let known = Query { completion: true, ..Query::default() };
    let yaw = Query { pose: PoseSearch::YAW, ..known.clone() };
    let mut group = criterion.benchmark_group("query");
    for (name, query, observations) in [
        ("known pose", known.clone(), &upright),
        ("known pose, class alone", Query { completion: false, ..known.clone() }, &upright),
        ("known pose, class alone, by the lasso", Query { completion: false, method: Method::Paper, ..known.clone() }, &upright),
        ("yaw", yaw.clone(), &turned),
        ("yaw, tracked", Query { rotation_prior: tracked, ..yaw }, &turned),
        ("any rotation", Query { pose: PoseSearch::Full, ..known.clone() }, &turned),
    ] {
        let mut next = in_turn(observations);
        group.bench_function(name, |b| {
            b.iter(|| {
                let classified = perceiver.classify(next.next().unwrap(), &query, &mut work, &mut percept).unwrap();
                if query.completion {
                    classified.complete().unwrap();
                }
            })
        });
    }
    group.finish();
}

/// A depth image of 640 × 480 pixels, in memory, to the grids of its six objects.
fn camera(criterion: &mut Criterion) {
    let scene = objects_on_table(6);
    let options = GridOptions::new([30; 3]);
    let mut voxels = vec![0; options.dims.iter().product()];
    let mut group = criterion.benchmark_group("camera");
    group.bench_function("plane and placement, 6 objects", |b| b.iter(|| lay_grids(scene.frame(), &options)));
    let laid = lay_grids(scene.frame(), &options);
    let carvers: Vec<_> = laid.carvers().filter_map(|(_, carver)| carver.ok()).collect();
    let mut next = in_turn(&carvers);
    group.bench_function("carving, one object", |b| b.iter(|| carve(next.next().unwrap(), &mut voxels)));
    group.bench_function("frame to grids, 6 objects", |b| {
        b.iter(|| {
            for (_, carver) in lay_grids(scene.frame(), &options).carvers() {
                carve(&carver.expect("all six are seen"), &mut voxels).unwrap();
            }
        })
    });
    group.finish();
}

/// One household thing of each class on a table, seen by a depth sensor with its faults.
fn on_tables(dims: Dims) -> Vec<ViewSample> {
    let see = |class: &&str| -> ViewSample {
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let shape = household::make(class, dims, 1).expect("its own class");
        let at_rest = AtRest::new(&shape, None, Rotation::identity(), Some(0.15)).expect("it is not empty");
        let views = (0..20).find_map(|_| at_rest.see_finely(TURN, 0.6, Sensing::Mixed, &mut rng));
        views.expect("enough of it is seen")
    };
    household::CLASSES.iter().map(see).collect()
}

/// What answers a camera's observation, all unknown, by the household model: whole queries, searched and followed, and two of their kernels.
fn before_a_camera(criterion: &mut Criterion) {
    let model = load(concat!(env!("CARGO_MANIFEST_DIR"), "/models/household.safetensors").as_ref()).expect("the shipped model");
    let perceiver = Perceiver::new(Arc::new(model)).unwrap();
    let views = on_tables(perceiver.model().dims());
    let (mut work, mut percept) = (perceiver.workspace(), Percept::default());
    let mut asked: Vec<(&ViewSample, Query)> = views.iter().map(|view| (view, view.query(true))).collect();
    let mut group = criterion.benchmark_group("before a camera");
    for (name, completion, is_followed) in [
        ("class, pose, size and place", false, false),
        ("the same with completion", true, false),
        ("followed", false, true),
        ("followed, with completion", true, true),
    ] {
        for (view, query) in &mut asked {
            query.completion = completion;
            query.expected = None;
            if is_followed {
                perceiver.classify(&view.observation, query, &mut work, &mut percept).unwrap();
                query.expected = percept.expected;
            }
        }
        let mut next = in_turn(&asked);
        group.bench_function(name, |b| {
            b.iter(|| {
                let (view, query) = next.next().unwrap();
                let classified = perceiver.classify(&view.observation, query, &mut work, &mut percept).unwrap();
                if completion {
                    classified.complete().unwrap();
                }
            })
        });
    }
    let forest = perceiver.model().camera_densities().and_then(|cameras| cameras.forest.as_ref()).expect("of the shipped model");
    let (measures, mut shares) = ([0.5_f32; CAMERA_MEASURES], Vec::new());
    group.bench_function("the forest's shares", |b| b.iter(|| forest.shares(black_box(&measures), &mut shares)));
    for width in [32, 64] {
        let rows = vec![0.5_f32; 256 * width + span(width)];
        let mut gram = vec![0.0; packed_len(width)];
        group.bench_function(BenchmarkId::new("Gram matrix of 256 rows", width), |b| {
            b.iter(|| dispatch(AddGram::of_all(black_box(&rows), 256, width, width, &mut gram)));
        });
    }
    group.finish();
}

/// Few samples: what is compared are medians, and a search over rotations takes its time.
fn settings() -> Criterion {
    let times = std::time::Duration::from_secs;
    Criterion::default().sample_size(20).warm_up_time(times(1)).measurement_time(times(2))
}

criterion_group!(name = kernels; config = settings(); targets = class, hull, cholesky, grids, query, camera, before_a_camera);
criterion_main!(kernels);
