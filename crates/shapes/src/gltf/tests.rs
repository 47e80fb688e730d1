use super::*;
use proptest::prelude::*;
use serde_json::{Value, json};

/// A tetrahedron: positions, then indices.
const POSITIONS: [[f32; 3]; 4] = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 2.0, 0.0], [0.0, 0.0, 3.0]];
const INDICES: [u16; 12] = [0, 2, 1, 0, 1, 3, 0, 3, 2, 1, 2, 3];

fn binary() -> Vec<u8> {
    let mut bytes: Vec<u8> = POSITIONS.iter().flatten().flat_map(|c| c.to_le_bytes()).collect();
    bytes.extend(INDICES.iter().flat_map(|i| i.to_le_bytes()));
    bytes
}

fn document() -> Value {
    json!({
        "asset": { "version": "2.0", "generator": "made by hand" },
        "scene": 0,
        "scenes": [{ "nodes": [0] }],
        "nodes": [{ "mesh": 0, "name": "body" }],
        "meshes": [{ "primitives": [{ "attributes": { "POSITION": 0, "NORMAL": 0 }, "indices": 1, "material": 0 }] }],
        "materials": [{ "name": "none" }],
        "accessors": [
            { "bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3", "min": [0, 0, 0], "max": [1, 2, 3] },
            { "bufferView": 1, "componentType": 5123, "count": 12, "type": "SCALAR" },
        ],
        "bufferViews": [
            { "buffer": 0, "byteOffset": 0, "byteLength": 48, "target": 34962 },
            { "buffer": 0, "byteOffset": 48, "byteLength": 24 },
        ],
        "buffers": [{ "byteLength": 72 }],
    })
}

fn glb(document: &Value, binary: &[u8]) -> Vec<u8> {
    let mut json = document.to_string().into_bytes();
    json.resize(json.len().next_multiple_of(4), b' ');
    let mut bytes = b"glTF".to_vec();
    for word in [2, (12 + 8 + json.len() + 8 + binary.len()) as u32, json.len() as u32, JSON_CHUNK] {
        bytes.extend(word.to_le_bytes());
    }
    bytes.extend(&json);
    bytes.extend((binary.len() as u32).to_le_bytes());
    bytes.extend(BINARY_CHUNK.to_le_bytes());
    bytes.extend(binary);
    bytes
}

fn corners(mesh: &Mesh) -> Vec<[[f64; 3]; 3]> {
    mesh.triangles().iter().map(|t| mesh.corners(*t).map(|p| [p.x, p.y, p.z])).collect()
}

fn expected() -> Vec<[[f64; 3]; 3]> {
    INDICES.chunks(3).map(|t| [0, 1, 2].map(|n| POSITIONS[t[n] as usize].map(f64::from))).collect()
}

#[test]
fn text_binary_and_files_beside_give_the_same_mesh() {
    assert_eq!(corners(&parse_gltf(&glb(&document(), &binary())).unwrap()), expected());
    let mut inside = document();
    let base64 = "AAAAAAAAAAAAAAAAAACAPwAAAAAAAAAAAAAAAAAAAEAAAAAAAAAAAAAAAAAAAEBAAAACAAEAAAABAAMAAAADAAIAAQACAAMA";
    inside["buffers"][0]["uri"] = format!("data:application/octet-stream;base64,{base64}").into();
    for text in [inside.to_string(), serde_json::to_string_pretty(&inside).unwrap(), format!("\u{feff}{inside}")] {
        assert_eq!(corners(&parse_gltf(text.as_bytes()).unwrap()), expected());
    }
    let mut outside = document();
    outside["buffers"][0]["uri"] = "my%20mesh.bin".into();
    let beside = |name: &str| if name == "my mesh.bin" { Ok(binary()) } else { Err(format!("no {name}")) };
    let Content::Mesh(mesh) = read_gltf(outside.to_string().as_bytes(), &beside).unwrap() else { panic!() };
    assert_eq!(corners(&mesh), expected());
    assert!(parse_gltf(outside.to_string().as_bytes()).unwrap_err().to_string().contains("`my mesh.bin` lies in a file of its own"));
}

