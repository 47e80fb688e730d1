//! One suite for all importers: an asymmetric shape gives the same voxels in every format and variant, and every file that is refused is
//! refused by name: what is wrong, where, and what was found.

use beo_core::grid::{Dims, Occupancy};
use beo_shapes::{Close, Mesh, Note, ReadOptions, Up, read_shape, read_shape_noted, voxelise, write_binvox};
use nalgebra::Point3;
use std::path::{Path, PathBuf};

/// An F in the plane x–z, 1 thick along y; none of its mirror images is the shape itself.
const OUTLINE: [[f64; 2]; 10] =
    [[0.0, 0.0], [1.5, 0.0], [1.5, 2.5], [3.0, 2.5], [3.0, 3.5], [1.5, 3.5], [1.5, 5.0], [4.0, 5.0], [4.0, 6.0], [0.0, 6.0]];
/// Its triangles by hand, over the outline's corners.
const CAP: [[u32; 3]; 8] = [[0, 1, 2], [0, 2, 5], [2, 3, 4], [2, 4, 5], [0, 5, 6], [0, 6, 9], [6, 7, 8], [6, 8, 9]];
const THICKNESS: f64 = 1.0;
const CORNERS: usize = OUTLINE.len();

fn vertices() -> Vec<[f64; 3]> {
    [0.0, THICKNESS].iter().flat_map(|y| OUTLINE.map(|[x, z]| [x, *y, z])).collect()
}

/// The polygons: two caps, then the sides as squares.
fn polygons() -> Vec<Vec<u32>> {
    let n = CORNERS as u32;
    let caps = [(0..n).collect(), (n..2 * n).rev().collect()];
    caps.into_iter().chain((0..n).map(|a| vec![(a + 1) % n, a, a + n, (a + 1) % n + n])).collect()
}

/// The triangles, by hand.
fn triangles() -> Vec<[u32; 3]> {
    let n = CORNERS as u32;
    let caps = CAP.iter().flat_map(|&[a, b, c]| [[a, b, c], [c + n, b + n, a + n]]);
    let sides = (0..n).flat_map(|a| [[(a + 1) % n, a, a + n], [(a + 1) % n, a + n, (a + 1) % n + n]]);
    caps.chain(sides).collect()
}

fn dims() -> Dims {
    Dims::cube(30).unwrap()
}

fn expected() -> Occupancy {
    let mesh = Mesh::new(vertices().into_iter().map(Point3::from).collect(), triangles()).unwrap();
    voxelise(&mesh, dims(), 24)
}

/// Where a point lies in a file whose y axis is up.
fn y_up([x, y, z]: [f64; 3]) -> [f64; 3] {
    [x, z, -y]
}

fn f32s(points: &[[f64; 3]]) -> Vec<u8> {
    points.iter().flatten().flat_map(|c| (*c as f32).to_le_bytes()).collect()
}

fn rows<T: ToString>(rows: impl IntoIterator<Item = Vec<T>>) -> String {
    rows.into_iter().map(|row| row.iter().map(T::to_string).collect::<Vec<_>>().join(" ") + "\n").collect()
}

/// Vertices, then polygons with their counts.
fn body(points: &[[f64; 3]], polygons: &[Vec<u32>]) -> String {
    rows(points.iter().map(|p| p.to_vec())) + &rows(polygons.iter().map(|p| [&[p.len() as u32], &p[..]].concat()))
}

fn off(points: &[[f64; 3]], polygons: &[Vec<u32>]) -> String {
    format!("OFF\n{} {} 0\n{}", points.len(), polygons.len(), body(points, polygons))
}

fn obj(points: &[[f64; 3]]) -> String {
    let faces = polygons().into_iter().map(|p| std::iter::once("f".to_owned()).chain(p.iter().map(|v| format!("{}//1", v + 1))).collect());
    points.iter().map(|[x, y, z]| format!("v {x} {y} {z}\n")).collect::<String>() + &rows::<String>(faces)
}

