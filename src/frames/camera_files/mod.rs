//! Files that describe a camera, told apart by their content:
//!
//! | file | what |
//! | --- | --- |
//! | `ros` | ROS's `camera_info` in YAML |
//! | `kalibr` | Kalibr's `camchain.yaml` |
//! | `fields` | JSON of librealsense and of Open3D, and the like |
//! | `realsense` | what librealsense prints |
//! | `matrix` | `cam_K.txt` |
//! | `distortion` | the lens that a model's name and coefficients stand for |
//! | `description` | one camera of a file, and the choice of it |
//! | `document` | YAML and JSON as a tree |

mod description;
mod distortion;
mod document;
mod error;
mod fields;
mod kalibr;
mod matrix;
mod realsense;
mod ros;

use beo_camera::Intrinsics;
use beo_shapes::FormatError;
pub use description::CameraChoice;
use description::{Description, choose};
use document::{LONGEST, Node};
use error::wrong;

/// The content of a camera's file.
#[derive(Clone, Debug, PartialEq)]
pub struct CameraInfo {
    /// The camera.
    pub intrinsics: Intrinsics,
    /// Name of the camera's frame, where the file has one.
    pub frame_id: Option<String>,
}

/// Reads the camera of a file: a `camera_info` of ROS, Kalibr's `camchain.yaml`, intrinsics of librealsense or Open3D, or a matrix of nine
/// numbers.
///
/// # Errors
/// [`FormatError`]: what is none of these, lacks something, is not calibrated, or has a distortion model that is not supported.
pub fn parse_camera_info(bytes: &[u8], choice: &CameraChoice<'_>) -> Result<CameraInfo, FormatError> {
    if bytes.len() > LONGEST {
        return Err(wrong(format!("{} bytes: expected at most {LONGEST}", bytes.len())));
    }
    let text = std::str::from_utf8(bytes).map_err(|_| wrong("not text in UTF-8"))?.trim_start_matches('\u{feff}');
    let cameras = match matrix::numbers(text) {
        Some(numbers) => matrix::parse(&numbers)?,
        None if realsense::is_printed(text) => realsense::parse(text)?,
        None => of_document(&Node::parse(text)?)?,
    };
    let camera = choose(&cameras, choice)?;
    Ok(CameraInfo { intrinsics: camera.intrinsics(choice)?, frame_id: camera.frame_id.clone() })
}

/// The cameras of a YAML or JSON document: one, or one under each of its keys.
fn of_document(root: &Node) -> Result<Vec<Description>, FormatError> {
    if let Some(one) = camera(None, root) {
        return Ok(vec![one?]);
    }
    let below: Vec<Description> = root.entries().iter().filter_map(|(name, node)| camera(Some(name), node)).collect::<Result<_, _>>()?;
    if below.is_empty() { Ok(vec![ros::parse(root)?]) } else { Ok(below) }
}

/// The camera that a mapping is, if it is one.
fn camera(name: Option<&str>, node: &Node) -> Option<Result<Description, FormatError>> {
    if kalibr::is_camera(node) {
        return Some(kalibr::parse(name.unwrap_or("camera"), node));
    }
    if fields::is_camera(node) {
        return Some(fields::parse(name, node));
    }
    let is_ros = node.has(&["camera_matrix", "K"]) && node.has(&["image_width", "width"]);
    is_ros.then(|| Ok(Description { name: name.map(str::to_owned), ..ros::parse(node)? }))
}

#[cfg(test)]
mod tests {
    use super::*;
    use beo_camera::Lens;

    const CALIBRATION: &str = "image_width: 640
image_height: 480
camera_name: depth
camera_matrix:
  rows: 3
  cols: 3
  data: [525.0, 0.0, 319.5, 0.0, 524.5, 239.5, 0.0, 0.0, 1.0]
distortion_model: plumb_bob
distortion_coefficients:
  rows: 1
  cols: 5
  data: [0.1, -0.2, 0.001, -0.002, 0.05]
rectification_matrix: {rows: 3, cols: 3, data: [1, 0, 0, 0, 1, 0, 0, 0, 1]}
projection_matrix:
  rows: 3
  cols: 4
  data: [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0]
";

