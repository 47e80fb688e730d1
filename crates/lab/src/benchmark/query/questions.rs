//! The questions: observations of turned objects, and the prior knowledge of their pose.

use crate::evaluation::rotations::draw_rotation;
use beo_core::grid::{Dims, Observation, Occupancy, Turn, View, yaw};
use beo_core::perception::{PerceiveError, Perceiver, Percept, PoseSearch, Query, RotationPrior};
use beo_shapes::furniture;
use serde::{Deserialize, Serialize};

/// The prior knowledge of the pose.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Search {
    /// Objects stand as the training shapes do.
    Known,
    /// Turned about the vertical axis.
    Yaw,
    /// Turned in any way.
    Full,
    /// Turned about the vertical axis a little further than in an observation that was answered before.
    Tracking,
}

/// How far a tracked object turns between two observations: a turn in about three seconds at 30 Hz.
const TRACKED_TURN_RAD: f64 = 3.6 * std::f64::consts::PI / 180.0;
/// Seed of the rotations.
const SEED: u64 = 0;

impl Search {
    /// All, the quick ones first.
    pub const ALL: [Self; 4] = [Self::Known, Self::Tracking, Self::Yaw, Self::Full];

    /// Its name.
    pub fn name(self) -> &'static str {
        match self {
            Self::Known => "known pose",
            Self::Yaw => "yaw",
            Self::Full => "any rotation",
            Self::Tracking => "tracking",
        }
    }

    fn pose(self) -> PoseSearch {
        match self {
            Self::Known => PoseSearch::Known,
            Self::Yaw | Self::Tracking => PoseSearch::YAW,
            Self::Full => PoseSearch::Full,
        }
    }
}

/// A complete object.
pub struct Object {
    /// As it stands before it is turned.
    pub shape: Occupancy,
    /// Index of its class in the model, if it is one of the model's.
    pub class: Option<usize>,
}

/// A query that is timed.
pub struct Question {
    /// The observation.
    pub observation: Observation,
    /// The query; completion is asked for separately.
    pub query: Query,
    /// Index of the true class in the model, if known.
    pub class: Option<usize>,
}

/// `count` pieces of made-up furniture, no two alike, the classes in turns.
pub fn furniture(dims: Dims, count: usize, classes: &[&str]) -> Vec<Object> {
    let names = furniture::CLASSES;
    let piece = |i: usize| {
        let name = names[i % names.len()];
        let shape = furniture::make(name, dims, 1000 + (i / names.len()) as u64)?;
        Some(Object { shape, class: classes.iter().position(|class| *class == name) })
    };
    (0..count).filter_map(piece).collect()
}

/// One question for each object, turned at random over what is searched, seen from above.
pub fn questions(perceiver: &Perceiver, objects: &[Object], search: Search) -> Result<Vec<Question>, PerceiveError> {
    let (mut work, mut percept) = (perceiver.workspace(), Percept::default());
    let mut question = |(place, object): (usize, &Object)| {
        let rotation = draw_rotation(search.pose(), SEED, place);
        let seen = |rotation| View::Top.of(&Turn::new(object.shape.dims(), &rotation).occupancy(&object.shape));
        let mut query = Query { pose: search.pose(), view: Some(View::Top), ..Query::default() };
        if search == Search::Tracking {
            perceiver.classify(&seen(yaw(-TRACKED_TURN_RAD) * rotation), &query, &mut work, &mut percept)?;
            query.rotation_prior = RotationPrior::continuing(&percept);
        }
        let observation = if search == Search::Known { View::Top.of(&object.shape) } else { seen(rotation) };
        Ok(Question { observation, query, class: object.class })
    };
    objects.iter().enumerate().map(&mut question).collect()
}
