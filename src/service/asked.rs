//! The query that the header of a valid observation asks.

use beo_core::grid::{Outside, View, from_xyzw};
use beo_core::perception::{CompletionFrame, PoseSearch, Query, RotationPrior, ScaleSearch};
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
        Some(beo_ipc::CompletionFrame::Object) => CompletionFrame::Object,
        _ => CompletionFrame::Grid,
    };
    query.rotation_prior = if header.rotation_prior_concentration > 0.0 {
        let expected = from_xyzw(header.rotation_prior.map(f64::from));
        RotationPrior::around(expected, f64::from(header.rotation_prior_concentration))
    } else {
        RotationPrior::uniform()
    };
}

#[cfg(test)]
mod tests {
    use super::*;
    use beo_ipc::{PoseSearch as Wanted, Unit};

    fn asked(header: &ObservationHeader) -> Query {
        // Whatever an observation before it has asked.
        let mut query =
            Query { lying: true, camera: Some(Vector3::z()), voxel_size_m: Some(7.0), pose: PoseSearch::Full, ..Query::default() };
        ask(&mut query, header, PoseSearch::Known);
        query
    }

    const PLAIN: ObservationHeader = ObservationHeader::new([30; 3]);

    #[test]
    fn poses_are_searched_as_the_header_says_and_resting_poses_only_then() {
        let searches = [Wanted::Known, Wanted::Yaw, Wanted::Full, Wanted::Rest].map(|search| {
            let query = asked(&ObservationHeader { pose_search: search.code(), ..PLAIN });
            (query.pose, query.lying)
        });
        assert_eq!(searches, [(PoseSearch::Known, false), (PoseSearch::YAW, false), (PoseSearch::Full, false), (PoseSearch::YAW, true)]);
        // A daemon may be told to search what observations say to be known.
        let mut query = Query::default();
        ask(&mut query, &PLAIN, PoseSearch::YAW);
        assert_eq!((query.pose, query.lying), (PoseSearch::YAW, false));
    }

    #[test]
    fn true_sizes_count_only_in_metres_and_lengths_become_voxels() {
        let header = ObservationHeader {
            voxel_size_m: 0.5,
            view: beo_ipc::View::Camera.code(),
            sensor_position_m: [1.0, -2.0, 0.25],
            scale_search: beo_ipc::ScaleSearch::Search.code(),
            known_side_m: 4.0,
            ..PLAIN
        };
        let query = asked(&header);
        assert_eq!((query.voxel_size_m, query.view, query.camera), (None, None, Some(Vector3::new(2.0, -4.0, 0.5))));
        assert_eq!(query.scale, ScaleSearch::Search { side: Some(8.0) });
        assert_eq!(asked(&ObservationHeader { unit: Unit::Metres.code(), ..header }).voxel_size_m, Some(0.5));
        let unknown = asked(&ObservationHeader { known_side_m: 0.0, ..header });
        assert_eq!(unknown.scale, ScaleSearch::Search { side: None });
        let above = asked(&ObservationHeader { view: beo_ipc::View::TopDown.code(), ..PLAIN });
        assert_eq!((above.view, above.camera, above.scale), (Some(View::Top), None, ScaleSearch::Known));
    }

    #[test]
    fn frame_and_surroundings_are_the_headers() {
        let plain = asked(&PLAIN);
        assert_eq!((plain.outside, plain.frame), (Outside::Empty, CompletionFrame::Grid));
        let (outside, frame) = (beo_ipc::Outside::Unknown.code(), beo_ipc::CompletionFrame::Object.code());
        let query = asked(&ObservationHeader { outside, completion_frame: frame, ..PLAIN });
        assert_eq!((query.outside, query.frame), (Outside::Unknown, CompletionFrame::Object));
    }
}
