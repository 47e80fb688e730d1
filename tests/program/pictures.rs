//! Pictures and meshes of what is perceived, with and without a daemon.

use crate::client::{Client, block};
use crate::harness::{Running, beo, dims, instance, model, run, serve, shape, text};
use beo_shapes::parse_ply;
use nalgebra::{Point3, Vector3};
use std::path::{Path, PathBuf};

/// The files of a folder, sorted.
fn files(folder: &Path) -> Vec<PathBuf> {
    let mut files: Vec<_> = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    files.sort();
    files
}

fn names(folder: &Path) -> Vec<String> {
    files(folder).iter().map(|file| file.file_name().unwrap().to_string_lossy().into_owned()).collect()
}

/// Positions of a binary PLY's points, x, y, z first in 15 bytes each.
fn points(path: &Path) -> Vec<Point3<f64>> {
    let bytes = std::fs::read(path).unwrap();
    let end = bytes.windows(11).position(|line| line == b"end_header\n").unwrap() + 11;
    let side = |bytes: &[u8]| f64::from(f32::from_le_bytes(bytes.try_into().unwrap()));
    bytes[end..].chunks(15).map(|point| Point3::new(side(&point[..4]), side(&point[4..8]), side(&point[8..12]))).collect()
}

#[test]
fn perceive_leaves_a_picture_and_meshes_of_each_file() {
    let folder = tempfile::tempdir().unwrap();
    let shapes = ["chair", "table"].map(|class| shape(folder.path(), class, 1001));
    let [png, ply] = ["png", "ply/deeper"].map(|name| folder.path().join(name));
    let mut arguments: Vec<&std::ffi::OsStr> = vec!["perceive".as_ref(), "--pose".as_ref(), "yaw".as_ref()];
    arguments.extend(["--model".as_ref(), model().as_os_str(), "--png".as_ref(), png.as_os_str(), "--ply".as_ref(), ply.as_os_str()]);
    arguments.extend(shapes.iter().map(|file| file.as_os_str()));
    let output = run(arguments);
    assert!(output.status.success(), "{}", text(&output.stderr));
    assert_eq!(names(&png), ["0001-chair-1001.png", "0002-table-1001.png"]);
    let expected =
        ["0001-chair-1001-completion.ply", "0001-chair-1001-query.ply", "0002-table-1001-completion.ply", "0002-table-1001-query.ply"];
    assert_eq!(names(&ply), expected);
    let mesh = parse_ply(&std::fs::read(ply.join(expected[0])).unwrap()).unwrap();
    // Without a scale lengths are voxels, about the grid's centre.
    let reach = dims().x() as f64 / 2.0;
    assert!(mesh.bounds().iter().all(|corner| corner.iter().all(|side| side.abs() <= reach)));
    assert!((mesh.bounds()[1] - mesh.bounds()[0]).max() > reach, "a chair takes more than half of its grid");
}

#[test]
fn watch_places_meshes_where_the_observation_says() {
    let (name, folder) = (instance(), tempfile::tempdir().unwrap());
    let _daemon = serve(&name);
    let ply = folder.path().join("ply");
    let mut watcher = Running::start(beo(["watch", "--instance", &name, "--count", "1", "--ply", ply.to_str().unwrap()]));
    assert!(watcher.message().starts_with("watching"));
    // A quarter turn about z: the grid's x axis is the frame's y axis.
    let half = std::f64::consts::FRAC_1_SQRT_2;
    Client::new(&name).ask(|header, voxels| {
        header.position_m = [1.0, 2.0, 3.0];
        header.orientation = [0.0, 0.0, half, half];
        header.voxel_size_m = 0.01;
        block(voxels);
    });
    assert!(watcher.wait().success());
    let found = files(&ply);
    assert_eq!(found.len(), 2, "{found:?}");
    let seen = points(&found[1]);
    // The block has 10 voxels along the grid's x and 8 along its y, in the layer half a voxel above the centre.
    assert_eq!(seen.len(), 80);
    let about = |at: f64, extent: f64| (at - extent / 2.0 - 1e-6)..(at + extent / 2.0 + 1e-6);
    for point in &seen {
        assert!(about(1.0, 0.07).contains(&point.x) && about(2.0, 0.09).contains(&point.y), "{point}");
        assert!((point.z - 3.005).abs() < 1e-6);
    }
    let mesh = parse_ply(&std::fs::read(&found[0]).unwrap()).unwrap();
    let [low, high] = mesh.bounds();
    assert!(((low + high.coords).coords / 2.0 - Vector3::new(1.0, 2.0, high.z / 2.0 + low.z / 2.0)).norm() < 0.02);
    assert!((high.z - 3.01).abs() < 0.006, "half a voxel above the layer that was seen: {}", high.z);
}
