//! Is this observation one that can be answered? Header against payload, before a voxel is looked at.
//!
//! The voxels themselves are checked by the daemon while it copies them: a producer could change them after any earlier check.

use crate::codes::{CompletionFrame, Outside, PerceptStatus, PoseSearch, ScaleSearch, Unit, View, cut, tasks};
use crate::limits::{MAX_DIM, MIN_DIM, voxel_count};
use crate::messages::{ABI_VERSION, ObservationHeader, Percept};
pub use crate::quaternion::QUATERNION_NORM_TOLERANCE;
use crate::quaternion::norm;
use crate::text::to_field;

/// Why an observation is refused. The text is the percept's explanation.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Refusal {
    /// The producer was built for another version of the messages.
    #[error("abi_version is {0}; this daemon speaks version {ABI_VERSION}: build both from the same release")]
    UnknownVersion(u32),
    /// An axis is outside the limits.
    #[error("dims are {dims:?}; each axis must have {MIN_DIM} to {MAX_DIM} voxels")]
    BadDims {
        /// The header's value.
        dims: [u32; 3],
        /// Bytes of the payload.
        payload_len: usize,
    },
    /// The payload has not one byte per voxel.
    #[error("the payload has {payload_len} bytes; dims {dims:?} need {}", voxel_count(*.dims).unwrap_or(0))]
    WrongLength {
        /// The header's value.
        dims: [u32; 3],
        /// Bytes of the payload.
        payload_len: usize,
    },
    /// The memory that it lies in was cut while it was read.
    #[error("the memory of the observation was cut to less than its {payload_len} bytes while it was read")]
    Cut {
        /// Bytes of the payload.
        payload_len: usize,
    },
    /// The model was trained for other dims.
    #[error("dims are {dims:?}; the model is for {model:?}")]
    DimsNotOfModel {
        /// The header's value.
        dims: [u32; 3],
        /// The model's value.
        model: [u32; 3],
    },
    /// A voxel is none of 0, 1 and 255.
    #[error("voxel {index} is {value}; it must be 0 (empty), 1 (filled) or 255 (unknown)")]
    BadVoxel {
        /// Index in the payload.
        index: usize,
        /// The value found.
        value: u8,
    },
    /// NaN or infinite.
    #[error("{0} is not finite")]
    NotFinite(&'static str),
    /// Zero, negative, NaN or infinite.
    #[error("voxel_size_m is {0}; it must be positive and finite")]
    BadVoxelSize(f32),
    /// The norm of a quaternion is not 1.
    #[error("{field} has norm {norm:e}; it must be a unit quaternion x, y, z, w")]
    NotUnit {
        /// The field's name.
        field: &'static str,
        /// Its norm.
        norm: f64,
    },
    /// Negative, NaN or infinite.
    #[error("rotation_prior_concentration is {0}; it must be finite and not negative")]
    BadConcentration(f32),
    /// The view is a camera's, and the camera is at the grid's centre.
    #[error("sensor_position_m is the grid's centre; view {:?} needs the camera's place, from there along the grid's axes", View::Camera)]
    NoSensor,
    /// Negative, NaN or infinite.
    #[error("known_side_m is {0}; it must be positive and finite, or 0 for not known")]
    BadSide(f32),
    /// Negative, NaN or infinite.
    #[error("{field} is {value}; it must be finite and not negative, 0 for {meaning_of_0}")]
    BadDeviation {
        /// The field's name.
        field: &'static str,
        /// The value found.
        value: f32,
        /// How to say that there is nothing to say.
        meaning_of_0: &'static str,
    },
    /// Outside 0 to 1, or NaN.
    #[error("{field} is {value}; it must be a share from 0 to 1")]
    BadShare {
        /// The field's name.
        field: &'static str,
        /// The value found.
        value: f32,
    },
    /// The producer asks for something that this release does not know, or did not clear the header.
    #[error("byte {0} of reserved is not 0: clear the header first, or use a daemon of the producer's release")]
    Reserved(usize),
    /// A number that this version does not know.
    #[error("{field} is {code}; this daemon knows no such choice")]
    UnknownCode {
        /// Which field of the header.
        field: &'static str,
        /// The value found.
        code: u32,
    },
    /// No voxel is filled.
    #[error("nothing of an object is seen: no voxel is filled")]
    NothingSeen,
    /// Known, but not by this daemon and model.
    #[error("pose_search {0:?} is not supported by this daemon")]
    PoseSearchNotSupported(PoseSearch),
    /// Any rotation is searched at a known size and place only.
    #[error(
        "any rotation (pose_search full) is searched only where size and place are known: ask for rest, all ways in which objects rest, or yaw"
    )]
    RotationAndSize,
    /// The deadline has passed: the answer would be of no use.
    #[error("its deadline passed {late_ns} ns before its turn: send fewer, or set deadline_ns (CLOCK_MONOTONIC) later")]
    Expired {
        /// How long ago, nanoseconds.
        late_ns: u64,
    },
    /// The daemon failed.
    #[error("{0}")]
    Internal(String),
}

