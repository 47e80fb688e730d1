//! A small model of made-up furniture, for the tests of the search.

use crate::furniture;
use crate::grid::{Dims, Occupancy};
use crate::learning::{Shape, ShapeSet};
use crate::learning::{TrainOptions, train};
use crate::model::Model;
use crate::perception::Perceiver;
use std::sync::{Arc, OnceLock};

const CLASSES: [&str; 3] = ["chair", "monitor", "sofa"];
const SHAPES: u64 = 24;

fn dims() -> Dims {
    Dims::cube(16).expect("a valid size")
}

/// The model, trained once.
pub fn perceiver() -> &'static Perceiver {
    static PERCEIVER: OnceLock<Perceiver> = OnceLock::new();
    PERCEIVER.get_or_init(|| learn(Vec::new()))
}

/// The same that also knows what cameras see, from 20 to 50 degrees above the horizontal.
pub fn seeing_perceiver() -> &'static Perceiver {
    static PERCEIVER: OnceLock<Perceiver> = OnceLock::new();
    PERCEIVER.get_or_init(|| learn(vec![20.0, 50.0]))
}

fn learn(camera_elevations_deg: Vec<f64>) -> Perceiver {
    let make = |class: usize, seed: u64| Shape {
        object: furniture::make(CLASSES[class], dims(), seed).expect("a class of the generator"),
        class,
        file: format!("{class}/{seed}"),
    };
    let shapes = ShapeSet {
        classes: CLASSES.map(String::from).to_vec(),
        shapes: (0..CLASSES.len()).flat_map(|class| (0..SHAPES).map(move |seed| make(class, seed))).collect(),
        ..ShapeSet::default()
    };
    let longest_side = crate::grid::longest_side(dims());
    let options = TrainOptions { basis_range: [5, 20], camera_elevations_deg, longest_side, ..TrainOptions::default() };
    let model = train(&shapes, &options, &|_| ()).expect("shapes that can be learned");
    Perceiver::new(Arc::new(model)).expect("a usable model")
}

/// The model alone.
pub fn model() -> &'static Model {
    perceiver().model()
}

/// A shape that the model was not trained on.
pub fn unseen(class: &str, seed: u64) -> Occupancy {
    furniture::make(class, dims(), 1000 + seed).expect("a class of the generator")
}
