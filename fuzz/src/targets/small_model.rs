//! The smallest model that can be trained, of made-up furniture.

use beo_core::grid::Dims;
use beo_core::learning::{FEWEST_SHAPES, Shape, ShapeSet, TrainOptions, train};
use beo_core::model::{Model, Searched, ViewDensities, load, save};
use beo_shapes::furniture;
use std::path::PathBuf;
use std::sync::Arc;

/// Voxels along each side.
pub const SIDE: usize = 8;

const CLASSES: [&str; 2] = ["chair", "table"];

/// The model, loaded from its file.
pub fn model() -> Model {
    let path = scratch_file("small-model");
    let result = save(&learned(), &path).and_then(|()| load(&path));
    let _ = std::fs::remove_file(&path);
    result.expect("a model that was just saved")
}

/// The bytes of its file.
pub fn bytes() -> Vec<u8> {
    let path = scratch_file("small-model-bytes");
    save(&learned(), &path).expect("a place for temporary files");
    let bytes = std::fs::read(&path).expect("what was just saved");
    let _ = std::fs::remove_file(&path);
    bytes
}

fn learned() -> Model {
    let dims = Dims::cube(SIDE).expect("a size of a grid");
    let shape = |class: usize, seed: usize| Shape {
        object: furniture::make(CLASSES[class], dims, seed as u64).expect("a class of the generator"),
        class,
        file: format!("{class}/{seed}"),
    };
    let shapes = ShapeSet {
        classes: CLASSES.map(String::from).to_vec(),
        shapes: (0..CLASSES.len()).flat_map(|class| (0..FEWEST_SHAPES + 8).map(move |seed| shape(class, seed))).collect(),
        lengths_m: None,
        fine: None,
    };
    let options = TrainOptions { basis_range: [2, 3], folds: 2, ..TrainOptions::default() };
    let mut model = train(&shapes, &options, &|_| ()).expect("shapes that can be learned");
    // The view densities are most of the file: their first features are a smaller model of the same kind.
    let Searched::Here { views, .. } = &mut model.searched else { panic!("learned for a grid that is searched") };
    let views = Arc::make_mut(views);
    let (size, few) = (views.size, views.size.min(2));
    views.basis = first(&views.basis, size, few);
    views.means = first(&views.means, size, few);
    views.whitening = first(&views.whitening, ViewDensities::packed(size), ViewDensities::packed(few));
    views.regression = first(&views.regression, size, few);
    views.size = few;
    model
}

/// The first `kept` of every `of` values.
fn first<T: Copy>(values: &[T], of: usize, kept: usize) -> Vec<T> {
    values.chunks_exact(of).flat_map(|row| row[..kept].iter().copied()).collect()
}

/// A file of this process alone.
pub fn scratch_file(name: &str) -> PathBuf {
    std::env::temp_dir().join(format!("beo-fuzz-{name}-{}.safetensors", std::process::id()))
}
