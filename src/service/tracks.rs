//! What is remembered of each object after its last answer, for observations that continue it.

use beo_core::grid::from_xyzw;
use beo_core::perception::{ClassBelief, ExpectedPlacement, NoneBelief, Percept, PoseSearch, Query, RotationPrior};
use beo_ipc::ObservationHeader;
use nalgebra::Vector3;
use std::collections::HashMap;

/// Objects that are remembered; beyond, the one that was seen longest ago is forgotten.
const MOST_TRACKS: usize = 256;
/// An object that was not seen for so long is forgotten: what stands there then may be another.
const FORGOTTEN_AFTER_NS: u64 = 10_000_000_000;

/// Where a grid lies in the frame that the producer names.
#[derive(Clone, Copy, Debug, PartialEq)]
struct GridPose {
    frame_id: [u8; 32],
    position_m: Vector3<f64>,
    /// x, y, z, w.
    orientation: [f64; 4],
    voxel_size_m: f64,
}

impl From<&ObservationHeader> for GridPose {
    fn from(header: &ObservationHeader) -> Self {
        let ObservationHeader { frame_id, position_m, orientation, voxel_size_m, .. } = *header;
        Self { frame_id, position_m: position_m.into(), orientation, voxel_size_m: voxel_size_m.into() }
    }
}

/// One answer about an object.
#[derive(Clone, Debug)]
pub struct Answered {
    /// When the observation was captured, and when it was answered, CLOCK_MONOTONIC.
    captured_ns: u64,
    seen_ns: u64,
    grid: GridPose,
    /// Where its pose is to be expected; `None` where it was not searched.
    rotation: Option<RotationPrior>,
    /// The same of size and place too, before a camera.
    placement: Option<ExpectedPlacement>,
    /// Its class, given all frames so far.
    pub class: ClassBelief,
    /// Whether it is of no class, given all frames so far; `None` where the model cannot tell.
    pub none: Option<NoneBelief>,
}

impl Answered {
    /// An answer at `now_ns` to the observation with this header.
    pub fn new(
        header: &ObservationHeader,
        now_ns: u64,
        class: ClassBelief,
        none: Option<NoneBelief>,
        query: &Query,
        percept: &Percept,
    ) -> Self {
        let searched = query.pose != PoseSearch::Known;
        Self {
            captured_ns: header.capture_ns,
            seen_ns: now_ns,
            grid: header.into(),
            rotation: searched.then(|| RotationPrior::continuing(percept)),
            placement: percept.expected,
            class,
            none,
        }
    }

    /// Sets in `query` where the object is to be expected in the grid of `header`, whose frame is the same.
    pub fn expect(&self, header: &ObservationHeader, query: &mut Query) {
        let grid = GridPose::from(header);
        if grid.frame_id != self.grid.frame_id {
            return;
        }
        let [old, new] = [self.grid.orientation, grid.orientation].map(from_xyzw);
        let rotation = new.inverse() * old;
        if let Some(expected) = &self.rotation {
            // Without a time of capture, the frames of an object follow upon each other.
            let elapsed_ns = header.capture_ns.saturating_sub(self.captured_ns);
            let seconds = if self.captured_ns == 0 { 0.0 } else { elapsed_ns as f64 * 1e-9 };
            query.rotation_prior = expected.after(seconds).turned(&rotation);
        }
        let translation = new.inverse() * (self.grid.position_m - grid.position_m) / grid.voxel_size_m;
        query.expected =
            self.placement.map(|placement| placement.in_grid(&rotation, self.grid.voxel_size_m / grid.voxel_size_m, &translation));
    }
}

/// One object over time.
struct Track {
    last: Answered,
    /// The answer before: objects may change their numbers from frame to frame, so that the last answer of a number may be of the frame that
    /// is being answered.
    before: Option<Answered>,
}

/// Objects by (producer, object).
pub struct Tracks {
    tracks: HashMap<(u64, u64), Track>,
}

impl Default for Tracks {
    fn default() -> Self {
        Self { tracks: HashMap::with_capacity(MOST_TRACKS) }
    }
}

