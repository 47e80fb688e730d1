//! Arithmetic on a few values at a time, in shapes that compilers turn into vector instructions, and its compilation for the
//! CPU that it runs on.

use half::f16;

/// Values that are computed together.
pub const LANES: usize = 16;

/// One value per lane.
pub type Lanes = [f32; LANES];

/// The first [`LANES`] values of a slice that has as many.
#[inline(always)]
pub fn load(values: &[f32]) -> &Lanes {
    values.first_chunk().expect("a whole block")
}

/// Arithmetic that is compiled once for each kind of CPU. Mark `run` and all that it calls `#[inline(always)]`, and write loops
/// in it: a closure that is not inlined is compiled for the oldest CPU.
pub trait Kernel {
    /// Its result.
    type Output;

    /// Computes it; `FUSED`: the CPU multiplies and adds in one instruction, see [`multiply_add`].
    fn run<const FUSED: bool>(self) -> Self::Output;
}

/// Runs the version of a kernel for this CPU.
#[inline(always)]
pub fn dispatch<K: Kernel>(kernel: K) -> K::Output {
    match pulp::Arch::new() {
        pulp::Arch::Scalar => kernel.run::<false>(),
        arch => arch.dispatch(Fused(kernel)),
    }
}

/// Not a closure: one that is not inlined is compiled for the oldest CPU.
struct Fused<K>(K);

impl<K: Kernel> pulp::NullaryFnOnce for Fused<K> {
    type Output = K::Output;

    #[inline(always)]
    fn call(self) -> K::Output {
        self.0.run::<true>()
    }
}

/// a · b + c; rounded once where the CPU does that at no cost, and twice where a library would have to emulate it.
#[inline(always)]
pub fn multiply_add<const FUSED: bool>(a: f32, b: f32, c: f32) -> f32 {
    if FUSED { a.mul_add(b, c) } else { a * b + c }
}

/// e^x within two units in the last place; x is clamped to ±87.
#[inline(always)]
pub fn exp(x: f32) -> f32 {
    // 1.5 · 2²³: adding it rounds to the nearest integer, which is left in the low bits.
    const ROUND: f32 = 12_582_912.0;
    const LN2: [f32; 2] = [0.693_359_4, -2.121_944_4e-4];
    let x = x.clamp(-87.0, 87.0);
    let rounded = x * std::f32::consts::LOG2_E + ROUND;
    let n = rounded - ROUND;
    let r = x - n * LN2[0] - n * LN2[1];
    // Minimax over ±ln 2 / 2 (Cephes, expf).
    let p = 1.987_569_2e-4;
    let p = p * r + 1.398_199_9e-3;
    let p = p * r + 8.333_452e-3;
    let p = p * r + 4.166_579_6e-2;
    let p = p * r + 1.666_666_5e-1;
    let p = p * r + 5.000_000_3e-1;
    let power = rounded.to_bits().wrapping_sub(ROUND.to_bits()).wrapping_add(127) << 23;
    (p * r * r + r + 1.0) * f32::from_bits(power)
}

/// ln x within two units in the last place, for normal x > 0.
#[inline(always)]
pub fn ln(x: f32) -> f32 {
    const ROOT_HALF: u32 = 0x3f35_04f3;
    const LN2: [f32; 2] = [0.693_138_1, 9.058_001e-6];
    // x = 2^e m with m between √½ and √2.
    let bits = x.to_bits().wrapping_add(1_f32.to_bits() - ROOT_HALF);
    let e = ((bits >> 23) as i32 - 127) as f32;
    let f = f32::from_bits((bits & 0x007f_ffff) + ROOT_HALF) - 1.0;
    // ln(1 + f) in s = f / (2 + f) (FreeBSD, logf).
    let s = f / (2.0 + f);
    let z = s * s;
    let r = z * (0.666_666_6 + z * (0.400_009_7 + z * (0.284_987_87 + z * 0.242_790_79)));
    let half = 0.5 * f * f;
    s * (half + r) + e * LN2[1] - half + f + e * LN2[0]
}

/// The same values in single precision. A loop of its own: one that also adds is not always turned into vector instructions.
#[inline(always)]
pub fn widen<T: Copy + Into<f32>>(values: &[T; LANES]) -> Lanes {
    let mut wide = [0.0; LANES];
    for l in 0..LANES {
        wide[l] = values[l].into();
    }
    wide
}

/// A finite number of half precision in single precision. Integer arithmetic on many at a time; the library converts one or eight.
#[inline(always)]
pub fn single(half: f16) -> f32 {
    // By how much exponents differ, 127 − 15.
    const BIAS: u32 = 112 << 23;
    const LEAST_NORMAL: u32 = 1 << 23;
    let bits = u32::from(half.to_bits());
    let magnitude = (bits & 0x7fff) << 13;
    // What lies below the least normal number has no leading one: it is put there, and its value taken away.
    let below = f32::from_bits(magnitude + BIAS + LEAST_NORMAL) - f32::from_bits(BIAS + LEAST_NORMAL);
    let normal = f32::from_bits(magnitude + BIAS);
    let value = if magnitude < LEAST_NORMAL { below } else { normal };
    f32::from_bits(value.to_bits() | (bits & 0x8000) << 16)
}