#[test]
fn nodes_place_their_meshes() {
    let mut placed = document();
    // Turned by 90° about z, after doubling; below a node that moves.
    let half = 0.5_f64.sqrt();
    placed["nodes"] =
        json!([{ "children": [1], "translation": [10, 0, 0] }, { "mesh": 0, "rotation": [0, 0, half, half], "scale": [2, 2, 2] }]);
    let mesh = parse_gltf(&glb(&placed, &binary())).unwrap();
    for (found, [x, y, z]) in corners(&mesh).iter().flatten().zip(expected().iter().flatten()) {
        let wanted = [10.0 - 2.0 * y, 2.0 * x, 2.0 * z];
        assert!(found.iter().zip(wanted).all(|(a, b)| (a - b).abs() < 1e-12), "{found:?} {wanted:?}");
    }
    placed["nodes"] = json!([{ "mesh": 0, "matrix": [0, 2, 0, 0, -2, 0, 0, 0, 0, 0, 2, 0, 10, 0, 0, 1] }]);
    let other = parse_gltf(&glb(&placed, &binary())).unwrap();
    assert!(corners(&other).iter().flatten().flatten().zip(corners(&mesh).iter().flatten().flatten()).all(|(a, b)| (a - b).abs() < 1e-12));
    // Nodes outside of the scene do not count.
    placed["nodes"] = json!([{ "mesh": 0 }, { "mesh": 0, "translation": [5, 5, 5] }]);
    assert_eq!(corners(&parse_gltf(&glb(&placed, &binary())).unwrap()), expected());
}