    fn read(text: &str, choice: &CameraChoice<'_>) -> CameraInfo {
        parse_camera_info(text.as_bytes(), choice).unwrap()
    }

    fn camera(text: &str) -> CameraInfo {
        read(text, &CameraChoice::default())
    }

    fn message_for(text: &str, choice: &CameraChoice<'_>) -> String {
        parse_camera_info(text.as_bytes(), choice).unwrap_err().to_string()
    }

    fn message(text: &str) -> String {
        message_for(text, &CameraChoice::default())
    }

    #[test]
    fn a_calibration_file_is_read() {
        let expected = Intrinsics::new(640, 480, [525.0, 524.5], [319.5, 239.5], [0.1, -0.2, 0.001, -0.002, 0.05]).unwrap();
        assert_eq!(camera(CALIBRATION), CameraInfo { intrinsics: expected, frame_id: None });
    }

    #[test]
    fn what_topic_echo_prints_is_read_in_both_generations_of_ros() {
        let ros1 = "header: \n  seq: 7\n  stamp: \n    secs: 1\n    nsecs:  5\n  frame_id: \"camera_depth_optical_frame\"\nheight: 480\nwidth: 640\n\
            distortion_model: \"plumb_bob\"\nD: [0.1, -0.2, 0.001, -0.002]\nK: [525.0, 0.0, 319.5, 0.0, 524.5, 239.5, 0.0, 0.0, 1.0]\n\
            R: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]\nroi: \n  x_offset: 0\n  height: 0\n  width: 0\n---\nheight: 9\n---\n";
        let found = camera(ros1);
        assert_eq!(found.frame_id.as_deref(), Some("camera_depth_optical_frame"));
        assert_eq!(found.intrinsics, Intrinsics::new(640, 480, [525.0, 524.5], [319.5, 239.5], [0.1, -0.2, 0.001, -0.002, 0.0]).unwrap());
        let ros2 = "header:\n  frame_id: ''\nheight: 480\nwidth: 640\ndistortion_model: plumb_bob\nd: []\nk:\n- 525.0\n- 0.0\n- 319.5\n- 0.0\n\
            - 524.5\n- 239.5\n- 0.0\n- 0.0\n- 1.0\np: [1, 2]\n";
        let found = camera(ros2);
        assert_eq!((found.intrinsics.focal(), found.intrinsics.is_distorted(), found.frame_id), ([525.0, 524.5], false, None));
    }

    #[test]
    fn other_lenses_are_read_and_unknown_ones_refused_by_name() {
        let rational = CALIBRATION.replace("plumb_bob", "rational_polynomial").replace("0.05]", "0.05, 0.6, -2.8, 1.6]");
        let mut expected = [0.1, -0.2, 0.001, -0.002, 0.05, 0.6, -2.8, 1.6, 0.0, 0.0, 0.0, 0.0];
        assert_eq!(camera(&rational).intrinsics.lens(), Lens::RationalPolynomial(expected));
        expected[11] = 0.001;
        let prism = rational.replace("1.6]", "1.6, 0, 0, 0, 0.001, 0, 0]");
        assert_eq!(camera(&prism).intrinsics.lens(), Lens::RationalPolynomial(expected));
        let equidistant = CALIBRATION.replace("plumb_bob", "equidistant").replace(", 0.05]", "]");
        assert_eq!(camera(&equidistant).intrinsics.lens(), Lens::Equidistant([0.1, -0.2, 0.001, -0.002]));
        assert_eq!(camera(&CALIBRATION.replace("0.05]", "0.05, 0, 0, 0]")), camera(CALIBRATION));
        assert!(message(&CALIBRATION.replace("0.05]", "0.05, 1]")).contains("6 coefficients"));
        assert!(message(&CALIBRATION.replace("plumb_bob", "thin")).contains("`thin` is not supported"));
        assert!(message(&CALIBRATION.replace("distortion_model: plumb_bob\n", "")).contains("without a distortion_model"));
    }