/// Finite numbers of half precision in single precision.
pub fn widen_halves(from: &[f16], to: &mut [f32]) {
    dispatch(WidenHalves { from, to });
}

struct WidenHalves<'a> {
    from: &'a [f16],
    to: &'a mut [f32],
}

impl Kernel for WidenHalves<'_> {
    type Output = ();

    #[inline(always)]
    fn run<const FUSED: bool>(self) {
        self.to.iter_mut().zip(self.from).for_each(|(to, from)| *to = single(*from));
    }
}

/// Sum of all lanes, in pairs.
#[inline(always)]
pub fn sum(lanes: &Lanes) -> f32 {
    let eight: [f32; 8] = std::array::from_fn(|l| lanes[l] + lanes[l + 8]);
    let four: [f32; 4] = std::array::from_fn(|l| eight[l] + eight[l + 4]);
    (four[0] + four[2]) + (four[1] + four[3])
}

/// Inner product of the first whole `blocks` of two slices.
#[inline(always)]
pub fn dot_of_blocks<const FUSED: bool>(a: &[f32], b: &[f32], blocks: usize) -> f32 {
    let mut sums = [0.0_f32; LANES];
    for (a, b) in a.as_chunks::<LANES>().0.iter().zip(b.as_chunks::<LANES>().0).take(blocks) {
        for l in 0..LANES {
            sums[l] = multiply_add::<FUSED>(a[l], b[l], sums[l]);
        }
    }
    sum(&sums)
}

/// A value in \[0, 1\] as a byte, times 255 and rounded.
#[inline(always)]
pub fn to_byte(value: f32) -> u8 {
    // 2²³: adding it rounds to an integer, which is left in the low bits.
    const ROUND: f32 = 8_388_608.0;
    (value.clamp(0.0, 1.0) * 255.0 + ROUND).to_bits() as u8
}

/// Inner product over the shorter length, in partial sums that vectorise. The order of the sums is fixed, whatever the CPU.
#[inline(always)]
pub fn dot(a: &[f32], b: &[f32]) -> f32 {
    let n = a.len().min(b.len());
    let long = n - n % 32;
    let short = n - n % 8;
    let tail: f32 = a[short..n].iter().zip(&b[short..n]).map(|(x, y)| x * y).sum();
    partial_sums::<32>(&a[..long], &b[..long]) + partial_sums::<8>(&a[long..short], &b[long..short]) + tail
}

/// Inner product of whole chunks of `N` values.
#[inline(always)]
fn partial_sums<const N: usize>(a: &[f32], b: &[f32]) -> f32 {
    let mut sums = [0.0_f32; N];
    for (x, y) in a.chunks_exact(N).zip(b.chunks_exact(N)) {
        for i in 0..N {
            sums[i] += x[i] * y[i];
        }
    }
    sums.iter().sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exponential_and_logarithm_are_those_of_the_standard_library() {
        for i in -8600..=8600 {
            let x = i as f32 / 100.0 + 0.003;
            let (found, expected) = (f64::from(exp(x)), f64::from(x).exp());
            assert!((found - expected).abs() <= 2.5e-7 * expected, "exp {x}: {found} {expected}");
        }
        assert_eq!((exp(0.0), ln(1.0)), (1.0, 0.0));
        assert!(exp(1e9).is_finite() && exp(-1e9) > 0.0);
        for i in 1..40_000 {
            for x in [i as f32 / 20_000.0, i as f32, f32::MIN_POSITIVE * i as f32] {
                let (found, expected) = (f64::from(ln(x)), f64::from(x).ln());
                assert!(
                    (found - expected).abs() <= 2.5e-7 * expected.abs() + 1e-7 * f64::from((x - 1.0).abs().min(1e-3)),
                    "ln {x}: {found} {expected}"
                );
            }
        }
    }

    #[test]
    fn halves_are_widened_as_the_library_does_it() {
        let finite = |bits: &u16| f16::from_bits(*bits).is_finite();
        let halves: Vec<f16> = (0..=u16::MAX).filter(finite).map(f16::from_bits).collect();
        let mut wide = vec![f32::NAN; halves.len()];
        widen_halves(&halves, &mut wide);
        for (half, wide) in halves.iter().zip(wide) {
            assert_eq!(wide.to_bits(), half.to_f32().to_bits(), "{half}");
        }
    }

    #[test]
    fn blocks_are_multiplied_and_summed() {
        let a: Vec<f32> = (0..40).map(|i| i as f32 - 11.0).collect();
        let b: Vec<f32> = (0..40).map(|i| 0.5 * i as f32).collect();
        // Whole numbers and halves: the sums are exact.
        for blocks in 0..3 {
            let expected: f32 = a.iter().zip(&b).take(blocks * LANES).map(|(a, b)| a * b).sum();
            assert_eq!(dot_of_blocks::<false>(&a, &b, blocks), expected);
        }
    }

    #[test]
    fn bytes_are_rounded() {
        let values: Vec<f32> = (0..=2550).map(|i| i as f32 / 2550.0).collect();
        for value in values {
            assert!((value * 255.0 - f32::from(to_byte(value))).abs() < 0.5001, "{value}");
        }
        assert_eq!([-1.0, 2.0, 1.0].map(to_byte), [0, 255, 255]);
    }
}