#[test]
fn strips_fans_strides_sparse_and_quantised_positions_are_read() {
    let with = |mode: u8, indices: &[u8]| {
        let mut changed = document();
        changed["meshes"][0]["primitives"][0]["mode"] = mode.into();
        changed["accessors"][1] = json!({ "bufferView": 1, "componentType": 5121, "count": indices.len(), "type": "SCALAR" });
        let mut bytes = binary();
        bytes[48..48 + indices.len()].copy_from_slice(indices);
        parse_gltf(&glb(&changed, &bytes)).map(|mesh| mesh.triangles().to_vec())
    };
    assert_eq!(with(5, &[0, 1, 2, 3]).unwrap(), [[0, 1, 2], [2, 1, 3]]);
    assert_eq!(with(6, &[0, 1, 2, 3]).unwrap(), [[0, 1, 2], [0, 2, 3]]);
    assert!(with(4, &[0, 1, 2, 3]).unwrap_err().to_string().contains("4 indices: expected three for each"));
    assert!(with(4, &[0, 1, 4]).unwrap_err().to_string().contains("index 2 of accessor 1 names vertex 4: expected 0 to 3"));
    let points = read_gltf(
        &glb(
            &{
                let mut changed = document();
                changed["meshes"][0]["primitives"][0]["mode"] = 0.into();
                changed
            },
            &binary(),
        ),
        &|_| Err(String::new()),
    )
    .unwrap();
    assert!(matches!(points, Content::Points(cloud) if cloud.points().len() == 4));

    // Shorts with a stride, divided by 32767; the third position is put in.
    let mut bytes: Vec<u8> = Vec::new();
    for [x, y, z] in [[0_i16, 0, 0], [32767, 0, 0], [1, 1, 1], [0, 0, 32767]] {
        bytes.extend([x, y, z, 99].iter().flat_map(|c| c.to_le_bytes()));
    }
    bytes.extend([2_u8, 0]);
    bytes.extend([0_i16, 32767, 0].iter().flat_map(|c| c.to_le_bytes()));
    let changed = json!({
        "asset": { "version": "2.0" },
        "extensionsRequired": ["KHR_mesh_quantization"],
        "meshes": [{ "primitives": [{ "attributes": { "POSITION": 0 } }] }],
        "accessors": [{ "bufferView": 0, "componentType": 5122, "normalized": true, "count": 3, "type": "VEC3",
            "sparse": { "count": 1, "indices": { "bufferView": 1, "componentType": 5121 }, "values": { "bufferView": 2 } } }],
        "bufferViews": [
            { "buffer": 0, "byteLength": 32, "byteStride": 8 }, { "buffer": 0, "byteOffset": 32, "byteLength": 1 },
            { "buffer": 0, "byteOffset": 34, "byteLength": 6 }],
        "buffers": [{ "byteLength": 40 }],
    });
    assert_eq!(corners(&parse_gltf(&glb(&changed, &bytes)).unwrap()), [[[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]]);
}

#[test]
fn malformed_files_are_refused_by_what_is_wrong() {
    let message = |change: &dyn Fn(&mut Value)| {
        let mut changed = document();
        change(&mut changed);
        let message = parse_gltf(&glb(&changed, &binary())).unwrap_err().to_string();
        assert!(message.starts_with("glTF") && !message.contains(char::is_control), "{message}");
        message
    };
    assert!(message(&|d| d["asset"]["version"] = "1.0".into()).contains("asset version 1.0: expected 2.0"));
    assert!(
        message(&|d| d["extensionsRequired"] = json!(["KHR_draco_mesh_compression"])).contains("compressed (KHR_draco_mesh_compression)")
    );
    assert!(message(&|d| d["scene"] = 3.into()).contains("scene 3 does not exist"));
    assert!(message(&|d| d["nodes"][0]["mesh"] = 3.into()).contains("mesh 3 does not exist"));
    assert!(message(&|d| d["nodes"][0]["children"] = json!([0])).contains("expected a tree"));
    assert!(
        message(&|d| d["accessors"][0]["count"] = 5.into()).contains("5 elements of 12 bytes do not fit into buffer view 0 of 48 bytes")
    );
    assert!(message(&|d| d["accessors"][0]["count"] = json!(u64::MAX)).contains("more than the file has bytes"));
    assert!(message(&|d| d["accessors"][0]["componentType"] = 7.into()).contains("component type 7"));
    assert!(message(&|d| d["accessors"][0]["type"] = "VEC2".into()).contains("not of type VEC3"));
    assert!(message(&|d| d["bufferViews"][0]["byteLength"] = 99.into()).contains("reaches beyond its buffer of 72 bytes"));
    assert!(message(&|d| d["buffers"][0]["byteLength"] = 99.into()).contains("buffer 0 has 72 bytes, expected 99"));
    assert!(message(&|d| d["buffers"][0]["uri"] = "../x.bin".into()).contains("does not lie in the folder"));
    assert!(parse_gltf(b"{\"asset\": {\"version\": \"2.0\"}}").unwrap_err().to_string().contains("no triangle"));
    let good = glb(&document(), &binary());
    let error = |bytes: &[u8]| parse_gltf(bytes).unwrap_err().to_string();
    assert!(error(&good[..good.len() - 4]).contains("it is incomplete"));
    assert!(error(b"{\n\"asset\": 3}").contains("glTF, line 2: not a glTF document"));
    assert!(error(b"glTF\x01\0\0\0").contains("GLB version 1: expected 2"));
    let mut nan = binary();
    nan[..4].copy_from_slice(&f32::NAN.to_le_bytes());
    assert!(error(&glb(&document(), &nan)).contains("position 0 of accessor 0 is not a number"));
}

#[test]
fn a_small_file_cannot_place_a_mesh_without_end() {
    let mut changed = document();
    let count = 20_000;
    changed["nodes"] = vec![json!({ "mesh": 0 }); count].into();
    changed["scenes"][0]["nodes"] = (0..count).collect::<Vec<_>>().into();
    assert!(parse_gltf(&glb(&changed, &binary())).is_ok());
    let primitive = changed["meshes"][0]["primitives"][0].clone();
    changed["meshes"][0]["primitives"] = vec![primitive; 100].into();
    assert!(parse_gltf(&glb(&changed, &binary())).unwrap_err().to_string().contains("placing the same meshes often"));
}

proptest! {
    #[test]
    fn damaged_files_do_not_panic(at in 0..1200_usize, byte in any::<u8>()) {
        let mut bytes = glb(&document(), &binary());
        let at = at % bytes.len();
        bytes[at] = byte;
        let _ = parse_gltf(&bytes);
        let _ = parse_gltf(&bytes[..at]);
        let mut text = document().to_string().into_bytes();
        let at = at % text.len();
        text[at] = byte;
        let _ = parse_gltf(&text);
    }
}
