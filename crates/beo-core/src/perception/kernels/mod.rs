//! Arithmetic in the shapes that processors do fast, compiled for the CPU that it runs on.
//!
//! | file | content |
//! | --- | --- |
//! | `row_gram` | Gram matrices of rows of values, as packed lower triangles |
//! | `large_pages` | tables in large pages, where the system has them |

pub mod large_pages;
pub mod row_gram;
