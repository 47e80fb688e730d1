//! The importers: bytes to a mesh or a grid, meshes to voxels.

use beo_core::grid::{Dims, Observation, Occupancy};
use beo_shapes::{Content, Format, furniture, longest_side, parse, parse_npy_observation, voxelise, write_binvox, write_npy_observation};
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

fn check(format: Format, data: &[u8]) {
    match parse(format, data) {
        Ok(Content::Voxels(object)) => assert!(object.count() <= object.dims().voxels()),
        Ok(Content::Mesh(mesh)) => {
            let count = mesh.vertices().len() as u32;
            assert!(mesh.triangles().iter().flatten().all(|vertex| *vertex < count));
            voxelise(&mesh, dims(), longest_side(dims()));
        }
        Err(error) => assert!(!error.to_string().contains(char::is_control), "an error of one line that a terminal can show"),
    }
}

/// A small multiple of the file, and the largest grid of bits.
pub fn most_bytes_of_voxels(len: usize) -> usize {
    16 * len + (256 * 256 * 256 / 8) + (64 << 10)
}

/// A small multiple of the file; the PLY parser reserves up to half a megabyte.
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