    #[test]
    fn rectified_images_have_the_projection_matrix_and_no_distortion() {
        let rectified = CameraChoice { is_rectified: true, ..CameraChoice::default() };
        let with_p = CALIBRATION.replace("[1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0]", "[500, 0, 310, -25, 0, 501, 230, 0, 0, 0, 1, 0]");
        assert_eq!(read(&with_p, &rectified).intrinsics, Intrinsics::new(640, 480, [500.0, 501.0], [310.0, 230.0], [0.0; 5]).unwrap());
        let without = CALIBRATION.split("projection_matrix").next().unwrap();
        assert!(message_for(without, &rectified).contains("no projection_matrix"));
        // Without distortion, K describes them.
        assert_eq!(read(&without.replace("[0.1, -0.2, 0.001, -0.002, 0.05]", "[]"), &rectified).intrinsics.focal(), [525.0, 524.5]);
    }

    #[test]
    fn a_camera_that_is_not_calibrated_is_named() {
        let zeros = CALIBRATION.replace("[525.0, 0.0, 319.5, 0.0, 524.5, 239.5, 0.0, 0.0, 1.0]", "[0, 0, 0, 0, 0, 0, 0, 0, 0]");
        let rectified = CameraChoice { is_rectified: true, ..CameraChoice::default() };
        assert!(message(&zeros).contains("not calibrated; P is given") && message(&zeros).contains("--rectified"), "{}", message(&zeros));
        assert_eq!(read(&zeros, &rectified).intrinsics.focal(), [1.0; 2]);
        let nothing = zeros.replace("[1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0]", "[0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0]");
        assert!(message(&nothing).contains("not calibrated: calibrate it"));
        assert!(message_for(&nothing, &rectified).contains("projection matrix P is all zeros"));
    }

    #[test]
    fn binning_and_region_of_interest_are_applied() {
        let echo = |more: &str| format!("height: 480\nwidth: 640\nD: []\nK: [580, 0, 319.5, 0, 580, 239.5, 0, 0, 1]\n{more}");
        let halved = camera(&echo("binning_x: 2\nbinning_y: 2\nroi: {x_offset: 0, y_offset: 0, height: 0, width: 0, do_rectify: false}\n"));
        assert_eq!(halved.intrinsics, Intrinsics::new(320, 240, [290.0; 2], [159.5, 119.5], [0.0; 5]).unwrap());
        let part = camera(&echo("binning_x: 0\nbinning_y: 0\nroi:\n  x_offset: 100\n  y_offset: 50\n  height: 200\n  width: 300\n"));
        assert_eq!(part.intrinsics, Intrinsics::new(300, 200, [580.0; 2], [219.5, 189.5], [0.0; 5]).unwrap());
        assert!(message(&echo("roi: {x_offset: 600, width: 300, height: 200}\n")).contains("does not lie in the image"));
    }

