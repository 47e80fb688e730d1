//! Training shapes: complete shapes, each with the class that it belongs to.

use super::error::TrainError;
use super::options::FEWEST_SHAPES;
use crate::grid::{Dims, Occupancy};

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

/// The shapes of each class, which all have one size.
pub(super) fn by_class(shapes: &ShapeSet) -> Result<(Dims, Vec<Vec<&Occupancy>>), TrainError> {
    let Some(first) = shapes.shapes.first() else { return Err(TrainError::Nothing) };
    let dims = first.object.dims();
    let mut classes = vec![Vec::new(); shapes.classes.len()];
    for shape in &shapes.shapes {
        let found = shape.object.dims();
        if found != dims {
            return Err(TrainError::Dims { file: shape.file.clone(), found, expected: dims });
        }
        classes[shape.class].push(&shape.object);
    }
    if let Some(s) = classes.iter().position(|c| c.len() < FEWEST_SHAPES) {
        return Err(TrainError::TooFew { class: shapes.classes[s].clone(), found: classes[s].len() });
    }
    Ok((dims, classes))
}
