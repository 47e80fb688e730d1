//! Completions without a model: by a training shape, or by the mean of all. What was observed stays as observed.

use crate::evaluation::metrics::iou;
use beo_core::grid::{Observation, Occupancy};
use beo_core::learning::Shape;

/// The baselines that the training shapes of a class give for one observation.
pub struct Baselines<'a> {
    observation: &'a Observation,
    /// Number of the shapes.
    pub shapes: usize,
    /// The shape that disagrees with the fewest known voxels; of several the first.
    pub nearest: &'a Shape,
    /// The shape that agrees best with the truth: the greatest intersection over union over the unknown voxels.
    pub nearest_by_oracle: &'a Shape,
    /// Share of the shapes that fill a voxel.
    share: Vec<f32>,
}

impl<'a> Baselines<'a> {
    /// Of some shapes in path order, at least one.
    pub fn new(shapes: impl Iterator<Item = &'a Shape> + Clone, observation: &'a Observation, truth: &Occupancy) -> Self {
        let count = shapes.clone().count();
        assert!(count > 0, "no shape to complete with");
        let mut share = vec![0.0_f32; truth.dims().voxels()];
        shapes.clone().for_each(|shape| shape.object.bits().ones().for_each(|voxel| share[voxel] += 1.0));
        share.iter_mut().for_each(|v| *v /= count as f32);
        let nearest = shapes.clone().min_by_key(|shape| disagreements(observation, &shape.object));
        let agreement = |shape: &Shape| hidden_iou(observation, &shape.object, truth);
        let mut best: Option<(f64, &Shape)> = None;
        for shape in shapes {
            let found = agreement(shape);
            if best.is_none_or(|(least, _)| found > least) {
                best = Some((found, shape));
            }
        }
        let [nearest, nearest_by_oracle] = [nearest, best.map(|(_, shape)| shape)].map(|shape| shape.expect("there is a shape"));
        Self { observation, shapes: count, nearest, nearest_by_oracle, share }
    }

    /// The value of a voxel when a shape stands for all that was not observed.
    pub fn by_shape(&self, shape: &Shape, voxel: usize) -> f32 {
        self.observed(voxel).unwrap_or(f32::from(u8::from(shape.object.bits().contains(voxel))))
    }

    /// The same of the mean of all shapes.
    pub fn by_mean(&self, voxel: usize) -> f32 {
        self.observed(voxel).unwrap_or(self.share[voxel])
    }

    fn observed(&self, voxel: usize) -> Option<f32> {
        self.observation.known().contains(voxel).then(|| f32::from(u8::from(self.observation.filled().contains(voxel))))
    }
}

/// Known voxels that are other than a shape's.
fn disagreements(observation: &Observation, shape: &Occupancy) -> usize {
    let words = observation.known().as_slice().iter().zip(observation.filled().as_slice()).zip(shape.bits().as_slice());
    words.map(|((known, filled), shape)| (known & (filled ^ shape)).count_ones() as usize).sum()
}

/// Intersection over union of two objects over the unknown voxels.
fn hidden_iou(observation: &Observation, a: &Occupancy, b: &Occupancy) -> f64 {
    let words = observation.known().as_slice().iter().zip(a.bits().as_slice()).zip(b.bits().as_slice());
    let (both, either) = words.fold((0, 0), |(both, either), ((known, a), b)| {
        (both + (!known & a & b).count_ones() as usize, either + (!known & (a | b)).count_ones() as usize)
    });
    iou(both, either)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::evaluation::metrics::completion_errors;
    use beo_core::grid::{Dims, View};

    fn shapes() -> Vec<Shape> {
        let dims = Dims::new(8, 9, 10).unwrap();
        let object =
            |n: usize| Occupancy::from_fn(dims, |i, j, k| (i * 3 + j * (n + 2) + k * 7 + i * k * n).is_multiple_of(4 + n) && k < 9 - n);
        (0..5).map(|n| Shape { object: object(n), class: 0, file: format!("{n}") }).collect()
    }

    /// Everything by plain loops over voxels.
    #[test]
    fn nearest_and_mean_are_those_of_plain_loops() {
        let shapes = shapes();
        for (n, left_out) in shapes.iter().enumerate() {
            let observation = View::Top.of(&left_out.object);
            let others = || shapes.iter().filter(|other| other.file != left_out.file);
            let baselines = Baselines::new(others(), &observation, &left_out.object);
            let voxels = 0..left_out.object.dims().voxels();
            let filled = |shape: &Shape, voxel: usize| shape.object.bits().contains(voxel);
            let unlike = |shape: &Shape| voxels.clone().filter(|v| [0, 1][usize::from(filled(shape, *v))] != observation.code(*v)).count();
            // An unknown voxel is unlike every shape's.
            let fewest = others().map(unlike).min().unwrap();
            assert_eq!(baselines.nearest.file, others().find(|s| unlike(s) == fewest).unwrap().file, "{n}");
            let errors = |s: &Shape| completion_errors(&left_out.object, &observation, |v| baselines.by_shape(s, v));
            let best = others().map(|s| errors(s).iou_unknown).fold(0.0, f64::max);
            assert_eq!(errors(baselines.nearest_by_oracle).iou_unknown, best);
            assert_eq!(baselines.shapes, 4);
            for v in voxels.clone() {
                let share = others().filter(|s| filled(s, v)).count() as f32 / 4.0;
                let (by_mean, by_shape) = match observation.code(v) {
                    255 => (share, f32::from(u8::from(filled(baselines.nearest, v)))),
                    code => (f32::from(code), f32::from(code)),
                };
                assert_eq!((baselines.by_mean(v), baselines.by_shape(baselines.nearest, v)), (by_mean, by_shape));
            }
        }
    }

    #[test]
    fn of_equally_near_shapes_the_first_counts() {
        let mut shapes = shapes();
        let twin = Shape { file: "twin".into(), ..shapes[2].clone() };
        shapes.push(twin);
        let observation = View::Top.of(&shapes[2].object);
        let baselines = Baselines::new(shapes.iter(), &observation, &shapes[2].object);
        assert_eq!((&*baselines.nearest.file, &*baselines.nearest_by_oracle.file), ("2", "2"));
    }
}
