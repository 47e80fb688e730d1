//! The rotations of an evaluation, drawn so that each query's depends on the seed and its place alone.

use beo_core::grid::{Rotation, uniform_rotation, yaw};
use beo_core::perception::PoseSearch;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// The true rotation of the query at `place` among all: uniform over what is searched.
pub fn draw_rotation(pose: PoseSearch, seed: u64, place: usize) -> Rotation {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    rng.set_stream(place as u64 + 1);
    let numbers: [f64; 3] = std::array::from_fn(|_| rng.random_range(0.0..1.0));
    match pose {
        PoseSearch::Known => Rotation::identity(),
        PoseSearch::Yaw { span } => yaw(numbers[0] * span),
        PoseSearch::Full => uniform_rotation(numbers),
    }
}
