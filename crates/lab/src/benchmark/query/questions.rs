//! The questions: observations of turned objects, and the prior knowledge of their pose.

use crate::evaluation::rotations::draw_rotation;
use beo_core::grid::{Dims, Observation, Occupancy, Outside, Turn, View, yaw};
use beo_core::model::Model;
use beo_core::perception::{ClassBelief, PerceiveError, Perceiver, Percept, PoseSearch, Query, RotationPrior, ScaleSearch};
use beo_core::simulation::{self, Eye};
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
    /// Seen by a camera; resting pose, yaw, size and place are to be found.
    Camera,
    /// The same, a little further than in an observation that was answered before.
    #[serde(rename = "camera-tracking")]
    CameraTracking,
}

/// How far a tracked object turns between two observations: a turn in about three seconds at 30 Hz.
const TRACKED_TURN_RAD: f64 = 3.6 * std::f64::consts::PI / 180.0;
/// Height of the camera above the horizontal, and its distance in sides of the grid.
const CAMERA_ELEVATION_RAD: f64 = std::f64::consts::PI / 6.0;
const CAMERA_DISTANCE: f64 = 4.0;
/// Seed of the rotations.
const SEED: u64 = 0;

impl Search {
    /// All, the quick ones first.
    pub const ALL: [Self; 6] = [Self::Known, Self::Tracking, Self::Yaw, Self::CameraTracking, Self::Camera, Self::Full];

    /// Those that a model can answer: what cameras see only if it has learned views of cameras.
    pub fn of(model: &Model) -> Vec<Self> {
        let has_cameras = model.camera_densities().is_some();
        Self::ALL.into_iter().filter(|search| has_cameras || !search.is_camera()).collect()
    }

    /// Whether a camera sees the object.
    pub fn is_camera(self) -> bool {
        matches!(self, Self::Camera | Self::CameraTracking)
    }

    fn is_tracking(self) -> bool {
        matches!(self, Self::Tracking | Self::CameraTracking)
    }

    /// Its name.
    pub fn name(self) -> &'static str {
        match self {
            Self::Known => "known pose",
            Self::Yaw => "yaw",
            Self::Full => "any rotation",
            Self::Tracking => "tracking",
            Self::Camera => "camera",
            Self::CameraTracking => "camera, tracking",
        }
    }

    fn pose(self) -> PoseSearch {
        match self {
            Self::Known => PoseSearch::Known,
            Self::Yaw | Self::Tracking | Self::Camera | Self::CameraTracking => PoseSearch::YAW,
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

/// One question for each object, turned at random over what is searched, seen from above or by a camera.
pub fn questions(perceiver: &Perceiver, objects: &[Object], search: Search) -> Result<Vec<Question>, PerceiveError> {
    let (mut work, mut percept) = (perceiver.workspace(), Percept::default());
    let mut question = |(place, object): (usize, &Object)| {
        let rotation = draw_rotation(search.pose(), SEED, place);
        let eye = Eye { azimuth: 0.0, elevation: CAMERA_ELEVATION_RAD, distance: CAMERA_DISTANCE * object.shape.dims().x() as f64 };
        let seen = |rotation| {
            let turned = Turn::new(object.shape.dims(), &rotation).occupancy(&object.shape);
            if search.is_camera() { simulation::observe(&turned, &eye) } else { View::Top.of(&turned) }
        };
        let mut query = Query { pose: search.pose(), ..Query::default() };
        if search.is_camera() {
            (query.camera, query.scale) = (Some(eye.position()), ScaleSearch::Search { side: None });
            (query.outside, query.lying) = (Outside::Unknown, true);
        } else {
            query.view = Some(View::Top);
        }
        if search.is_tracking() {
            perceiver.classify(&seen(yaw(-TRACKED_TURN_RAD) * rotation), &query, &mut work, &mut percept)?;
            (query.rotation_prior, query.expected) = (RotationPrior::continuing(&percept), percept.expected);
            if search.is_camera() {
                ClassBelief::first(&percept.posterior).log_prior(&mut query.log_prior);
            }
        }
        let observation = if search == Search::Known { View::Top.of(&object.shape) } else { seen(rotation) };
        Ok(Question { observation, query, class: object.class })
    };
    objects.iter().enumerate().map(&mut question).collect()
}