fn stl_text(points: &[[f64; 3]]) -> String {
    let mut text = String::from("solid F\n");
    for triangle in triangles() {
        text += "facet normal 0 0 0\nouter loop\n";
        triangle.map(|v| points[v as usize]).iter().for_each(|[x, y, z]| text += &format!("vertex {x} {y} {z}\n"));
        text += "endloop\nendfacet\n";
    }
    text + "endsolid F\n"
}

fn stl_binary(header: &[u8], count: u32) -> Vec<u8> {
    let mut bytes = header.to_vec();
    bytes.resize(80, 0);
    bytes.extend(count.to_le_bytes());
    for triangle in triangles() {
        bytes.extend([0; 12]);
        bytes.extend(f32s(&triangle.map(|v| vertices()[v as usize])));
        bytes.extend([0; 2]);
    }
    bytes
}

fn ply_header(encoding: &str, vertices: usize, element: &str, count: usize) -> String {
    format!(
        "ply\nformat {encoding} 1.0\nelement vertex {vertices}\nproperty float x\nproperty float y\nproperty float z\nelement {element} {count}\n\
         property list int int vertex_indices\nend_header\n"
    )
}

fn ply_text(points: &[[f64; 3]]) -> String {
    ply_header("ascii", points.len(), "face", polygons().len()) + &body(points, &polygons())
}

fn ply_binary(lists: &[Vec<i32>], element: &str, is_big: bool) -> Vec<u8> {
    let encoding = if is_big { "binary_big_endian" } else { "binary_little_endian" };
    let mut bytes = ply_header(encoding, 2 * CORNERS, element, lists.len()).into_bytes();
    let mut put = |[a, b, c, d]: [u8; 4]| bytes.extend(if is_big { [d, c, b, a] } else { [a, b, c, d] });
    vertices().iter().flatten().for_each(|c| put((*c as f32).to_le_bytes()));
    for list in lists {
        put((list.len() as i32).to_le_bytes());
        list.iter().for_each(|v| put(v.to_le_bytes()));
    }
    bytes
}

/// A document whose triangles have y up, below a node that moves them.
fn gltf(uri: Option<&str>) -> String {
    let (points, indices) = (2 * CORNERS, 3 * triangles().len());
    let uri = uri.map_or(String::new(), |uri| format!(", \"uri\": \"{uri}\""));
    format!(
        r#"{{"asset": {{"version": "2.0"}}, "scene": 0, "scenes": [{{"nodes": [0]}}], "nodes": [{{"mesh": 0, "translation": [5, 6, 7]}}],
        "meshes": [{{"primitives": [{{"attributes": {{"POSITION": 0}}, "indices": 1}}]}}],
        "accessors": [{{"bufferView": 0, "componentType": 5126, "count": {points}, "type": "VEC3"}},
            {{"bufferView": 1, "componentType": 5123, "count": {indices}, "type": "SCALAR"}}],
        "bufferViews": [{{"buffer": 0, "byteLength": {0}}}, {{"buffer": 0, "byteOffset": {0}, "byteLength": {1}}}],
        "buffers": [{{"byteLength": {2}{uri}}}]}}"#,
        12 * points,
        2 * indices,
        12 * points + 2 * indices
    )
}

fn gltf_buffer() -> Vec<u8> {
    let points: Vec<[f64; 3]> = vertices().into_iter().map(y_up).collect();
    let mut bytes = f32s(&points);
    bytes.extend(triangles().iter().flatten().flat_map(|v| (*v as u16).to_le_bytes()));
    bytes
}

fn glb() -> Vec<u8> {
    let (mut json, binary) = (gltf(None).into_bytes(), gltf_buffer());
    json.resize(json.len().next_multiple_of(4), b' ');
    let mut bytes = b"glTF".to_vec();
    for word in [2, (28 + json.len() + binary.len()) as u32, json.len() as u32, 0x4e4f_534a] {
        bytes.extend(word.to_le_bytes());
    }
    bytes.extend(json);
    bytes.extend((binary.len() as u32).to_le_bytes());
    bytes.extend(*b"BIN\0");
    bytes.extend(binary);
    bytes
}