impl Refusal {
    /// The status of the percept that says so.
    pub fn status(&self) -> PerceptStatus {
        match self {
            Self::UnknownVersion(_) => PerceptStatus::UnknownVersion,
            Self::BadDims { .. } | Self::WrongLength { .. } | Self::Cut { .. } => PerceptStatus::BadDims,
            Self::DimsNotOfModel { .. } => PerceptStatus::DimsNotOfModel,
            Self::BadVoxel { .. } => PerceptStatus::BadVoxel,
            Self::NotFinite(_)
            | Self::BadVoxelSize(_)
            | Self::NotUnit { .. }
            | Self::BadConcentration(_)
            | Self::NoSensor
            | Self::BadSide(_)
            | Self::BadDeviation { .. }
            | Self::BadShare { .. }
            | Self::Reserved(_)
            | Self::UnknownCode { .. } => PerceptStatus::BadHeader,
            Self::NothingSeen => PerceptStatus::NothingSeen,
            Self::PoseSearchNotSupported(_) | Self::RotationAndSize => PerceptStatus::PoseSearchNotSupported,
            Self::Expired { .. } => PerceptStatus::Expired,
            Self::Internal(_) => PerceptStatus::Internal,
        }
    }

    /// The percept's `detail`, as [`PerceptStatus`] describes it.
    pub fn detail(&self) -> u64 {
        match self {
            Self::UnknownVersion(version) => u64::from(*version),
            Self::BadDims { payload_len, .. } | Self::WrongLength { payload_len, .. } | Self::Cut { payload_len } => *payload_len as u64,
            Self::DimsNotOfModel { model: [x, y, z], .. } => u64::from(*x) | u64::from(*y) << 16 | u64::from(*z) << 32,
            Self::BadVoxel { index, .. } => *index as u64,
            Self::PoseSearchNotSupported(search) => u64::from(search.code()),
            Self::RotationAndSize => u64::from(PoseSearch::Full.code()),
            Self::Expired { late_ns } => *late_ns,
            Self::NotFinite(_)
            | Self::BadVoxelSize(_)
            | Self::NotUnit { .. }
            | Self::BadConcentration(_)
            | Self::NoSensor
            | Self::BadSide(_)
            | Self::BadDeviation { .. }
            | Self::BadShare { .. }
            | Self::Reserved(_)
            | Self::UnknownCode { .. }
            | Self::NothingSeen
            | Self::Internal(_) => 0,
        }
    }
}

impl Percept {
    /// The percept that refuses an observation and says why. A placement that is not valid is not repeated.
    pub fn refusing(observation: &ObservationHeader, refusal: &Refusal) -> Self {
        let mut percept = Self::answering(observation);
        percept.status = refusal.status().code();
        percept.detail = refusal.detail();
        percept.explanation = to_field(&refusal.to_string());
        percept.cut &= cut::ALL;
        if Unit::from_code(percept.unit).is_none() {
            percept.unit = Self::EMPTY.unit;
        }
        if check_placement(observation).is_err() {
            percept.position_m = Self::EMPTY.position_m;
            percept.orientation = Self::EMPTY.orientation;
            percept.voxel_size_m = Self::EMPTY.voxel_size_m;
            percept.object_position_m = Self::EMPTY.object_position_m;
        }
        percept
    }
}

