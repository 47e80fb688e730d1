//! Views from above of objects that are turned in any way: a Gaussian of hull features for each class and each direction that
//! may point up.

use half::f16;

/// Directions of the object that are distinguished.
pub const DIRECTIONS: usize = 192;

/// Gaussians of the features z = Bᵀ · pooled hull of the object turned by E F_d (d points up, E is small): p features, m classes.
#[derive(Clone, Debug, PartialEq)]
pub struct ViewDensities {
    /// Number of features, p.
    pub size: usize,
    /// B, one row of p values per cell of the pooled grid.
    pub basis: Vec<f16>,
    /// Means, `[direction][class]`, p values each.
    pub means: Vec<f16>,
    /// Rows of L⁻¹ of the covariances S = L Lᵀ, lower triangular and packed (row i has i + 1 values), `[direction][class]`.
    pub whitening: Vec<f16>,
    /// Regression of the rotation vector of E, in radians, on z less its mean: Cov(E, z) S⁻¹, `[direction][class]`, 3 × p each.
    pub regression: Vec<f16>,
}

impl ViewDensities {
    /// Length of a packed lower triangle, p (p + 1) / 2.
    pub fn packed(size: usize) -> usize {
        size * (size + 1) / 2
    }

    /// Number of classes, m.
    pub fn classes(&self) -> usize {
        self.means.len() / (DIRECTIONS * self.size).max(1)
    }

    /// The mean of a class at a direction, of `classes`.
    pub fn mean(&self, direction: usize, class: usize, classes: usize) -> &[f16] {
        block(&self.means, direction * classes + class, self.size)
    }

    /// The packed L⁻¹ of a class at a direction, of `classes`.
    pub fn whitening(&self, direction: usize, class: usize, classes: usize) -> &[f16] {
        block(&self.whitening, direction * classes + class, Self::packed(self.size))
    }

    /// The regression of a class at a direction, of `classes`.
    pub fn regression(&self, direction: usize, class: usize, classes: usize) -> &[f16] {
        block(&self.regression, direction * classes + class, 3 * self.size)
    }
}

fn block(values: &[f16], index: usize, size: usize) -> &[f16] {
    &values[index * size..(index + 1) * size]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every value is its own place, modulo what half precision holds exactly.
    #[test]
    fn blocks_stand_by_direction_then_class_and_leave_nothing_out() {
        let (size, classes) = (3, 2);
        let count =
            |each: usize| -> Vec<f16> { (0..DIRECTIONS * classes * each).map(|place| f16::from_f32((place % 2048) as f32)).collect() };
        let densities = ViewDensities { size, basis: vec![], means: count(3), whitening: count(6), regression: count(9) };
        assert_eq!((densities.classes(), ViewDensities::packed(3)), (2, 6));
        let (mut means, mut whitening, mut regression) = (Vec::new(), Vec::new(), Vec::new());
        for (direction, class) in (0..DIRECTIONS).flat_map(|direction| (0..classes).map(move |class| (direction, class))) {
            means.extend_from_slice(densities.mean(direction, class, classes));
            whitening.extend_from_slice(densities.whitening(direction, class, classes));
            regression.extend_from_slice(densities.regression(direction, class, classes));
        }
        assert_eq!((means, whitening, regression), (densities.means, densities.whitening, densities.regression));
    }
}