fn npy(descr: &str, is_fortran: bool, dims: Dims, value: impl Fn([usize; 3]) -> Vec<u8>) -> Vec<u8> {
    let order = if is_fortran { "True" } else { "False" };
    let header = format!("{{'descr': '{descr}', 'fortran_order': {order}, 'shape': ({}, {}, {}), }}\n", dims.x(), dims.y(), dims.z());
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend((header.len() as u16).to_le_bytes());
    bytes.extend(header.as_bytes());
    for n in 0..dims.voxels() {
        let fortran = [n % dims.x(), n / dims.x() % dims.y(), n / dims.x() / dims.y()];
        bytes.extend(value(if is_fortran { fortran } else { dims.coordinates(n) }));
    }
    bytes
}

fn voxels(object: &Occupancy, is_fortran: bool, descr: &str) -> Vec<u8> {
    npy(descr, is_fortran, object.dims(), |[i, j, k]| vec![u8::from(object.is_filled(i, j, k))])
}

/// A ZIP archive of stored members.
fn npz(members: &[(&str, &[u8])]) -> Vec<u8> {
    let (mut bytes, mut directory) = (Vec::new(), Vec::new());
    for (name, content) in members {
        let at = bytes.len() as u32;
        let mut common = vec![20, 0, 0, 0, 0, 0, 0, 0, 0, 0];
        common.extend(crc32fast::hash(content).to_le_bytes());
        common.extend((content.len() as u32).to_le_bytes().repeat(2));
        common.extend((name.len() as u16).to_le_bytes());
        common.extend([0, 0]);
        bytes.extend([b"PK\x03\x04", &common[..], name.as_bytes(), content].concat());
        directory.extend([b"PK\x01\x02\x14\x00", &common[..], &[0; 10], &at.to_le_bytes(), name.as_bytes()].concat());
    }
    let start = bytes.len() as u32;
    let count = (members.len() as u16).to_le_bytes().repeat(2);
    let sizes = [(directory.len() as u32).to_le_bytes(), start.to_le_bytes()].concat();
    [bytes, directory, b"PK\x05\x06\0\0\0\0".to_vec(), count, sizes, vec![0, 0]].concat()
}

fn binvox(object: &Occupancy) -> Vec<u8> {
    let mut bytes = Vec::new();
    write_binvox(&mut bytes, object).unwrap();
    bytes
}

fn file(folder: &Path, name: &str, bytes: &[u8]) -> PathBuf {
    let path = folder.join(name);
    std::fs::write(&path, bytes).unwrap();
    path
}

/// The grid with y up that turns into `object`.
fn lying(object: &Occupancy) -> Occupancy {
    let n = object.dims().x();
    Occupancy::from_fn(object.dims(), |i, j, k| object.is_filled(i, n - 1 - k, j))
}

#[test]
fn the_shape_itself_is_what_was_drawn() {
    // 4 voxels a unit, centred; strictly within a rectangle of the F, or farther from all than a voxel.
    let object = expected();
    let rectangles = [[0.0, 1.5, 0.0, 6.0], [0.0, 3.0, 2.5, 3.5], [0.0, 4.0, 5.0, 6.0]];
    let (mut inside, mut outside) = (0, 0);
    for voxel in 0..dims().voxels() {
        let [i, j, k] = dims().coordinates(voxel);
        let at = |index: usize, extent: f64| (index as f64 + 0.5 - 15.0) / 4.0 + extent / 2.0;
        let (x, y, z) = (at(i, 4.0), at(j, THICKNESS), at(k, 6.0));
        let within = |margin: f64| {
            (-margin..=THICKNESS + margin).contains(&y)
                && rectangles.iter().any(|[a, b, c, d]| (a - margin..=b + margin).contains(&x) && (c - margin..=d + margin).contains(&z))
        };
        if within(0.0) {
            assert!(object.is_filled(i, j, k), "{i} {j} {k}");
            inside += 1;
        } else if !within(0.3) {
            assert!(!object.is_filled(i, j, k), "{i} {j} {k}");
            outside += 1;
        }
    }
    assert!(inside > 800 && outside > 20_000, "{inside} {outside}");
}

