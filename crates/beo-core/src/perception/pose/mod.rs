//! Pose by search over rotations (eqs. 11, 12, 19–21), jointly with the class.
//!
//! | file | content |
//! | --- | --- |
//! | `prior` | P(r): uniform, around an expected rotation, or around the last answer of a tracked object |
//! | `posterior` | weighted rotations, merged into hypotheses |
//! | `grid` | rotations spread evenly over SO(3) |
//! | `circle` | search over angles about z, whatever the score |
//! | `yaw` | scores of such angles by the hull's projection |
//! | `viewpoint` | any rotation as a direction that points up and a turn in the image plane |
//! | `hull_features` | what a view from above shows, in few numbers |
//! | `view_scores` | scores of all directions, turns and classes by such numbers |
//! | `yaw_search` | class and angle about z |
//! | `levels` | large grids: search on smaller ones, refinement on the larger |
//! | `climb` | hill climbing and the top of a parabola, by which all searches refine |
//! | `merging` | what lies near the best that is left becomes one mode |
//! | `modes` | peaks among scored rotations |
//! | `refine` | a rotation refined by reconstructing the object and turning it onto the observation |
//! | `full` | search over SO(3): from these, class and pose |

pub(crate) mod circle;
pub(crate) mod climb;
pub(super) mod full;
pub(crate) mod grid;
pub(crate) mod hull_features;
pub(super) mod levels;
pub(crate) mod merging;
mod modes;
pub(crate) mod posterior;
mod prior;
mod refine;
#[cfg(test)]
pub(super) mod small;
pub(crate) mod view_scores;
pub(crate) mod viewpoint;
pub(crate) mod yaw;
pub(super) mod yaw_search;

pub use posterior::Hypothesis;
pub use prior::RotationPrior;

/// Knowledge of the rotation from object axes to grid axes.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum PoseSearch {
    /// None: the grid stands as the training shapes do.
    #[default]
    Known,
    /// A rotation about z by an angle in \[0, span), radians.
    Yaw {
        /// At most a full turn.
        span: f64,
    },
    /// Any rotation.
    Full,
}

impl PoseSearch {
    /// A rotation about z by any angle.
    pub const YAW: Self = Self::Yaw { span: std::f64::consts::TAU };

    /// The name on the command line and in results.
    pub fn name(self) -> &'static str {
        match self {
            Self::Known => "known",
            Self::Yaw { .. } => "yaw",
            Self::Full => "full",
        }
    }
}
