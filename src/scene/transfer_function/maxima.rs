//! Finds the greatest of any run of a table's entries, in constant time.

use crate::constants::CLASSIFICATION_TABLE_LEN;

/// `rows[p][i]`: the greatest of entries i .. i + 2^p (a sparse table).
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Maxima {
    rows: Vec<Vec<f32>>,
}

impl Maxima {
    /// Builds the rows from [`CLASSIFICATION_TABLE_LEN`] entries, none of them NaN.
    pub(super) fn new(entries: Vec<f32>) -> Self {
        debug_assert_eq!(entries.len(), CLASSIFICATION_TABLE_LEN);
        let len = entries.len();
        let mut rows = vec![entries];
        let mut run = 1;
        while 2 * run <= len {
            let shorter = &rows[rows.len() - 1];
            let longer = (0..=len - 2 * run)
                .map(|i| shorter[i].max(shorter[i + run]))
                .collect();
            rows.push(longer);
            run *= 2;
        }
        Self { rows }
    }

    /// The greatest of entries `first..=last`.
    pub(super) fn greatest(&self, first: usize, last: usize) -> f32 {
        let level = (last - first + 1).ilog2() as usize;
        let row = &self.rows[level];
        row[first].max(row[last + 1 - (1 << level)])
    }

    #[cfg(feature = "gpu")]
    pub(super) fn rows(&self) -> &[Vec<f32>] {
        &self.rows
    }
}
