//! Tools of all searches.
//!
//! | file | content |
//! | --- | --- |
//! | `grid` | rotations spread evenly over SO(3) |
//! | `climb` | hill climbing and the top of a parabola, by which all searches refine |
//! | `merging` | what lies near the best that is left becomes one mode |

pub(crate) mod climb;
pub(crate) mod grid;
pub(crate) mod merging;
