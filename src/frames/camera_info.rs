//! ROS's `camera_info` in YAML: as `camera_calibration` writes it (`camera_matrix: {data: [...]}`), and as `rostopic echo` and
//! `ros2 topic echo` print it (`K: [...]`, `k: ...`).
//!
//! The document is walked event by event and only the fields wanted are kept; aliases, which can make a small file huge, are refused.

use beo_camera::Intrinsics;
use beo_core::text::printable;
use beo_shapes::FormatError;
use saphyr_parser::{Event, Parser};

/// What is read of a `camera_info`.
#[derive(Clone, Debug, PartialEq)]
pub struct CameraInfo {
    /// The camera.
    pub intrinsics: Intrinsics,
    /// Name of the camera's frame, where the header has one.
    pub frame_id: Option<String>,
}

/// Longest file that is read; they have about two thousand bytes.
const LONGEST: usize = 1 << 16;
/// Deepest nesting.
const DEEPEST: usize = 16;

fn wrong(problem: impl Into<String>) -> FormatError {
    FormatError::File { format: "camera_info", problem: printable(&problem.into()) }
}

/// Reads the first document of a `camera_info` YAML: size, camera matrix and distortion; `plumb_bob` with 0, 4 or 5 coefficients.
///
/// # Errors
/// [`FormatError`]: what is no YAML, lacks one of these or has another distortion model, which is named.
pub fn parse_camera_info(bytes: &[u8]) -> Result<CameraInfo, FormatError> {
    let fields = Fields::read(bytes)?;
    let side = |field: Field, name: &str| {
        let text = fields.one(field)?.ok_or_else(|| wrong(format!("there is no {name}")))?;
        text.parse::<u32>().map_err(|_| wrong(format!("{name} is `{text:.40}`: expected a number of pixels")))
    };
    let (width, height) = (side(Field::Width, "image_width")?, side(Field::Height, "image_height")?);
    let matrix = fields.numbers(Field::Matrix)?.ok_or_else(|| wrong("there is no camera_matrix with data, and no K"))?;
    let &[fx, skew, cx, a, fy, cy, b, c, one] = &matrix[..] else {
        return Err(wrong(format!("the camera matrix has {} numbers: expected 9", matrix.len())));
    };
    if [skew, a, b, c, one] != [0.0, 0.0, 0.0, 0.0, 1.0] {
        return Err(wrong("the camera matrix is not [fx 0 cx, 0 fy cy, 0 0 1]"));
    }
    let mut distortion = fields.numbers(Field::Distortion)?.unwrap_or_default();
    let straight = distortion.iter().all(|coefficient| *coefficient == 0.0);
    match fields.one(Field::Model)?.unwrap_or("") {
        "plumb_bob" if [0, 4, 5].contains(&distortion.len()) => {}
        "plumb_bob" => return Err(wrong(format!("plumb_bob with {} coefficients: expected 0, 4 or 5", distortion.len()))),
        // Drivers of cameras without distortion name all sorts of models, or none.
        _ if straight => distortion.clear(),
        "" => return Err(wrong("distortion coefficients without a distortion_model")),
        other => return Err(wrong(format!("the distortion model `{other:.40}` is not supported: rectify the images, or use plumb_bob"))),
    }
    distortion.resize(5, 0.0);
    let coefficients: [f64; 5] = std::array::from_fn(|i| distortion[i]);
    let intrinsics = Intrinsics::new(width, height, [fx, fy], [cx, cy], coefficients).map_err(|error| wrong(error.to_string()))?;
    Ok(CameraInfo { intrinsics, frame_id: fields.one(Field::FrameId)?.filter(|id| !id.is_empty()).map(str::to_owned) })
}

/// What is kept of the document.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Field {
    Width,
    Height,
    Matrix,
    Distortion,
    Model,
    FrameId,
}

impl Field {
    /// The field that the keys of nested mappings lead to, in any of its spellings.
    fn at(keys: &[&str]) -> Option<Self> {
        Some(match keys {
            ["image_width" | "width"] => Self::Width,
            ["image_height" | "height"] => Self::Height,
            ["camera_matrix", "data"] | ["K" | "k"] => Self::Matrix,
            ["distortion_coefficients", "data"] | ["D" | "d"] => Self::Distortion,
            ["distortion_model"] => Self::Model,
            ["header", "frame_id"] => Self::FrameId,
            _ => return None,
        })
    }
}

