//! Reads lists of cells in legacy VTK files, in both styles.
//!
//! | version | after the keyword | then |
//! |---|---|---|
//! | before 5 | number of cells, number of numbers | each cell's count of nodes and its nodes |
//! | 5 | number of offsets, number of nodes | `OFFSETS` type, the offsets; `CONNECTIVITY` type, the nodes |
//!
//! Polyhedra have faces in place of nodes, in the form of [`CellMesh`](crate::io::CellMesh). The word
//! `OFFSETS` distinguishes the styles.

use super::scan::{DataType, Scanner};
use crate::data::cells::CellKind;
use crate::error::Result;
use crate::io::bytes::scalars::ScalarType;

/// Cells without their kinds.
#[derive(Debug)]
pub(super) struct CellList {
    /// Start of each cell's nodes; one more at the end.
    pub(super) offsets: Vec<u32>,
    /// The nodes.
    pub(super) connectivity: Vec<u32>,
}

impl Default for CellList {
    fn default() -> Self {
        Self {
            offsets: vec![0],
            connectivity: Vec::new(),
        }
    }
}

impl CellList {
    pub(super) fn len(&self) -> usize {
        self.offsets.len() - 1
    }

    /// Reads a list, from the word after its keyword on.
    pub(super) fn read(scan: &mut Scanner<'_>) -> Result<Self> {
        let first = scan.count("the number of cells")?;
        let second = scan.count("the number of numbers")?;
        if scan.peek().as_deref() == Some("OFFSETS") {
            Self::with_offsets(scan, first, second)
        } else {
            Self::with_counts(scan, first, second)
        }
    }

    fn with_offsets(
        scan: &mut Scanner<'_>,
        offset_count: usize,
        node_count: usize,
    ) -> Result<Self> {
        scan.expect("OFFSETS")?;
        let offset_type = scan.data_type()?;
        let mut offsets = scan.ids(offset_type, offset_count)?;
        scan.skip_metadata();
        let word = scan.peek().unwrap_or("the end of the file".to_owned());
        if word != "CONNECTIVITY" {
            return Err(scan.fault("CONNECTIVITY after the offsets", word));
        }
        scan.expect("CONNECTIVITY")?;
        let node_type = scan.data_type()?;
        let connectivity = scan.ids(node_type, node_count)?;
        if offsets.is_empty() {
            offsets.push(0);
        }
        let rise = offsets.windows(2).all(|w| w[0] <= w[1]);
        let ends = [offsets[0], offsets[offsets.len() - 1]].map(|n| n as usize);
        if !rise || ends != [0, connectivity.len()] {
            return Err(scan.fault(
                format!("offsets that rise from 0 to {}", connectivity.len()),
                if rise {
                    format!("offsets from {} to {}", ends[0], ends[1])
                } else {
                    "offsets that fall".to_owned()
                },
            ));
        }
        Ok(Self {
            offsets,
            connectivity,
        })
    }

    fn with_counts(scan: &mut Scanner<'_>, cell_count: usize, number_count: usize) -> Result<Self> {
        if cell_count > number_count {
            let expected = format!("at least one number for each of {cell_count} cells");
            return Err(scan.fault(expected, format!("{number_count}")));
        }
        let mut numbers = scan.ids(DataType::Number(ScalarType::I32), number_count)?;
        let mut offsets = Vec::with_capacity(cell_count + 1);
        offsets.push(0);
        // The counts are removed in place.
        let (mut from, mut to) = (0, 0);
        for i in 0..cell_count {
            let end = numbers
                .get(from)
                .and_then(|&n| (from + 1).checked_add(n as usize));
            let Some(end) = end.filter(|&end| end <= numbers.len()) else {
                let expected = format!("{cell_count} cells in {number_count} numbers");
                return Err(scan.fault(expected, format!("cell {i} beyond them")));
            };
            numbers.copy_within(from + 1..end, to);
            to += end - from - 1;
            from = end;
            offsets.push(u32::try_from(to).map_err(|_| too_many(scan))?);
        }
        if from != number_count {
            let expected = format!("{number_count} numbers in {cell_count} cells");
            return Err(scan.fault(expected, format!("{from}")));
        }
        numbers.truncate(to);
        Ok(Self {
            offsets,
            connectivity: numbers,
        })
    }

    /// Appends the cells of `other`.
    pub(super) fn append(&mut self, other: &Self, scan: &Scanner<'_>) -> Result<()> {
        let base = u32::try_from(self.connectivity.len()).map_err(|_| too_many(scan))?;
        for &offset in &other.offsets[1..] {
            let offset = offset.checked_add(base).ok_or_else(|| too_many(scan))?;
            self.offsets.push(offset);
        }
        self.connectivity.extend_from_slice(&other.connectivity);
        Ok(())
    }

    /// Number of nodes of each cell.
    pub(super) fn sizes(&self) -> impl Iterator<Item = u32> {
        self.offsets.windows(2).map(|w| w[1] - w[0])
    }
}

fn too_many(scan: &Scanner<'_>) -> crate::Error {
    let expected = format!("at most {} numbers in cells", u32::MAX);
    scan.error(expected, "more", "split the grid")
}

/// Reads `CELL_TYPES`, from the word after it on.
pub(super) fn kinds(scan: &mut Scanner<'_>) -> Result<Vec<CellKind>> {
    let count = scan.count("the number of cells")?;
    let kinds = scan.ids(DataType::Number(ScalarType::I32), count)?;
    let kind = |n: u32| match u8::try_from(n) {
        Ok(n) => Ok(CellKind(n)),
        Err(_) => Err(scan.fault("kinds of cells from 0 to 255", n.to_string())),
    };
    kinds.into_iter().map(kind).collect()
}
