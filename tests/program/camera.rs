//! `beo camera`: frames of boxes on a table, of which everything is known in closed form; and real frames, where BEO_DEPTH names them.

use crate::harness::{PATIENCE, RESOLUTION, instance, run, serve, text};
use crate::real_shapes::skipped;
use beo::frames::{FolderOptions, FrameFolder};
use beo_core::grid::Observation;
use beo_ipc::{InstanceName, Percept, PerceptStatus, Subscriber, SubscriberOptions};
use beo_shapes::read_observation;
use nalgebra::{Isometry3, Matrix3, Point3, Quaternion, Rotation3, Translation3, UnitQuaternion, Vector3};
use std::path::{Path, PathBuf};
use std::time::Instant;

pub const SIZE: [u32; 2] = [320, 240];
pub const FOCAL: f64 = 262.0;

/// A box on the table z = 0 of the world: opposite corners, metres.
type Block = [[f64; 3]; 2];
const TALL: Block = [[-0.05, -0.05, 0.0], [0.05, 0.05, 0.12]];
const LOW: Block = [[0.10, -0.20, 0.0], [0.18, -0.12, 0.06]];

/// A camera at `place` that looks at the foot of the first block.
fn camera(place: [f64; 3]) -> Isometry3<f64> {
    let place = Vector3::from(place);
    let z = (Vector3::new(0.0, 0.0, 0.05) - place).normalize();
    let x = z.cross(&Vector3::z()).normalize();
    let axes = Matrix3::from_columns(&[x, z.cross(&x), z]);
    Isometry3::from_parts(Translation3::from(place), UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(axes)))
}

/// Distance along a ray, in its lengths, at which it enters a block.
fn enters(block: &Block, from: &Point3<f64>, ray: &Vector3<f64>) -> Option<f64> {
    let (mut near, mut far) = (0.0_f64, f64::INFINITY);
    for axis in 0..3 {
        let [a, b] = [0, 1].map(|end| (block[end][axis] - from[axis]) / ray[axis]);
        (near, far) = (near.max(a.min(b)), far.min(a.max(b)));
    }
    (near <= far).then_some(near)
}

/// Depth in millimetres and labels as seen by a camera: 1 and 2 the blocks, 0 the table, which ends at half a metre.
pub fn render(camera_to_world: &Isometry3<f64>) -> (Vec<u16>, Vec<u8>) {
    let from = Point3::from(camera_to_world.translation.vector);
    (0..SIZE[0] * SIZE[1])
        .map(|pixel| {
            let [u, v] = [pixel % SIZE[0], pixel / SIZE[0]].map(f64::from);
            let ray = camera_to_world.rotation * Vector3::new((u - 159.5) / FOCAL, (v - 119.5) / FOCAL, 1.0);
            let table = Some(-from.z / ray.z).filter(|t| *t > 0.0 && (from + ray * *t).coords.xy().abs().max() < 0.5);
            let hits = [(table, 0), (enters(&TALL, &from, &ray), 1), (enters(&LOW, &from, &ray), 2)];
            let first = hits.into_iter().filter_map(|(t, label)| Some((t?, label))).min_by(|a, b| a.0.total_cmp(&b.0));
            first.map_or((0, 0), |(metres, label)| ((metres * 1000.0).round() as u16, label))
        })
        .unzip()
}

fn png(path: &Path, depth: png::BitDepth, data: &[u8]) {
    let mut encoder = png::Encoder::new(std::fs::File::create(path).unwrap(), SIZE[0], SIZE[1]);
    encoder.set_color(png::ColorType::Grayscale);
    encoder.set_depth(depth);
    encoder.write_header().unwrap().write_image_data(data).unwrap();
}

/// Writes one frame of the flat layout.
pub fn write(folder: &Path, name: &str, depth: &[u16], labels: &[u8]) {
    let bytes: Vec<u8> = depth.iter().flat_map(|value| value.to_be_bytes()).collect();
    png(&folder.join(format!("{name}_depth.png")), png::BitDepth::Sixteen, &bytes);
    png(&folder.join(format!("{name}_label.png")), png::BitDepth::Eight, labels);
    let info = format!(
        "image_width: {}\nimage_height: {}\ncamera_matrix: {{data: [{FOCAL}, 0, 159.5, 0, {FOCAL}, 119.5, 0, 0, 1]}}\n\
         distortion_model: plumb_bob\ndistortion_coefficients: {{data: [0, 0, 0, 0, 0]}}\n",
        SIZE[0], SIZE[1]
    );
    std::fs::write(folder.join("camera_info.yaml"), info).unwrap();
}

