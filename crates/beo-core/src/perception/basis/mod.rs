//! The shared basis W' as queries read it.
//!
//! | file | content | source |
//! | --- | --- | --- |
//! | `reading` | W' by tables or in place | |
//! | `projection` | linear projection onto W' by runs of voxels | eq. 5 |
//! | `rows` | rows of values in 16 bits | |
//! | `tiles` | Gram matrices of stacks of voxels, summed once for all queries | eq. 16 |
//! | `shared_rows` | W' where it lies in the model file, for grids too large for tables | eqs. 5, 16, 17 |

pub mod projection;
pub mod reading;
pub mod rows;
pub mod shared_rows;
pub mod tiles;
