//! Prior densities over rotations.

use super::PoseSearch;
use crate::grid::Rotation;
use crate::perception::percept::Percept;

/// Concentrations beyond this (a spread of a fifth of a degree) are taken for this.
const MOST_CONCENTRATED: f64 = 1e5;

/// Components of less weight are no place to begin a search.
const NEGLIGIBLE: f64 = 0.01;

/// Time from frame to frame, seconds.
const FRAME_S: f64 = 1.0 / 30.0;
/// From frame to frame an object turns by about 10°: κ = 1/σ².
const FRAME_CONCENTRATION: f64 = 32.8;
/// Probability that it turned in any other way, or that the last answer was wrong: what lets tracking recover.
const FRAME_FLOOR: f64 = 0.02;
/// Weight of the pose that was answered, against all hypotheses.
const COMMITMENT: f64 = 0.5;

/// P(r) as a mixture: a uniform floor, and components exp(κ cos θ) around rotations, θ the angle from them (the isotropic
/// matrix Fisher density; about one axis, von Mises).
#[derive(Clone, Debug, Default)]
pub struct RotationPrior {
    components: Vec<(Rotation, f64)>,
    concentration: f64,
    floor: f64,
}

impl RotationPrior {
    /// The uniform density.
    pub fn uniform() -> Self {
        Self::default()
    }

    /// A density around one rotation; `concentration` κ ≥ 0.
    pub fn around(rotation: Rotation, concentration: f64) -> Self {
        Self { components: vec![(rotation, 1.0)], concentration: concentration.clamp(0.0, MOST_CONCENTRATED), floor: 0.0 }
    }

    /// A density around weighted rotations, of which a share `floor` (0 to 1) is uniform: what is elsewhere stays possible.
    pub fn mixture(components: impl IntoIterator<Item = (Rotation, f64)>, concentration: f64, floor: f64) -> Self {
        let mut components: Vec<(Rotation, f64)> = components.into_iter().filter(|(_, weight)| *weight > 0.0).collect();
        let total: f64 = components.iter().map(|(_, weight)| weight).sum();
        components.iter_mut().for_each(|(_, weight)| *weight /= total);
        Self { components, concentration: concentration.clamp(0.0, MOST_CONCENTRATED), floor: floor.clamp(0.0, 1.0) }
    }

    /// Becomes another density, in the memory that this one has.
    pub(super) fn set(&mut self, other: &Self) {
        self.components.clone_from(&other.components);
        (self.concentration, self.floor) = (other.concentration, other.floor);
    }

    /// Where an object is to be expected one frame after `percept`: around its hypotheses, and most of all around the one that
    /// was answered, so that of the equivalent poses of a symmetric object the same one stays the answer.
    pub fn continuing(percept: &Percept) -> Self {
        let others = percept.hypotheses.iter().map(|h| (h.rotation, (1.0 - COMMITMENT) * h.probability));
        Self::mixture(std::iter::once((percept.rotation_object_to_grid, COMMITMENT)).chain(others), FRAME_CONCENTRATION, FRAME_FLOOR)
    }

    /// The same where not a frame but `seconds` have passed since the object was seen: its uniform part grows as if it had the same chance of
    /// being turned in any way in each of the frames between.
    pub fn after(&self, seconds: f64) -> Self {
        let frames = (seconds / FRAME_S).max(1.0);
        Self { floor: 1.0 - (1.0 - self.floor).powf(frames), ..self.clone() }
    }

    /// The same density of rotations that are followed by `rotation`, as for a grid in which this one is turned so.
    pub fn turned(&self, rotation: &Rotation) -> Self {
        let components = self.components.iter().map(|(centre, weight)| (rotation * centre, *weight)).collect();
        Self { components, ..*self }
    }

    /// Whether it is the same everywhere.
    pub fn is_uniform(&self) -> bool {
        self.components.is_empty() || self.concentration == 0.0
    }

