//! Grades levels of neighbouring nodes, and finds the nodes beside jumps.

use rayon::prelude::*;

use crate::sample::field::gradient::step_along;

/// Dimensions of an array of nodes, and the periods of indices that close.
#[derive(Debug, Clone, Copy)]
pub(super) struct Extent {
    pub(super) dims: [usize; 3],
    pub(super) periods: [Option<usize>; 3],
}

impl Extent {
    pub(super) fn len(&self) -> usize {
        self.dims.iter().product()
    }

    pub(super) fn node(&self, n: usize) -> [usize; 3] {
        let [ni, nj, _] = self.dims;
        [n % ni, n / ni % nj, n / (ni * nj)]
    }

    pub(super) fn number(&self, [i, j, k]: [usize; 3]) -> usize {
        i + self.dims[0] * (j + self.dims[1] * k)
    }

    /// Returns the index some steps away, held to the ends of an index that does not close.
    pub(super) fn held(&self, axis: usize, at: usize, by: isize) -> usize {
        step_along(at, by, self.dims[axis], self.periods[axis]).unwrap_or(match by < 0 {
            true => 0,
            false => self.dims[axis] - 1,
        })
    }

    /// Combines each entry with those up to `reach` nodes away along every index.
    fn combined<T: Copy + Send + Sync>(
        &self,
        mut entries: Vec<T>,
        reach: isize,
        combine: impl Fn(T, T) -> T + Sync,
    ) -> Vec<T> {
        let [ni, nj, _] = self.dims;
        for axis in 0..3 {
            let mut all = entries.clone();
            let rows = all.par_chunks_mut(ni.max(1)).enumerate();
            rows.for_each(|(row, all)| {
                let of_row = [0, row % nj, row / nj];
                let row_at = |[_, j, k]: [usize; 3]| &entries[ni * (j + nj * k)..][..ni];
                for by in (-reach..=reach).filter(|&by| by != 0) {
                    if axis == 0 {
                        let own = row_at(of_row);
                        for (i, all) in all.iter_mut().enumerate() {
                            *all = combine(*all, own[self.held(0, i, by)]);
                        }
                    } else {
                        let mut to = of_row;
                        to[axis] = self.held(axis, of_row[axis], by);
                        for (all, other) in all.iter_mut().zip(row_at(to)) {
                            *all = combine(*all, *other);
                        }
                    }
                }
            });
            entries = all;
        }
        entries
    }

    /// Raises levels until neighbours differ by one at most along each index.
    ///
    /// - `may_split`: false for nodes whose cells cannot be split.
    pub(super) fn grade(&self, levels: &mut Vec<[u8; 3]>, may_split: &[bool]) {
        loop {
            let greatest = self.combined(levels.clone(), 1, |a, b| {
                [0, 1, 2].map(|axis| a[axis].max(b[axis]))
            });
            let raise = |(n, level): (usize, &mut [u8; 3])| {
                let raised = [0, 1, 2].map(|a| level[a].max(greatest[n][a].saturating_sub(1)));
                let changes = may_split[n] && raised != *level;
                if changes {
                    *level = raised;
                }
                changes
            };
            let changed = levels.par_iter_mut().enumerate().map(raise);
            if !changed.reduce(|| false, |a, b| a | b) {
                return;
            }
        }
    }

    /// Returns true for each node for which, and for all of whose neighbours, a property holds.
    pub(super) fn all_around(&self, holds: Vec<bool>) -> Vec<bool> {
        self.combined(holds, 1, |a, b| a && b)
    }

    /// Returns true for each node with another level among the nodes up to `reach` away.
    pub(super) fn beside_jumps(&self, levels: &[[u8; 3]], reach: isize) -> Vec<bool> {
        let both: Vec<[[u8; 3]; 2]> = levels.iter().map(|&level| [level; 2]).collect();
        let both = self.combined(both, reach, |a, b| {
            let each = |of: fn(u8, u8) -> u8, n: usize| [0, 1, 2].map(|i| of(a[n][i], b[n][i]));
            [each(u8::min, 0), each(u8::max, 1)]
        });
        both.into_iter()
            .map(|[least, most]| least != most)
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn graded_levels_differ_by_one_between_neighbours() {
        let extent = Extent {
            dims: [9, 8, 7],
            periods: [None, Some(7), None],
        };
        let mut levels = vec![[0; 3]; extent.len()];
        levels[extent.number([4, 0, 3])] = [4, 0, 2];
        let mut may_split = vec![true; extent.len()];
        let fixed = extent.number([6, 0, 3]);
        may_split[fixed] = false;
        extent.grade(&mut levels, &may_split);
        assert_eq!(levels[fixed], [0; 3]);
        // Across the seam of the closed index.
        assert_eq!(levels[extent.number([4, 6, 3])], [3, 0, 1]);
        for n in (0..extent.len()).filter(|&n| may_split[n]) {
            let [i, j, k] = extent.node(n);
            for (axis, by) in [(0, 1), (1, 1), (2, 1), (0, -1), (1, -1), (2, -1)] {
                let mut to = [i, j, k];
                to[axis] = extent.held(axis, to[axis], by);
                let other = levels[extent.number(to)];
                assert!((0..3).all(|a| other[a] <= levels[n][a] + 1), "{n} {to:?}");
            }
        }
    }
}
