//! Knowledge of the rotation of an object.

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
