//! Selects parts of arrays with values of any type.

use std::ops::Range;

use crate::data::association::Association;
use crate::data::dataset::{Dataset, FieldSource};
use crate::scene::{Values, of_same_type};

/// Selection of the entries of an array, with their order.
pub(super) trait Selection {
    /// Returns the selected entries.
    fn pick<T: Copy>(&self, all: &[T]) -> Vec<T>;

    /// Returns the selected values, in the same type.
    fn values(&self, all: &Values) -> Values {
        of_same_type!(all, v => self.pick(v))
    }

    /// Selects the values of each component. A derived source stays, because it follows from other fields.
    fn source(&self, all: &FieldSource) -> FieldSource {
        match all {
            FieldSource::Scalar(values) => FieldSource::Scalar(self.values(values)),
            FieldSource::Vector(parts) => {
                FieldSource::Vector(parts.iter().map(|part| self.values(part)).collect())
            }
            FieldSource::Derived(derive) => FieldSource::Derived(*derive),
        }
    }
}

/// Applies a selection to each field. Fields whose number of values does not match the samples are left out, with a
/// note.
///
/// - `of`: returns the selection of nodes or cells, and their number before.
pub(super) fn reselect<'a, S: Selection + 'a>(
    dataset: &mut Dataset,
    of: impl Fn(Association) -> (&'a S, usize),
) {
    let mut left = Vec::with_capacity(dataset.fields.len());
    for mut field in std::mem::take(&mut dataset.fields) {
        let (selection, count) = of(field.association);
        let len = match &field.source {
            FieldSource::Scalar(values) => values.len(),
            FieldSource::Vector(parts) => parts.first().map_or(count, Values::len),
            FieldSource::Derived(_) => count,
        };
        if len == count {
            field.source = selection.source(&field.source);
            left.push(field);
        } else {
            let name = &field.name;
            dataset.notes.push(format!(
                "field `{name}` has {len} values for {count} samples and is left out"
            ));
        }
    }
    dataset.fields = left;
}

/// Runs of kept entries, in order.
#[derive(Debug, Default, PartialEq)]
pub(super) struct Runs(Vec<Range<usize>>);

impl Runs {
    /// Builds the runs of the entries below `count` for which `is_kept` returns true.
    pub(super) fn of(count: usize, is_kept: impl Fn(usize) -> bool) -> Self {
        let mut runs = Self::default();
        for i in (0..count).filter(|&i| is_kept(i)) {
            runs.push(i..i + 1);
        }
        runs
    }

    /// Appends a run. A run that begins at the end of the last one extends it.
    pub(super) fn push(&mut self, run: Range<usize>) {
        match self.0.last_mut() {
            Some(last) if last.end == run.start => last.end = run.end,
            _ if run.is_empty() => {}
            _ => self.0.push(run),
        }
    }

    /// Appends a box of indices of an array, x fastest, that begins at `first`.
    pub(super) fn push_box(&mut self, first: usize, dims: [usize; 3], part: &[Range<usize>; 3]) {
        let [i, j, k] = part;
        for k in k.clone() {
            for j in j.clone() {
                let row = first + dims[0] * (j + dims[1] * k);
                self.push(row + i.start..row + i.end);
            }
        }
    }

    /// Returns the number of kept entries.
    pub(super) fn len(&self) -> usize {
        self.0.iter().map(Range::len).sum()
    }

    /// Returns the indices of the kept entries.
    pub(super) fn indices(&self) -> impl Iterator<Item = usize> + '_ {
        self.0.iter().cloned().flatten()
    }

    /// Returns the runs of an array with `stride` entries for each entry of this one.
    pub(super) fn strided(&self, stride: usize) -> Self {
        let wide = |run: &Range<usize>| stride * run.start..stride * run.end;
        Self(self.0.iter().map(wide).collect())
    }
}

impl Selection for Runs {
    fn pick<T: Copy>(&self, all: &[T]) -> Vec<T> {
        let mut kept = Vec::with_capacity(self.len());
        for run in &self.0 {
            kept.extend_from_slice(&all[run.clone()]);
        }
        kept
    }
}

/// Permutation and reversal of the axes of a three-dimensional array.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Turned {
    /// Number of entries along the new axes.
    pub(super) dims: [usize; 3],
    /// Old axis of each new axis.
    pub(super) axes: [usize; 3],
    /// True for each new axis that is reversed.
    pub(super) is_reversed: [bool; 3],
}

impl Selection for Turned {
    fn pick<T: Copy>(&self, all: &[T]) -> Vec<T> {
        let mut old = [0; 3];
        for (new, &axis) in self.axes.iter().enumerate() {
            old[axis] = self.dims[new];
        }
        let strides = self.axes.map(|axis| old[..axis].iter().product::<usize>());
        let step = |axis: usize, i: usize| match self.is_reversed[axis] {
            true => strides[axis] * (self.dims[axis] - 1 - i),
            false => strides[axis] * i,
        };
        let mut turned = Vec::with_capacity(all.len());
        for k in 0..self.dims[2] {
            for j in 0..self.dims[1] {
                let row = step(1, j) + step(2, k);
                turned.extend((0..self.dims[0]).map(|i| all[row + step(0, i)]));
            }
        }
        turned
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn runs_are_joined_and_boxes_are_rows() {
        let runs = Runs::of(9, |i| i % 4 != 0);
        assert_eq!(runs, Runs(vec![1..4, 5..8]));
        assert_eq!(runs.len(), 6);
        assert_eq!(runs.pick(b"abcdefghi"), b"bcdfgh");
        assert_eq!(runs.strided(2).len(), 12);
        let mut part = Runs::default();
        // The box is part of 3 x 2 x 2 entries behind 10 others.
        part.push_box(10, [3, 2, 2], &[1..3, 0..2, 1..2]);
        assert_eq!(part.indices().collect::<Vec<_>>(), [17, 18, 20, 21]);
        part.push_box(22, [3, 2, 2], &[0..3, 0..2, 0..0]);
        assert_eq!(part.len(), 4);
    }

    #[test]
    fn arrays_are_turned() {
        // An array of 2 x 3 x 1, x fastest, under a quarter turn about z. The new x is the old -y, and the new y is the
        // old x.
        let turned = Turned {
            dims: [3, 2, 1],
            axes: [1, 0, 2],
            is_reversed: [true, false, false],
        };
        assert_eq!(turned.pick(b"abcdef"), b"ecafdb");
    }
}
