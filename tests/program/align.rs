//! Alignment by the program: from scattered shapes to a model, and what it refuses.

use crate::harness::{run, text};
use crate::real_shapes::skipped;
use beo_core::grid::{Dims, Occupancy, from_xyzw, uniform_rotation};
use beo_shapes::alignment::ShapeSimilarity;
use beo_shapes::{Alignment, Mesh, parse_binvox, parse_off, write_binvox, write_off};
use nalgebra::{Point3, Vector3};
use std::path::Path;

/// The mesh of a solid L with a foot, each of other proportions, turned, scaled and moved.
fn scattered(n: usize) -> Mesh {
    let wide = 3.0 + 0.3 * (n % 3) as f64;
    let corners = [[[0.0; 3], [1.0, 1.0, 8.0]], [[0.0; 3], [wide, 1.0, 1.0]], [[0.0, 0.0, 0.0], [1.0, 2.0, 1.2]]];
    let (mut vertices, mut triangles) = (Vec::new(), Vec::new());
    for [low, high] in corners {
        let first = vertices.len() as u32;
        vertices.extend((0..8).map(|c| Point3::from([0, 1, 2].map(|a| if c >> a & 1 == 0 { low[a] } else { high[a] }))));
        let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
        triangles.extend(quads.iter().flat_map(|[a, b, c, d]| [[a, b, c], [a, c, d]].map(|t| t.map(|v| v + first))));
    }
    let share = |step: f64| (0.1 + step * n as f64).fract();
    let pose = ShapeSimilarity {
        rotation: uniform_rotation([share(0.37), share(0.61), share(0.23)]),
        scale: 1.0 + n as f64,
        translation: Vector3::new(n as f64, -3.0, 7.0),
    };
    Mesh::new(vertices, triangles).unwrap().mapped(|point| pose.place(point)).unwrap()
}

fn write(path: &Path, mesh: &Mesh) {
    std::fs::create_dir_all(path.parent().unwrap()).unwrap();
    let mut bytes = Vec::new();
    write_off(&mut bytes, mesh).unwrap();
    std::fs::write(path, bytes).unwrap();
}

fn alignment(folder: &Path) -> Alignment {
    Alignment::parse(&std::fs::read(folder.join("alignment.json")).unwrap()).unwrap()
}

