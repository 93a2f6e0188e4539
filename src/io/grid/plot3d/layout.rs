//! Defines the layouts of PLOT3D files, and finds those that agree with a file's size.

use crate::io::bytes::scalars::{Encoding, ScalarType, Stride, doubles};

/// Encoding of the numbers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Form {
    /// As text, separated by white space or commas.
    Text,
    Binary {
        double: bool,
        big_endian: bool,
        /// Whether a u32 with the byte count stands before and after each record.
        records: bool,
    },
}

/// A file's numbers: bytes, or the numbers in its text.
#[derive(Debug, Clone, Copy)]
pub(super) enum Contents<'a> {
    Bytes(&'a [u8]),
    Numbers(&'a [f64]),
}

/// The content of a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Content {
    Grid,
    Solution,
    /// Any number of functions at the nodes of a grid.
    Functions,
}

/// The content of a file, and its number of dimensions.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Kind {
    pub(super) content: Content,
    /// 3; or 2, for which the header has no nk, the grid no z and the solution no momentum along z.
    pub(super) axes: usize,
}

impl Kind {
    pub(super) const GRID: Self = Self::of(Content::Grid, 3);
    pub(super) const FLAT_GRID: Self = Self::of(Content::Grid, 2);

    pub(super) const fn of(content: Content, axes: usize) -> Self {
        Self { content, axes }
    }

    /// Number of counts in the header for each grid: nodes along each axis, and the number of functions in a
    /// file of these.
    fn counts(self) -> usize {
        self.axes + usize::from(self.content == Content::Functions)
    }
}

/// One layout of a file. Sizes and offsets are in bytes, or in numbers for text.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Layout {
    pub(super) form: Form,
    /// Whether the number of grids comes first.
    pub(super) counted: bool,
    /// Grids only: whether iblank follows the coordinates.
    pub(super) blanked: bool,
    /// Nodes along i, j and k of each grid.
    pub(super) dims: Vec<[usize; 3]>,
    /// Functions only: number of functions of each grid.
    pub(super) functions: Vec<usize>,
    /// Number of dimensions: 3 or 2.
    pub(super) axes: usize,
}

impl Form {
    /// All forms that these contents can have, those with record marks first.
    fn all(contents: Contents<'_>) -> Vec<Self> {
        let Contents::Bytes(_) = contents else {
            return vec![Self::Text];
        };
        (0..8)
            .map(|bits| Self::Binary {
                records: bits & 4 == 0,
                double: bits & 2 != 0,
                big_endian: bits & 1 != 0,
            })
            .collect()
    }

    pub(super) fn real_size(self) -> usize {
        match self {
            Self::Text => 1,
            Self::Binary { double: false, .. } => 4,
            Self::Binary { double: true, .. } => 8,
        }
    }

    fn word_size(self) -> usize {
        match self {
            Self::Text => 1,
            Self::Binary { .. } => 4,
        }
    }

    fn mark_size(self) -> usize {
        match self {
            Self::Binary { records: true, .. } => 4,
            _ => 0,
        }
    }
}

impl<'a> Contents<'a> {
    /// The contents of a file; `numbers` are given for text.
    pub(super) fn of(bytes: &'a [u8], numbers: Option<&'a [f64]>) -> Self {
        numbers.map_or(Self::Bytes(bytes), Self::Numbers)
    }

    pub(super) fn len(self) -> usize {
        match self {
            Self::Bytes(bytes) => bytes.len(),
            Self::Numbers(numbers) => numbers.len(),
        }
    }

    /// Whether only zero bytes follow from `end` on; text must end there.
    fn rest_is_padding(self, end: usize) -> bool {
        match self {
            Self::Bytes(bytes) => bytes
                .get(end..)
                .is_some_and(|rest| rest.iter().all(|&b| b == 0)),
            Self::Numbers(numbers) => end == numbers.len(),
        }
    }