#[test]
fn every_format_and_variant_gives_the_same_voxels() {
    let folder = tempfile::tempdir().unwrap();
    let expected = expected();
    let points = vertices();
    let far: Vec<[f64; 3]> = points.iter().map(|[x, y, z]| [x + 432_100.0, y + 4_583_200.0, z + 95.0]).collect();
    let lists: Vec<Vec<i32>> = polygons().iter().map(|p| p.iter().map(|v| *v as i32).collect()).collect();
    let strip = triangles().iter().flat_map(|t| t.iter().map(|v| *v as i32).chain([-1])).collect();
    let count = triangles().len() as u32;
    file(folder.path(), "an F.bin", &gltf_buffer());

    let mut variants: Vec<(String, Vec<u8>)> = Vec::new();
    for (kind, text, far) in [
        ("off", off(&points, &polygons()), off(&far, &polygons())),
        ("obj", obj(&points), obj(&far)),
        ("stl", stl_text(&points), stl_text(&far)),
        ("ply", ply_text(&points), ply_text(&far)),
    ] {
        variants.push((format!("plain.{kind}"), text.clone().into()));
        variants.push((format!("far.{kind}"), far.into()));
        variants.push((format!("mark.{kind}"), format!("\u{feff}{text}").into()));
        variants.push((format!("return.{kind}"), text.replace('\n', "\r").into()));
        variants.push((format!("both.{kind}"), text.replace('\n', "\r\n").into()));
        variants.push((format!("marked-both.{kind}"), format!("\u{feff}{}", text.replace('\n', "\r\n")).into()));
    }
    variants.push(("blank.ply".into(), ply_text(&points).replace("end_header\n", "end_header\n\n").replace("\n4 ", "\n\n4 ").into()));
    variants.push(("end-solid.stl".into(), stl_text(&points).replace("endsolid", "end solid").into()));
    for (name, bytes) in [
        ("binary.stl", stl_binary(b"binary", count)),
        ("solid.stl", stl_binary(b"solid by CAD", count)),
        ("trailing.stl", [stl_binary(b"solid by CAD", count), vec![1, 2]].concat()),
        ("count0.stl", stl_binary(b"binary", 0)),
        ("count7.stl", stl_binary(b"solid", 7)),
        ("little.ply", ply_binary(&lists, "face", false)),
        ("big.ply", ply_binary(&lists, "face", true)),
        ("strips.ply", ply_binary(&[strip], "tristrips", false)),
        ("plain.glb", glb()),
        ("beside.gltf", gltf(Some("an%20F.bin")).into()),
        ("plain.binvox", binvox(&expected)),
        ("bool.npy", voxels(&expected, false, "|b1")),
        ("bytes.npy", voxels(&expected, false, "|u1")),
        ("fortran.npy", voxels(&expected, true, "|b1")),
        ("one.npz", npz(&[("voxels.npy", &voxels(&expected, false, "|b1"))])),
        ("two.npz", npz(&[("name.npy", b"\x93NUMPY\x01\x00"), ("voxels.npy", &voxels(&expected, true, "|u1"))])),
    ] {
        variants.push((name.into(), bytes));
    }
    let options = ReadOptions::new(dims());
    for (name, bytes) in &variants {
        let path = file(folder.path(), name, bytes);
        let reading = read_shape_noted(&path, &options).unwrap_or_else(|error| panic!("{error}"));
        let both = reading.object.overlap(&expected);
        assert!(reading.object == expected, "{name}: {} voxels, {both} of {} in common", reading.object.count(), expected.count());
        let is_counted = matches!(reading.notes[..], [Note::Count(_)]);
        assert_eq!(is_counted, name.starts_with("count"), "{name}: {:?}", reading.notes);
        assert!(is_counted || reading.notes.is_empty(), "{name}: {:?}", reading.notes);
    }

    // With y up, told by a flag.
    let points: Vec<[f64; 3]> = points.iter().copied().map(y_up).collect();
    let options = ReadOptions { up: Some(Up::Y), ..options };
    for (name, bytes) in [
        ("y.off", off(&points, &polygons()).into_bytes()),
        ("y.obj", obj(&points).into_bytes()),
        ("y.stl", stl_text(&points).into_bytes()),
        ("y.ply", ply_text(&points).into_bytes()),
        ("y.binvox", binvox(&lying(&expected))),
        ("y.npy", voxels(&lying(&expected), false, "|b1")),
        ("y.npz", npz(&[("a.npy", &voxels(&lying(&expected), true, "|b1"))])),
        ("y.glb", glb()),
    ] {
        let object = read_shape(&file(folder.path(), name, &bytes), &options).unwrap();
        assert!(object == expected, "{name}: {} of {} voxels in common", object.overlap(&expected), expected.count());
    }
}