#[test]
fn scattered_meshes_are_aligned_and_learned_as_they_then_lie() {
    let folder = tempfile::tempdir().unwrap();
    let (dir, out, pictures) = (folder.path().join("brackets"), folder.path().join("out/brackets"), folder.path().join("png"));
    (0..8).for_each(|n| write(&dir.join(format!("{n}.off")), &scattered(n)));
    std::fs::write(dir.join("broken.off"), "no mesh").unwrap();
    let path = |path: &Path| path.to_str().unwrap().to_owned();
    let align = |out: &Path, threads: &str| {
        run(["align", &path(&dir), "--out", &path(out), "--resolution", "24", "--png", &path(&pictures), "--threads", threads])
    };
    let aligned = align(&out, "1");
    let (said, warned) = (text(&aligned.stdout), text(&aligned.stderr));
    assert!(aligned.status.success(), "{warned}");
    assert!(warned.contains("skipped brackets/broken.off: unreadable: ") && warned.contains("OFF, line 1"), "{warned}");
    assert!(said.contains("brackets: 8 shapes, entropy "), "{said}");
    for picture in ["brackets-mean.png", "brackets-shapes.png"] {
        assert!(std::fs::read(pictures.join(picture)).unwrap().starts_with(b"\x89PNG"));
    }

    let written = alignment(&out);
    let class = &written.classes["brackets"];
    assert!(class.entropy_after < 0.6 * class.entropy_before && class.entropy_after < class.entropy_normalised, "{class:?}");
    assert_eq!(class.files.len(), 8);
    let mut longest = 0.0;
    for (n, file) in class.files.iter().enumerate() {
        assert_eq!((file.input.as_str(), file.output.as_str()), (format!("{n}.off").as_str(), format!("{n}.off").as_str()));
        let mesh = parse_off(&std::fs::read(out.join(&file.output)).unwrap()).unwrap();
        // What was written is the input under the transform that is named.
        let named = ShapeSimilarity { rotation: from_xyzw(file.rotation_xyzw), scale: file.scale, translation: file.translation.into() };
        let input = parse_off(&std::fs::read(dir.join(&file.input)).unwrap()).unwrap();
        let apart = input.vertices().iter().zip(mesh.vertices()).map(|(a, b)| (named.place(a) - b).norm()).fold(0.0, f64::max);
        assert!(apart < 1e-6, "{apart}");
        let [low, high] = mesh.bounds();
        assert!(low.iter().chain(high.iter()).all(|x| x.abs() <= 0.5));
        longest += (high - low).max() / 8.0;
    }
    assert!((longest - 0.8).abs() < 1e-6, "{longest}");

    // Whatever the threads.
    let again = folder.path().join("again");
    assert!(align(&again, "3").status.success());
    for n in 0..8 {
        let bytes = |folder: &Path| std::fs::read(folder.join(format!("{n}.off"))).unwrap();
        assert_eq!(bytes(&out), bytes(&again));
    }

    let model = path(&folder.path().join("m.safetensors"));
    let trained = run(["train", &path(&out), "--out", &model, "--resolution", "16"]);
    let message = text(&trained.stderr);
    assert!(trained.status.success(), "{message}");
    assert_eq!(message.lines().filter(|line| line.contains("placed by `beo align`")).count(), 1, "{message}");
    assert!(run(["perceive", &path(&out.join("3.off")), "--model", &model]).status.success());
    std::fs::write(out.join("alignment.json"), "{}").unwrap();
    for command in [["train", &path(&out), "--out", &model], ["perceive", &path(&out.join("3.off")), "--model", &model]] {
        let broken = run(command);
        assert_eq!(broken.status.code(), Some(1));
        let message = text(&broken.stderr);
        assert!(message.contains("brackets/alignment.json: missing field `format`"), "{message}");
    }
}

#[test]
fn classes_and_splits_are_kept_y_may_be_up_and_voxels_stay_voxels() {
    let folder = tempfile::tempdir().unwrap();
    let (dir, out) = (folder.path().join("in"), folder.path().join("out"));
    for n in 0..3 {
        write(&dir.join(format!("bracket/train/{n}.off")), &scattered(n));
        write(&dir.join(format!("bracket/test/{n}.off")), &scattered(n + 3));
    }
    let dims = Dims::new(20, 24, 22).unwrap();
    for n in 0..4_usize {
        // A stair, moved.
        let stair = Occupancy::from_fn(dims, |i, j, k| {
            let (i, j, k) = (i.wrapping_sub(2 + n), j.wrapping_sub(3), k.wrapping_sub(1 + n));
            i < 12 && j < 4 && k < 4 || i < 4 && j < 4 && k < 9 || i < 3 && j < 8 && k < 3
        });
        let mut bytes = Vec::new();
        write_binvox(&mut bytes, &stair).unwrap();
        let train = dir.join("stair/train");
        std::fs::create_dir_all(&train).unwrap();
        std::fs::write(train.join(format!("{n}.binvox")), bytes).unwrap();
    }
    let (dir, out) = (dir.to_str().unwrap(), out.to_str().unwrap());
    let aligned = run(["align", dir, "--out", out, "--resolution", "20", "--up", "y"]);
    assert!(aligned.status.success(), "{}", text(&aligned.stderr));
    let out = Path::new(out);
    let written = alignment(out);
    assert_eq!(written.classes.keys().collect::<Vec<_>>(), ["bracket", "stair"]);
    for file in &written.classes["bracket"].files {
        let read = |path: &Path| parse_off(&std::fs::read(path).unwrap()).unwrap();
        let named = ShapeSimilarity { rotation: from_xyzw(file.rotation_xyzw), scale: file.scale, translation: file.translation.into() };
        let (input, output) = (read(&Path::new(dir).join(&file.input)), read(&out.join(&file.output)));
        // From the coordinates of the file, in which y is up.
        let apart = input.vertices().iter().zip(output.vertices()).map(|(a, b)| (named.place(a) - b).norm()).fold(0.0, f64::max);
        assert!(apart < 1e-6, "{apart}");
    }
    let stairs: Vec<Occupancy> =
        (0..4).map(|n| parse_binvox(&std::fs::read(out.join(format!("stair/train/{n}.binvox"))).unwrap()).unwrap()).collect();
    for stair in &stairs {
        assert_eq!(stair.dims(), Dims::cube(24).unwrap());
        let both = stair.overlap(&stairs[0]) as f64;
        let iou = both / (stair.count() as f64 + stairs[0].count() as f64 - both);
        assert!(iou > 0.85, "{iou}");
    }
}