/// The camera of most tests: half a metre above the table, six tenths in front of the block.
pub fn usual() -> Isometry3<f64> {
    camera([-0.6, 0.0, 0.5])
}

/// One frame from the usual place, with a third object of five pixels on the table.
pub fn scene(folder: &Path) {
    let (depth, mut labels) = render(&usual());
    let bottom = (SIZE[0] * (SIZE[1] - 2)) as usize;
    labels[bottom + 5..bottom + 10].fill(3);
    write(folder, "scene", &depth, &labels);
}

pub fn beo_camera(folder: &Path, arguments: &[&str]) -> (Option<i32>, String, String) {
    let output = run(["camera", folder.to_str().unwrap()].iter().chain(arguments));
    (output.status.code(), text(&output.stdout), text(&output.stderr))
}

/// Percepts until there are so many.
pub fn percepts(subscriber: &Subscriber, count: usize) -> Vec<Percept> {
    let start = Instant::now();
    let mut percepts = Vec::new();
    while percepts.len() < count {
        percepts.extend(subscriber.take_percept().unwrap());
        assert!(start.elapsed() < PATIENCE, "{} of {count} percepts", percepts.len());
        subscriber.wait(std::time::Duration::from_millis(5)).unwrap();
    }
    percepts
}

#[test]
fn every_object_ends_as_a_percept_at_its_place_or_a_stated_reason() {
    let folder = tempfile::tempdir().unwrap();
    scene(folder.path());
    let name = instance();
    let _daemon = serve(&name);
    let subscriber = Subscriber::open_within(&InstanceName::new(&name).unwrap(), &SubscriberOptions::default(), PATIENCE).unwrap();
    let (code, said, errors) = beo_camera(folder.path(), &["--instance", &name, "--frame-id", "kinect"]);
    assert_eq!(code, Some(0), "{said}{errors}");
    let lines: Vec<&str> = said.lines().collect();
    assert_eq!(lines.len(), 2, "{said}");
    assert!(lines[0].starts_with("scene: no grid: object 3 has 5 depth readings"), "{said}");
    assert_eq!(lines[1], "1 frames, 1 objects without a grid, 2 observations sent, 2 answered, 0 refused");

    let mut found = percepts(&subscriber, 2);
    found.sort_by_key(|percept| percept.object_id);
    assert_eq!(subscriber.take_percept().unwrap().map(|percept| percept.object_id), None);
    assert_eq!(found.iter().map(|percept| percept.object_id).collect::<Vec<_>>(), [1, 2]);
    assert_eq!(found[0].sensor_stamp_ns, found[1].sensor_stamp_ns);
    for (percept, block) in found.iter().zip([TALL, LOW]) {
        assert_eq!((percept.status, beo_ipc::text::from_field(&percept.frame_id)), (PerceptStatus::Ok.code(), "kinect"));
        let position = usual() * Point3::from(percept.position_m);
        let centre: [f64; 3] = std::array::from_fn(|axis| 0.5 * (block[0][axis] + block[1][axis]));
        assert!((position - Point3::from(centre)).norm() < 0.01, "{position} for {centre:?}");
        let [x, y, z, w] = percept.orientation;
        let up = usual().rotation * UnitQuaternion::new_unchecked(Quaternion::new(w, x, y, z)) * Vector3::z();
        assert!(up.angle(&Vector3::z()) < 0.5_f64.to_radians(), "{up}");
        assert_eq!(percept.dims, [RESOLUTION as u32; 3]);
        assert!((0.0..=1.0).contains(&percept.fit), "{}", percept.fit);
    }
}