/// Checks a header against its payload's length (bytes). On success it gives the number of voxels, which is that length.
///
/// The header must be the reader's own copy: one that lies in shared memory could change after the check.
pub fn validate(header: &ObservationHeader, payload_len: usize) -> Result<usize, Refusal> {
    if header.abi_version != ABI_VERSION {
        return Err(Refusal::UnknownVersion(header.abi_version));
    }
    let dims = header.dims;
    let voxels = voxel_count(dims).ok_or(Refusal::BadDims { dims, payload_len })?;
    if voxels != payload_len {
        return Err(Refusal::WrongLength { dims, payload_len });
    }
    check_placement(header)?;
    check_code("pose_search", header.pose_search, PoseSearch::from_code(header.pose_search).is_some())?;
    check_code("tasks", header.tasks, header.tasks & !tasks::ALL == 0)?;
    check_code("completion_frame", header.completion_frame, CompletionFrame::from_code(header.completion_frame).is_some())?;
    check_code("outside", header.outside, Outside::from_code(header.outside).is_some())?;
    check_code("view", header.view, View::from_code(header.view).is_some())?;
    check_code("continues", header.continues, header.continues <= 1)?;
    check_code("scale_search", header.scale_search, ScaleSearch::from_code(header.scale_search).is_some())?;
    check_code("unit", header.unit, Unit::from_code(header.unit).is_some())?;
    check_code("cut", header.cut, header.cut & !cut::ALL == 0)?;
    check_rotation_prior(header)?;
    check_sensor(header)?;
    check_readings(header)?;
    match header.reserved.iter().position(|byte| *byte != 0) {
        Some(place) => Err(Refusal::Reserved(place)),
        None => Ok(voxels),
    }
}

/// Fails if the header has a deadline that lies before `now_ns` (CLOCK_MONOTONIC): to be asked when the observation's turn comes.
pub fn check_deadline(header: &ObservationHeader, now_ns: u64) -> Result<(), Refusal> {
    match now_ns.checked_sub(header.deadline_ns) {
        Some(late_ns) if header.deadline_ns != 0 && late_ns > 0 => Err(Refusal::Expired { late_ns }),
        _ => Ok(()),
    }
}

fn check_rotation_prior(header: &ObservationHeader) -> Result<(), Refusal> {
    let concentration = header.rotation_prior_concentration;
    if !(concentration.is_finite() && concentration >= 0.0) {
        return Err(Refusal::BadConcentration(concentration));
    }
    if concentration == 0.0 {
        return Ok(());
    }
    if !header.rotation_prior.iter().all(|value| value.is_finite()) {
        return Err(Refusal::NotFinite("rotation_prior"));
    }
    check_unit("rotation_prior", header.rotation_prior.map(f64::from))
}

fn check_sensor(header: &ObservationHeader) -> Result<(), Refusal> {
    if header.view == View::Camera.code() {
        if !header.sensor_position_m.iter().all(|value| value.is_finite()) {
            return Err(Refusal::NotFinite("sensor_position_m"));
        }
        if header.sensor_position_m == [0.0; 3] {
            return Err(Refusal::NoSensor);
        }
    }
    let side = header.known_side_m;
    if header.scale_search == ScaleSearch::Search.code() && !(side.is_finite() && side >= 0.0) {
        return Err(Refusal::BadSide(side));
    }
    if header.scale_search == ScaleSearch::Search.code() && side > 0.0 {
        check_deviation("known_side_deviation_m", header.known_side_deviation_m, "exact")?;
    }
    Ok(())
}

