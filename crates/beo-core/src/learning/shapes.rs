//! Training shapes: complete shapes, each with the class that it belongs to.

use crate::grid::Occupancy;

/// One complete shape.
#[derive(Debug, Clone)]
pub struct Shape {
    /// Its voxels, in the canonical orientation of its class.
    pub object: Occupancy,
    /// Index into [`ShapeSet::classes`].
    pub class: usize,
    /// Where it comes from, for messages: `class/split/name`.
    pub file: String,
}

/// Shapes of several classes.
#[derive(Debug, Clone, Default)]
pub struct ShapeSet {
    /// Names of the classes, sorted.
    pub classes: Vec<String>,
    /// The shapes, all on grids of one size.
    pub shapes: Vec<Shape>,
    /// True lengths of each shape along its canonical axes, metres, in the same order; `None` where units are not known.
    pub lengths_m: Option<Vec<[f64; 3]>>,
}