    /// `count` numbers from `at` on: reals, or the words of counts and iblank.
    pub(super) fn numbers(
        self,
        form: Form,
        real: bool,
        at: usize,
        count: usize,
    ) -> Option<Vec<f64>> {
        match (self, form) {
            (Self::Numbers(numbers), Form::Text) => {
                Some(numbers.get(at..at.checked_add(count)?)?.to_vec())
            }
            (
                Self::Bytes(bytes),
                Form::Binary {
                    double, big_endian, ..
                },
            ) => {
                let scalar = match (real, double) {
                    (false, _) => ScalarType::I32,
                    (true, false) => ScalarType::F32,
                    (true, true) => ScalarType::F64,
                };
                let stride = Stride {
                    first: at,
                    step: scalar.size(),
                    count,
                };
                doubles(bytes, Encoding { scalar, big_endian }, stride)
            }
            _ => None,
        }
    }

    fn word(self, form: Form, at: usize) -> Option<f64> {
        self.numbers(form, false, at, 1)?.pop()
    }

    /// A count of at least 1.
    fn count(self, form: Form, at: usize) -> Option<usize> {
        let word = self.word(form, at)?;
        let sound = word >= 1.0 && word <= f64::from(i32::MAX) && word.fract().abs() <= 0.0;
        #[allow(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "a whole number between 1 and i32::MAX"
        )]
        sound.then_some(word as usize)
    }
}

impl Layout {
    /// All layouts of a file that begins with `head`, in the order of preference: record marks before none, a
    /// grid count before none, single before double precision, little before big endian, no iblank before one.
    pub(super) fn all(head: Contents<'_>, kind: Kind) -> impl Iterator<Item = Self> {
        let forms = Form::all(head);
        let marked = |marked: bool| move |form: &Form| (form.mark_size() > 0) == marked;
        let mut headers = Vec::new();
        for with_marks in [true, false] {
            for counted in [true, false] {
                for &form in forms.iter().filter(|f| marked(with_marks)(f)) {
                    headers.push((form, counted));
                }
            }
        }
        let blanked = match kind.content {
            Content::Grid => &[false, true][..],
            Content::Solution | Content::Functions => &[false],
        };
        headers
            .into_iter()
            .filter_map(move |(form, counted)| of_header(head, form, counted, kind))
            .flat_map(move |layout| {
                blanked.iter().map(move |&blanked| Self {
                    blanked,
                    ..layout.clone()
                })
            })
    }

    /// The layouts with the size of the file and with the right record marks.
    pub(super) fn fitting(contents: Contents<'_>, kind: Kind) -> impl Iterator<Item = Self> {
        Self::all(contents, kind).filter(move |layout| {
            layout.end(kind) == Some(contents.len()) && layout.marks_agree(contents, kind)
        })
    }

    /// Whether the contents have this layout, except for zero bytes after it.
    pub(super) fn fits_padded(&self, contents: Contents<'_>, kind: Kind) -> bool {
        self.end(kind)
            .is_some_and(|end| contents.rest_is_padding(end))
            && self.marks_agree(contents, kind)
    }

    /// The numbers of nodes of each grid.
    pub(super) fn node_counts(&self) -> Option<Vec<usize>> {
        let product = |d: &[usize; 3]| d[0].checked_mul(d[1])?.checked_mul(d[2]);
        self.dims.iter().map(product).collect()
    }

    /// The sizes of the records of a file.
    fn record_sizes(&self, kind: Kind) -> Option<Vec<usize>> {
        let (real, word) = (self.form.real_size(), self.form.word_size());
        let per_node = |grid: usize| match kind.content {
            Content::Grid => Some(kind.axes * real + usize::from(self.blanked) * word),
            // Density, momentum, energy.
            Content::Solution => Some((kind.axes + 2) * real),
            Content::Functions => self.functions.get(grid)?.checked_mul(real),
        };
        let mut sizes = Vec::new();
        if self.counted {
            sizes.push(word);
        }
        sizes.push(self.dims.len().checked_mul(kind.counts() * word)?);
        for (grid, nodes) in self.node_counts()?.into_iter().enumerate() {
            if kind.content == Content::Solution {
                sizes.push(4 * real);
            }
            sizes.push(nodes.checked_mul(per_node(grid)?)?);
        }
        Some(sizes)
    }

