//! Settings of the searches: one table, with units and where each value comes from. How sure scores may be is not here but in the model's
//! [`Calibration`](crate::model::Calibration), which is fitted to its own shapes.

/// Radians of an angle in degrees.
const fn degrees(value: f64) -> f64 {
    value / 180.0 * std::f64::consts::PI
}

/// The search about z (`pose::circle`).
pub(super) struct YawSettings {
    /// Step of the coarse grid, at most, radians; it divides the span.
    pub coarse_rad: f64,
    /// The same where the prior expects the object somewhere.
    pub coarse_elsewhere_rad: f64,
    /// Steps of the hill climbing, each in turn, radians.
    pub fine_rad: [f64; 3],
    /// Modes that are refined, at most …
    pub most_modes: usize,
    /// … and only those whose peak on the coarse grid is within this of the best one's, nats.
    pub hopeless_nats: f64,
}

/// 870 queries of objects held out of ModelNet10's `train`, at 30³: against exhaustive search at 1°, the best class was another in at most five.
pub(super) const YAW: YawSettings = YawSettings {
    coarse_rad: degrees(10.0),
    coarse_elsewhere_rad: degrees(15.0),
    fine_rad: [degrees(5.0), degrees(2.0), degrees(1.0)],
    most_modes: 8,
    hopeless_nats: 8.0,
};

/// The search over SO(3) (`pose::full`).
pub(super) struct FullSettings {
    /// Best rotations of a class among which modes are sought.
    pub candidates: usize,
    /// The score of a class is T log Σ exp(score / T) over rotations, with this T, nats.
    pub soft_maximum_nats: f64,
    /// Rotations around a peak are averaged with weights exp(score / T), with this T, nats.
    pub averaging_nats: f64,
    /// Modes that are refined if the class is known …
    pub modes_of_known_class: usize,
    /// … else those of each of the most probable classes, …
    pub modes: usize,
    /// … and how many classes.
    pub classes: usize,
    /// Weight of the log evidence against the hull's score, for noise as it is (the evidence goes with its inverse, so the weight goes with the
    /// noise): multiplied by the model's own inflation.
    pub evidence_weight: f64,
    /// The sum of both is divided by this to be a log probability.
    pub temperature: f64,
    /// The same of the hull's score alone.
    pub hull_temperature: f64,
    /// Steps of the refinement, radians.
    pub fine_rad: [f64; 3],
    /// Without densities of views: step of the grid, radians, …
    pub coarse_rad: f64,
    /// … and of the refinement.
    pub fine_from_coarse_rad: [f64; 4],
}

/// 540 objects held out of ModelNet10's `train`, seen from above: the right mode was among the first eight of the known class for 95 % of the
/// views, and the expected calibration error of the class is 0.06.
pub(super) const FULL: FullSettings = FullSettings {
    candidates: 200,
    soft_maximum_nats: 4.0,
    averaging_nats: 6.0,
    modes_of_known_class: 5,
    modes: 2,
    classes: 4,
    evidence_weight: 0.1 / 16.0,
    temperature: 10.0,
    hull_temperature: 8.0,
    fine_rad: [degrees(4.0), degrees(2.0), degrees(1.0)],
    coarse_rad: degrees(30.0),
    fine_from_coarse_rad: [degrees(8.0), degrees(4.0), degrees(2.0), degrees(1.0)],
};

/// The search for what a camera sees (`camera::camera_search`).
pub(super) struct CameraSettings {
    /// Modes of the most probable class that are refined, at most …
    pub most_modes: usize,
    /// … and only those within this of the best, nats.
    pub hopeless_nats: f64,
    /// Classes whose modes are refined are at least so probable by the view's densities, …
    pub least_likely: f64,
    /// … and at most so many.
    pub most_likely: usize,
    /// The same where yaw, size and place are known, so that a class costs no more than its evidence: all that are at least so probable.
    pub least_likely_of_known: f64,
    /// The visible part takes this share of the longest side, where no density says it.
    pub visible_share: f64,
    /// Standard deviations then: yaw (radians), log size, place (units of the view's frame, of which the visible part takes twenty), lengths (units).
    pub unsure: [f64; crate::model::OFFSETS],
}

/// Views of household things and of ModelNet10 at 15 to 75 degrees, rendered from shapes that were left out of the training.
pub(super) const CAMERA: CameraSettings = CameraSettings {
    most_modes: 2,
    hopeless_nats: 3.0,
    least_likely: 0.05,
    most_likely: 3,
    least_likely_of_known: 1e-4,
    visible_share: 0.92,
    unsure: [0.1, 0.1, 1.5, 1.0, 1.0, 4.0, 4.0, 4.0],
};

/// An object before a camera that is looked for where it is expected (`camera::camera_search`).
pub(super) struct FollowedSettings {
    /// It is searched everywhere again after so many frames.
    pub most_frames: u32,
    /// The forest names its class no less than the one that it names most, within this, nats.
    pub share_falls_nats: f64,
    /// The best log density of the view where it is expected to be turned, weighted as in the posterior over poses, is no less than the best
    /// elsewhere, within this, nats: the equivalent poses of a symmetric object differ by less.
    pub turn_falls_nats: f64,
    /// The log evidence, weighted as in the posterior over classes, is no less than if each known voxel were explained as well as when the object
    /// was last answered, within this, nats.
    pub fit_falls_nats: f64,
}

/// Real frames of still objects, with the noise of a structured-light sensor added twelve times over: of 727 frames that were followed the
/// weighted log evidence fell by less than a third of this in 95 %, and by more in 1 %. Objects that are exchanged for another are mostly told
/// by how much of them is seen, and by the forest.
pub(super) const FOLLOWED: FollowedSettings =
    FollowedSettings { most_frames: 9, share_falls_nats: 1.0, turn_falls_nats: 0.5, fit_falls_nats: 4.0 };

/// Classes whose posterior by the hull is below this share of the best one's are not worth computing their evidence, which weighs little in the
/// blend: on objects held out of ModelNet10's `train`, no answer and no log loss changed.
pub(super) const LEAST_SHARE_OF_BEST: f64 = 1e-2;

/// The paper's search: step about z, 10°, then 1° in its neighbourhood; over all rotations, 20°, of which the best are decided by density.
pub(super) struct PaperSettings {
    /// Step of the coarse search about z, radians, and its neighbourhood that is searched finely.
    pub coarse_rad: f64,
    /// Step of the fine search about z, radians.
    pub fine_rad: f64,
    /// Step of the search over all rotations, radians.
    pub step_rad: f64,
    /// Best rotations of the coarse search over all that the density decides between.
    pub finalists: usize,
}

/// Section IV of the paper.
pub(super) const PAPER: PaperSettings =
    PaperSettings { coarse_rad: degrees(10.0), fine_rad: degrees(1.0), step_rad: degrees(20.0), finalists: 16 };
