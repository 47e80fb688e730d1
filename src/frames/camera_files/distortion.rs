//! The lens that a distortion model and its coefficients stand for, under the names that ROS, Kalibr, OpenCV and librealsense give it.

use beo_camera::Lens;

/// The lens of a model by its name.
///
/// # Errors
/// A model that is not known, is not named, or has more coefficients than it takes; zeros at the end do not count.
pub(super) fn lens(model: Option<&str>, coefficients: &[f64]) -> Result<Lens, String> {
    let used = coefficients.iter().rposition(|c| *c != 0.0).map_or(0, |last| last + 1);
    let used = &coefficients[..used];
    let short = model.unwrap_or_default().to_ascii_lowercase().replace([' ', '_', '-'], "");
    let short = short.rsplit('.').next().unwrap_or_default().trim_start_matches("rs2distortion");
    match short {
        "equidistant" | "equi" | "fisheye" | "kannalabrandt" | "kannalabrandt4" => Ok(Lens::Equidistant(padded(model, used)?)),
        // Drivers of cameras without distortion name all sorts of models, or none.
        _ if used.is_empty() => Ok(Lens::Straight),
        "plumbbob" | "radtan" | "radialtangential" | "brownconrady" => {
            let too_many = || {
                format!(
                    "plumb_bob with {} coefficients: expected at most 5; if they are k1, k2, p1, p2, k3, k4, k5, k6, the model's name is rational_polynomial",
                    used.len()
                )
            };
            Ok(Lens::PlumbBob(padded(model, used).map_err(|_| too_many())?))
        }
        "rationalpolynomial" | "rational" => {
            let tilted =
                |_| "rational_polynomial with a tilted sensor (coefficients 13 and 14) is not supported: rectify the images".to_owned();
            Ok(Lens::RationalPolynomial(padded(model, used).map_err(tilted)?))
        }
        "modifiedbrownconrady" | "inversebrownconrady" => Ok(Lens::ModifiedBrownConrady(padded(model, used)?)),
        "" | "none" => Err("distortion coefficients without a distortion_model: name it, as plumb_bob for k1, k2, p1, p2, k3".into()),
        _ => Err(format!(
            "the distortion model `{:.40}` is not supported: use plumb_bob, rational_polynomial or equidistant, or rectify the images and give --rectified",
            model.unwrap_or_default()
        )),
    }
}

fn padded<const N: usize>(model: Option<&str>, used: &[f64]) -> Result<[f64; N], String> {
    if used.len() > N {
        return Err(format!("{:.40} with {} coefficients: expected at most {N}", model.unwrap_or_default(), used.len()));
    }
    Ok(std::array::from_fn(|i| used.get(i).copied().unwrap_or(0.0)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_name_of_a_model_leads_to_its_lens() {
        let k = [0.1, -0.2, 0.001, -0.002, 0.05];
        for name in ["plumb_bob", "radtan", "Brown Conrady", "distortion.brown_conrady", "RS2_DISTORTION_BROWN_CONRADY"] {
            assert_eq!(lens(Some(name), &k), Ok(Lens::PlumbBob(k)), "{name}");
        }
        for name in ["distortion.inverse_brown_conrady", "Modified Brown Conrady"] {
            assert_eq!(lens(Some(name), &k), Ok(Lens::ModifiedBrownConrady(k)), "{name}");
        }
        for name in ["equidistant", "fisheye", "Kannala Brandt4", "distortion.kannala_brandt4"] {
            assert_eq!(lens(Some(name), &k[..4]), Ok(Lens::Equidistant([0.1, -0.2, 0.001, -0.002])), "{name}");
        }
        let twelve = [0.78, -2.98, 0.0007, 0.00006, 1.7, 0.66, -2.81, 1.63, 0.0, 0.0, 0.0, 0.0];
        assert_eq!(lens(Some("rational_polynomial"), &twelve[..8]), Ok(Lens::RationalPolynomial(twelve)));
        assert_eq!(lens(Some("rational_polynomial"), &[&twelve[..], &[0.0; 2]].concat()), Ok(Lens::RationalPolynomial(twelve)));
    }

    #[test]
    fn zeros_at_the_end_do_not_count_and_fewer_coefficients_are_filled_with_zeros() {
        assert_eq!(lens(Some("plumb_bob"), &[0.1, -0.2]), Ok(Lens::PlumbBob([0.1, -0.2, 0.0, 0.0, 0.0])));
        assert_eq!(lens(Some("plumb_bob"), &[0.1, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]), Ok(Lens::PlumbBob([0.1, 0.0, 0.0, 0.0, 0.0])));
        for model in [None, Some("plumb_bob"), Some("rational_polynomial"), Some("whatever"), Some("none")] {
            assert_eq!(lens(model, &[0.0; 8]), Ok(Lens::Straight), "{model:?}");
        }
        // Without coefficients a fisheye is still one: it is not the pinhole's projection.
        assert_eq!(lens(Some("equidistant"), &[0.0; 8]), Ok(Lens::Equidistant([0.0; 4])));
    }

    #[test]
    fn what_is_no_known_lens_is_refused_with_the_reason() {
        assert!(lens(Some("plumb_bob"), &[0.1; 8]).unwrap_err().contains("rational_polynomial"));
        assert!(lens(Some("rational_polynomial"), &[0.1; 14]).unwrap_err().contains("tilted"));
        assert!(lens(Some("equidistant"), &[0.1; 5]).unwrap_err().contains("at most 4"));
        assert!(lens(None, &[0.1]).unwrap_err().contains("without a distortion_model"));
        assert!(lens(Some("none"), &[0.1]).unwrap_err().contains("without a distortion_model"));
        assert!(lens(Some("ftheta"), &[0.1]).unwrap_err().contains("`ftheta` is not supported"));
    }
}
