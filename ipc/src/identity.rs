//! Numbers that tell one producer or one run of a daemon from another.

use std::hash::{BuildHasher, Hasher, RandomState};

/// A number that no other producer or daemon of this machine has, but for a chance of 2⁻⁶⁴; never 0.
pub(crate) fn unique_id() -> u64 {
    // RandomState is keyed from the system's random numbers, once per process; process and time separate what the keys alone would not.
    let mut hasher = RandomState::new().build_hasher();
    hasher.write_u32(std::process::id());
    hasher.write_u64(crate::clock::monotonic_ns());
    hasher.finish().max(1)
}

#[cfg(test)]
mod tests {
    #[test]
    fn ids_differ() {
        let ids: std::collections::HashSet<_> = (0..1000).map(|_| super::unique_id()).collect();
        assert_eq!(ids.len(), 1000);
        assert!(!ids.contains(&0));
    }
}
