//! The Python package `beo`: the mathematics, the depth camera's front end and the shared-memory clients of beo, on NumPy arrays.
//!
//! | file | what |
//! | --- | --- |
//! | `arrays` | NumPy arrays in and out |
//! | `failures` | errors of the libraries as Python's exceptions |
//! | `question` | what is asked about a grid, for a model in this process and for a daemon |
//! | `model`, `training` | models: loaded, trained, saved, asked |
//! | `percept` | the answers of a model |
//! | `camera` | labels and grids from depth images |
//! | `shapes` | complete shapes from files, and made up |
//! | `observer`, `subscriber` | the shared-memory clients |
//!
//! Whatever takes longer than a look at its arguments runs without the interpreter's lock.

mod arrays;
mod camera;
mod failures;
mod model;
mod observer;
mod percept;
mod question;
mod shapes;
mod subscriber;
mod training;

/// The compiled part of the package `beo`.
#[pyo3::pymodule]
mod _beo {
    #[pymodule_export]
    use crate::camera::{CarvedGrid, carve, segment};
    #[pymodule_export]
    use crate::model::Model;
    #[pymodule_export]
    use crate::observer::Observer;
    #[pymodule_export]
    use crate::percept::{Hypothesis, Percept};
    #[pymodule_export]
    use crate::shapes::{household_shape, read_shape_file, view_from_above};
    #[pymodule_export]
    use crate::subscriber::{PublishedPercept, Subscriber};

    #[pymodule_export]
    #[expect(non_upper_case_globals, reason = "Python's name for it")]
    const __version__: &str = env!("CARGO_PKG_VERSION");
}
