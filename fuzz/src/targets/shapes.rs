//! The importers: bytes to a mesh or a grid, meshes to voxels.

use beo_core::grid::{Dims, Observation, Occupancy};
use beo_shapes::{AlignedClass, AlignedFile, Alignment};
use beo_shapes::{Content, Format, furniture, longest_side, parse, parse_npy_observation, parse_npz_observation, voxelise};
use beo_shapes::{write_binvox, write_npy_observation};
use std::fmt::Write;

/// Voxels along each side of the seeds, and of the grid that meshes are brought to.
const SIDE: usize = 12;

fn dims() -> Dims {
    Dims::cube(SIDE).expect("a size of a grid")
}

/// A binvox file.
pub fn binvox(data: &[u8]) {
    check(Format::Binvox, data);
}

/// An npy file, as a shape and as an observation.
pub fn npy(data: &[u8]) {
    check(Format::Npy, data);
    let _ = parse_npy_observation(data);
}

/// An npz file, as a shape and as an observation.
pub fn npz(data: &[u8]) {
    check(Format::Npz, data);
    let _ = parse_npz_observation(data);
}

/// A glTF or GLB file.
pub fn gltf(data: &[u8]) {
    check(Format::Gltf, data);
}

/// An OFF file.
pub fn off(data: &[u8]) {
    check(Format::Off, data);
}

/// An OBJ file.
pub fn obj(data: &[u8]) {
    check(Format::Obj, data);
}

/// An STL file.
pub fn stl(data: &[u8]) {
    check(Format::Stl, data);
}

/// A PLY file.
pub fn ply(data: &[u8]) {
    check(Format::Ply, data);
}

/// An alignment file, as `beo align` leaves it beside the shapes.
pub fn alignment(data: &[u8]) {
    match Alignment::parse(data) {
        Ok(alignment) => {
            let text = serde_json::to_string(&alignment).expect("what was read can be written");
            assert_eq!(Alignment::parse(text.as_bytes()), Ok(alignment));
        }
        Err(line) => assert!(!line.contains(char::is_control), "an error of one line that a terminal can show"),
    }
}

fn check(format: Format, data: &[u8]) {
    match parse(format, data) {
        Ok(Content::Voxels(object)) => assert!(object.count() <= object.dims().voxels()),
        Ok(Content::Mesh(mesh)) => {
            let count = mesh.vertices().len() as u32;
            assert!(mesh.triangles().iter().flatten().all(|vertex| *vertex < count));
            voxelise(&mesh, dims(), longest_side(dims()));
        }
        Ok(Content::Points(cloud)) => assert!(!cloud.points().is_empty()),
        Err(error) => assert!(!error.to_string().contains(char::is_control), "an error of one line that a terminal can show"),
    }
}

/// A small multiple of the file, and the largest grid of bits.
pub fn most_bytes_of_voxels(len: usize) -> usize {
    16 * len + (256 * 256 * 256 / 8) + (64 << 10)
}

/// As of voxels; what was packed is unpacked, at most the largest grid of bytes, and brought into order.
pub fn most_bytes_of_archive(len: usize) -> usize {
    16 * len + 3 * (256 * 256 * 256) + (1 << 20)
}

/// A small multiple of the file, and what a small file may place again and again: 2¹⁵ vertices and twice as many triangles.
pub fn most_bytes_of_scene(len: usize) -> usize {
    256 * len + (8 << 20)
}

/// A small multiple of the file.
pub fn most_bytes_of_mesh(len: usize) -> usize {
    64 * len + (1 << 20)
}

/// Made-up furniture.
fn objects() -> Vec<Occupancy> {
    ["chair", "table", "toilet"].iter().filter_map(|class| furniture::make(class, dims(), 1)).collect()
}

/// Seeds.
pub fn binvox_seeds() -> Vec<Vec<u8>> {
    let file = |object: &Occupancy| {
        let mut bytes = Vec::new();
        write_binvox(&mut bytes, object).expect("memory takes all");
        bytes
    };
    objects().iter().map(file).collect()
}

/// Seeds.
pub fn npy_seeds() -> Vec<Vec<u8>> {
    let file = |object: &Occupancy| {
        let mut bytes = Vec::new();
        write_npy_observation(&mut bytes, &Observation::complete(object)).expect("memory takes all");
        bytes
    };
    let mut seeds: Vec<Vec<u8>> = objects().iter().map(file).collect();
    for (from, to) in [(&b"|u1"[..], &b"|b1"[..]), (b"False", b"True ")] {
        let mut changed = seeds[0].clone();
        if let Some(at) = changed.windows(from.len()).position(|window| window == from) {
            changed[at..at + to.len()].copy_from_slice(to);
        }
        seeds.push(changed);
    }
    seeds
}