    /// The rotations around which most of it lies.
    pub fn centres(&self) -> impl Iterator<Item = &Rotation> {
        let heavy = self.components.iter().filter(|(_, weight)| *weight >= NEGLIGIBLE);
        heavy.map(|(rotation, _)| rotation).filter(|_| self.concentration > 0.0)
    }

    /// A function that gives the log density at a rotation, relative to the uniform one.
    pub fn log_density(&self, search: PoseSearch) -> impl Fn(&Rotation) -> f64 + Sync + '_ {
        let scale = if self.is_uniform() { 0.0 } else { log_mean(self.concentration, search) };
        move |rotation| {
            if self.is_uniform() {
                return 0.0;
            }
            let peaks = self.components.iter().map(|(centre, weight)| {
                // cos θ = 2 q² − 1, q the product of the quaternions.
                let log = 2.0 * self.concentration * (centre.coords.dot(&rotation.coords).powi(2) - 1.0) - scale;
                weight * log.exp()
            });
            (self.floor + (1.0 - self.floor) * peaks.sum::<f64>()).max(f64::MIN_POSITIVE).ln()
        }
    }
}

/// log of the mean of exp(κ (cos θ − 1)) over all rotations that are searched: θ is uniform about one axis; over SO(3) it has
/// density (1 − cos θ) / π on \[0, π\].
fn log_mean(concentration: f64, search: PoseSearch) -> f64 {
    let full = search == PoseSearch::Full;
    // The midpoint rule on a smooth periodic function: its error falls as exp(−2 n² / κ) once the points are nearer than the peak is wide.
    let points = 16 + (4.0 * concentration.sqrt()) as usize;
    let mut sum = 0.0;
    for i in 0..points {
        let cos = ((i as f64 + 0.5) * std::f64::consts::PI / points as f64).cos();
        sum += (concentration * (cos - 1.0)).exp() * if full { 1.0 - cos } else { 1.0 };
    }
    (sum / points as f64).ln()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::yaw;

    #[test]
    fn densities_are_normalised_as_by_bessel_functions() {
        // scipy.special: log(ive(0, k)) about one axis, log(ive(0, k) - ive(1, k)) over SO(3)
        let expected = [(0.5, -0.438450281, -0.716181511), (10.0, -2.057027917, -5.025141637), (400.0, -3.914357915, -10.598343270)];
        for (concentration, axis, full) in expected {
            assert!((log_mean(concentration, PoseSearch::YAW) - axis).abs() < 1e-8, "{}", log_mean(concentration, PoseSearch::YAW));
            assert!((log_mean(concentration, PoseSearch::Full) - full).abs() < 1e-8, "{}", log_mean(concentration, PoseSearch::Full));
        }
    }

    #[test]
    fn a_floor_keeps_everything_possible() {
        let prior = RotationPrior::mixture([(yaw(1.0), 0.7), (yaw(2.0), 0.3)], 200.0, 0.1);
        let density = prior.log_density(PoseSearch::YAW);
        assert!((density(&yaw(5.0)) - 0.1_f64.ln()).abs() < 1e-6);
        assert!(density(&yaw(1.0)) > density(&yaw(2.0)) && density(&yaw(2.0)) > 1.0);
        // Half a second of fifteen frames in which a tenth becomes uniform; less than a frame counts as one.
        let later = |seconds: f64| prior.after(seconds).log_density(PoseSearch::YAW)(&yaw(5.0));
        assert!((later(0.5) - (1.0 - 0.9_f64.powi(15)).ln()).abs() < 1e-6 && (later(0.01) - 0.1_f64.ln()).abs() < 1e-6);
        assert_eq!(RotationPrior::uniform().after(1.0).log_density(PoseSearch::YAW)(&yaw(3.0)), 0.0);
        assert_eq!(RotationPrior::uniform().log_density(PoseSearch::Full)(&yaw(3.0)), 0.0);
        assert!(RotationPrior::around(yaw(0.0), f64::INFINITY).log_density(PoseSearch::YAW)(&yaw(3.0)).is_finite());
    }
}
