//! Regions of pixels that hang together along rows and columns, as runs of pixels along rows (union–find over runs: Rosenfeld and Pfaltz,
//! "Sequential operations in digital picture processing", 1966).

/// Pixels of a row from `start` to before `end`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Run {
    /// The row.
    pub row: usize,
    /// Its first pixel's column.
    pub start: usize,
    /// The column after its last pixel's.
    pub end: usize,
}

/// A part of the image: columns and rows from the first to before the second number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Window {
    /// Columns.
    pub columns: [usize; 2],
    /// Rows.
    pub rows: [usize; 2],
}

/// Regions of a window of an image.
#[derive(Clone, Debug)]
pub struct Regions {
    runs: Vec<Run>,
    /// Of each run the number of its region, from 0 on.
    regions: Vec<usize>,
    count: usize,
}

impl Regions {
    /// The regions of the pixels that belong to any, in an image `width` pixels wide.
    pub fn find(width: usize, window: Window, belongs: impl Fn(usize) -> bool) -> Self {
        let (mut runs, mut parents): (Vec<Run>, Vec<usize>) = (Vec::new(), Vec::new());
        let mut above = 0..0;
        for row in window.rows[0]..window.rows[1] {
            let first = runs.len();
            let mut column = window.columns[0];
            let mut before = above.start;
            while column < window.columns[1] {
                if !belongs(row * width + column) {
                    column += 1;
                    continue;
                }
                let start = column;
                while column < window.columns[1] && belongs(row * width + column) {
                    column += 1;
                }
                let number = runs.len();
                runs.push(Run { row, start, end: column });
                parents.push(number);
                // Runs of both rows ascend: those that end before this one begins touch none that follows.
                while before < above.end && runs[before].end <= start {
                    before += 1;
                }
                let touching = (before..above.end).take_while(|other| runs[*other].start < column);
                for other in touching {
                    let (a, b) = (root(&mut parents, other), root(&mut parents, number));
                    parents[a.max(b)] = a.min(b);
                }
            }
            above = first..runs.len();
        }
        let mut count = 0;
        let mut regions = vec![0; runs.len()];
        for run in 0..runs.len() {
            // The first run of a region is its root.
            let root = root(&mut parents, run);
            regions[run] = if root == run { count } else { regions[root] };
            count += usize::from(root == run);
        }
        Self { runs, regions, count }
    }

    /// How many there are.
    pub fn count(&self) -> usize {
        self.count
    }

    /// All runs, each with the number of its region; row by row.
    pub fn runs(&self) -> impl Iterator<Item = (&Run, usize)> {
        self.runs.iter().zip(self.regions.iter().copied())
    }
}

fn root(parents: &mut [usize], mut run: usize) -> usize {
    while parents[run] != run {
        parents[run] = parents[parents[run]];
        run = parents[run];
    }
    run
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn regions_hang_together_along_rows_and_columns() {
        let picture = "
            ##.#.###
            .#.#.#.#
            .###...#
            #...####";
        let rows: Vec<&str> = picture.split_whitespace().collect();
        let belongs = |pixel: usize| rows[pixel / 8].as_bytes()[pixel % 8] == b'#';
        let all = Regions::find(8, Window { columns: [0, 8], rows: [0, 4] }, belongs);
        let mut sizes = vec![0; all.count()];
        all.runs().for_each(|(run, region)| sizes[region] += run.end - run.start);
        assert_eq!(sizes, [8, 10, 1]);
        let part = Regions::find(8, Window { columns: [0, 4], rows: [0, 2] }, belongs);
        assert_eq!(part.count(), 2);
    }
}
