//! Merging of what is scored into modes: greedily, the best that is left takes all that lie near it.

/// Modes among `0..count`, which are in falling order of their score. Keeps its memory from use to use.
#[derive(Clone, Debug, Default)]
pub struct Merging {
    taken: Vec<bool>,
    next: usize,
}

impl Merging {
    /// Begins with `count` members that belong to no mode.
    pub fn start(&mut self, count: usize) {
        self.taken.clear();
        self.taken.resize(count, false);
        self.next = 0;
    }

    /// The peak of the next mode, the best member that is left; `member` is called with each member that lies `near` it, itself the first.
    pub fn next(&mut self, near: impl Fn(usize, usize) -> bool, mut member: impl FnMut(usize)) -> Option<usize> {
        let peak = (self.next..self.taken.len()).find(|i| !self.taken[*i])?;
        self.next = peak + 1;
        for other in peak..self.taken.len() {
            if !self.taken[other] && (other == peak || near(peak, other)) {
                self.taken[other] = true;
                member(other);
            }
        }
        Some(peak)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_best_that_is_left_takes_what_lies_near() {
        let places = [5.0_f64, 9.0, 5.5, 8.2, 20.0];
        let mut merging = Merging::default();
        merging.start(places.len());
        let mut modes = Vec::new();
        loop {
            let mut members = Vec::new();
            let Some(peak) = merging.next(|a, b| (places[a] - places[b]).abs() <= 1.0, |m| members.push(m)) else { break };
            modes.push((peak, members));
        }
        assert_eq!(modes, [(0, vec![0, 2]), (1, vec![1, 3]), (4, vec![4])]);
    }
}
