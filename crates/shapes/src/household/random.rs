//! Random numbers of things.

use rand::RngExt;
use rand_chacha::ChaCha8Rng;

pub(super) struct Random(pub ChaCha8Rng);

impl Random {
    pub fn within(&mut self, low: f64, high: f64) -> f64 {
        self.0.random_range(low..high)
    }

    pub fn chance(&mut self, probability: f64) -> bool {
        self.0.random_range(0.0..1.0) < probability
    }

    pub fn one_of<T: Copy>(&mut self, things: &[T]) -> T {
        things[self.0.random_range(0..things.len())]
    }

    /// Log-uniform: every factor is as probable as any other.
    pub fn about(&mut self, low: f64, high: f64) -> f64 {
        self.within(low.ln(), high.ln()).exp()
    }
}
