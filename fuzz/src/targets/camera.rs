//! Input of `beo camera`: images of depth and labels, and what is known of the camera.

use beo::frames::{
    CameraChoice, ColourLabels, DepthUnit, MOST_PIXELS, Raster, VoidLabels, parse_camera_info, parse_jpeg_image, parse_npy_image,
    parse_png_image, parse_scene_camera, parse_tiff_image, parse_trajectory,
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

/// A JPEG.
pub fn jpeg(data: &[u8]) {
    image(parse_jpeg_image(data));
}

/// A camera's file, of whatever program, read for images of several sizes, raw and rectified.
pub fn camera_info(data: &[u8]) {
    let choices = [
        CameraChoice::default(),
        CameraChoice { image: Some([640, 480]), is_rectified: true, name: None },
        CameraChoice { image: Some([320, 240]), is_rectified: false, name: Some("cam1") },
    ];
    for choice in choices {
        if let Some(info) = one_line(parse_camera_info(data, &choice)) {
            let camera = info.intrinsics;
            for at in [camera.centre().map(|c| c + 1.0), [0.0, 0.0], [f64::from(camera.width()), -7.0]] {
                assert!(camera.ray(at).iter().all(|value| value.is_finite()));
                assert!(camera.unproject(at).is_none_or(|ray| camera.project(&(ray * 2.0).into()).is_some()));
            }
        }
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
        let size = raster.size();
        if let Some(depth) = one_line(raster.clone().into_depth(&DepthUnit::default(), &[9999.0])) {
            assert!(depth.values().len() == pixels(size) && depth.values().len() <= MOST_PIXELS);
            assert!(depth.values().iter().all(|metres| *metres >= 0.0));
        }
        let mask = raster.clone().into_mask();
        assert_eq!((mask.size(), mask.values().len()), (size, pixels(size)));
        if let Some(labels) = one_line(raster.into_labels(&VoidLabels::Customary, &mut ColourLabels::default())) {
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
    (32 * MOST_PIXELS).min(len.saturating_mul(4 * 4096)) + 16 * len + (4 << 20)
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
        file(ColorType::Rgba, BitDepth::Sixteen, png::Compression::Fast, 3072),
        file(ColorType::GrayscaleAlpha, BitDepth::Eight, png::Compression::Fast, 768),
    ]
}

/// Seeds: 24 × 16 pixels, grey and baseline, and in colours and progressive.
pub fn jpeg_seeds() -> Vec<Vec<u8>> {
    const GREY: &str = "ffd8ffe000104a46494600010100000100010000ffdb0043000d090a0b0a080d0b0a0b0e0e0d0f13201513121213271c1e17202e2931302e292d2c33\
        3a4a3e333646372c2d405741464c4e525352323e5a615a50604a51524fffc0000b080010001801011100ffc400160001010100000000000000000000\
        000000060705ffc400281000000307010901000000000000000000010311000204051213140615161731415265a1a4e2ffda0008010100003f001da4\
        34e6f3cd4d81cbc5b6409d5dbad51e7411143bbd331e11f9ef93f6d3a9a41ecf9ac640dcb98c7be4d689552f082a74e4da9a4351eec4d4d8ec4cab84\
        09345ca115e7455507b7db31e2e781faff000d3a9a466d09ac6475bb7927be750ab4d4f08a2f5e6dffd9";
    const COLOURS: &str = "ffd8ffe000104a46494600010100000100010000ffdb0043000d090a0b0a080d0b0a0b0e0e0d0f13201513121213271c1e17202e2931302e292d2c33\
        3a4a3e333646372c2d405741464c4e525352323e5a615a50604a51524fffdb0043010e0e0e131113261515264f352d354f4f4f4f4f4f4f4f4f4f4f4f\
        4f4f4f4f4f4f4f4f4f4f4f4f4f4f4f4f4f4f4f4f4f4f4f4f4f4f4f4f4f4f4f4f4f4f4f4f4f4fffc20011080010001803012200021101031101ffc400\
        17000101010100000000000000000000000000040506ffc4001501010100000000000000000000000000000304ffda000c03010002100310000001e7\
        ed8ad09734353fffc4001a100002020300000000000000000000000002030001121314ffda00080101000105024af6971c2ac492cd45d90af22fffc4\
        001a110001050100000000000000000000000000010312133122ffda0008010301013f0176e9718261ffc40019110001050000000000000000000000\
        0000000102111322ffda0008010201013f017d93910fffc4001a1000030003010000000000000000000000000111213351a1ffda0008010100063f02\
        9660d9e0d71965c1afd1beb3ffc4001a10010001050000000000000000000000001100012131f0f1ffda0008010100013f2157192336ee5f7528c573\
        80936e65b712a4ffda000c03010002000300000010fc2fffc400181100020300000000000000000000000000001131c1f1ffda0008010301013f10c4\
        58c8e4ffc4001811000203000000000000000000000000000011017181ffda0008010201013f10aec19433ffc4001c10000200070000000000000000\
        00000000011100103141516171ffda0008010100013f10bfe9d801546641ab49268a717fd3b00ba1c48376926996a3ffd9";
    let byte = |pair: &[u8]| u8::from_str_radix(std::str::from_utf8(pair).expect("digits"), 16).expect("digits");
    [GREY, COLOURS].map(|hex| hex.as_bytes().chunks_exact(2).map(byte).collect()).to_vec()
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
        "header:\n  frame_id: cam\nheight: 480\nwidth: 640\ndistortion_model: rational_polynomial\nD: [0.78, -2.98, 0.0007, 0.00006, 1.7, 0.66, -2.81, \
         1.63]\nK: [290.0, 0.0, 159.5, 0.0, 290.0, 119.5, 0.0, 0.0, 1.0]\nP: [290, 0, 159, 0, 0, 290, 119, 0, 0, 0, 1, 0]\nbinning_x: 2\n\
         binning_y: 2\nroi: {x_offset: 10, y_offset: 20, height: 200, width: 300}\n",
        "cam0:\n  camera_model: pinhole\n  intrinsics: [290.0, 290.0, 159.5, 119.5]\n  distortion_model: radtan\n  distortion_coeffs: [0.1, 0.0, 0.0, \
         0.0]\n  resolution: [320, 240]\ncam1:\n  camera_model: pinhole\n  intrinsics: [290, 290, 159.5, 119.5]\n  distortion_model: equidistant\n  \
         distortion_coeffs: [0.01, 0.002, 0, 0]\n  resolution: [320, 240]\n",
        "{\n\t\"width\": 320, \"height\": 240, \"intrinsic_matrix\": [290,0,0,0,290,0,159.5,119.5,1]\n}",
        "{\"width\": 640, \"height\": 480, \"ppx\": 317.9, \"ppy\": 241.4, \"fx\": 387.5, \"fy\": 388.0, \"model\": \"distortion.inverse_brown_conrady\", \
         \"coeffs\": [0.1, -0.2, 0.001, 0.0, 0.0]}",
        " Intrinsic of \"Depth\" / 640x480 / {Z16}\n  Width: \t640\n  Height: \t480\n  PPX: \t317.9\n  PPY: \t241.4\n  Fx: \t387\n  Fy: \t388\n  \
         Distortion: \tBrown Conrady\n  Coeffs: \t0 \t0 \t0 \t0 \t0\n  FOV (deg): \t79 x 63\n\n",
        "[ 640x480  p[317.9 241.4]  f[387.5 388]  Inverse Brown Conrady [0.1 -0.2 0.001 0 0] ]\n",
        "2.9e+02 0 1.595e+02\n0 2.9e+02 1.195e+02\n0 0 1\n",
        "%YAML 1.2\n---\n? [a, {b: !!str c}]\n: &x >-\n  folded\nk:\n- 1\n- - 2\n  - *x\nwidth: !!int \"3\" # comment\n...\n",
    ];
    texts.iter().map(|text| text.as_bytes().to_vec()).collect()
}

/// Seeds.
pub fn scene_camera_seeds() -> Vec<Vec<u8>> {
    let place = r#", "cam_R_w2c": [0, -1, 0, 1, 0, 0, 0, 0, 1], "cam_t_w2c": [10.5, 0, 500]"#;
    let camera = |more: &str| format!("{{\"cam_K\": [572.4, 0.0, 325.3, 0.0, 573.6, 242.0, 0.0, 0.0, 1.0], \"depth_scale\": 0.1{more}}}");
    vec![format!("{{\"0\": {}, \"000007\": {}}}", camera(place), camera(", \"view_level\": 3")).into_bytes()]
}

/// Seeds.
pub fn trajectory_seeds() -> Vec<Vec<u8>> {
    let text = "# timestamp tx ty tz qx qy qz qw\n1305031102.1604 1.34 0.62 1.65 0.6574 0.6126 -0.2949 -0.3248\n2e1 0 0 0 0 0 0 1\n\n";
    vec![text.as_bytes().to_vec()]
}