#[test]
fn of_a_sequence_the_class_of_an_object_is_filtered() {
    let folder = tempfile::tempdir().unwrap();
    let (depth, labels) = render(&usual());
    ["a", "b"].iter().for_each(|name| write(folder.path(), name, &depth, &labels));
    let name = instance();
    let _daemon = serve(&name);
    let subscriber = Subscriber::open_within(&InstanceName::new(&name).unwrap(), &SubscriberOptions::default(), PATIENCE).unwrap();
    let play = |arguments: &[&str]| {
        let (code, said, errors) = beo_camera(folder.path(), &[&["--instance", &name], arguments].concat());
        assert_eq!(code, Some(0), "{said}{errors}");
        percepts(&subscriber, 4).iter().map(|percept| (percept.object_id, percept.filtered)).collect::<Vec<_>>()
    };
    let mut alone = play(&["--track=none"]);
    alone.sort_unstable();
    assert_eq!(alone, [(1, 0), (1, 0), (2, 0), (2, 0)]);
    for arguments in [&[][..], &["--track"], &["--track=place"], &["--track=label"]] {
        let mut tracked = play(arguments);
        tracked.sort_unstable();
        assert_eq!(tracked, [(1, 0), (1, 1), (2, 0), (2, 1)], "{arguments:?}");
    }
    // Labels that change are no matter where the place tells, and mislead where they are what tells.
    let exchanged: Vec<u8> = labels.iter().map(|label| if (1..=2).contains(label) { 3 - label } else { *label }).collect();
    write(folder.path(), "b", &depth, &exchanged);
    let classes = |arguments: &[&str]| {
        let (code, said, errors) = beo_camera(folder.path(), &[&["--instance", &name], arguments].concat());
        assert_eq!(code, Some(0), "{said}{errors}");
        percepts(&subscriber, 4).iter().map(|percept| percept.filtered).sum::<u32>()
    };
    assert_eq!(classes(&[]), 2);
    // Where the second frame has the objects elsewhere, nothing is continued.
    let moved: Vec<u8> = labels.iter().map(|label| if *label == 1 { 7 } else { 0 }).collect();
    write(folder.path(), "b", &depth, &moved);
    let (code, said, errors) = beo_camera(folder.path(), &["--instance", &name, "--count", "3"]);
    assert_eq!(code, Some(0), "{said}{errors}");
    // Frames a, b, a: the first object is continued twice under another label; the second is new again.
    let found: Vec<(u64, u32)> = percepts(&subscriber, 5).iter().map(|percept| (percept.object_id, percept.filtered)).collect();
    let of = |object: u64| found.iter().filter(|(id, _)| *id == object).map(|(_, filtered)| *filtered).collect::<Vec<_>>();
    assert_eq!((of(1), of(7), of(2)), (vec![0, 1], vec![1], vec![0, 0]));
}

/// A grid that was written, and its frame in the world, with the camera where it was.
struct Written {
    observation: Observation,
    grid_to_world: Isometry3<f64>,
    voxel_size_m: f64,
}

impl Written {
    fn read(folder: &Path, stem: &str, camera_to_world: &Isometry3<f64>) -> Self {
        let beside = std::fs::read_to_string(folder.join(format!("{stem}.json"))).unwrap();
        let beside: serde_json::Value = serde_json::from_str(&beside).unwrap();
        let number = |name: &str, i: usize| beside[name][i].as_f64().unwrap();
        let [x, y, z, w] = [0, 1, 2, 3].map(|i| number("orientation", i));
        let [a, b, c] = [0, 1, 2].map(|i| number("position_m", i));
        let grid_to_camera = Isometry3::from_parts(Translation3::new(a, b, c), UnitQuaternion::new_normalize(Quaternion::new(w, x, y, z)));
        let camera = Point3::from([0, 1, 2].map(|i| number("sensor_position_m", i)));
        assert!((grid_to_camera * camera).coords.norm() < 1e-9, "the camera is at its own origin");
        Self {
            observation: read_observation(&folder.join(format!("{stem}.npy"))).unwrap(),
            grid_to_world: camera_to_world * grid_to_camera,
            voxel_size_m: beside["voxel_size_m"].as_f64().unwrap(),
        }
    }

    /// Code and centre in the world of every voxel.
    fn voxels(&self) -> impl Iterator<Item = (u8, Point3<f64>)> {
        let dims = self.observation.dims();
        (0..dims.voxels()).map(move |index| {
            let [i, j, k] = dims.coordinates(index);
            let place = |at: usize, side: usize| (at as f64 + 0.5 - side as f64 / 2.0) * self.voxel_size_m;
            let centre = Point3::new(place(i, dims.x()), place(j, dims.y()), place(k, dims.z()));
            (self.observation.code(index), self.grid_to_world * centre)
        })
    }
}

/// Signed distance from the surface of a block, negative inside.
fn outside(block: &Block, point: &Point3<f64>) -> f64 {
    (0..3).map(|axis| (block[0][axis] - point[axis]).max(point[axis] - block[1][axis])).fold(f64::NEG_INFINITY, f64::max)
}

fn filled(written: &Written, on: impl Fn(&Point3<f64>) -> bool) -> usize {
    written.voxels().filter(|(code, point)| *code == 1 && on(point)).count()
}

