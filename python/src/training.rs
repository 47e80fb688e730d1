//! Training on shapes that are NumPy arrays.

use crate::arrays::{bytes, dims, is_array, occupancy};
use crate::failures::{invalid, of_perceiving, of_training};
use beo_core::grid::Dims;
use beo_core::learning::{FEWEST_SHAPES, Shape, ShapeSet, Step, TrainOptions, train};
use beo_core::model::{LONGEST_CLASS_NAME, MOST_CLASSES, MOST_COMPONENTS};
use beo_core::perception::Perceiver;
use pyo3::exceptions::PyUserWarning;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::collections::HashSet;
use std::ffi::CString;
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::sync::Arc;

/// Filled voxels of a shape at least.
const FEWEST_VOXELS: usize = 16;

/// The training set: each class's shapes by its name.
pub fn shapes(given: &Bound<'_, PyDict>) -> PyResult<ShapeSet> {
    let py = given.py();
    let mut classes: Vec<(String, Bound<'_, PyAny>)> =
        given.iter().map(|(name, shapes)| Ok((name.extract()?, shapes))).collect::<PyResult<_>>()?;
    classes.sort_by(|a, b| a.0.cmp(&b.0));
    if classes.is_empty() || classes.len() > MOST_CLASSES {
        return Err(invalid(format!(
            "shapes: {} classes; give 1 to {MOST_CLASSES}, as {{\"mug\": array, \"bowl\": array}}",
            classes.len()
        )));
    }
    let mut set = ShapeSet::default();
    for (class, (name, given)) in classes.iter().enumerate() {
        if name.is_empty() || name.len() > LONGEST_CLASS_NAME || name.chars().any(char::is_control) {
            return Err(invalid(format!(
                "shapes: the class name {name:?} has {} bytes; use 1 to {LONGEST_CLASS_NAME}, printable",
                name.len()
            )));
        }
        let (mut known, mut twice) = (HashSet::new(), 0);
        for (number, (dims, voxels)) in grids(given, name)?.into_iter().enumerate() {
            let file = format!("shapes[{name:?}][{number}]");
            let object = occupancy(dims, &voxels, &file)?;
            if object.count() < FEWEST_VOXELS {
                let count = object.count();
                return Err(invalid(format!("{file}: {count} voxels are filled; a shape has at least {FEWEST_VOXELS}: leave it out")));
            }
            if !known.insert(object.clone()) {
                twice += 1;
                continue;
            }
            set.shapes.push(Shape { object, class, file });
        }
        if known.len() < FEWEST_SHAPES {
            let count = known.len();
            return Err(invalid(format!("shapes[{name:?}]: {count} different shapes; at least {FEWEST_SHAPES} are needed")));
        }
        if twice > 0 {
            let text = format!("shapes[{name:?}]: duplicates are left out, {twice} in number");
            let text = CString::new(text).map_err(invalid)?;
            PyErr::warn(py, &py.get_type::<PyUserWarning>(), &text, 2)?;
        }
    }
    set.classes = classes.into_iter().map(|(name, _)| name).collect();
    Ok(set)
}

/// The shapes of one class: an array of four axes, or a sequence of arrays of three.
fn grids(given: &Bound<'_, PyAny>, name: &str) -> PyResult<Vec<(Dims, Vec<u8>)>> {
    let label = format!("shapes[{name:?}]");
    if is_array(given)? {
        let (shape, bytes) = bytes(given, &label)?;
        let &[count, ref sides @ ..] = &shape[..] else { return Err(invalid(format!("`{label}` has no axes: give (n, x, y, z)"))) };
        if sides.len() != 3 {
            return Err(invalid(format!("`{label}` has the shape {shape:?}: give (n, x, y, z)")));
        }
        let dims = dims(sides, &label)?;
        return Ok((0..count).map(|n| (dims, bytes[n * dims.voxels()..(n + 1) * dims.voxels()].to_vec())).collect());
    }
    let one = |(number, grid): (usize, PyResult<Bound<'_, PyAny>>)| {
        let label = format!("{label}[{number}]");
        let (shape, bytes) = bytes(&grid?, &label)?;
        Ok((dims(&shape, &label)?, bytes))
    };
    given.try_iter()?.enumerate().map(one).collect()
}

/// The options of a training.
pub fn options(set: &ShapeSet, poses: bool, (least, most): (usize, usize), seed: u64) -> PyResult<TrainOptions> {
    if least == 0 || least > most || most > MOST_COMPONENTS {
        return Err(invalid(format!("components are ({least}, {most}): use (least, most) with 1 ≤ least ≤ most ≤ {MOST_COMPONENTS}")));
    }
    let side = |shape: &Shape| shape.object.bounds().map_or(0, |[low, high]| (0..3).map(|a| high[a] - low[a]).max().unwrap_or(0));
    let longest_side = set.shapes.iter().map(side).max().unwrap_or(0);
    Ok(TrainOptions { poses, basis_range: [least, most], seed, longest_side, ..TrainOptions::default() })
}

/// The training is left where it stands, as Ctrl-C or `progress` raised this.
struct Left(PyErr);

/// Learns, without the interpreter's lock but for the calls of `progress`.
pub fn learn(py: Python<'_>, set: &ShapeSet, options: &TrainOptions, progress: Option<&Py<PyAny>>) -> PyResult<Perceiver> {
    let look = |step: Step| {
        let looked = Python::attach(|py| {
            py.check_signals()?;
            match progress.filter(|_| step.pass.is_none()) {
                Some(progress) => progress.call1(py, (step.name, step.done, step.total)).map(drop),
                None => Ok(()),
            }
        });
        // The training has no way to be told to end: it is unwound, as by a panic, without the message of one.
        if let Err(error) = looked {
            resume_unwind(Box::new(Left(error)));
        }
    };
    let trained = py.detach(|| catch_unwind(AssertUnwindSafe(|| train(set, options, &look))));
    let model = match trained {
        Ok(model) => model.map_err(|error| of_training(&error))?,
        Err(cause) => match cause.downcast::<Left>() {
            Ok(left) => return Err(left.0),
            Err(panic) => resume_unwind(panic),
        },
    };
    py.detach(|| Perceiver::new(Arc::new(model))).map_err(|error| of_perceiving(&error))
}
