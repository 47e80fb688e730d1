//! Alignment with the mean of the true class, from several starts: the paper's baseline for pose. It is told the class, and answers the pose
//! alone.

use super::questions::{Question, Search};
use crate::benchmark::percentiles::Percentiles;
use crate::evaluation::icp::{Freedom, Icp, filled_points, mean_object, yaw_starts};
use beo_core::grid::cube_rotations;
use beo_core::perception::Perceiver;
use std::hint::black_box;
use std::time::Instant;

/// Starts, about z and over all rotations.
const STARTS: usize = 24;
/// Questions that are enough for a median of something so slow.
const ENOUGH: usize = 10;

/// Times of some of the questions; `None` where no rotation is searched or no object is of a known class.
pub fn time_icp(perceiver: &Perceiver, questions: &[Question], search: Search) -> Option<Percentiles> {
    let (freedom, starts) = match search {
        Search::Yaw => (Freedom::Yaw, yaw_starts(STARTS, std::f64::consts::TAU)),
        Search::Full => (Freedom::Full, cube_rotations()),
        Search::Known | Search::Tracking | Search::Camera | Search::CameraTracking => return None,
    };
    let mut times_ns = Vec::new();
    for (question, class) in questions.iter().filter_map(|question| Some((question, question.class?))).take(ENOUGH) {
        let mean = Icp::new(&mean_object(perceiver.model().dims(), |voxel| perceiver.class_mean(class, voxel)));
        let start = Instant::now();
        black_box(mean.align(&filled_points(&question.observation), freedom, &starts));
        times_ns.push(start.elapsed().as_nanos() as u64);
    }
    (!times_ns.is_empty()).then(|| Percentiles::of_times(times_ns))
}