    #[test]
    fn kalibr_s_chain_is_read_by_name() {
        let chain = "cam0:\n  cam_overlaps: [1]\n  camera_model: pinhole\n  distortion_coeffs: [-0.2, 0.1, 0.001, 0.002]\n  distortion_model: radtan\n  \
            intrinsics: [461.6, 460.1, 362.6, 248.1]\n  resolution: [752, 480]\n  rostopic: /cam0/image_raw\n\
            cam1:\n  T_cn_cnm1:\n  - [1.0, 0.0, 0.0, -0.11]\n  - [0.0, 1.0, 0.0, 0.0]\n  camera_model: pinhole\n  \
            distortion_coeffs: [0.01, 0.002, 0.0, 0.0]\n  distortion_model: equidistant\n  intrinsics: [290, 291, 159.5, 119.5]\n  resolution: [320, 240]\n";
        let of = |image, name| CameraChoice { image, name, is_rectified: false };
        let first = read(chain, &of(None, Some("cam0"))).intrinsics;
        assert_eq!(first, Intrinsics::new(752, 480, [461.6, 460.1], [362.6, 248.1], [-0.2, 0.1, 0.001, 0.002, 0.0]).unwrap());
        assert_eq!(read(chain, &of(Some([320, 240]), None)).intrinsics.lens(), Lens::Equidistant([0.01, 0.002, 0.0, 0.0]));
        assert!(message(chain).contains("cam0, cam1") && message(chain).contains("--camera-name"));
        assert!(message_for(&chain.replace("pinhole", "omni"), &of(None, Some("cam0"))).contains("`omni` is not supported"));
    }

    #[test]
    fn open3d_s_matrix_is_read_in_columns_and_in_rows() {
        let expected = Intrinsics::new(320, 240, [290.0, 291.0], [159.5, 119.5], [0.0; 5]).unwrap();
        let columns = "{\n\t\"height\" : 240,\n\t\"intrinsic_matrix\" : \n\t[\n\t\t290.0,\n\t\t0,\n\t\t0,\n\t\t0,\n\t\t291.0,\n\t\t0,\n\t\t159.5,\n\t\t119.5,\n\t\t1\n\t],\n\t\"width\" : 320\n}\n";
        assert_eq!(camera(columns).intrinsics, expected);
        assert_eq!(
            camera("{\"width\": 320, \"height\": 240, \"intrinsic_matrix\": [[290, 0, 159.5], [0, 291, 119.5], [0, 0, 1]]}").intrinsics,
            expected
        );
        // PinholeCameraParameters hold one.
        assert_eq!(camera(&format!("{{\"class_name\": \"PinholeCameraParameters\", \"intrinsic\": {columns}}}")).intrinsics, expected);
    }

    #[test]
    fn librealsense_s_intrinsics_are_read_from_json_and_from_what_it_prints() {
        let expected =
            Intrinsics::with_lens(640, 480, [387.5, 388.0], [317.9, 241.4], Lens::ModifiedBrownConrady([0.1, -0.2, 0.001, 0.0, 0.0]))
                .unwrap();
        let json = "{\"width\": 640, \"height\": 480, \"ppx\": 317.9, \"ppy\": 241.4, \"fx\": 387.5, \"fy\": 388.0, \
            \"model\": \"distortion.inverse_brown_conrady\", \"coeffs\": [0.1, -0.2, 0.001, 0.0, 0.0]}";
        assert_eq!(camera(json).intrinsics, expected);
        assert_eq!(camera(&json.replace("\"distortion.inverse_brown_conrady\"", "2")).intrinsics, expected);
        assert_eq!(
            camera(&format!("{{\"depth\": {json}, \"color\": {{\"fx\": 1, \"fy\": 1, \"cx\": 1, \"cy\": 1}}}}")).intrinsics,
            expected
        );
        assert_eq!(camera("[ 640x480  p[317.9 241.4]  f[387.5 388]  Inverse Brown Conrady [0.1 -0.2 0.001 0 0] ]\n").intrinsics, expected);
        let block = |name: &str, size: [u32; 2], fx: f64| {
            format!(
                " Intrinsic of \"{name}\" / {}x{} / {{Z16}}\n  Width:      \t{}\n  Height:     \t{}\n  PPX:        \t317.9\n  PPY:        \t241.4\n  \
                 Fx:         \t{fx}\n  Fy:         \t388\n  Distortion: \tInverse Brown Conrady\n  Coeffs:     \t0.1  \t-0.2  \t0.001  \t0  \t0  \n  \
                 FOV (deg):  \t79.1 x 63.5\n\n",
                size[0], size[1], size[0], size[1]
            )
        };
        let printed = format!(
            "Device info:\n    Name: \tD435\n\nIntrinsic Parameters:\n\n{}{}{}{}",
            block("Depth", [1280, 720], 9.0),
            block("Depth", [640, 480], 387.5),
            block("Color", [640, 480], 8.0),
            block("Depth", [640, 480], 387.5)
        );
        let choice = CameraChoice { image: Some([640, 480]), ..CameraChoice::default() };
        assert_eq!(read(&printed, &choice).intrinsics, expected);
        assert_eq!(read(&printed, &CameraChoice { name: Some("color"), ..choice }).intrinsics.focal(), [8.0, 388.0]);
        assert!(message_for(&printed.replace("Coeffs", "Cofs"), &choice).contains("Depth have no Coeffs"));
    }