#[test]
fn voxel_files_of_other_sizes_are_refused_or_resampled() {
    let folder = tempfile::tempdir().unwrap();
    let expected = expected();
    let large = Occupancy::from_fn(Dims::cube(60).unwrap(), |i, j, k| expected.is_filled(i / 2, j / 2, k / 2));
    let options = ReadOptions::new(dims());
    let array = voxels(&large, false, "|b1");
    for (name, bytes) in [("a.binvox", binvox(&large)), ("a.npy", array.clone()), ("a.npz", npz(&[("a.npy", &array)]))] {
        let path = file(folder.path(), name, &bytes);
        let message = read_shape(&path, &options).unwrap_err().to_string();
        assert!(message.contains("60×60×60 voxels where 30×30×30 are needed: --resample"), "{message}");
        let reading = read_shape_noted(&path, &ReadOptions { resample: true, ..options }).unwrap();
        assert!(matches!(reading.notes[..], [Note::Resampled { .. }]));
        assert_eq!(reading.object, expected, "{name}");
    }
}

#[test]
fn point_clouds_become_the_voxels_that_hold_a_point() {
    let folder = tempfile::tempdir().unwrap();
    let on_surface = |n: &i32| [n / 1600, n / 40 % 40, n % 40].iter().any(|c| *c == 0 || *c == 39);
    let points: Vec<Vec<f64>> =
        (0..64_000).filter(on_surface).map(|n| vec![f64::from(n / 1600), f64::from(n / 40 % 40) / 2.0, f64::from(n % 40) * 0.75]).collect();
    let text = rows(points.clone());
    let count = points.len();
    let ply = ply_header("ascii", count, "face", 0);
    let bare: String =
        ply.lines().filter(|line| !line.contains("face") && !line.contains("list")).map(|line| format!("{line}\n")).collect();
    for (name, text) in [
        ("a.ply", bare + &text),
        ("face0.ply", ply + &text),
        ("a.obj", text.lines().map(|line| format!("v {line}\n")).collect()),
        ("a.off", format!("OFF\n{count} 0 0\n{text}")),
    ] {
        let path = file(folder.path(), name, text.as_bytes());
        let options = ReadOptions::new(dims());
        let reading = read_shape_noted(&path, &options).unwrap();
        assert_eq!(reading.notes, [Note::PointCloud { points: count }]);
        assert_eq!(reading.object.bounds().unwrap(), [[3, 9, 6], [27, 21, 24]], "{name}");
        assert_eq!(reading.object.count(), 24 * 12 * 18, "{name}: what it encloses is filled");
        let message = read_shape(&path, &ReadOptions { point_clouds: false, ..options }).unwrap_err().to_string();
        assert!(message.contains("is a point cloud of") && message.contains("--point-clouds"), "{message}");
        let message = read_shape(&path, &ReadOptions { close: Close::Holes, ..options }).unwrap_err().to_string();
        assert!(message.contains("no holes to close") && message.contains("--close hull"), "{message}");
    }
}