    /// Offsets of each grid's last record, and of the file's end.
    pub(super) fn bodies(&self, kind: Kind) -> Option<(Vec<usize>, usize)> {
        let mark = self.form.mark_size();
        let sizes = self.record_sizes(kind)?;
        let header = 1 + usize::from(self.counted);
        let per_grid = if kind.content == Content::Solution {
            2
        } else {
            1
        };
        let mut starts = Vec::with_capacity(self.dims.len());
        let mut at: usize = 0;
        for (i, size) in sizes.into_iter().enumerate() {
            if i >= header && (i - header) % per_grid == per_grid - 1 {
                starts.push(at.checked_add(mark)?);
            }
            at = at.checked_add(size)?.checked_add(2 * mark)?;
        }
        Some((starts, at))
    }

    pub(super) fn end(&self, kind: Kind) -> Option<usize> {
        self.bodies(kind).map(|(_, end)| end)
    }

    /// Whether the record marks, if this layout has them, are right.
    pub(super) fn marks_agree(&self, contents: Contents<'_>, kind: Kind) -> bool {
        if self.form.mark_size() == 0 {
            return true;
        }
        // Marks are unsigned, words are not.
        let says = |at: usize, size: usize| {
            let mark = contents.word(self.form, at);
            let unsigned = mark.map(|mark| mark.rem_euclid(2.0_f64.powi(32)));
            unsigned.is_some_and(|mark| (mark - size as f64).abs() <= 0.0)
        };
        let mut at = 0;
        self.record_sizes(kind).is_some_and(|sizes| {
            sizes.into_iter().all(|size| {
                let agree = says(at, size) && says(at + 4 + size, size);
                at += size + 8;
                agree
            })
        })
    }

    /// Whether the file has each k plane as a separate record.
    pub(super) fn is_in_planes(&self, contents: Contents<'_>) -> bool {
        // Only marks between planes distinguish them.
        if self.form.mark_size() == 0 {
            return false;
        }
        let planes = Self {
            dims: self
                .dims
                .iter()
                .flat_map(|&[ni, nj, nk]| std::iter::repeat_n([ni, nj, 1], nk))
                .take(contents.len() / 8 + 1)
                .collect(),
            ..self.clone()
        };
        let extra = planes.dims.len().checked_sub(self.dims.len());
        let Some(extra) = extra.filter(|&n| n > 0) else {
            return false;
        };
        // The header counts the grids, not the planes.
        let end = planes.end(Kind::GRID);
        end.and_then(|end| end.checked_sub(12 * extra)) == Some(contents.len())
    }

    pub(super) fn describe(&self) -> String {
        let form = match self.form {
            Form::Text => "text".to_owned(),
            Form::Binary {
                double,
                big_endian,
                records,
            } => format!(
                "{} {}{}",
                if big_endian {
                    "big-endian"
                } else {
                    "little-endian"
                },
                if double { "f64" } else { "f32" },
                if records { ", record marks" } else { "" },
            ),
        };
        let counted = if self.counted { ", grid count" } else { "" };
        let blanked = if self.blanked { ", iblank" } else { "" };
        let dims = describe_dims(&self.dims);
        let flat = if self.axes == 2 {
            " in two dimensions"
        } else {
            ""
        };
        let functions = match self.functions.as_slice() {
            [] => String::new(),
            [1] => ", 1 function".to_owned(),
            [n] => format!(", {n} functions"),
            [n, ..] => format!(", {n} functions of the first"),
        };
        format!("{dims}{flat} {form}{counted}{blanked}{functions}")
    }
}

/// "3 x 2 x 4", or "3 x 2 x 4 and 2 more grids".
pub(super) fn describe_dims(dims: &[[usize; 3]]) -> String {
    let [ni, nj, nk] = dims.first().copied().unwrap_or_default();
    let first = format!("{ni} x {nj} x {nk}");
    match dims.len() {
        0 | 1 => first,
        2 => format!("{first} and 1 more grid"),
        n => format!("{first} and {} more grids", n - 1),
    }
}