/// Checks of the shares and deviations of the readings that the grid was made of.
fn check_readings(header: &ObservationHeader) -> Result<(), Refusal> {
    let shares = [("share_support", header.share_support), ("share_edge", header.share_edge), ("share_far", header.share_far)];
    if let Some((field, value)) = shares.into_iter().find(|(_, value)| !(0.0..=1.0).contains(value)) {
        return Err(Refusal::BadShare { field, value });
    }
    check_deviation("surface_deviation_m", header.surface_deviation_m, "not said")
}

fn check_deviation(field: &'static str, value: f32, meaning_of_0: &'static str) -> Result<(), Refusal> {
    if value.is_finite() && value >= 0.0 { Ok(()) } else { Err(Refusal::BadDeviation { field, value, meaning_of_0 }) }
}

fn check_unit(field: &'static str, quaternion: [f64; 4]) -> Result<(), Refusal> {
    let norm = norm(quaternion);
    if (norm - 1.0).abs() > QUATERNION_NORM_TOLERANCE {
        return Err(Refusal::NotUnit { field, norm });
    }
    Ok(())
}

fn check_placement(header: &ObservationHeader) -> Result<(), Refusal> {
    if !header.position_m.iter().all(|value| value.is_finite()) {
        return Err(Refusal::NotFinite("position_m"));
    }
    if !header.orientation.iter().all(|value| value.is_finite()) {
        return Err(Refusal::NotFinite("orientation"));
    }
    check_unit("orientation", header.orientation)?;
    if !(header.voxel_size_m.is_finite() && header.voxel_size_m > 0.0) {
        return Err(Refusal::BadVoxelSize(header.voxel_size_m));
    }
    Ok(())
}

