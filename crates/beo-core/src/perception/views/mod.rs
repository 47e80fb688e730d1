//! Densities of turned objects that are seen from above, and scores by them.
//!
//! | file | content |
//! | --- | --- |
//! | `viewpoint` | any rotation as a direction that points up and a turn in the image plane |
//! | `hull_features` | a view from above in few numbers |
//! | `view_scores` | scores of all directions, turns and classes by such numbers |

pub(crate) mod hull_features;
pub(crate) mod view_scores;
pub(crate) mod viewpoint;
