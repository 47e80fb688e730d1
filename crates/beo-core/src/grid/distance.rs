//! The exact Euclidean distance transform in linear time: three passes of the lower envelope of parabolas, one per axis
//! (Felzenszwalb and Huttenlocher, "Distance transforms of sampled functions", Theory of Computing 2012).

use super::Dims;
use fixedbitset::FixedBitSet;

/// Larger than any squared distance in a grid, small enough to be exact in single precision sums.
const FAR: f32 = 1e9;

/// For each voxel the distance from its centre to that of the nearest set voxel, in voxels; all infinite where none is set.
/// `out` gets d values.
pub fn distance_transform(dims: Dims, set: &FixedBitSet, out: &mut Vec<f32>) {
    let [nx, ny, nz] = <[usize; 3]>::from(dims);
    out.clear();
    out.extend((0..dims.voxels()).map(|voxel| if set.contains(voxel) { 0.0 } else { FAR }));
    if set.is_clear() {
        out.fill(f32::INFINITY);
        return;
    }
    let mut line = Envelope::new(nx.max(ny).max(nz));
    for column in 0..nx * ny {
        line.pass(out, column * nz, 1, nz);
    }
    for i in 0..nx {
        for k in 0..nz {
            line.pass(out, i * ny * nz + k, nz, ny);
        }
    }
    for start in 0..ny * nz {
        line.pass(out, start, ny * nz, nx);
    }
    out.iter_mut().for_each(|value| *value = value.sqrt());
}

/// Scratch memory of the passes.
struct Envelope {
    values: Vec<f32>,
    /// Places of the parabolas of the envelope, and from where each is lowest.
    places: Vec<usize>,
    from: Vec<f32>,
}

impl Envelope {
    fn new(longest: usize) -> Self {
        Self { values: vec![0.0; longest], places: vec![0; longest], from: vec![0.0; longest + 1] }
    }

    /// Replaces `n` values f(q), `stride` apart, by min over p of f(p) + (q − p)².
    fn pass(&mut self, data: &mut [f32], start: usize, stride: usize, n: usize) {
        let Self { values, places, from } = self;
        for (q, value) in values.iter_mut().enumerate().take(n) {
            *value = data[start + q * stride];
        }
        let mut last = 0;
        (places[0], from[0]) = (0, f32::NEG_INFINITY);
        for q in 1..n {
            loop {
                let p = places[last];
                let rise = values[q] - values[p] + (q * q) as f32 - (p * p) as f32;
                let crossing = rise / (2 * (q - p)) as f32;
                if crossing > from[last] {
                    last += 1;
                    (places[last], from[last]) = (q, crossing);
                    break;
                }
                if last == 0 {
                    (places[0], from[0]) = (q, f32::NEG_INFINITY);
                    break;
                }
                last -= 1;
            }
        }
        from[last + 1] = f32::INFINITY;
        let mut k = 0;
        for q in 0..n {
            while from[k + 1] < q as f32 {
                k += 1;
            }
            let p = places[k];
            data[start + q * stride] = values[p] + (q.abs_diff(p) * q.abs_diff(p)) as f32;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn without_a_set_voxel_all_is_infinitely_far() {
        let dims = Dims::cube(8).unwrap();
        let mut out = Vec::new();
        distance_transform(dims, &FixedBitSet::with_capacity(512), &mut out);
        assert_eq!(out, vec![f32::INFINITY; 512]);
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(40))]
        #[test]
        fn distances_are_those_of_exhaustive_search(voxels in prop::collection::vec(0..8_usize * 9 * 10, 1..12)) {
            let dims = Dims::new(8, 9, 10).unwrap();
            let mut set = FixedBitSet::with_capacity(dims.voxels());
            voxels.iter().for_each(|v| set.insert(*v));
            let mut out = Vec::new();
            distance_transform(dims, &set, &mut out);
            for (voxel, distance) in out.iter().enumerate() {
                let here = dims.coordinates(voxel);
                let to = |v: &usize| (0..3).map(|a| here[a].abs_diff(dims.coordinates(*v)[a]).pow(2)).sum::<usize>();
                let nearest = voxels.iter().map(to).min().unwrap() as f32;
                prop_assert_eq!(*distance, nearest.sqrt());
            }
        }
    }
}
