//! The shared basis W' as queries read it.
//!
//! | file | content | source |
//! | --- | --- | --- |
//! | `known` | an observation taken apart: hull, unknown runs, filled voxels | V_q, w_q of eq. 13 |
//! | `reading` | W' by tables or in place | |
//! | `projection` | linear projection onto W' by runs of voxels | eq. 5 |
//! | `rows` | rows of values in 16 bits | |
//! | `columns` | the same by blocks of voxels of one column | |
//! | `tiles` | Gram matrices of stacks of voxels, summed once for all queries | eq. 16 |
//! | `shared_rows` | W' where it lies in the model file, for grids too large for tables | eqs. 5, 16, 17 |
//! | `shared_sums` | sums over its rows | |

pub mod columns;
pub mod known;
pub mod projection;
pub mod reading;
pub mod rows;
pub mod shared_rows;
pub mod shared_sums;
pub mod tiles;
