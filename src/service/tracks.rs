//! What was last answered of each object, for observations that continue it.

use beo_core::perception::{Percept, RotationPrior};
use std::collections::HashMap;

/// Objects that are remembered; beyond, the one that was seen longest ago is forgotten.
const MOST_TRACKS: usize = 256;

/// Last answers by (producer, object).
#[derive(Default)]
pub struct Tracks {
    last: HashMap<(u64, u64), (u64, RotationPrior)>,
    /// Counts answers: the age of each.
    answers: u64,
}

impl Tracks {
    /// Where an object that was answered before is to be expected; `None` if it was not.
    pub fn expectation(&self, producer: u64, object: u64) -> Option<&RotationPrior> {
        self.last.get(&(producer, object)).map(|(_, prior)| prior)
    }

    /// Remembers an answer.
    pub fn remember(&mut self, producer: u64, object: u64, percept: &Percept) {
        self.answers += 1;
        if self.last.len() >= MOST_TRACKS
            && !self.last.contains_key(&(producer, object))
            && let Some(oldest) = self.last.iter().min_by_key(|(_, (age, _))| *age).map(|(key, _)| *key)
        {
            self.last.remove(&oldest);
        }
        self.last.insert((producer, object), (self.answers, RotationPrior::continuing(percept)));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use beo_core::grid::yaw;
    use beo_core::perception::{Hypothesis, PoseSearch};

    fn percept(angle: f64) -> Percept {
        let rotation = yaw(angle);
        Percept { rotation, hypotheses: vec![Hypothesis { rotation, class: 0, probability: 1.0 }], ..Percept::default() }
    }

    #[test]
    fn objects_are_told_apart_and_the_oldest_is_forgotten() {
        let mut tracks = Tracks::default();
        (0..MOST_TRACKS as u64 + 1).for_each(|object| tracks.remember(1, object, &percept(object as f64 * 0.01)));
        assert!(tracks.expectation(1, 0).is_none());
        assert!(tracks.expectation(2, 1).is_none());
        let expected = tracks.expectation(1, 100).unwrap().log_density(PoseSearch::YAW);
        assert!(expected(&yaw(1.0)) > 1.0 && expected(&yaw(3.0)) < -1.0);
    }
}
