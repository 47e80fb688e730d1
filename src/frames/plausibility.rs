//! Depths and sizes that no tabletop or household scene has: nearly always a unit that was taken for another.

use super::CapturedFrame;

/// Objects are seen from this far, metres: nearer no depth camera measures, farther none resolves them.
const DEPTHS_M: [f64; 2] = [0.1, 5.0];
/// Longest sides of objects, metres: from a dice to a bed.
const SIDES_M: [f64; 2] = [0.005, 3.0];
/// Depth and size that a mended unit should lead to.
const USUAL_DEPTH_M: f64 = 0.8;
const USUAL_SIDE_M: f64 = 0.15;
/// By what units are mistaken.
const FACTORS: [f64; 6] = [1e-6, 1e-3, 1e-1, 10.0, 1e3, 1e6];

/// A question about the unit of a frame's depth, if its objects are as far away or as near as none is.
pub fn question_depth(frame: &CapturedFrame) -> Option<String> {
    let depth = frame.typical_depth_m.filter(|depth| !(DEPTHS_M[0]..=DEPTHS_M[1]).contains(depth))?;
    Some(format!(
        "{}: what it shows is {} away, which is no tabletop or household scene: is the depth in other units? If so, give --depth-scale {} \
         (metres per unit; it was {})",
        frame.name(),
        metres(depth),
        number(frame.metres_per_unit * mending(depth, USUAL_DEPTH_M)),
        number(frame.metres_per_unit)
    ))
}

/// A question about the unit of a frame's depth, if an object of it is as large or as small as none is.
pub fn question_size(frame: &CapturedFrame, object: u16, longest_side_m: f64) -> Option<String> {
    (!(SIDES_M[0]..=SIDES_M[1]).contains(&longest_side_m)).then(|| {
        format!(
            "{}: object {object} is {} long, which no household object is: is the depth in other units? If so, give --depth-scale {} \
             (metres per unit; it was {})",
            frame.name(),
            metres(longest_side_m),
            number(frame.metres_per_unit * mending(longest_side_m, USUAL_SIDE_M)),
            number(frame.metres_per_unit)
        )
    })
}

/// A question about a known longest side, if it is as none is.
pub fn question_known_side(side_m: f64) -> Option<String> {
    (!(SIDES_M[0]..=SIDES_M[1]).contains(&side_m)).then(|| {
        format!(
            "--known-side {side_m} is {}, which no household object has: it is in metres; did you mean --known-side {}?",
            metres(side_m),
            number(side_m * mending(side_m, USUAL_SIDE_M))
        )
    })
}

/// The factor that leads nearest to what is usual.
fn mending(found: f64, usual: f64) -> f64 {
    let off = |factor: &f64| (found * factor / usual).ln().abs();
    FACTORS.into_iter().min_by(|a, b| off(a).total_cmp(&off(b))).unwrap_or(1.0)
}

fn metres(value: f64) -> String {
    if value < 0.01 { format!("{:.2} mm", value * 1e3) } else { format!("{value:.3} m") }
}

/// A number without the noise of its last digits.
fn number(value: f64) -> String {
    format!("{value:.9}").trim_end_matches('0').trim_end_matches('.').to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frames::Image;
    use beo_camera::Intrinsics;

    fn frame(depth_m: f64, metres_per_unit: f64) -> CapturedFrame {
        let camera = Intrinsics::new(1, 1, [1.0; 2], [0.0; 2], [0.0; 5]).unwrap();
        let image = |depth| Image::new(1, 1, vec![depth]).unwrap();
        let mut frame = CapturedFrame::new("a".into(), camera, image(depth_m as f32), Image::new(1, 1, vec![1]).unwrap()).unwrap();
        (frame.typical_depth_m, frame.metres_per_unit) = (Some(depth_m), metres_per_unit);
        frame
    }

    #[test]
    fn a_unit_that_is_wrong_by_ten_or_a_thousand_is_questioned_with_the_flag_that_mends_it() {
        for (depth, unit, mended) in [
            // Millimetres read as metres; tenths of them as millimetres; metres as millimetres; micrometres as metres.
            (750.0, 1.0, "--depth-scale 0.001 "),
            (7.5, 0.001, "--depth-scale 0.0001 "),
            (0.000_75, 0.001, "--depth-scale 1 "),
            (0.075, 0.0001, "--depth-scale 0.001 "),
            (750_000.0, 1.0, "--depth-scale 0.000001 "),
        ] {
            let question = question_depth(&frame(depth, unit)).unwrap();
            assert!(question.contains(mended), "{question}");
        }
        for depth in [0.15, 0.75, 4.9] {
            assert_eq!(question_depth(&frame(depth, 0.001)), None);
        }
    }

    #[test]
    fn a_size_that_no_object_has_is_questioned() {
        let question = question_size(&frame(0.8, 0.001), 7, 117.0).unwrap();
        assert!(question.contains("object 7 is 117.000 m long") && question.contains("--depth-scale 0.000001 "), "{question}");
        assert_eq!(question_size(&frame(0.8, 0.001), 7, 0.117), None);
        assert!(question_known_side(117.0).unwrap().contains("--known-side 0.117?"));
        assert!(question_known_side(0.000_117).unwrap().contains("--known-side 0.117?"));
        assert_eq!(question_known_side(0.117), None);
    }
}