/// Corners and square faces of the boxes of a made-up piece: every filled voxel of one layer.
fn boxes() -> (Vec<[usize; 3]>, Vec<[usize; 4]>) {
    let (mut corners, mut faces) = (Vec::new(), Vec::new());
    let object = &objects()[0];
    let filled = (0..dims().voxels()).map(|voxel| dims().coordinates(voxel)).filter(|&[i, j, k]| object.is_filled(i, j, k));
    for [i, j, k] in filled.step_by(17) {
        let first = corners.len();
        corners.extend((0..8).map(|c| [i + (c & 1), j + (c >> 1 & 1), k + (c >> 2)]));
        let sides = [[0, 1, 3, 2], [4, 5, 7, 6], [0, 1, 5, 4], [2, 3, 7, 6], [0, 2, 6, 4], [1, 3, 7, 5]];
        faces.extend(sides.map(|side| side.map(|corner| first + corner)));
    }
    (corners, faces)
}

/// Seeds.
pub fn off_seeds() -> Vec<Vec<u8>> {
    let (corners, faces) = boxes();
    let mut body = format!("{} {} 0\n", corners.len(), faces.len());
    corners.iter().for_each(|[x, y, z]| writeln!(body, "{x} {y}.5 {z}e0").expect("memory takes all"));
    faces.iter().for_each(|[a, b, c, d]| writeln!(body, "4 {a} {b} {c} {d} 0.5 0.5 0.5").expect("memory takes all"));
    ["OFF\n", "OFF", "# comment\nCOFF\n"].iter().map(|head| format!("{head}{body}").into_bytes()).collect()
}

/// Seeds.
pub fn obj_seeds() -> Vec<Vec<u8>> {
    let (corners, faces) = boxes();
    let mut text = String::from("mtllib none.mtl\no body\n");
    corners.iter().for_each(|[x, y, z]| writeln!(text, "v {x} {y}.5 -{z}e-1 0.1 0.2 0.3").expect("memory takes all"));
    text += "vn 0 0 1\nvt 0.5 0.5\ng part\nusemtl none\n";
    for (f, face) in faces.iter().enumerate() {
        let [a, b, c, d] = face.map(|corner| corner + 1);
        let line = match f % 3 {
            0 => format!("f {a} {b} {c} {d}\n"),
            1 => format!("f {a}/1/1 {b}/1/1 \\\n {c}/1/1\n"),
            _ => format!("f -{} -{} -{}\nl {a} {b}\n", corners.len() - face[0], corners.len() - face[1], corners.len() - face[2]),
        };
        text += &line;
    }
    vec![text.into_bytes()]
}

/// Seeds: the first array of [`npy_seeds`], stored and deflated without compression, beside another member.
pub fn npz_seeds() -> Vec<Vec<u8>> {
    let array = &npy_seeds()[0];
    // One block of RFC 1951 that is stored.
    let length = array.len() as u16;
    let mut block = vec![1];
    block.extend(length.to_le_bytes());
    block.extend((!length).to_le_bytes());
    block.extend(array);
    let archive = |method: u16, packed: &[u8]| {
        let (mut bytes, mut directory) = (Vec::new(), Vec::new());
        for (name, method, packed, content) in [("a.txt", 0, &b"a"[..], &b"a"[..]), ("voxels.npy", method, packed, array)] {
            let at = bytes.len() as u32;
            let mut common = vec![20, 0, 0, 0];
            common.extend(method.to_le_bytes());
            common.extend([0; 4]);
            common.extend(crc32fast::hash(content).to_le_bytes());
            common.extend((packed.len() as u32).to_le_bytes());
            common.extend((content.len() as u32).to_le_bytes());
            common.extend((name.len() as u16).to_le_bytes());
            common.extend([0, 0]);
            bytes.extend([b"PK\x03\x04", &common[..], name.as_bytes(), packed].concat());
            directory.extend([b"PK\x01\x02\x14\x00", &common[..], &[0; 10], &at.to_le_bytes(), name.as_bytes()].concat());
        }
        let (start, size) = ((bytes.len() as u32).to_le_bytes(), (directory.len() as u32).to_le_bytes());
        [&bytes[..], &directory[..], b"PK\x05\x06\0\0\0\0\x02\0\x02\0", &size[..], &start[..], &[0, 0]].concat()
    };
    vec![archive(0, array), archive(8, &block)]
}