    #[test]
    fn a_matrix_alone_takes_its_size_from_the_image() {
        let choice = CameraChoice { image: Some([320, 240]), ..CameraChoice::default() };
        let expected = Intrinsics::new(320, 240, [290.0, 291.0], [159.5, 119.5], [0.0; 5]).unwrap();
        let matrix = "2.9e+02 0 1.595e+02\n0 291 1.195e+02\n0 0 1";
        assert_eq!(read(matrix, &choice).intrinsics, expected);
        assert_eq!(read("# fx 0 cx\n290, 0, 159.5, 0\r\n0, 291, 119.5, 0\r\n0, 0, 1, 0\r\n0, 0, 0, 1\r\n", &choice).intrinsics, expected);
        assert!(message(matrix).contains("no image size"));
        assert!(message_for("1 2 3 4", &choice).contains("4 numbers"));
        assert!(message_for("1 2 3 4 5 6 7 8 9", &choice).contains("is not [fx 0 cx"));
        assert!(message_for("0 0 0 0 0 0 0 0 0", &choice).contains("not calibrated"));
    }

    #[test]
    fn what_lacks_something_or_is_hostile_is_refused_with_the_reason() {
        assert!(message("").contains("no image_width"));
        assert!(message(&CALIBRATION.replace("image_width: 640", "image_width: wide")).contains("`wide`"));
        assert!(message(&CALIBRATION.replace("image_width: 640", "image_width: 0")).contains("0 × 480"));
        assert!(message(&CALIBRATION.replace("camera_matrix", "matrix")).contains("no camera_matrix"));
        assert!(message(&CALIBRATION.replace("[525.0, 0.0", "[525.0")).contains("8 numbers"));
        assert!(message(&CALIBRATION.replace("[525.0, 0.0", "[525.0, 0.5")).contains("not [fx 0 cx"));
        assert!(message(&CALIBRATION.replace("525.0", "nan")).contains("focal"));
        assert!(message(&CALIBRATION.replace("525.0", "{}")).contains("not a number"));
        assert!(message(&format!("{CALIBRATION}K: [1]\n")).contains("both camera_matrix and K"));
        assert!(message("a: &x [1]\nb: *x\n").contains("line 2: aliases"));
        assert!(message(&format!("a: {}{}\n", "[".repeat(40), "]".repeat(40))).contains("line 1: nested too deeply"));
        assert!(message(&"[".repeat(5000)).starts_with("camera_info, line 1"));
        assert!(message(&"a: ".repeat(50_000)).contains("at most"));
        assert!(message("a: \"x\u{1b}").lines().count() == 1);
        assert!(parse_camera_info(b"\xff\xfe", &CameraChoice::default()).unwrap_err().to_string().contains("UTF-8"));
        // Keys that are no text, and mappings in sequences, are nothing of ours.
        assert!(message("? [width]\n: 3\n").contains("no image_width"));
        assert!(message("[{width: 3}]\n").contains("no image_width"));
    }
}