#[test]
fn grids_as_files_hold_what_is_true_of_the_scene() {
    let folder = tempfile::tempdir().unwrap();
    scene(folder.path());
    let out = folder.path().join("grids");
    let (code, said, errors) = beo_camera(folder.path(), &["--out", out.to_str().unwrap(), "--resolution", "24"]);
    assert_eq!(code, Some(0), "{said}{errors}");
    assert!(said.lines().last().unwrap().starts_with("1 frames, 1 objects without a grid, 2 grids written to "), "{said}");
    for (stem, block) in [("scene-1", TALL), ("scene-2", LOW)] {
        let written = Written::read(&out, stem, &usual());
        let side = (0..3).map(|axis| block[1][axis] - block[0][axis]).fold(0.0, f64::max);
        assert!((written.voxel_size_m / (side * 1.5 / 24.0) - 1.0).abs() < 0.2, "{stem}: {}", written.voxel_size_m);
        // The band is as wide as a voxel seen along the optical axis: half of its diagonal at most.
        let band = 0.9 * written.voxel_size_m + 0.004;
        for (code, point) in written.voxels() {
            let distance = outside(&block, &point);
            match code {
                1 => assert!(distance.abs() < band, "{stem}: filled at {point}, {distance} from the surface"),
                0 => assert!(distance > -band, "{stem}: empty at {point}, inside"),
                _ => assert!(point.z < block[1][2] + band, "{stem}: unknown at {point}, above"),
            }
        }
        assert!(filled(&written, |point| (point.z - block[1][2]).abs() < band) > 20, "the top of {stem}");
        assert!(filled(&written, |point| (point.x - block[0][0]).abs() < band) > 20, "the front of {stem}");
    }
}

#[test]
fn fused_frames_know_both_sides() {
    let folder = tempfile::tempdir().unwrap();
    let cameras = [usual(), camera([0.6, 0.1, 0.5])];
    let mut trajectory = String::from("# stamp tx ty tz qx qy qz qw\n");
    for (name, place) in ["a", "b"].iter().zip(&cameras) {
        let (depth, labels) = render(place);
        write(folder.path(), name, &depth, &labels);
        let (t, q) = (place.translation.vector, place.rotation.coords);
        trajectory += &format!("12.5 {} {} {} {} {} {} {}\n", t.x, t.y, t.z, q.x, q.y, q.z, q.w);
    }
    let poses = folder.path().join("poses.txt");
    std::fs::write(&poses, &trajectory).unwrap();
    let out = folder.path().join("grids");
    let arguments = ["--out", out.to_str().unwrap(), "--fuse", "--trajectory", poses.to_str().unwrap()];
    let (code, said, errors) = beo_camera(folder.path(), &arguments);
    assert_eq!(code, Some(0), "{said}{errors}");
    let [first, second] = [0, 1].map(|i| Written::read(&out, ["a-1", "b-1"][i], &cameras[i]));
    assert!((first.grid_to_world.translation.vector - second.grid_to_world.translation.vector).norm() < 1e-9);
    let sides = |written: &Written| [TALL[0][0], TALL[1][0]].map(|x| filled(written, |p| (p.x - x).abs() < 0.008 && p.z < 0.1));
    let ([front, back], [still_front, now_back]) = (sides(&first), sides(&second));
    assert!(front > 50 && back == 0 && still_front > 50 && now_back > 50, "{front} {back} {still_front} {now_back}");

    std::fs::write(&poses, "1 0 0 0 0 0 0 1\n").unwrap();
    let (code, _, errors) = beo_camera(folder.path(), &arguments);
    assert!(code == Some(1) && errors.contains("1 poses for 2 frames"), "{errors}");
    let (code, _, errors) = beo_camera(folder.path(), &arguments[..3]);
    assert!(code == Some(1) && errors.contains("--trajectory"), "{errors}");
}

#[test]
fn without_a_plane_gravity_says_what_is_up() {
    let folder = tempfile::tempdir().unwrap();
    let (mut depth, labels) = render(&usual());
    // Only the objects have readings.
    depth.iter_mut().zip(&labels).filter(|(_, label)| **label == 0).for_each(|(depth, _)| *depth = 0);
    write(folder.path(), "dark", &depth, &labels);
    let out = folder.path().join("grids");
    let out = ["--out", out.to_str().unwrap()];
    let (code, said, _) = beo_camera(folder.path(), &out);
    // Nothing at all was answered.
    assert_eq!((code, said.lines().filter(|line| line.contains("--gravity")).count()), (Some(1), 2), "{said}");
    let down = usual().rotation.inverse() * -Vector3::z();
    let gravity = format!("{},{},{}", down.x, down.y, down.z);
    let (code, said, errors) = beo_camera(folder.path(), &[&out[..], &["--gravity", &gravity]].concat());
    assert!(code == Some(0) && said.contains("0 objects without a grid, 2 grids"), "{said}{errors}");
    let (code, _, errors) = beo_camera(folder.path(), &[&out[..], &["--gravity", "0,0,0"]].concat());
    assert!(code == Some(2) && errors.contains("direction"), "{errors}");
}