fn check_code(field: &'static str, code: u32, known: bool) -> Result<(), Refusal> {
    if known { Ok(()) } else { Err(Refusal::UnknownCode { field, code }) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::text::from_field;

    const DIMS: [u32; 3] = [30, 20, 10];
    const LEN: usize = 6000;

    fn refusal(change: impl Fn(&mut ObservationHeader)) -> Refusal {
        let mut header = ObservationHeader::new(DIMS);
        change(&mut header);
        validate(&header, LEN).expect_err("a hostile header passed")
    }

    #[test]
    fn a_good_header_passes_with_its_voxel_count() {
        let mut header = ObservationHeader::new(DIMS);
        assert_eq!(validate(&header, LEN), Ok(LEN));
        header.orientation = [0.5, -0.5, 0.5, -0.5004];
        header.pose_search = PoseSearch::Full.code();
        header.tasks = tasks::ALL;
        header.frame_id = [0xff; 32];
        header.sequence = u64::MAX;
        header.capture_ns = u64::MAX;
        assert_eq!(validate(&header, LEN), Ok(LEN));
        assert_eq!(validate(&ObservationHeader::new([256; 3]), 1 << 24), Ok(1 << 24));
    }

    #[test]
    fn dims_that_lie_or_overflow_are_refused() {
        for dims in [[0; 3], [u32::MAX; 3], [7, 30, 30], [257, 8, 8], [1 << 31, 2, 1], [65536, 65536, 1], [1 << 22, 1 << 22, 1 << 20]] {
            assert_eq!(refusal(|header| header.dims = dims), Refusal::BadDims { dims, payload_len: LEN });
        }
        assert_eq!(refusal(|header| header.dims = dims_swapped()).status(), PerceptStatus::BadDims);
        for payload_len in [0, LEN - 1, LEN + 1, usize::MAX] {
            let refusal = validate(&ObservationHeader::new(DIMS), payload_len).unwrap_err();
            assert_eq!(refusal, Refusal::WrongLength { dims: DIMS, payload_len });
            assert_eq!((refusal.status(), refusal.detail()), (PerceptStatus::BadDims, payload_len as u64));
        }
    }

    fn dims_swapped() -> [u32; 3] {
        [31, 20, 10]
    }

    #[test]
    fn placements_that_are_not_finite_are_refused() {
        for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
            for axis in 0..3 {
                assert_eq!(refusal(|header| header.position_m[axis] = bad), Refusal::NotFinite("position_m"));
            }
            for part in 0..4 {
                assert_eq!(refusal(|header| header.orientation[part] = bad), Refusal::NotFinite("orientation"));
            }
        }
        for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 0.0, -0.0, -0.01] {
            let refusal = refusal(|header| header.voxel_size_m = bad);
            assert!(matches!(refusal, Refusal::BadVoxelSize(_)), "{bad}");
            assert_eq!(refusal.status(), PerceptStatus::BadHeader);
        }
    }

    #[test]
    fn sensors_and_sizes_are_checked_only_where_they_count() {
        let with = |change: &dyn Fn(&mut ObservationHeader)| {
            let mut header = ObservationHeader::new(DIMS);
            change(&mut header);
            validate(&header, LEN)
        };
        assert_eq!(with(&|header| (header.sensor_position_m, header.known_side_m) = ([f32::NAN; 3], f32::NAN)), Ok(LEN));
        assert_eq!(refusal(|header| header.view = View::Camera.code()), Refusal::NoSensor);
        for bad in [f32::NAN, f32::INFINITY] {
            let nowhere = |header: &mut ObservationHeader| (header.view, header.sensor_position_m) = (View::Camera.code(), [1.0, bad, 0.0]);
            assert_eq!(refusal(nowhere), Refusal::NotFinite("sensor_position_m"));
        }
        for bad in [f32::NAN, f32::INFINITY, -0.1] {
            let refusal = refusal(|header| (header.scale_search, header.known_side_m) = (ScaleSearch::Search.code(), bad));
            assert!(matches!(refusal, Refusal::BadSide(_)) && refusal.status() == PerceptStatus::BadHeader, "{bad}");
        }
        let good = |header: &mut ObservationHeader| {
            (header.view, header.sensor_position_m) = (View::Camera.code(), [-1.0, 0.0, 0.5]);
            (header.scale_search, header.known_side_m) = (ScaleSearch::Search.code(), 0.12);
        };
        assert_eq!(with(&good), Ok(LEN));
    }

    #[test]
    fn shares_deviations_and_reserved_bytes_out_of_range_are_refused() {
        type Field = (&'static str, fn(&mut ObservationHeader) -> &mut f32);
        let shares: [Field; 3] = [
            ("share_support", |header| &mut header.share_support),
            ("share_edge", |header| &mut header.share_edge),
            ("share_far", |header| &mut header.share_far),
        ];
        for (name, field) in shares {
            for bad in [f32::NAN, f32::INFINITY, -0.01, 1.01] {
                let refusal = refusal(|header| *field(header) = bad);
                assert!(matches!(refusal, Refusal::BadShare { field, .. } if field == name), "{name} {bad}");
                assert_eq!(refusal.status(), PerceptStatus::BadHeader);
            }
        }
        for bad in [f32::NAN, f32::INFINITY, -0.001] {
            let noisy = refusal(|header| header.surface_deviation_m = bad);
            assert!(matches!(noisy, Refusal::BadDeviation { field: "surface_deviation_m", .. }), "{bad}");
            let searched = |header: &mut ObservationHeader| {
                (header.scale_search, header.known_side_m, header.known_side_deviation_m) = (ScaleSearch::Search.code(), 0.1, bad);
            };
            assert!(matches!(refusal(searched), Refusal::BadDeviation { field: "known_side_deviation_m", .. }), "{bad}");
        }
        assert_eq!(refusal(|header| header.reserved[55] = 1), Refusal::Reserved(55));
        let mut header = ObservationHeader::new(DIMS);
        (header.share_support, header.share_edge, header.share_far) = (1.0, 0.0, 0.5);
        (header.surface_deviation_m, header.unit, header.cut) = (0.002, Unit::Metres.code(), cut::ALL);
        // Not read, as no side is known, or no size is searched.
        header.known_side_deviation_m = f32::NAN;
        assert_eq!(validate(&header, LEN), Ok(LEN));
        header.scale_search = ScaleSearch::Search.code();
        assert_eq!(validate(&header, LEN), Ok(LEN));
        (header.scale_search, header.known_side_m) = (ScaleSearch::Known.code(), 0.1);
        assert_eq!(validate(&header, LEN), Ok(LEN));
    }

    #[test]
    fn quaternions_that_are_not_unit_are_refused() {
        for bad in [[0.0; 4], [0.0, 0.0, 0.0, 2.0], [0.5; 4].map(|value| value * 1.01), [1.0; 4], [f64::MAX; 4]] {
            let refusal = refusal(|header| header.orientation = bad);
            assert!(matches!(refusal, Refusal::NotUnit { field: "orientation", .. }), "{bad:?}");
            assert_eq!(refusal.status(), PerceptStatus::BadHeader);
        }
    }

    #[test]
    fn rotation_priors_are_checked_only_where_they_count() {
        for bad in [f32::NAN, f32::INFINITY, -1.0] {
            let refusal = refusal(|header| header.rotation_prior_concentration = bad);
            assert!(matches!(refusal, Refusal::BadConcentration(_)), "{bad}");
        }
        let prior = |quaternion: [f32; 4], concentration| {
            let mut header = ObservationHeader::new(DIMS);
            (header.rotation_prior, header.rotation_prior_concentration) = (quaternion, concentration);
            validate(&header, LEN)
        };
        assert_eq!(prior([f32::NAN; 4], 0.0), Ok(LEN));
        assert_eq!(prior([0.6, 0.0, 0.0, 0.8], 10.0), Ok(LEN));
        assert_eq!(prior([f32::NAN; 4], 1.0), Err(Refusal::NotFinite("rotation_prior")));
        assert!(matches!(prior([1.0; 4], 1.0), Err(Refusal::NotUnit { field: "rotation_prior", .. })));
    }

    #[test]
    fn quaternions_near_unit_are_repeated_at_length_one() {
        let repeated = |orientation| Percept::answering(&ObservationHeader { orientation, ..ObservationHeader::new(DIMS) }).orientation;
        let exact = [0.5, -0.5, 0.5, -0.5];
        assert_eq!(repeated(exact), exact);
        let rounded = [0.1_f64, 0.2, 0.3, 0.86_f64.sqrt()];
        assert_eq!(repeated(rounded), rounded, "bit by bit");
        let long = exact.map(|value| value * 1.0009);
        assert!(repeated(long).iter().zip(exact).all(|(value, wanted)| (value - wanted).abs() < 1e-15));
        let completion = crate::CompletionHeader::answering(&ObservationHeader { orientation: long, ..ObservationHeader::new(DIMS) });
        assert_eq!(completion.orientation, repeated(long));
    }

    #[test]
    fn a_deadline_counts_once_it_has_passed() {
        let check = |deadline_ns, now_ns| check_deadline(&ObservationHeader { deadline_ns, ..ObservationHeader::new(DIMS) }, now_ns);
        assert_eq!(check(0, u64::MAX), Ok(()), "0 is no deadline");
        assert_eq!(check(u64::MAX, 5), Ok(()));
        assert_eq!(check(5, 5), Ok(()));
        let refusal = check(5, 8).unwrap_err();
        assert_eq!((refusal.status(), refusal.detail()), (PerceptStatus::Expired, 3));
    }

    #[test]
    fn unknown_versions_and_choices_are_refused() {
        for version in [0, 1, 3, u32::MAX] {
            let refusal = refusal(|header| header.abi_version = version);
            assert_eq!((refusal.status(), refusal.detail()), (PerceptStatus::UnknownVersion, u64::from(version)));
        }
        type Change = fn(&mut ObservationHeader, u32);
        let fields: [(&str, u32, Change); 9] = [
            ("unit", 2, |header, code| header.unit = code),
            ("cut", 4, |header, code| header.cut = code),
            ("pose_search", 4, |header, code| header.pose_search = code),
            ("tasks", 8, |header, code| header.tasks = code),
            ("completion_frame", 2, |header, code| header.completion_frame = code),
            ("outside", 2, |header, code| header.outside = code),
            ("view", 3, |header, code| header.view = code),
            ("scale_search", 2, |header, code| header.scale_search = code),
            ("continues", 2, |header, code| header.continues = code),
        ];
        for (field, first_unknown, change) in fields {
            for code in [first_unknown, u32::MAX] {
                let refusal = refusal(|header| change(header, code));
                assert_eq!(refusal, Refusal::UnknownCode { field, code });
                assert_eq!(refusal.status(), PerceptStatus::BadHeader);
            }
        }
    }

    #[test]
    fn a_refusing_percept_names_the_observation_and_the_reason_but_repeats_no_nan() {
        let mut header = ObservationHeader::new(DIMS);
        (header.producer_id, header.object_id, header.sequence, header.capture_ns) = (5, 6, 7, 8);
        header.position_m = [1.0, 2.0, 3.0];
        let percept = Percept::refusing(&header, &Refusal::BadVoxel { index: 123, value: 7 });
        assert_eq!((percept.producer_id, percept.object_id, percept.sequence, percept.capture_ns), (5, 6, 7, 8));
        assert_eq!((percept.status, percept.detail), (PerceptStatus::BadVoxel.code(), 123));
        assert_eq!(percept.position_m, [1.0, 2.0, 3.0]);
        assert_eq!((percept.class_index, percept.class_count), (crate::NO_CLASS, 0));
        assert_eq!(from_field(&percept.explanation), "voxel 123 is 7; it must be 0 (empty), 1 (filled) or 255 (unknown)");

        header.position_m[1] = f64::NAN;
        (header.cut, header.unit) = (u32::MAX, u32::MAX);
        let refusal = validate(&header, LEN).unwrap_err();
        let percept = Percept::refusing(&header, &refusal);
        assert_eq!(percept.position_m, [0.0; 3]);
        assert_eq!((percept.cut, percept.unit), (cut::ALL, 0));
        assert_eq!((percept.none_probability, percept.fit), (crate::NOT_COMPUTED, crate::NOT_COMPUTED));
        assert_eq!(from_field(&percept.explanation), "position_m is not finite");

        let percept = Percept::refusing(&header, &Refusal::DimsNotOfModel { dims: DIMS, model: [30, 31, 32] });
        assert_eq!(percept.detail, 30 | 31 << 16 | 32 << 32);
    }

    #[test]
    fn every_explanation_fits_its_field() {
        let long = [
            Refusal::BadDims { dims: [u32::MAX; 3], payload_len: usize::MAX },
            Refusal::WrongLength { dims: [256; 3], payload_len: usize::MAX },
            Refusal::DimsNotOfModel { dims: [256; 3], model: [256; 3] },
            Refusal::BadVoxel { index: usize::MAX, value: 254 },
            Refusal::UnknownCode { field: "completion_frame", code: u32::MAX },
            Refusal::NotUnit { field: "rotation_prior", norm: f64::MIN_POSITIVE.sqrt() },
            Refusal::BadConcentration(f32::MIN),
            Refusal::BadVoxelSize(-f32::from_bits(1)),
            Refusal::BadVoxelSize(f32::MIN),
            Refusal::Expired { late_ns: u64::MAX },
            Refusal::BadDeviation { field: "known_side_deviation_m", value: f32::MIN, meaning_of_0: "not said" },
            Refusal::BadShare { field: "share_support", value: f32::MIN },
            Refusal::Reserved(55),
            Refusal::UnknownVersion(u32::MAX),
            Refusal::NothingSeen,
        ];
        for refusal in long {
            let text = refusal.to_string();
            assert_eq!(from_field(&to_field::<{ crate::limits::EXPLANATION_LEN }>(&text)), text);
        }
    }
}