/// The layout from the words at the start of a file of this form, without iblank: all counts are at least 1.
fn of_header(head: Contents<'_>, form: Form, counted: bool, kind: Kind) -> Option<Layout> {
    let (mark, word) = (form.mark_size(), form.word_size());
    let mut at = mark;
    let mut grids = 1;
    if counted {
        grids = head.count(form, at)?;
        at += word + 2 * mark;
    }
    // There cannot be more grids than the file has counts for.
    if grids > head.len() / (kind.counts() * word) {
        return None;
    }
    let mut next = || {
        let count = head.count(form, at);
        at += word;
        count
    };
    let mut layout = Layout {
        form,
        counted,
        blanked: false,
        dims: Vec::with_capacity(grids),
        functions: Vec::new(),
        axes: kind.axes,
    };
    for _ in 0..grids {
        let mut dims = [1; 3];
        for n in dims.iter_mut().take(kind.axes) {
            *n = next()?;
        }
        layout.dims.push(dims);
        if kind.content == Content::Functions {
            layout.functions.push(next()?);
        }
    }
    Some(layout)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A file of this layout, filled with bytes that are no small counts.
    fn file(layout: &Layout, kind: Kind) -> Vec<u8> {
        let Form::Binary {
            big_endian,
            records,
            ..
        } = layout.form
        else {
            panic!()
        };
        let word = |n: usize| {
            let n = u32::try_from(n).unwrap();
            if big_endian {
                n.to_be_bytes()
            } else {
                n.to_le_bytes()
            }
        };
        let mut header = vec![];
        if layout.counted {
            header.push(word(layout.dims.len()).to_vec());
        }
        header.push(
            layout
                .dims
                .iter()
                .flatten()
                .flat_map(|&n| word(n))
                .collect(),
        );
        let mut bytes = Vec::new();
        for (i, size) in layout.record_sizes(kind).unwrap().into_iter().enumerate() {
            let mark = if records { word(size).to_vec() } else { vec![] };
            bytes.extend(&mark);
            match header.get(i) {
                Some(record) => bytes.extend(record),
                None => bytes.extend(vec![0x3f; size]),
            }
            bytes.extend(&mark);
        }
        bytes
    }

    #[test]
    fn the_size_tells_the_layouts_apart() {
        // A grid count of 1 could be mistaken for a dimension; the size distinguishes them for all grids of
        // more than one node.
        let grids: [&[[usize; 3]]; 7] = [
            &[[2, 3, 4]],
            &[[1, 2, 3]],
            &[[3, 1, 1]],
            &[[1, 1, 5]],
            &[[2, 3, 4], [2, 2, 2]],
            &[[1, 1, 2], [1, 1, 2], [4, 1, 1]],
            &[[5, 5, 5]; 4],
        ];
        for dims in grids {
            for form in Form::all(Contents::Bytes(&[])) {
                for (counted, blanked) in
                    [(false, false), (false, true), (true, false), (true, true)]
                {
                    if !counted && dims.len() > 1 {
                        continue;
                    }
                    let layout = Layout {
                        form,
                        counted,
                        blanked,
                        dims: dims.to_vec(),
                        functions: vec![],
                        axes: 3,
                    };
                    let bytes = file(&layout, Kind::GRID);
                    let fitting: Vec<_> =
                        Layout::fitting(Contents::Bytes(&bytes), Kind::GRID).collect();
                    assert_eq!(fitting, [layout]);
                }
            }
        }
    }

    /// Without record marks, two grids can have the size of one grid with iblank whose first
    /// dimension is the grid count.
    #[test]
    fn of_two_that_fit_the_one_with_a_grid_count_is_first() {
        let layout = Layout {
            form: Form::Binary {
                double: false,
                big_endian: false,
                records: false,
            },
            counted: true,
            blanked: false,
            dims: vec![[2, 4, 2], [2, 2, 1]],
            functions: vec![],
            axes: 3,
        };
        let bytes = file(&layout, Kind::GRID);
        let fitting: Vec<_> = Layout::fitting(Contents::Bytes(&bytes), Kind::GRID).collect();
        assert_eq!(fitting.len(), 2);
        assert_eq!(fitting[0], layout);
        assert_eq!(fitting[1].dims, [[2, 2, 4]]);
    }
}
