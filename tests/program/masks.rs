//! Masks as people and detectors make them change neither what an object is called nor how large it is, and what is cut off is said to be:
//! the shipped model, through a synthetic camera with the noise of structured light.

use crate::camera::{beo_camera, percepts};
use crate::harness::{PATIENCE, instance, serve_with};
use beo::frames::synthetic::{DepthImage, FrameWriter, MaskFaults, NoiseModel, Scene, SyntheticCamera, orbit};
use beo_camera::Intrinsics;
use beo_ipc::{InstanceName, Percept, Subscriber, SubscriberOptions, cut};
use beo_shapes::household;
use nalgebra::{Isometry3, Point3, Vector3};
use std::path::Path;

/// Labels of the table, which files of frames do not have, of the mug and of the carton.
const TABLE: u16 = 0;
const MUG: u16 = 1;
const CARTON: u16 = 2;

const FAULTS: [(&str, MaskFaults); 8] = [
    ("as it should be", MaskFaults::NONE),
    ("1 px too wide", MaskFaults { growth_px: 1, ..MaskFaults::NONE }),
    ("3 px too wide", MaskFaults { growth_px: 3, ..MaskFaults::NONE }),
    ("4 px too wide", MaskFaults { growth_px: 4, ..MaskFaults::NONE }),
    ("shifted by 2 px", MaskFaults { shift_px: [2, -2], ..MaskFaults::NONE }),
    ("3 px too wide, shifted by 2 px", MaskFaults { growth_px: 3, shift_px: [-2, 2], ..MaskFaults::NONE }),
    ("a box", MaskFaults { is_box: true, ..MaskFaults::NONE }),
    ("with a speck", MaskFaults { speck_px: 8, ..MaskFaults::NONE }),
];

/// What the mug and the carton are made as: class and seed.
const OBJECTS: [(&str, u64); 2] = [("mug", 3), ("box", 7)];

/// A camera of VGA size, of which only the first columns are kept.
fn camera(columns: u32) -> SyntheticCamera {
    SyntheticCamera::new(Intrinsics::new(columns, 480, [525.0; 2], [319.5, 239.5], [0.0; 5]).unwrap())
}

/// What a camera sees of a mug and a carton on a table, and from where.
fn seen(camera: &SyntheticCamera) -> (DepthImage, Isometry3<f64>) {
    let [mug, carton] = OBJECTS.map(|(class, seed)| household::mesh(class, seed).unwrap());
    let mut scene = Scene::new();
    scene.add_table([1.4, 1.0], Isometry3::identity(), TABLE);
    scene.add(&mug, Isometry3::new(Vector3::new(0.02, -0.14, 0.0), Vector3::z() * 0.9), MUG);
    scene.add(&carton, Isometry3::new(Vector3::new(0.0, 0.14, 0.0), Vector3::z() * 0.5), CARTON);
    let camera_to_world = orbit(&Point3::new(0.0, 0.0, 0.04), 0.75, 0.0, 35_f64.to_radians());
    let mut exact = camera.render(&scene, &camera_to_world);
    NoiseModel::default().apply(camera, &mut exact, 11);
    (exact, camera_to_world)
}

/// A frame for each fault.
fn write_frames(folder: &Path) {
    let camera = camera(640);
    let (exact, camera_to_world) = seen(&camera);
    let mut writer = FrameWriter::new(folder, camera.intrinsics()).unwrap();
    for (n, (_, faults)) in FAULTS.iter().enumerate() {
        let mut image = exact.clone();
        faults.apply(&mut image, TABLE);
        writer.write(&format!("{n}"), n as u64, &camera_to_world, &image).unwrap();
    }
    writer.finish().unwrap();
}

/// The percepts of so many objects of the frames in a folder, in their order, by the shipped model.
fn perceived(folder: &Path, count: usize) -> Vec<Percept> {
    let name = instance();
    let model = Path::new(env!("CARGO_MANIFEST_DIR")).join("models/household.safetensors");
    let _daemon = serve_with(&name, &model, |command| command);
    let subscriber = Subscriber::open_within(&InstanceName::new(&name).unwrap(), &SubscriberOptions::default(), PATIENCE).unwrap();
    let (code, said, errors) = beo_camera(folder, &["--instance", &name, "--track=none"]);
    assert_eq!(code, Some(0), "{said}{errors}");
    // The next frame is sent when the one before is answered.
    percepts(&subscriber, count)
}

