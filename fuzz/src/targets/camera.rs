//! What `beo camera` reads: images of depth and labels, and what is known of the camera.

use beo::frames::{
    MOST_PIXELS, Raster, parse_camera_info, parse_npy_image, parse_png_image, parse_scene_camera, parse_tiff_image, parse_trajectory,
};
use beo_shapes::FormatError;
use std::io::Cursor;
use tiff::encoder::{Compression, TiffEncoder, colortype};

/// A PNG as it is, and with checksums that fit, so that what comes after them is reached too.
pub fn png(data: &[u8]) {
    image(parse_png_image(data));
    image(parse_png_image(&signed(data)));
}

/// A TIFF.
pub fn tiff(data: &[u8]) {
    image(parse_tiff_image(data));
}

/// An npy image.
pub fn npy(data: &[u8]) {
    image(parse_npy_image(data));
}

/// A ROS `camera_info`.
pub fn camera_info(data: &[u8]) {
    if let Some(info) = one_line(parse_camera_info(data)) {
        let [u, v] = info.intrinsics.centre();
        assert!(info.intrinsics.ray([u + 1.0, v + 1.0]).iter().all(|value| value.is_finite()));
    }
}

/// A BOP `scene_camera.json`.
pub fn scene_camera(data: &[u8]) {
    for camera in one_line(parse_scene_camera(data)).unwrap_or_default().values() {
        assert!(camera.metres_per_unit > 0.0 && camera.intrinsics(640, 480).is_ok());
        assert!(camera.camera_to_world.is_none_or(|place| place.to_homogeneous().iter().all(|value| value.is_finite())));
    }
}

/// A trajectory.
pub fn trajectory(data: &[u8]) {
    for pose in one_line(parse_trajectory(data)).unwrap_or_default() {
        assert!(pose.camera_to_world.to_homogeneous().iter().all(|value| value.is_finite()));
    }
}

fn image(raster: Result<Raster, FormatError>) {
    if let Some(raster) = one_line(raster) {
        let pixels = |[width, height]: [u32; 2]| width as usize * height as usize;
        if let Some(depth) = one_line(raster.clone().into_depth(0.001)) {
            assert!(depth.values().len() == pixels(depth.size()) && depth.values().len() <= MOST_PIXELS);
        }
        if let Some(labels) = one_line(raster.into_labels()) {
            assert_eq!(labels.values().len(), pixels(labels.size()));
        }
    }
}

fn one_line<T>(result: Result<T, FormatError>) -> Option<T> {
    result.map_err(|error| assert!(!error.to_string().contains(char::is_control), "an error of one line that a terminal can show")).ok()
}

/// The chunks of a PNG with the checksums that they should have.
fn signed(data: &[u8]) -> Vec<u8> {
    let mut bytes = data.to_vec();
    let mut at = 8;
    while let Some(length) = bytes.get(at..at + 4) {
        let length = u32::from_be_bytes([length[0], length[1], length[2], length[3]]) as usize;
        let end = at.saturating_add(8).saturating_add(length);
        let Some(chunk) = bytes.get(at + 4..end) else { break };
        let checksum = crc32fast::hash(chunk).to_be_bytes();
        let Some(place) = bytes.get_mut(end..end + 4) else { break };
        place.copy_from_slice(&checksum);
        at = end + 4;
    }
    bytes
}

/// A small multiple of the file and of the largest image that it could hold.
pub fn most_bytes_of_image(len: usize) -> usize {
    (16 * MOST_PIXELS).min(len.saturating_mul(4 * 4096)) + 16 * len + (4 << 20)
}

/// A small multiple of the file.
pub fn most_bytes_of_text(len: usize) -> usize {
    256 * len + (1 << 20)
}

/// Seeds.
pub fn png_seeds() -> Vec<Vec<u8>> {
    use png::{BitDepth, ColorType};
    let file = |colour, depth, compression, bytes: usize| {
        let mut file = Vec::new();
        let mut encoder = png::Encoder::new(&mut file, 24, 16);
        encoder.set_color(colour);
        encoder.set_depth(depth);
        encoder.set_compression(compression);
        if colour == ColorType::Indexed {
            encoder.set_palette((0..48).collect::<Vec<u8>>());
        }
        let data: Vec<u8> = (0..bytes).map(|i| (i * i / 7) as u8).collect();
        encoder.write_header().expect("memory takes all").write_image_data(&data).expect("memory takes all");
        file
    };
    vec![
        file(ColorType::Grayscale, BitDepth::Sixteen, png::Compression::NoCompression, 768),
        file(ColorType::Grayscale, BitDepth::Sixteen, png::Compression::Balanced, 768),
        file(ColorType::Grayscale, BitDepth::Eight, png::Compression::Fast, 384),
        file(ColorType::Grayscale, BitDepth::One, png::Compression::Fast, 48),
        file(ColorType::Indexed, BitDepth::Four, png::Compression::Fast, 192),
        file(ColorType::Rgb, BitDepth::Eight, png::Compression::Fast, 1152),
    ]
}

