//! How a shape is turned, scaled and moved: what the descent changes, and the similarity that it stands for.

use beo_core::grid::Rotation;
use nalgebra::{Point3, Vector3};

/// Takes input coordinates x to output coordinates `scale` · `rotation` · x + `translation`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ShapeSimilarity {
    /// First turned …
    pub rotation: Rotation,
    /// … and scaled …
    pub scale: f64,
    /// … then moved, in output coordinates.
    pub translation: Vector3<f64>,
}

impl ShapeSimilarity {
    /// A rotation alone.
    pub fn turning(rotation: Rotation) -> Self {
        Self { rotation, scale: 1.0, translation: Vector3::zeros() }
    }

    /// Where a point came from.
    pub fn place_back(&self, point: &Point3<f64>) -> Point3<f64> {
        Point3::from(self.rotation.inverse() * (point.coords - self.translation) / self.scale)
    }

    /// Where a point goes.
    pub fn place(&self, point: &Point3<f64>) -> Point3<f64> {
        Point3::from(self.scale * (self.rotation * point.coords) + self.translation)
    }

    /// This one after `first`.
    pub fn after(&self, first: &Self) -> Self {
        Self {
            rotation: self.rotation * first.rotation,
            scale: self.scale * first.scale,
            translation: self.place(&Point3::from(first.translation)).coords,
        }
    }
}

/// The seven numbers of one shape: it is turned about its centre of mass.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Pose {
    pub rotation: Rotation,
    /// Of the scale in units of that which the normalisation gave.
    pub log_scale: f64,
    /// Where the centre of mass goes.
    pub centre: Vector3<f64>,
}

/// How far one step of the descent goes along each of the seven numbers.
pub(super) type Steps = [f64; 7];

impl Pose {
    /// One step along a number: rotations about x, y, z in radians, the logarithm of the scale, the centre along x, y, z.
    pub fn moved(&self, number: usize, step: f64) -> Self {
        let mut moved = *self;
        match number {
            0..3 => {
                let axis = nalgebra::Unit::new_unchecked(Vector3::ith(number, 1.0));
                moved.rotation = Rotation::from_axis_angle(&axis, step) * self.rotation;
            }
            3 => moved.log_scale += step,
            _ => moved.centre[number - 4] += step,
        }
        moved
    }

    /// Turned about the shape's own centre.
    pub fn turned(&self, rotation: &Rotation) -> Self {
        Self { rotation: rotation * self.rotation, ..*self }
    }

    /// The similarity for a shape of this centre and unit of scale.
    pub fn similarity(&self, centre: &Vector3<f64>, unit: f64) -> ShapeSimilarity {
        let scale = unit * self.log_scale.exp();
        ShapeSimilarity { rotation: self.rotation, scale, translation: self.centre - scale * (self.rotation * centre) }
    }

    /// Where it lies as seen from `base`.
    pub fn seen_from(&self, base: &Self) -> Self {
        let back = base.rotation.inverse();
        Self {
            rotation: back * self.rotation,
            log_scale: self.log_scale - base.log_scale,
            centre: back * (self.centre - base.centre) * (-base.log_scale).exp(),
        }
    }

    /// The transform as seen from here.
    pub fn carrying(&self, relative: &Self) -> Self {
        Self {
            rotation: self.rotation * relative.rotation,
            log_scale: self.log_scale + relative.log_scale,
            centre: self.centre + self.rotation * relative.centre * self.log_scale.exp(),
        }
    }
}
