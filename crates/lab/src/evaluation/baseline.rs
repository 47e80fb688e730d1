//! The paper's baseline for pose, measured: every query aligned with the mean of its true class by ICP.

use super::icp::{Freedom, Icp, filled_points, mean_object, yaw_starts};
use super::metrics;
use super::protocol::{Milliseconds, PoseErrors, PoseFigures, Protocol};
use super::viewpoint::Posed;
use beo_core::grid::Rotation;
use beo_core::grid::cube_rotations;
use beo_core::learning::Shape;
use beo_core::perception::{Perceiver, PoseSearch};
use serde::Serialize;
use std::time::Instant;

/// Starts of the multi-start baseline about z; over all rotations, the 24 of the cube.
const YAW_STARTS: usize = 24;

/// The outcome of ICP from some number of starts.
#[derive(Clone, Debug, Serialize)]
pub struct IcpEvaluation {
    /// Number of starts.
    pub starts: usize,
    /// Rotation errors.
    pub pose_error_deg: PoseFigures,
    /// Times of one query.
    pub query_ms: Milliseconds,
    /// Errors of each query, in path order.
    pub per_query: Vec<PoseErrors>,
}

/// ICP from one start, the identity, and from several; none in known pose, where there is nothing to estimate.
pub fn evaluate_icp(
    perceiver: &Perceiver,
    shapes: &[&Shape],
    classes: &[usize],
    pose: PoseSearch,
    protocol: &Protocol,
    mut seen: impl FnMut(),
) -> Vec<IcpEvaluation> {
    let (freedom, several) = match pose {
        PoseSearch::Known => return Vec::new(),
        PoseSearch::Yaw { span } => (Freedom::Yaw, yaw_starts(YAW_STARTS, span)),
        PoseSearch::Full => (Freedom::Full, cube_rotations()),
    };
    let dims = perceiver.model().dims();
    let means = (0..perceiver.model().classes.len()).map(|s| mean_object(dims, |voxel| perceiver.class_mean(s, voxel)));
    let means: Vec<Icp> = means.map(|mean| Icp::new(&mean)).collect();
    let measure = |starts: &[Rotation], seen: &mut dyn FnMut()| {
        let (mut times, mut per_query) = (Vec::new(), Vec::new());
        for (place, shape) in shapes.iter().enumerate() {
            let posed = Posed::new(shape, pose, protocol.viewpoint, protocol.seed, place);
            let start = Instant::now();
            let result = means[classes[shape.class]].align(&filled_points(&posed.observation), freedom, starts);
            times.push(start.elapsed().as_secs_f64() * 1e3);
            per_query.push(posed.errors(shape, pose, &result.rotation_object_to_grid));
            seen();
        }
        IcpEvaluation {
            starts: starts.len(),
            pose_error_deg: metrics::pose_figures(&per_query),
            query_ms: metrics::milliseconds(&times),
            per_query,
        }
    };
    vec![measure(&[Rotation::identity()], &mut seen), measure(&several, &mut seen)]
}