/// Seeds.
pub fn tiff_seeds() -> Vec<Vec<u8>> {
    let metres: Vec<f32> = (0..384).map(|i| 0.5 + 0.001 * i as f32).collect();
    let units: Vec<u16> = (0..384).map(|i| 500 + i).collect();
    let mut seeds = Vec::new();
    for compression in [Compression::Uncompressed, Compression::Lzw, Compression::Deflate(tiff::encoder::DeflateLevel::Fast)] {
        let (mut floats, mut words) = (Cursor::new(Vec::new()), Cursor::new(Vec::new()));
        let encoder = TiffEncoder::new(&mut floats).map(|encoder| encoder.with_compression(compression));
        encoder.and_then(|mut encoder| encoder.write_image::<colortype::Gray32Float>(24, 16, &metres)).expect("memory takes all");
        let encoder = TiffEncoder::new_big(&mut words).map(|encoder| encoder.with_compression(compression));
        encoder.and_then(|mut encoder| encoder.write_image::<colortype::Gray16>(24, 16, &units)).expect("memory takes all");
        seeds.extend([floats.into_inner(), words.into_inner()]);
    }
    seeds
}

/// Seeds.
pub fn npy_seeds() -> Vec<Vec<u8>> {
    let file = |descr: &str, fortran: &str, width: usize| {
        let header = format!("{{'descr': '{descr}', 'fortran_order': {fortran}, 'shape': (6, 8), }}\n");
        let data: Vec<u8> = (0..48 * width).map(|i| if i % width < 2 { i as u8 } else { 0 }).collect();
        [b"\x93NUMPY\x01\x00", &(header.len() as u16).to_le_bytes()[..], header.as_bytes(), &data].concat()
    };
    vec![file("<f4", "False", 4), file("<f8", "True", 8), file("<u2", "False", 2), file("<i8", "False", 8), file("|u1", "True", 1)]
}

/// Seeds.
pub fn camera_info_seeds() -> Vec<Vec<u8>> {
    let texts = [
        "image_width: 640\nimage_height: 480\ncamera_name: depth\ncamera_matrix:\n  rows: 3\n  cols: 3\n  data: [525.0, 0.0, 319.5, 0.0, 525.0, \
         239.5, 0.0, 0.0, 1.0]\ndistortion_model: plumb_bob\ndistortion_coefficients:\n  rows: 1\n  cols: 5\n  data: [0.1, -0.2, 0.0, 0.0, 0.01]\n",
        "header: \n  seq: 0\n  frame_id: \"camera\"\nheight: 480\nwidth: 640\ndistortion_model: plumb_bob\nD: []\nK: [5e2, 0, 3e2, 0, 5e2, 2e2, 0, \
         0, 1]\nroi: {x_offset: 0, height: 0}\n---\n",
        "%YAML 1.2\n---\n? [a, {b: !!str c}]\n: &x >-\n  folded\nk:\n- 1\n- - 2\n  - *x\nwidth: !!int \"3\" # comment\n...\n",
    ];
    texts.iter().map(|text| text.as_bytes().to_vec()).collect()
}

/// Seeds.
pub fn scene_camera_seeds() -> Vec<Vec<u8>> {
    let place = r#", "cam_R_w2c": [0, -1, 0, 1, 0, 0, 0, 0, 1], "cam_t_w2c": [10.5, 0, 500]"#;
    let camera = |more: &str| format!("{{\"cam_K\": [572.4, 0.0, 325.3, 0.0, 573.6, 242.0, 0.0, 0.0, 1.0], \"depth_scale\": 0.1{more}}}");
    vec![format!("{{\"0\": {}, \"7\": {}}}", camera(place), camera(", \"view_level\": 3")).into_bytes()]
}

/// Seeds.
pub fn trajectory_seeds() -> Vec<Vec<u8>> {
    let text = "# timestamp tx ty tz qx qy qz qw\n1305031102.1604 1.34 0.62 1.65 0.6574 0.6126 -0.2949 -0.3248\n2e1 0 0 0 0 0 0 1\n\n";
    vec![text.as_bytes().to_vec()]
}