#[test]
fn a_picture_of_each_frame_shows_what_was_found() {
    let folder = tempfile::tempdir().unwrap();
    scene(folder.path());
    let (out, pictures) = (folder.path().join("grids"), folder.path().join("pictures"));
    let arguments = ["--out", out.to_str().unwrap(), "--png", pictures.to_str().unwrap()];
    let (code, said, errors) = beo_camera(folder.path(), &arguments);
    assert_eq!(code, Some(0), "{said}{errors}");
    let names: Vec<_> = std::fs::read_dir(&pictures).unwrap().map(|entry| entry.unwrap().file_name()).collect();
    assert_eq!(names, ["scene.png"]);
    let decoder = png::Decoder::new(std::io::BufReader::new(std::fs::File::open(pictures.join("scene.png")).unwrap()));
    let reader = decoder.read_info().unwrap();
    // The image with the bar beside it or the text below it; below are the legend and three objects.
    assert!(reader.info().width >= SIZE[0] + 72 && reader.info().height == SIZE[1] + 8 + 4 * 17, "{:?}", reader.info().size());
    let (code, _, errors) = beo_camera(folder.path(), &["--out", out.to_str().unwrap(), "--png", folder.path().to_str().unwrap()]);
    assert!(code == Some(2) && errors.contains("a folder of their own"), "{errors}");
}

#[test]
fn a_frame_that_cannot_be_read_is_named_and_skipped() {
    let folder = tempfile::tempdir().unwrap();
    scene(folder.path());
    std::fs::write(folder.path().join("bad_depth.png"), b"\x89PNG\r\n").unwrap();
    std::fs::copy(folder.path().join("scene_label.png"), folder.path().join("bad_label.png")).unwrap();
    std::fs::copy(folder.path().join("scene_depth.png"), folder.path().join("half_depth.png")).unwrap();
    let out = folder.path().join("grids");
    let (code, said, _) = beo_camera(folder.path(), &["--out", out.to_str().unwrap()]);
    assert_eq!(code, Some(0));
    assert!(said.contains("bad: skipped: ") && said.contains("bad_depth.png: PNG: "), "{said}");
    assert!(said.contains("half: skipped: there is no ") && said.contains("half_label.png"), "{said}");
    assert!(said.contains("1 frames (2 skipped), 1 objects without a grid, 2 grids"), "{said}");
    std::fs::remove_file(folder.path().join("camera_info.yaml")).unwrap();
    let (code, _, errors) = beo_camera(folder.path(), &["--out", out.to_str().unwrap()]);
    assert!(code == Some(1) && errors.contains("no frame of"), "{errors}");
}

#[test]
fn every_labelled_object_of_the_real_frames_has_a_grid_or_a_reason() {
    let Some(root) = std::env::var_os("BEO_DEPTH").map(PathBuf::from) else {
        return skipped("set BEO_DEPTH to the folder of real depth frames");
    };
    for (name, support) in [("osd", Some(1)), ("tabletop", None)] {
        let folder = root.join(name);
        let frames = FrameFolder::open(&folder, FolderOptions::default()).unwrap();
        let objects = |frame: usize| frames.read(frame).unwrap().frame().objects(support).len();
        let expected: usize = (0..frames.count()).map(objects).sum();
        let out = tempfile::tempdir().unwrap();
        let mut arguments = vec!["--out", out.path().to_str().unwrap()];
        arguments.extend(support.iter().flat_map(|_| ["--support-label", "1"]));
        let (code, said, errors) = beo_camera(&folder, &arguments);
        assert_eq!(code, Some(0), "{said}{errors}");
        let reasons = said.lines().filter(|line| line.contains(": no grid: ")).count();
        let files: Vec<PathBuf> = std::fs::read_dir(out.path()).unwrap().map(|entry| entry.unwrap().path()).collect();
        let grids = files.iter().filter(|path| path.extension().is_some_and(|end| end == "npy")).count();
        assert_eq!(grids + reasons, expected, "{said}");
        assert!(expected >= frames.count() && grids * 10 >= expected * 9, "{grids} of {expected}: {said}");
        // Something of each object was seen.
        for path in files.iter().filter(|path| path.extension().is_some_and(|end| end == "npy")) {
            assert!(read_observation(path).unwrap().filled().count_ones(..) >= 20, "{}", path.display());
        }
    }
}
