//! The belief about each object after its last answer, for observations that continue it.

use super::belief::ClassBelief;
use beo_core::perception::{Percept, RotationPrior};
use std::collections::HashMap;

/// Objects that are remembered; beyond, the one that was seen longest ago is forgotten.
const MOST_TRACKS: usize = 256;
/// An object that was not seen for so long is forgotten: what stands there then may be another.
const FORGOTTEN_AFTER_NS: u64 = 10_000_000_000;

/// One object over time.
pub struct Track {
    /// When it was last answered, CLOCK_MONOTONIC.
    seen_ns: u64,
    /// Where its pose is to be expected; `None` where it was not searched.
    pub expected_rotation: Option<RotationPrior>,
    /// Its class, given all frames so far.
    pub class: ClassBelief,
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
    /// An object that was answered before and is not forgotten at `now_ns`.
    pub fn of(&self, producer: u64, object: u64, now_ns: u64) -> Option<&Track> {
        self.tracks.get(&(producer, object)).filter(|track| now_ns.saturating_sub(track.seen_ns) < FORGOTTEN_AFTER_NS)
    }

    /// Remembers an answer: what is believed of its class, and where it stands if that was searched.
    pub fn remember(&mut self, producer: u64, object: u64, now_ns: u64, class: ClassBelief, searched: Option<&Percept>) {
        if self.tracks.len() >= MOST_TRACKS && !self.tracks.contains_key(&(producer, object)) {
            self.tracks.retain(|_, track| now_ns.saturating_sub(track.seen_ns) < FORGOTTEN_AFTER_NS);
            if self.tracks.len() >= MOST_TRACKS
                && let Some(oldest) = self.tracks.iter().min_by_key(|(key, track)| (track.seen_ns, **key)).map(|(key, _)| *key)
            {
                self.tracks.remove(&oldest);
            }
        }
        let expected_rotation = searched.map(RotationPrior::continuing);
        self.tracks.insert((producer, object), Track { seen_ns: now_ns, expected_rotation, class });
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use beo_core::grid::yaw;
    use beo_core::perception::{Hypothesis, PoseSearch};

    fn percept(angle: f64) -> Percept {
        let rotation = yaw(angle);
        Percept {
            rotation_object_to_grid: rotation,
            hypotheses: vec![Hypothesis { rotation, class: 0, probability: 1.0 }],
            ..Percept::default()
        }
    }

    fn belief() -> ClassBelief {
        ClassBelief::first(&[0.5, 0.5])
    }

    #[test]
    fn objects_are_told_apart_and_the_oldest_is_forgotten() {
        let mut tracks = Tracks::default();
        let all = 0..MOST_TRACKS as u64 + 1;
        all.for_each(|object| tracks.remember(1, object, object, belief(), Some(&percept(object as f64 * 0.01))));
        assert!(tracks.of(1, 0, 300).is_none() && tracks.tracks.len() == MOST_TRACKS);
        assert!(tracks.of(2, 1, 300).is_none());
        let track = tracks.of(1, 100, 300).unwrap();
        let expected = track.expected_rotation.as_ref().unwrap().log_density(PoseSearch::YAW);
        assert!(expected(&yaw(1.0)) > 1.0 && expected(&yaw(3.0)) < -1.0);
    }

    #[test]
    fn an_object_that_is_seen_again_takes_nobodys_place() {
        let mut tracks = Tracks::default();
        (0..MOST_TRACKS as u64).for_each(|object| tracks.remember(1, object, object, belief(), None));
        (0..10).for_each(|_| tracks.remember(1, 7, 300, belief(), None));
        assert!((0..MOST_TRACKS as u64).all(|object| tracks.of(1, object, 300).is_some()), "there is room for all that were remembered");
        // Where many are forgotten anyway, they make room, and who was seen lately stays.
        tracks.remember(1, 7, FORGOTTEN_AFTER_NS + 300, belief(), None);
        tracks.remember(1, 1000, FORGOTTEN_AFTER_NS + 300, belief(), None);
        assert!([7, 1000].iter().all(|object| tracks.of(1, *object, FORGOTTEN_AFTER_NS + 301).is_some()));
        assert_eq!(tracks.tracks.len(), 2);
    }

    #[test]
    fn an_object_that_was_not_seen_for_long_is_forgotten() {
        let mut tracks = Tracks::default();
        tracks.remember(1, 1, 5, belief(), None);
        assert!(tracks.of(1, 1, 5 + FORGOTTEN_AFTER_NS - 1).is_some());
        assert!(tracks.of(1, 1, 5 + FORGOTTEN_AFTER_NS).is_none());
    }
}