/// Seeds: a text with everything beside it left out, and the binary form.
pub fn gltf_seeds() -> Vec<Vec<u8>> {
    let (corners, faces) = boxes();
    let mut binary: Vec<u8> = corners.iter().flatten().flat_map(|c| (*c as f32).to_le_bytes()).collect();
    let start = binary.len();
    let triangles = faces.iter().flat_map(|[a, b, c, d]| [*a, *b, *c, *a, *c, *d]);
    binary.extend(triangles.flat_map(|corner| (corner as u32).to_le_bytes()));
    let mut json = serde_json::json!({
        "asset": { "version": "2.0" },
        "scene": 0,
        "scenes": [{ "nodes": [0] }],
        "nodes": [{ "children": [1], "rotation": [0, 0, 0, 1], "scale": [1, 2, 1] }, { "mesh": 0, "translation": [1, 2, 3] }],
        "meshes": [{ "primitives": [{ "attributes": { "POSITION": 0 }, "indices": 1, "mode": 4 }] }],
        "accessors": [
            { "bufferView": 0, "componentType": 5126, "count": corners.len(), "type": "VEC3" },
            { "bufferView": 1, "componentType": 5125, "count": 6 * faces.len(), "type": "SCALAR" },
        ],
        "bufferViews": [{ "buffer": 0, "byteLength": start }, { "buffer": 0, "byteOffset": start, "byteLength": binary.len() - start }],
        "buffers": [{ "byteLength": binary.len() }],
    })
    .to_string()
    .into_bytes();
    json.resize(json.len().next_multiple_of(4), b' ');
    let mut glb = b"glTF".to_vec();
    for word in [2, (28 + json.len() + binary.len()) as u32, json.len() as u32, 0x4e4f_534a] {
        glb.extend(word.to_le_bytes());
    }
    glb.extend(json);
    glb.extend((binary.len() as u32).to_le_bytes());
    glb.extend(*b"BIN\0");
    glb.extend(binary);
    let text = br#"{"asset":{"version":"2.0"},"meshes":[{"primitives":[{"attributes":{"POSITION":0},"mode":5}]}],
        "accessors":[{"bufferView":0,"componentType":5121,"count":4,"type":"VEC3","normalized":true}],
        "bufferViews":[{"buffer":0,"byteLength":12,"byteStride":3}],"buffers":[{"byteLength":12,"uri":"data:;base64,AAAA/wAAAP8AAAD/"}]}"#;
    vec![glb, text.to_vec()]
}

/// Seeds.
pub fn stl_seeds() -> Vec<Vec<u8>> {
    let (corners, faces) = boxes();
    let triangles: Vec<[[usize; 3]; 3]> =
        faces.iter().flat_map(|[a, b, c, d]| [[*a, *b, *c], [*a, *c, *d]]).map(|t| t.map(|corner| corners[corner])).collect();
    let mut binary = b"made up".to_vec();
    binary.resize(80, b' ');
    binary.extend((triangles.len() as u32).to_le_bytes());
    let mut text = String::from("solid made up\n");
    for triangle in &triangles {
        binary.extend([0; 12]);
        text += "facet normal 0 0 0\nouter loop\n";
        for [x, y, z] in triangle {
            binary.extend([*x, *y, *z].iter().flat_map(|c| (*c as f32).to_le_bytes()));
            writeln!(text, "vertex {x} {y} {z}").expect("memory takes all");
        }
        binary.extend([0, 0]);
        text += "endloop\nendfacet\n";
    }
    text += "endsolid made up\n";
    vec![binary, text.into_bytes()]
}

/// Seeds.
pub fn ply_seeds() -> Vec<Vec<u8>> {
    let (corners, faces) = boxes();
    let header = |encoding: &str| {
        format!(
            "ply\nformat {encoding} 1.0\ncomment made up\nelement vertex {}\nproperty float x\nproperty double y\nproperty short z\n\
             property uchar red\nelement edge 1\nproperty int a\nelement face {}\nproperty list uchar int vertex_indices\nend_header\n",
            corners.len(),
            faces.len()
        )
    };
    let mut text = header("ascii");
    corners.iter().for_each(|[x, y, z]| writeln!(text, "{x} {y} {z} 9").expect("memory takes all"));
    text += "77\n";
    faces.iter().for_each(|[a, b, c, d]| writeln!(text, "4 {a} {b} {c} {d}").expect("memory takes all"));
    let binary = |encoding: &str, order: fn(Vec<u8>) -> Vec<u8>| {
        let mut bytes = header(encoding).into_bytes();
        for [x, y, z] in &corners {
            bytes.extend(order((*x as f32).to_le_bytes().to_vec()));
            bytes.extend(order((*y as f64).to_le_bytes().to_vec()));
            bytes.extend(order((*z as i16).to_le_bytes().to_vec()));
            bytes.push(9);
        }
        bytes.extend(order(77_i32.to_le_bytes().to_vec()));
        for face in &faces {
            bytes.push(4);
            face.iter().for_each(|corner| bytes.extend(order((*corner as i32).to_le_bytes().to_vec())));
        }
        bytes
    };
    let reversed = |mut bytes: Vec<u8>| {
        bytes.reverse();
        bytes
    };
    vec![text.into_bytes(), binary("binary_little_endian", |bytes| bytes), binary("binary_big_endian", reversed)]
}

/// Seeds.
pub fn alignment_seeds() -> Vec<Vec<u8>> {
    let file = |number: usize| AlignedFile {
        input: format!("pliers/{number}.obj"),
        output: format!("pliers/{number}.off"),
        rotation_xyzw: [0.0, 0.0, 0.6, 0.8],
        scale: 0.1,
        translation: [0.1, -0.2, 1.0 / 3.0],
    };
    let class = AlignedClass { entropy_before: 3.0, entropy_normalised: 2.0, entropy_after: 1.0, files: (0..3).map(file).collect() };
    let alignment = Alignment::new(40, [("pliers".to_owned(), class)].into());
    vec![serde_json::to_vec(&alignment).expect("plain text"), serde_json::to_vec_pretty(&alignment).expect("plain text")]
}