#[test]
fn open_meshes_are_named_and_closed_on_demand() {
    // A box, without and with its bottom.
    let folder = tempfile::tempdir().unwrap();
    let corners: Vec<[f64; 3]> = (0..8).map(|c| [3 * (c & 1), 2 * (c >> 1 & 1), 4 * (c >> 2)].map(f64::from)).collect();
    let sides = [[4, 5, 7, 6], [0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3]].map(Vec::from);
    let bottom = vec![0, 2, 3, 1];
    let open = file(folder.path(), "open.off", off(&corners, &sides).as_bytes());
    let twice = file(folder.path(), "twice.off", off(&corners, &[&sides[..], &sides[..]].concat()).as_bytes());
    let closed = file(folder.path(), "closed.off", off(&corners, &[&sides[..], &[bottom]].concat()).as_bytes());
    let options = ReadOptions::new(dims());
    let full = read_shape_noted(&closed, &options).unwrap();
    assert!(full.notes.is_empty());
    for path in [&open, &twice] {
        let hollow = read_shape_noted(path, &options).unwrap();
        assert!(matches!(hollow.notes[..], [Note::Open { missing }] if missing > 0.5), "{:?}", hollow.notes);
        assert!(hollow.notes[0].to_string().contains("--close holes") && !hollow.object.is_filled(15, 15, 15));
        for close in [Close::Holes, Close::Hull] {
            let filled = read_shape_noted(path, &ReadOptions { close, ..options }).unwrap();
            assert!(matches!(filled.notes[..], [Note::Closed { .. }]));
            let both = filled.object.overlap(&full.object);
            let (count, all) = (filled.object.count(), full.object.count());
            assert!(count == both && both as f64 > 0.97 * all as f64, "{close:?}: {both} of {count} and {all}");
        }
    }
    // Closing leaves closed meshes as they are.
    for close in [Close::Holes, Close::Hull] {
        let same = read_shape_noted(&closed, &ReadOptions { close, ..options }).unwrap();
        assert!(same.object == full.object && same.notes.is_empty());
    }
    // Rays follow the F, whose front is missing, into its dents.
    let open = file(folder.path(), "f.off", off(&vertices(), &polygons()[1..]).as_bytes());
    assert!(matches!(read_shape_noted(&open, &options).unwrap().notes[..], [Note::Open { .. }]));
    let filled = read_shape(&open, &ReadOptions { close: Close::Holes, ..options }).unwrap();
    let (both, all) = (filled.overlap(&expected()) as f64, expected().count() as f64);
    assert!(both >= 0.9 * all && both >= 0.97 * filled.count() as f64, "{both} of {} and {all}", filled.count());
}