#[test]
fn what_cannot_be_aligned_is_refused_in_one_line() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let refused = |arguments: &[&str], code: i32, part: &str| {
        let output = run([["align"].as_slice(), arguments].concat());
        let message = text(&output.stderr);
        assert_eq!(output.status.code(), Some(code), "{message}");
        assert!(message.contains(part) && !message.contains("panicked"), "`{part}` is not in: {message}");
        assert!(message.lines().count() == 1, "{message}");
    };
    std::fs::create_dir(path("empty")).unwrap();
    refused(&[&path("empty"), "--out", &path("out")], 1, "a folder of shapes looks like");
    write(&folder.path().join("one/a.off"), &scattered(1));
    refused(&[&path("one"), "--out", &path("out")], 1, "class `one` has 1 usable shapes: at least 2");
    (0..2).for_each(|n| write(&folder.path().join(format!("two/{n}.off")), &scattered(n)));
    refused(&[&path("two"), "--out", &path("two")], 1, "the folder of the shapes themselves");
    refused(&[&path("two"), "--out", &path("two/../two/.")], 1, "the folder of the shapes themselves");
    refused(&[&path("two"), "--out", &path("one")], 1, "it is not empty");
    refused(&[&path("two"), "--out", &path("one/a.off")], 1, "this is a file");
    refused(&[&path("two"), "--out", &path("out"), "--resolution", "8"], 2, "use 16 to 120");
    assert!(!folder.path().join("out").exists());
    // Two are enough.
    assert!(run(["align", &path("two"), "--out", &path("out"), "--resolution", "16"]).status.success());
}

/// Real pliers, open and closed, in any pose.
#[test]
fn pliers_lie_flat_with_their_jaws_at_one_end() {
    let Some(root) = std::env::var_os("BEO_PSB") else {
        return skipped("set BEO_PSB to the folder of shapes of the Princeton benchmark, plier/*.off");
    };
    let folder = tempfile::tempdir().unwrap();
    let (dir, out) = (Path::new(&root).join("plier"), folder.path().join("plier"));
    let aligned = run(["align", dir.to_str().unwrap(), "--out", out.to_str().unwrap()]);
    assert!(aligned.status.success(), "{}", text(&aligned.stderr));
    println!("{}", text(&aligned.stdout));
    let class = &alignment(&out).classes["plier"];
    assert!(class.entropy_after < 0.79 * class.entropy_before && class.entropy_after < 0.85 * class.entropy_normalised, "{class:?}");
    let mut shares = Vec::new();
    for file in &class.files {
        let mesh = parse_off(&std::fs::read(out.join(&file.output)).unwrap()).unwrap();
        let [low, high] = mesh.bounds();
        let side = high - low;
        assert!(side.z < 0.35 * side.x.min(side.y), "{}: does not lie flat: {side}", file.output);
        // How far from the side of -y the surface lies on average: handles have more of it than jaws.
        let (mut area, mut sum) = (0.0, 0.0);
        for triangle in mesh.triangles() {
            let [a, b, c] = mesh.corners(*triangle);
            let twice = (b - a).cross(&(c - a)).norm();
            area += twice;
            sum += twice * ((a.y + b.y + c.y) / 3.0 - low.y);
        }
        shares.push(sum / area / side.y);
    }
    // 0.39 to 0.53, 0.46 on average: one that lies the wrong way round has 1 less that.
    let mean = shares.iter().sum::<f64>() / shares.len() as f64;
    assert!(mean < 0.475 && shares.iter().all(|share| *share < 0.56), "jaws are not at +y: {shares:?}");
}
