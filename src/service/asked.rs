//! What the header of a valid observation asks for, as a query.

use beo_core::grid::{Outside, View, from_xyzw};
use beo_core::perception::{Frame, PoseSearch, Query, RotationPrior, ScaleSearch};
use beo_ipc::ObservationHeader;
use nalgebra::Vector3;

/// Sets in `query` what `header` asks for. `known` is the search for observations that say that their pose is known.
pub fn ask(query: &mut Query, header: &ObservationHeader, known: PoseSearch) {
    query.view = match beo_ipc::View::from_code(header.view) {
        Some(beo_ipc::View::TopDown) => Some(View::Top),
        _ => None,
    };
    let voxel = f64::from(header.voxel_size_m);
    query.camera = (beo_ipc::View::from_code(header.view) == Some(beo_ipc::View::Camera))
        .then(|| Vector3::from(header.sensor_position_m.map(|v| f64::from(v) / voxel)));
    query.scale = match beo_ipc::ScaleSearch::from_code(header.scale_search) {
        Some(beo_ipc::ScaleSearch::Search) => {
            let side = f64::from(header.known_side_m) / voxel;
            ScaleSearch::Search { side: (side > 0.0).then_some(side) }
        }
        _ => ScaleSearch::Known,
    };
    query.pose = match beo_ipc::PoseSearch::from_code(header.pose_search) {
        Some(beo_ipc::PoseSearch::Yaw | beo_ipc::PoseSearch::Rest) => PoseSearch::YAW,
        Some(beo_ipc::PoseSearch::Full) => PoseSearch::Full,
        _ => known,
    };
    query.lying = beo_ipc::PoseSearch::from_code(header.pose_search) == Some(beo_ipc::PoseSearch::Rest);
    query.voxel_size_m = (beo_ipc::Unit::from_code(header.unit) == Some(beo_ipc::Unit::Metres)).then_some(voxel);
    query.outside = match beo_ipc::Outside::from_code(header.outside) {
        Some(beo_ipc::Outside::Unknown) => Outside::Unknown,
        _ => Outside::Empty,
    };
    query.frame = match beo_ipc::CompletionFrame::from_code(header.completion_frame) {
        Some(beo_ipc::CompletionFrame::Object) => Frame::Object,
        _ => Frame::Grid,
    };
    query.rotation_prior = if header.rotation_prior_concentration > 0.0 {
        let expected = from_xyzw(header.rotation_prior.map(f64::from));
        RotationPrior::around(expected, f64::from(header.rotation_prior_concentration))
    } else {
        RotationPrior::uniform()
    };
}