impl Tracks {
    /// The last answer about the object that an observation continues, if it has not been forgotten at `now_ns`.
    pub fn continued(&self, header: &ObservationHeader, now_ns: u64) -> Option<&Answered> {
        let track = self.tracks.get(&(header.producer_id, header.continued_object_id)).filter(|_| header.continues != 0)?;
        let is_earlier = |answered: &&Answered| header.capture_ns == 0 || answered.captured_ns < header.capture_ns;
        let last = [Some(&track.last), track.before.as_ref()].into_iter().flatten().find(is_earlier);
        last.filter(|last| now_ns.saturating_sub(last.seen_ns) < FORGOTTEN_AFTER_NS)
    }

    /// Remembers an answer about an object of a producer.
    pub fn remember(&mut self, producer: u64, object: u64, answered: Answered) {
        let now_ns = answered.seen_ns;
        if let Some(track) = self.tracks.get_mut(&(producer, object)) {
            track.before = Some(std::mem::replace(&mut track.last, answered));
            return;
        }
        if self.tracks.len() >= MOST_TRACKS {
            self.tracks.retain(|_, track| now_ns.saturating_sub(track.last.seen_ns) < FORGOTTEN_AFTER_NS);
            if self.tracks.len() >= MOST_TRACKS
                && let Some(oldest) = self.tracks.iter().min_by_key(|(key, track)| (track.last.seen_ns, **key)).map(|(key, _)| *key)
            {
                self.tracks.remove(&oldest);
            }
        }
        self.tracks.insert((producer, object), Track { last: answered, before: None });
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use beo_core::grid::{Similarity, yaw};
    use beo_core::perception::Hypothesis;

    fn percept(angle: f64) -> Percept {
        let rotation = yaw(angle);
        Percept {
            rotation_object_to_grid: rotation,
            hypotheses: vec![Hypothesis { rotation, class: 0, probability: 1.0 }],
            ..Percept::default()
        }
    }

    fn answered(header: &ObservationHeader, now_ns: u64, percept: &Percept) -> Answered {
        let query = Query { pose: PoseSearch::YAW, ..Query::default() };
        Answered::new(header, now_ns, ClassBelief::first(&[0.5, 0.5]), None, &query, percept)
    }

    fn header(object: u64) -> ObservationHeader {
        ObservationHeader {
            producer_id: 1,
            object_id: object,
            continued_object_id: object,
            continues: 1,
            ..ObservationHeader::new([30; 3])
        }
    }

    /// Remembers an answer at `now_ns` about an object, by the tracks' own keys.
    fn remember(tracks: &mut Tracks, object: u64, now_ns: u64, angle: f64) {
        tracks.remember(1, object, answered(&header(object), now_ns, &percept(angle)));
    }

    #[test]
    fn objects_are_told_apart_and_the_oldest_is_forgotten() {
        let mut tracks = Tracks::default();
        (0..MOST_TRACKS as u64 + 1).for_each(|object| remember(&mut tracks, object, object, object as f64 * 0.01));
        assert!(tracks.continued(&header(0), 300).is_none() && tracks.tracks.len() == MOST_TRACKS);
        assert!(tracks.continued(&ObservationHeader { producer_id: 2, ..header(1) }, 300).is_none());
        assert!(tracks.continued(&ObservationHeader { continues: 0, ..header(100) }, 300).is_none());
        let mut query = Query::default();
        tracks.continued(&header(100), 300).unwrap().expect(&header(100), &mut query);
        let expected = query.rotation_prior.log_density(PoseSearch::YAW);
        assert!(expected(&yaw(1.0)) > 1.0 && expected(&yaw(3.0)) < -1.0);
    }

    #[test]
    fn an_object_that_is_seen_again_takes_nobodys_place() {
        let mut tracks = Tracks::default();
        (0..MOST_TRACKS as u64).for_each(|object| remember(&mut tracks, object, object, 0.0));
        (0..10).for_each(|_| remember(&mut tracks, 7, 300, 0.0));
        let is_known = |tracks: &Tracks, object: u64, now_ns: u64| tracks.continued(&header(object), now_ns).is_some();
        assert!((0..MOST_TRACKS as u64).all(|object| is_known(&tracks, object, 300)), "there is room for all that were remembered");
        // Where many are forgotten anyway, they make room, and who was seen lately stays.
        remember(&mut tracks, 7, FORGOTTEN_AFTER_NS + 300, 0.0);
        remember(&mut tracks, 1000, FORGOTTEN_AFTER_NS + 300, 0.0);
        assert!([7, 1000].iter().all(|object| is_known(&tracks, *object, FORGOTTEN_AFTER_NS + 301)));
        assert_eq!(tracks.tracks.len(), 2);
    }

    #[test]
    fn an_object_that_was_not_seen_for_long_is_forgotten() {
        let mut tracks = Tracks::default();
        remember(&mut tracks, 1, 5, 0.0);
        assert!(tracks.continued(&header(1), 5 + FORGOTTEN_AFTER_NS - 1).is_some());
        assert!(tracks.continued(&header(1), 5 + FORGOTTEN_AFTER_NS).is_none());
    }

    /// Two objects whose numbers a producer exchanges: whichever is answered first, the other is continued by the frame before.
    #[test]
    fn objects_that_exchange_their_numbers_are_continued_by_the_frame_before() {
        let mut tracks = Tracks::default();
        let at = |object: u64, continued: u64, captured: u64| ObservationHeader {
            capture_ns: captured,
            continued_object_id: continued,
            ..header(object)
        };
        for (object, angle) in [(1, 1.0), (2, 2.0)] {
            tracks.remember(1, object, answered(&at(object, object, 100), 100, &percept(angle)));
        }
        for (object, continued) in [(1, 2), (2, 1)] {
            let header = at(object, continued, 200);
            let mut query = Query::default();
            tracks.continued(&header, 200).unwrap().expect(&header, &mut query);
            assert!(query.rotation_prior.log_density(PoseSearch::YAW)(&yaw(continued as f64)) > 1.0, "{object}");
            tracks.remember(1, object, answered(&header, 200, &percept(continued as f64)));
        }
    }

    #[test]
    fn the_longer_an_object_was_not_seen_the_less_is_known_of_how_it_is_turned() {
        let at = |capture_ns: u64| ObservationHeader { capture_ns, ..header(1) };
        let turned = |before_ns: u64, now_ns: u64| {
            let mut query = Query::default();
            answered(&at(before_ns), 5, &percept(0.3)).expect(&at(now_ns), &mut query);
            query.rotation_prior.log_density(PoseSearch::YAW)(&yaw(0.3 + 3.0))
        };
        let [frame, second] = [33_000_000, 1_000_000_000].map(|elapsed_ns| turned(7, 7 + elapsed_ns));
        assert!(second > frame + 2.0 && second < 0.0, "{frame} {second}");
        // Where a producer says no times, or times that go back, nothing passed between.
        assert_eq!([turned(0, 0), turned(0, 1 << 60), turned(9, 0), turned(9, 8)], [frame; 4]);
    }

    #[test]
    fn what_is_expected_lies_in_the_frame_where_it_lay_whatever_the_grid() {
        let placed = Similarity { rotation: yaw(0.3), scale: 1.1, translation_voxels: Vector3::new(1.0, 2.0, -1.0) };
        let expected = ExpectedPlacement {
            class: 0,
            component: 0,
            placed,
            log_scale_deviation: 0.05,
            place_deviation_voxels: 1.0,
            seen_side_voxels: 20.0,
            log_evidence_per_voxel: 0.1,
            frames_since_search: 0,
        };
        let grid = |angle: f64, position_m: [f64; 3], voxel_size_m: f32| ObservationHeader {
            orientation: beo_core::grid::to_xyzw(&yaw(angle)),
            position_m,
            voxel_size_m,
            ..header(1)
        };
        let (old, new) = (grid(0.5, [0.1, 0.2, 0.8], 0.01), grid(-0.2, [0.12, 0.17, 0.82], 0.008));
        let answer = Percept { expected: Some(expected), ..percept(0.3) };
        let mut query = Query::default();
        answered(&old, 5, &answer).expect(&new, &mut query);
        let in_frame = |header: &ObservationHeader, placed: &Similarity| {
            let point = placed.place(&Vector3::new(3.0, 0.0, 1.0)) * f64::from(header.voxel_size_m);
            from_xyzw(header.orientation) * point + Vector3::from(header.position_m)
        };
        let found = query.expected.unwrap().placed;
        assert!((in_frame(&old, &placed) - in_frame(&new, &found)).norm() < 1e-9);
        assert!(query.rotation_prior.log_density(PoseSearch::YAW)(&yaw(0.3 + 0.7)) > 1.0, "turned against the new grid");
        // Of another frame nothing is known.
        let mut other = Query::default();
        answered(&old, 5, &answer).expect(&ObservationHeader { frame_id: [7; 32], ..new }, &mut other);
        assert!(other.expected.is_none() && other.rotation_prior.is_uniform());
    }
}