#[test]
fn every_refused_file_says_what_is_wrong() {
    let folder = tempfile::tempdir().unwrap();
    let float = |value: f32| npy("<f4", false, dims(), move |[i, ..]| if i == 0 { value.to_le_bytes().to_vec() } else { vec![0; 4] });
    let grey = |value: u8| npy("|u1", false, dims(), move |[i, ..]| vec![if i == 3 { value } else { 0 }]);
    let points = vertices();
    let good = off(&points, &polygons());
    let crossed = "OFF\n5 2 0\n0 0 0\n2 0 0\n0 1 0\n2 1.5 0\n0 0 9\n4 0 1 2 3\n3 0 1 4\n";
    let flat = b"\x93NUMPY\x01\x00\x3c\x00{'descr': '|b1', 'fortran_order': False, 'shape': (8, 8), }\n";
    let draco = r#"{"asset":{"version":"2.0"},"extensionsRequired":["KHR_draco_mesh_compression"]}"#;
    let nothing = "ply\nformat ascii 1.0\nelement vertex 0\nproperty float x\nproperty float y\nproperty float z\nend_header\n";
    let cases: Vec<(&str, Vec<u8>, &[&str])> = vec![
        ("crossed.off", crossed.into(), &["OFF, line 8", "4 corners", "crosses itself", "triangulate"]),
        ("float-index.off", good.replace("\n4 1 0", "\n4 1.0 0").into(), &["OFF, line", "`1.0`", "not a whole number"]),
        ("float-index.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1.0 2.0 3.0\n".into(), &["OBJ, line 4", "`1.0`", "not a whole number"]),
        ("comma.obj", "v 0,5 0 0\n".into(), &["OBJ, line 1", "`0,5`", "written with a point"]),
        ("utf16.obj", b"\xff\xfev\x000\x00".to_vec(), &["OBJ", "UTF-16", "UTF-8"]),
        ("short.stl", stl_binary(b"binary", 9999), &["STL, byte 80", "9999 triangles", "incomplete"]),
        ("odd.stl", [stl_binary(b"binary", 7), vec![0; 3]].concat(), &["STL, byte 80", "says 7 triangles", "bytes more"]),
        ("cut.stl", stl_text(&points)[..500].into(), &["STL, line"]),
        (
            "float-index.ply",
            ply_text(&points).replace("list int int", "list int float").into(),
            &["PLY", "floating-point", "list uchar int"],
        ),
        ("no-vertex.ply", "ply\nformat ascii 1.0\nelement face 0\nend_header\n".into(), &["PLY", "no element `vertex`"]),
        ("cut.ply", ply_binary(&[vec![0, 1, 2]], "face", false)[..250].to_vec(), &["PLY", "do not fit", "incomplete"]),
        ("draco.gltf", draco.into(), &["glTF", "compressed", "without compression"]),
        ("missing.gltf", gltf(Some("nowhere.bin")).into(), &["glTF", "nowhere.bin"]),
        ("outside.gltf", gltf(Some("../a.bin")).into(), &["glTF", "does not lie in the folder"]),
        ("cut.glb", glb()[..400].to_vec(), &["glTF, byte 8", "incomplete"]),
        ("float.npy", float(1.0), &["npy", "float32", "expected bool or uint8", "array >= 0.5"]),
        ("shares.npy", float(0.3), &["npy", "float32", "probabilities", "array >= 0.5"]),
        ("int.npy", npy("<i8", false, dims(), |_| vec![0; 8]), &["npy", "int64", "astype(bool)"]),
        ("short-int.npy", npy("<i8", false, dims(), |_| vec![0; 4]), &["npy", "int64"]),
        ("picture.npy", grey(255), &["npy", "(3, 0, 0)", "holds 255", "all values are 0 and 255", "(array > 0)"]),
        ("grey.npy", grey(80), &["npy", "holds 80", "threshold"]),
        ("flat.npy", flat.to_vec(), &["npy", "(8, 8)", "three axes"]),
        ("none.npz", npz(&[("a.txt", b"")]), &["npz", "holds no array", "a.txt"]),
        ("float.npz", npz(&[("a.npy", &float(0.5))]), &["npz", "array `a`", "float32", "probabilities"]),
        ("several.npz", npz(&[("a.npy", &grey(1)), ("b.npy", &grey(1))]), &["npz", "a.npy, b.npy", "keep the one"]),
        ("cut.npz", npz(&[("a.npy", &grey(1))])[..300].to_vec(), &["npz", "no directory", "incomplete"]),
        ("a.binvox", b"#binvox 1\ndim 8 8\ndata\n".to_vec(), &["binvox, line 2", "three whole numbers"]),
        ("empty.ply", nothing.into(), &["no triangle"]),
    ];
    for (name, bytes, parts) in &cases {
        let path = file(folder.path(), name, bytes);
        let error = read_shape(&path, &ReadOptions::new(dims())).map(|_| panic!("{name} was read")).unwrap_err();
        let message = error.to_string();
        assert!(parts.iter().all(|part| message.contains(part)), "{name}: {message}");
        assert_eq!(message.matches(&path.display().to_string()).count(), 1, "the path stands once: {message}");
        assert!(!error.without_path().contains(&path.display().to_string()) && !message.contains(char::is_control), "{message}");
    }
}
