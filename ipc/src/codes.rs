//! The numbers that messages use for choices, and their checked conversion from what another process wrote.

/// Gives an enum with explicit values a checked conversion from its number: what comes from shared memory is never transmuted.
macro_rules! checked_codes {
    ($name:ident { $($variant:ident),+ $(,)? }) => {
        impl $name {
            /// The number in messages.
            pub const fn code(self) -> u32 {
                self as u32
            }

            /// The choice for a number from a message, `None` if this version does not know it.
            pub const fn from_code(code: u32) -> Option<Self> {
                $(if code == Self::$variant as u32 { return Some(Self::$variant); })+
                None
            }
        }
    };
}

/// How an observation was answered: [`crate::Percept::status`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[repr(u32)]
pub enum PerceptStatus {
    /// Answered.
    Ok = 0,
    /// The header's dims are outside the limits, or their product is not the payload's length. `detail` is the payload's length.
    BadDims = 1,
    /// The dims are not those that the model was trained for. `detail` is the model's x | y << 16 | z << 32.
    DimsNotOfModel = 2,
    /// A voxel is neither 0 (empty), 1 (filled) nor 255 (unknown). `detail` is the voxel's index in the payload.
    BadVoxel = 3,
    /// A value of the header is out of its range (see the explanation). `detail` is 0.
    BadHeader = 4,
    /// The header's `abi_version` is not [`crate::ABI_VERSION`]. `detail` is the version found. Producer, object, sequence and stamps are
    /// what lies at their places of this version.
    UnknownVersion = 5,
    /// The daemon cannot do this pose search. `detail` is the `pose_search` asked for.
    PoseSearchNotSupported = 6,
    /// The daemon failed on a valid observation; the explanation says why.
    Internal = 7,
    /// The daemon ends and had no time left for this observation. `detail` is 0.
    Stopping = 8,
    /// The observation's `deadline_ns` had passed before its turn came. `detail` is by how many nanoseconds.
    Expired = 9,
    /// The grid holds nothing of an object: no voxel is filled. There is no class, no pose and no completion. `detail` is 0.
    NothingSeen = 10,
}
checked_codes!(PerceptStatus {
    Ok,
    BadDims,
    DimsNotOfModel,
    BadVoxel,
    BadHeader,
    UnknownVersion,
    PoseSearchNotSupported,
    Internal,
    Stopping,
    Expired,
    NothingSeen
});

/// The state of the daemon: [`crate::Status::state`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
#[repr(u32)]
pub enum DaemonState {
    /// It answers.
    #[default]
    Serving = 0,
    /// It answers with the model it has, and checks another.
    Reloading = 1,
    /// It ends: what waits is answered as long as there is time.
    Stopping = 2,
    /// It failed on the last observation that it tried to answer ([`PerceptStatus::Internal`]).
    Failing = 3,
}
checked_codes!(DaemonState { Serving, Reloading, Stopping, Failing });

/// The prior knowledge of the object's rotation: [`crate::ObservationHeader::pose_search`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
#[repr(u32)]
pub enum PoseSearch {
    /// The grid is in the object's canonical orientation.
    #[default]
    Known = 0,
    /// The object is upright; its rotation about z is unknown.
    Yaw = 1,
    /// The rotation is unknown.
    Full = 2,
    /// The object rests on a support plane below the grid (up is the grid's +z), in any of the poses in which its class can rest, turned
    /// by any angle about the vertical. In models that have learned no resting poses every class stands upright: then it is [`Self::Yaw`].
    Rest = 3,
}
checked_codes!(PoseSearch { Known, Yaw, Full, Rest });

/// The frame of a completed grid: [`crate::ObservationHeader::completion_frame`] and [`crate::CompletionHeader::frame`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
#[repr(u32)]
pub enum CompletionFrame {
    /// The observation's grid.
    #[default]
    Grid = 0,
    /// The canonical orientation of the training shapes.
    Object = 1,
}
checked_codes!(CompletionFrame { Grid, Object });

/// The assumption about voxels outside the grid: [`crate::ObservationHeader::outside`]. It matters where a rotated object reaches over the
/// grid's edge.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
#[repr(u32)]
pub enum Outside {
    /// The grid holds the whole object: outside is empty.
    #[default]
    Empty = 0,
    /// Nothing is known of what is outside.
    Unknown = 1,
}
checked_codes!(Outside { Empty, Unknown });