/// The scalars of each field that was found.
#[derive(Default)]
struct Fields(Vec<(Field, Vec<String>)>);

/// A mapping or sequence that the walk is in.
struct Node {
    /// Of a mapping: the key whose value comes next.
    key: Option<String>,
    is_mapping: bool,
    /// It is itself a key, which is nothing that is wanted.
    is_key: bool,
}

impl Fields {
    fn read(bytes: &[u8]) -> Result<Self, FormatError> {
        if bytes.len() > LONGEST {
            return Err(wrong(format!("{} bytes: expected at most {LONGEST}", bytes.len())));
        }
        let text = std::str::from_utf8(bytes).map_err(|_| wrong("not text in UTF-8"))?;
        let mut found = Self::default();
        let mut nodes: Vec<Node> = Vec::new();
        for event in Parser::new_from_str(text) {
            let (event, span) = event.map_err(|error| at(error.marker().line(), error.info()))?;
            // A value has begun where its key is known; where it is not, this is the key.
            let is_key = nodes.last().is_some_and(|node| node.is_mapping && node.key.is_none());
            match event {
                Event::Scalar(value, ..) => match nodes.last_mut() {
                    Some(node) if is_key => node.key = Some(value.into_owned()),
                    _ => {
                        found.add(&nodes, value.into_owned()).map_err(|problem| at(span.start.line(), &problem))?;
                        value_ended(&mut nodes);
                    }
                },
                Event::MappingStart(..) | Event::SequenceStart(..) => {
                    if nodes.len() == DEEPEST {
                        return Err(at(span.start.line(), "nested too deeply"));
                    }
                    let is_mapping = matches!(event, Event::MappingStart(..));
                    if !is_mapping && !is_key {
                        found.begin(&nodes).map_err(|problem| at(span.start.line(), &problem))?;
                    }
                    nodes.push(Node { key: None, is_mapping, is_key });
                }
                Event::MappingEnd | Event::SequenceEnd => match nodes.pop() {
                    Some(node) if node.is_key => nodes.iter_mut().last().into_iter().for_each(|parent| parent.key = Some(String::new())),
                    _ => value_ended(&mut nodes),
                },
                Event::Alias(_) => return Err(at(span.start.line(), "aliases are not supported: write the value itself")),
                Event::DocumentEnd => break,
                _ => {}
            }
        }
        Ok(found)
    }

    /// The field that the walk is in.
    fn field(nodes: &[Node]) -> Option<Field> {
        // Numbers may lie in sequences of sequences, but no mapping in a sequence is one of ours.
        let mappings = nodes.iter().take_while(|node| node.is_mapping).count();
        if nodes[mappings..].iter().any(|node| node.is_mapping) {
            return None;
        }
        let keys: Vec<&str> = nodes[..mappings].iter().filter_map(|node| node.key.as_deref()).collect();
        Field::at(&keys)
    }

    /// A sequence begins; the outermost of a field is its value.
    fn begin(&mut self, nodes: &[Node]) -> Result<(), String> {
        match Self::field(nodes).filter(|_| nodes.last().is_some_and(|node| node.is_mapping)) {
            Some(field) => self.enter(field),
            None => Ok(()),
        }
    }

    fn add(&mut self, nodes: &[Node], value: String) -> Result<(), String> {
        let Some(field) = Self::field(nodes) else { return Ok(()) };
        if nodes.last().is_some_and(|node| node.is_mapping) {
            self.enter(field)?;
        }
        // The last one entered: fields do not nest.
        self.0.iter_mut().last().into_iter().for_each(|(_, values)| values.push(value.clone()));
        Ok(())
    }

    fn enter(&mut self, field: Field) -> Result<(), String> {
        if self.get(field).is_some() {
            return Err(format!("a second {field:?}: which one holds?"));
        }
        self.0.push((field, Vec::new()));
        Ok(())
    }

