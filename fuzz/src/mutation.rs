//! From good inputs to hostile ones: flips, splices, truncations, repeats, and numbers at the limits of their types.

use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Longest input that is made.
const LONGEST: usize = 1 << 16;

/// Numbers as text that parsers may stumble over.
const NUMBERS: [&str; 22] = [
    "0",
    "-1",
    "1",
    "255",
    "256",
    "257",
    "65535",
    "65536",
    "2147483647",
    "-2147483648",
    "4294967295",
    "4294967296",
    "9223372036854775807",
    "-9223372036854775808",
    "18446744073709551615",
    "99999999999999999999999",
    "1e400",
    "-1e39",
    "1e-400",
    "nan",
    "inf",
    "3.4028236e38",
];

/// Makes hostile inputs; the same seed gives the same ones.
pub struct Mutator {
    seeds: Vec<Vec<u8>>,
    random: ChaCha8Rng,
}

impl Mutator {
    /// From these good inputs.
    pub fn new(seeds: Vec<Vec<u8>>, seed: u64) -> Self {
        Self { seeds, random: ChaCha8Rng::seed_from_u64(seed) }
    }

    /// The next input.
    pub fn next_input(&mut self, input: &mut Vec<u8>) {
        input.clear();
        let first = self.pick();
        input.extend_from_slice(&self.seeds[first]);
        // Mostly few changes, so that what comes after the first check is reached too.
        let changes = 1 << self.random.random_range(0..6_u32);
        for _ in 0..self.random.random_range(1..=changes) {
            self.change(input);
        }
        input.truncate(LONGEST.max(self.seeds[first].len()));
    }

    fn pick(&mut self) -> usize {
        self.random.random_range(0..self.seeds.len())
    }

    fn change(&mut self, input: &mut Vec<u8>) {
        if input.is_empty() {
            input.push(self.random.random());
        }
        let at = self.place(input.len());
        match self.random.random_range(0..10_u32) {
            0 | 1 => input[at] ^= 1 << self.random.random_range(0..8_u32),
            2 => input[at] = *self.choice(&[0, 1, 2, 127, 128, 254, 255, b' ', b'\n', b'"', b'-', b'/', b'[', b'{']),
            3 => {
                let mut bytes = vec![0; self.random.random_range(1..9)];
                self.random.fill_bytes(&mut bytes);
                input.splice(at..at, bytes);
            }
            4 => drop(input.drain(at..self.end(at, input.len()))),
            5 => {
                let part = input[at..self.end(at, input.len())].to_vec();
                let to = self.place(input.len());
                let times = self.random.random_range(1..=3);
                (0..times).for_each(|_| drop(input.splice(to..to, part.iter().copied())));
            }
            6 => self.integer(input, at),
            7 => self.number(input, at),
            8 => {
                let other = self.pick();
                let other = &self.seeds[other];
                let from = self.random.random_range(0..other.len());
                input.truncate(at);
                input.extend_from_slice(&other[from..]);
            }
            _ => input.truncate(at),
        }
    }

    /// Half of all places lie in the first 512 bytes, where the headers are.
    fn place(&mut self, len: usize) -> usize {
        let end = if self.random.random() { len.min(512) } else { len };
        self.random.random_range(0..end.max(1))
    }

    fn end(&mut self, at: usize, len: usize) -> usize {
        (at + self.random.random_range(1..64_usize)).min(len)
    }

    fn choice<'a, T>(&mut self, choices: &'a [T]) -> &'a T {
        &choices[self.random.random_range(0..choices.len())]
    }

    /// A binary number at a limit, in either byte order.
    fn integer(&mut self, input: &mut [u8], at: usize) {
        let width = *self.choice(&[2, 4, 8]);
        let value =
            *self.choice(&[0, 1, 255, 65535, 1 << 16, i32::MAX as u64, 1 << 31, u64::from(u32::MAX), 1 << 32, i64::MAX as u64, u64::MAX]);
        let float = *self.choice(&[f64::NAN, f64::INFINITY, f64::MAX, f64::MIN_POSITIVE, -0.0, 1e30]);
        let mut bytes = match self.random.random_range(0..4_u32) {
            0 => (float as f32).to_le_bytes().to_vec(),
            1 => float.to_le_bytes().to_vec(),
            _ => value.to_le_bytes()[..width].to_vec(),
        };
        if self.random.random() {
            bytes.reverse();
        }
        let end = (at + bytes.len()).min(input.len());
        input[at..end].copy_from_slice(&bytes[..end - at]);
    }

    /// A number as text in place of the one at or after `at`.
    fn number(&mut self, input: &mut Vec<u8>, at: usize) {
        let Some(start) = input[at..].iter().position(u8::is_ascii_digit).map(|n| at + n) else { return };
        let end = input[start..].iter().position(|b| !b.is_ascii_digit()).map_or(input.len(), |n| start + n);
        let number = *self.choice(&NUMBERS);
        input.splice(start..end, number.bytes());
    }
}