/// Where the sensor looked from: [`crate::ObservationHeader::view`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
#[repr(u32)]
pub enum View {
    /// Not said.
    #[default]
    Unspecified = 0,
    /// From above, along −z of the grid.
    TopDown = 1,
    /// A camera at [`crate::ObservationHeader::sensor_position_m`].
    Camera = 2,
}
checked_codes!(View { Unspecified, TopDown, Camera });

/// The prior knowledge of the object's size and of its place in the grid: [`crate::ObservationHeader::scale_search`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
#[repr(u32)]
pub enum ScaleSearch {
    /// The grid lies about the object as it does about the training shapes: the same centre, the same share for the longest side.
    #[default]
    Known = 0,
    /// The grid was laid about what is visible of the object: size and place are found.
    Search = 1,
}
checked_codes!(ScaleSearch { Known, Search });

/// The unit of an observation's lengths: [`crate::ObservationHeader::unit`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
#[repr(u32)]
pub enum Unit {
    /// Not known: lengths count voxels, or are in a unit that the producer knows. Nothing is concluded from true sizes.
    #[default]
    Unknown = 0,
    /// Metres.
    Metres = 1,
}
checked_codes!(Unit { Unknown, Metres });

/// How a percept was computed: [`crate::Percept::method`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
#[repr(u32)]
pub enum Method {
    /// Nothing was computed: the observation was refused.
    #[default]
    None = 0,
    /// The calibrated blend.
    Auto = 1,
    /// The nearest class mean on the known voxels.
    Mean = 2,
    /// As in the paper.
    Paper = 3,
    /// The evidence of the class models.
    Evidence = 4,
    /// The class density of the visual hull.
    Hull = 5,
}
checked_codes!(Method { None, Auto, Mean, Paper, Evidence, Hull });

/// The bits of [`crate::ObservationHeader::tasks`].
pub mod tasks {
    /// Class posterior. It is computed in any case.
    pub const CLASS: u32 = 1;
    /// Pose hypotheses.
    pub const POSE: u32 = 2;
    /// Completed occupancy with its uncertainty.
    pub const COMPLETION: u32 = 4;
    /// All that this version knows.
    pub const ALL: u32 = CLASS | POSE | COMPLETION;
}

/// The bits of [`crate::ObservationHeader::cut`]: what keeps the object from being seen whole from where the sensor is.
pub mod cut {
    /// It goes on beyond the border of the image.
    pub const BORDER: u32 = 1;
    /// Something nearer hides a part of it.
    pub const OCCLUDER: u32 = 2;
    /// All that this version knows.
    pub const ALL: u32 = BORDER | OCCLUDER;

    /// The words for the bits that are set, as JSON and people have them.
    pub fn words(bits: u32) -> impl Iterator<Item = &'static str> {
        [(BORDER, "border"), (OCCLUDER, "occluder")].into_iter().filter(move |(bit, _)| bits & bit != 0).map(|(_, word)| word)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn codes_round_trip_and_unknown_ones_are_refused() {
        for code in 0..11 {
            assert_eq!(PerceptStatus::from_code(code).map(PerceptStatus::code), Some(code));
        }
        for code in [11, 255, u32::MAX] {
            assert_eq!(PerceptStatus::from_code(code), None);
            assert_eq!(PoseSearch::from_code(code), None);
            assert_eq!(Method::from_code(code), None);
        }
        assert_eq!(PoseSearch::from_code(4), None);
        assert_eq!(Unit::from_code(2), None);
        assert_eq!(DaemonState::from_code(4), None);
        assert_eq!(CompletionFrame::from_code(2), None);
        assert_eq!(Outside::from_code(2), None);
        assert_eq!(View::from_code(3), None);
        assert_eq!(ScaleSearch::from_code(2), None);
    }

    #[test]
    fn what_cuts_an_object_has_words() {
        assert_eq!(cut::words(0).count(), 0);
        assert_eq!(cut::words(cut::ALL | 8).collect::<Vec<_>>(), ["border", "occluder"]);
        assert_eq!(cut::words(cut::OCCLUDER).collect::<Vec<_>>(), ["occluder"]);
    }
}