    fn get(&self, field: Field) -> Option<&[String]> {
        self.0.iter().find(|(name, _)| *name == field).map(|(_, values)| &values[..])
    }

    fn one(&self, field: Field) -> Result<Option<&str>, FormatError> {
        match self.get(field) {
            None => Ok(None),
            Some([value]) => Ok(Some(value)),
            Some(values) => Err(wrong(format!("{field:?} has {} values: expected one", values.len()))),
        }
    }

    fn numbers(&self, field: Field) -> Result<Option<Vec<f64>>, FormatError> {
        let number = |text: &String| text.parse().map_err(|_| wrong(format!("{field:?}: `{text:.40}` is not a number")));
        self.get(field).map(|values| values.iter().map(number).collect()).transpose()
    }
}

/// The value of the innermost mapping's key was read.
fn value_ended(nodes: &mut [Node]) {
    if let Some(node) = nodes.last_mut() {
        node.key = None;
    }
}

fn at(line: usize, problem: &str) -> FormatError {
    FormatError::Line { format: "camera_info", line, problem: printable(problem) }
}

#[cfg(test)]
mod tests {
    use super::*;

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

    fn camera(text: &str) -> CameraInfo {
        parse_camera_info(text.as_bytes()).unwrap()
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
    fn other_distortion_models_are_refused_by_name_unless_they_do_nothing() {
        let message = |text: &str| parse_camera_info(text.as_bytes()).unwrap_err().to_string();
        for model in ["rational_polynomial", "equidistant"] {
            let other = CALIBRATION.replace("plumb_bob", model);
            assert!(message(&other).contains(&format!("`{model}` is not supported")), "{}", message(&other));
            assert!(!camera(&other.replace("0.1, -0.2, 0.001, -0.002, 0.05", "0, 0.0, 0, 0, 0, 0, 0, 0")).intrinsics.is_distorted());
        }
        assert!(message(&CALIBRATION.replace("0.05]", "0.05, 1]")).contains("6 coefficients"));
        assert!(message(&CALIBRATION.replace("distortion_model: plumb_bob\n", "")).contains("without a distortion_model"));
    }

    #[test]
    fn what_lacks_something_or_is_hostile_is_refused_with_the_reason() {
        let message = |text: &str| parse_camera_info(text.as_bytes()).unwrap_err().to_string();
        assert!(message("").contains("no image_width"));
        assert!(message(&CALIBRATION.replace("image_width: 640", "image_width: wide")).contains("`wide`"));
        assert!(message(&CALIBRATION.replace("image_width: 640", "image_width: 0")).contains("0 × 480"));
        assert!(message(&CALIBRATION.replace("camera_matrix", "matrix")).contains("no camera_matrix"));
        assert!(message(&CALIBRATION.replace("[525.0, 0.0", "[525.0")).contains("8 numbers"));
        assert!(message(&CALIBRATION.replace("[525.0, 0.0", "[525.0, 0.5")).contains("not [fx 0 cx"));
        assert!(message(&CALIBRATION.replace("525.0", "nan")).contains("focal"));
        assert!(message(&CALIBRATION.replace("525.0", "{}")).contains("8 numbers"));
        assert!(message(&format!("{CALIBRATION}K: [1]\n")).contains("line 18: a second Matrix"));
        assert!(message("a: &x [1]\nb: *x\n").contains("line 2: aliases"));
        assert!(message(&format!("a: {}{}\n", "[".repeat(40), "]".repeat(40))).contains("line 1: nested too deeply"));
        assert!(message(&"[".repeat(5000)).starts_with("camera_info, line 1"));
        assert!(message(&"a: ".repeat(30_000)).contains("at most"));
        assert!(message("a: \"x\u{1b}").lines().count() == 1);
        assert!(parse_camera_info(b"\xff\xfe").unwrap_err().to_string().contains("UTF-8"));
        // Keys that are no text, and mappings in sequences, are nothing of ours.
        assert!(message("? [width]\n: 3\n").contains("no image_width"));
        assert!(message("[{width: 3}]\n").contains("no image_width"));
    }
}
