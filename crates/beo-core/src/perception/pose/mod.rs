//! Pose by search over rotations (eqs. 11, 12, 19–21), jointly with the class.
//!
//! | file | content |
//! | --- | --- |
//! | `posterior` | weighted rotations, merged into hypotheses |
//! | `circle` | search over angles about z, whatever the score |
//! | `yaw` | scores of such angles by the hull's projection |
//! | `yaw_search` | class and angle about z |
//! | `modes` | peaks among scored rotations |
//! | `refine` | a rotation refined by reconstructing the object and turning it onto the observation |
//! | `full` | search over SO(3): from these, class and pose |

pub(crate) mod circle;
pub(super) mod full;
mod modes;
pub(crate) mod posterior;
mod refine;
#[cfg(test)]
pub(super) mod small;
pub(crate) mod yaw;
pub(super) mod yaw_search;