/// The most probable class, and the longest side with its standard deviation.
fn found(percept: &Percept) -> (u32, f32, f32) {
    let sides = percept.object_extent_m.into_iter().zip(percept.object_extent_deviation_m);
    let (longest, deviation) = sides.max_by(|a, b| a.0.total_cmp(&b.0)).expect("three sides");
    (percept.class_index, longest, deviation)
}

/// Whether a mask leaves out some of the object's own readings, so that its outline can no longer be known.
fn takes_away(faults: &MaskFaults) -> bool {
    !faults.is_box && faults.shift_px.iter().any(|shift| shift.unsigned_abs() > faults.growth_px.max(0) as u32)
}

/// Masks that hold more than the object: the longest side is within 5 % of the true one. Where they hold less, within two standard deviations.
#[test]
fn masks_that_are_off_change_neither_class_nor_size() {
    let folder = tempfile::tempdir().unwrap();
    write_frames(folder.path());
    let answers = perceived(folder.path(), 2 * FAULTS.len());
    let of = |frame: usize, object: u16| {
        let pair = &answers[2 * frame..2 * frame + 2];
        found(pair.iter().find(|percept| percept.object_id == u64::from(object)).expect("both objects of a frame"))
    };
    for ((object, class), made) in [(MUG, 5), (CARTON, 2)].into_iter().zip(OBJECTS) {
        let [low, high] = household::mesh(made.0, made.1).unwrap().bounds();
        let longest = (high - low).max() as f32;
        for (frame, (fault, faults)) in FAULTS.iter().enumerate() {
            let (named, side, deviation) = of(frame, object);
            assert_eq!(named, class, "object {object}, mask {fault}");
            let most = if takes_away(faults) { 2.0 * deviation } else { 0.05 * longest };
            assert!((side - longest).abs() < most, "object {object}, mask {fault}: {side} ± {deviation} m for {longest}");
        }
    }
}

/// Half of the mug lies beyond the right border of the image.
#[test]
fn an_object_that_the_border_cuts_is_said_to_be_cut_and_is_less_sure() {
    let (whole, _) = seen(&camera(640));
    let columns: Vec<u32> = whole.labels().iter().zip(0_u32..).filter(|(label, _)| **label == MUG).map(|(_, pixel)| pixel % 640).collect();
    let middle = (columns.iter().min().unwrap() + columns.iter().max().unwrap()) / 2;
    let answer_of = |columns: u32| {
        let folder = tempfile::tempdir().unwrap();
        let camera = camera(columns);
        let (image, camera_to_world) = seen(&camera);
        let mut writer = FrameWriter::new(folder.path(), camera.intrinsics()).unwrap();
        writer.write("a", 0, &camera_to_world, &image).unwrap();
        writer.finish().unwrap();
        let count = [MUG, CARTON].into_iter().filter(|object| image.labels().contains(object)).count();
        let answers = perceived(folder.path(), count);
        *answers.iter().find(|percept| percept.object_id == u64::from(MUG)).expect("the mug")
    };
    let [whole, half] = [640, middle].map(answer_of);
    assert_eq!((whole.cut, half.cut), (0, cut::BORDER));
    let surest = |percept: &Percept| percept.posterior.iter().copied().fold(0.0, f32::max);
    assert!(surest(&half) < 0.95 && surest(&half) < surest(&whole), "{} of {}", surest(&half), surest(&whole));
    let longest = found(&half).1;
    for (part, all) in half.object_extent_deviation_m.into_iter().zip(whole.object_extent_deviation_m) {
        assert!(part > all && part >= 0.25 * longest, "{part} m, {all} m of the whole");
    }
    assert!(half.object_position_deviation_m.iter().all(|deviation| *deviation >= 0.15 * longest));
}
