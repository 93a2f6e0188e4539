//! Reads extents of the structured VTK XML formats, and joins pieces by them.
//!
//! ```text
//! <StructuredGrid WholeExtent="i0 i1 j0 j1 k0 k1">
//!   <Piece Extent="i0 i1 j0 j1 k0 k1"> <PointData/> <CellData/> ... </Piece> ...
//! </StructuredGrid>
//! ```
//!
//! An extent names the first and the last node along each axis; cells lie between nodes. Pieces must cover the
//! whole extent, and may overlap; then the last one counts. For `vtkGhostType` a mark stays only if all
//! overlapping pieces have it, because a node marked as another piece's in one piece is that other piece's own.

use std::path::Path;

use roxmltree::Node;

use super::array::Array;
use super::pieces::{Piece, element_of, keep_common, to_fields};
use super::xml::numbers;
use crate::data::association::Association;
use crate::data::blanking::GHOST_TYPE;
use crate::data::dataset::Field;
use crate::error::{Advice, Error, Result};
use crate::scene::Values;

/// First and last node along each axis.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::io) struct Extent {
    pub(in crate::io) first: [i64; 3],
    pub(in crate::io) last: [i64; 3],
}

impl Extent {
    fn from_numbers([i0, i1, j0, j1, k0, k1]: [i32; 6]) -> Self {
        Self {
            first: [i0, j0, k0].map(i64::from),
            last: [i1, j1, k1].map(i64::from),
        }
    }

    /// An extent from reals, with at least one node and no more than fit into memory.
    pub(in crate::io) fn from_reals(reals: [f64; 6]) -> Option<Self> {
        let [i0, i1, j0, j1, k0, k1] = reals;
        let whole = |n: f64| {
            #[allow(
                clippy::cast_possible_truncation,
                reason = "it was checked to be whole and small"
            )]
            (n.abs() <= f64::from(i32::MAX) && n.fract() == 0.0).then_some(n as i64)
        };
        let [first, last] = [[i0, j0, k0], [i1, j1, k1]].map(|ends| {
            let [i, j, k] = ends.map(whole);
            Some([i?, j?, k?])
        });
        let extent = Self {
            first: first?,
            last: last?,
        };
        let is_sound = !extent.is_empty() && extent.count(Association::Nodes).is_some();
        is_sound.then_some(extent)
    }

    /// The whole extent of a data set, which has at least one node.
    pub(in crate::io) fn whole(path: &Path, element: Node<'_, '_>) -> Result<Self> {
        let whole = Self::from_numbers(numbers(path, element, "WholeExtent", None)?);
        if whole.is_empty() || whole.count(Association::Nodes).is_none() {
            let correct = "correct the attribute";
            return Err(Error::format(
                path,
                format!("{}, `WholeExtent`", element.tag_name().name()),
                "last nodes that are not before the first ones, and a count that fits into memory",
                format!("{:?} to {:?}", whole.first, whole.last),
                match whole.is_empty() {
                    true => Advice::no_data(correct),
                    false => correct.into(),
                },
            ));
        }
        Ok(whole)
    }

    /// The extent of a piece; `None` if it is empty.
    pub(in crate::io) fn of_piece(whole: &Self, piece: Piece<'_>) -> Result<Option<Self>> {
        Self::of_element(whole, piece.path, piece.node)
    }

    /// The extent of a piece's element; `None` if it is empty.
    pub(in crate::io) fn of_element(
        whole: &Self,
        path: &Path,
        element: Node<'_, '_>,
    ) -> Result<Option<Self>> {
        let extent = match element.attribute("Extent") {
            None => *whole,
            Some(_) => Self::from_numbers(numbers(path, element, "Extent", None)?),
        };
        if extent.is_empty() {
            return Ok(None);
        }
        let inside = (0..3).all(|axis| {
            extent.first[axis] >= whole.first[axis] && extent.last[axis] <= whole.last[axis]
        });
        if !inside {
            return Err(Error::format(
                path,
                "Piece, `Extent`",
                format!("an extent within {:?} to {:?}", whole.first, whole.last),
                format!("{:?} to {:?}", extent.first, extent.last),
                "correct the attribute",
            ));
        }
        Ok(Some(extent))
    }

    fn is_empty(&self) -> bool {
        (0..3).any(|axis| self.last[axis] < self.first[axis])
    }

    /// Number of nodes, or of cells, along each axis.
    pub(in crate::io) fn dims(&self, association: Association) -> [usize; 3] {
        [0, 1, 2].map(|axis| {
            let steps = usize::try_from(self.last[axis] - self.first[axis]).unwrap_or(0);
            match association {
                Association::Nodes => steps + 1,
                Association::Cells => steps,
            }
        })
    }

    pub(in crate::io) fn count(&self, association: Association) -> Option<usize> {
        let [x, y, z] = self.dims(association);
        x.checked_mul(y)?.checked_mul(z)
    }

    /// Offset of this extent's start from another's along each axis.
    pub(in crate::io) fn shift_from(&self, whole: &Self) -> [usize; 3] {
        [0, 1, 2].map(|axis| usize::try_from(self.first[axis] - whole.first[axis]).unwrap_or(0))
    }

    /// The target of each row along i: its start here, its start in the whole, its length.
    fn rows(
        &self,
        whole: &Self,
        association: Association,
    ) -> impl Iterator<Item = (usize, usize, usize)> + use<> {
        let [whole_x, whole_y, _] = whole.dims(association);
        let [nx, ny, nz] = self.dims(association);
        let [dx, dy, dz] = self.shift_from(whole);
        (0..nz).flat_map(move |k| {
            (0..ny).map(move |j| {
                let to = ((k + dz) * whole_y + j + dy) * whole_x + dx;
                ((k * ny + j) * nx, to, nx)
            })
        })
    }
}

/// One piece with its arrays decoded, and with the data of its format.
#[derive(Debug)]
pub(in crate::io) struct Part<G = ()> {
    pub(in crate::io) extent: Extent,
    pub(in crate::io) geometry: G,
    node_arrays: Vec<Array>,
    cell_arrays: Vec<Array>,
}

impl Part {
    /// Decodes the arrays of a piece; `None` if it is empty.
    pub(in crate::io) fn read(whole: &Extent, piece: Piece<'_>) -> Result<Option<Self>> {
        let Some(extent) = Extent::of_piece(whole, piece)? else {
            return Ok(None);
        };
        let arrays = |association| {
            let count = extent.count(association).unwrap_or(usize::MAX);
            piece.fields(association, count)
        };
        Ok(Some(Self {
            extent,
            geometry: (),
            node_arrays: arrays(Association::Nodes)?,
            cell_arrays: arrays(Association::Cells)?,
        }))
    }

    /// Adds the data of the piece's format.
    pub(in crate::io) fn with<G>(self, geometry: G) -> Part<G> {
        Part {
            extent: self.extent,
            geometry,
            node_arrays: self.node_arrays,
            cell_arrays: self.cell_arrays,
        }
    }
}

impl<G> Part<G> {
    /// - `node_arrays`, `cell_arrays`: a number for each node and each cell of the extent.
    pub(in crate::io) fn of(
        extent: Extent,
        geometry: G,
        node_arrays: Vec<Array>,
        cell_arrays: Vec<Array>,
    ) -> Self {
        Self {
            extent,
            geometry,
            node_arrays,
            cell_arrays,
        }
    }

    /// Whether the part has any nodes, or cells.
    pub(in crate::io) fn has_any(&self, association: Association) -> bool {
        self.extent.count(association) != Some(0)
    }

    pub(in crate::io) fn arrays(&self, association: Association) -> &[Array] {
        match association {
            Association::Nodes => &self.node_arrays,
            Association::Cells => &self.cell_arrays,
        }
    }

    pub(in crate::io) fn arrays_mut(&mut self, association: Association) -> &mut Vec<Array> {
        match association {
            Association::Nodes => &mut self.node_arrays,
            Association::Cells => &mut self.cell_arrays,
        }
    }
}

impl<G> Part<G> {
    /// Separates the data of the piece's format from the rest.
    pub(in crate::io) fn split(self) -> (Part, (Extent, G)) {
        let part = Part {
            extent: self.extent,
            geometry: (),
            node_arrays: self.node_arrays,
            cell_arrays: self.cell_arrays,
        };
        (part, (self.extent, self.geometry))
    }
}

/// Joins the arrays of all parts: fields, and notes on what was left out.
///
/// # Errors
/// Parts that do not cover the whole, or no array at all.
pub(in crate::io) fn join(
    path: &Path,
    whole: &Extent,
    parts: Vec<Part>,
) -> Result<(Vec<Field>, Vec<String>)> {
    let mut notes = Vec::new();
    let mut nodes = Vec::new();
    let mut cells = Vec::new();
    for part in parts {
        nodes.push((part.extent, part.node_arrays));
        cells.push((part.extent, part.cell_arrays));
    }
    let mut fields = Vec::new();
    for (association, parts) in [(Association::Nodes, nodes), (Association::Cells, cells)] {
        let arrays = assemble(path, whole, parts, association, &mut notes)?;
        fields.extend(to_fields(arrays, association));
    }
    if fields.is_empty() {
        let why = notes.first().map_or("", |note| note.as_str());
        let separator = if why.is_empty() { "" } else { ", " };
        return Err(Error::format(
            path,
            "PointData and CellData",
            "at least one array of numbers",
            format!("none{separator}{why}"),
            Advice::no_data(
                "save the grid with its data (one that is one node thick has no cells)",
            ),
        ));
    }
    Ok((fields, notes))
}

/// Joins the arrays of nodes, or those of cells.
fn assemble(
    path: &Path,
    whole: &Extent,
    parts: Vec<(Extent, Vec<Array>)>,
    association: Association,
    notes: &mut Vec<String>,
) -> Result<Vec<Array>> {
    let element = element_of(association);
    // A piece one node thick adds no cells.
    let (extents, mut arrays): (Vec<_>, Vec<_>) = parts
        .into_iter()
        .filter(|(extent, _)| extent.count(association) != Some(0))
        .unzip();
    keep_common(&mut arrays, element, notes);
    let array_count = arrays.first().map_or(0, Vec::len);
    if array_count == 0 {
        return Ok(Vec::new());
    }
    if extents == [*whole] {
        return Ok(arrays.remove(0));
    }
    check_cover(path, whole, &extents, association, element)?;
    let mut arrays: Vec<_> = arrays.into_iter().map(Vec::into_iter).collect();
    let mut joined = Vec::with_capacity(array_count);
    for _ in 0..array_count {
        // One array of all parts at a time, so that parts are freed on the way.
        let parts: Vec<Array> = arrays.iter_mut().filter_map(Iterator::next).collect();
        joined.push(join_array(whole, &extents, parts, association));
    }
    Ok(joined)
}

/// Copies the parts of one array, alike in name and kind, into the whole.
fn join_array(
    whole: &Extent,
    extents: &[Extent],
    parts: Vec<Array>,
    association: Association,
) -> Array {
    let mut name = String::new();
    let mut components = Vec::new();
    for part in parts {
        name = part.name;
        components.push(part.components.into_iter());
    }
    let mut whole_components = Vec::new();
    loop {
        let parts: Vec<Values> = components.iter_mut().filter_map(Iterator::next).collect();
        let parts = Values::alike(parts);
        macro_rules! copy {
            ($kind:ident, $fill:expr, $combine:expr) => {{
                let parts =
                    parts
                        .into_iter()
                        .zip(extents)
                        .filter_map(|(part, &extent)| match part {
                            Values::$kind(values) => Some((extent, values)),
                            _ => None,
                        });
                Values::$kind(place(whole, association, $fill, parts, $combine))
            }};
        }
        whole_components.push(match parts.first() {
            None => break,
            Some(Values::U8(_)) if name == GHOST_TYPE => copy!(U8, u8::MAX, |a, b| a & b),
            Some(Values::U8(_)) => copy!(U8, 0, |_, b| b),
            Some(Values::I16(_)) => copy!(I16, 0, |_, b| b),
            Some(Values::U16(_)) => copy!(U16, 0, |_, b| b),
            Some(Values::F32(_)) => copy!(F32, 0.0, |_, b| b),
            Some(Values::F64(_)) => copy!(F64, 0.0, |_, b| b),
        });
    }
    Array {
        name,
        components: whole_components,
    }
}

/// Copies the samples of all parts into the whole, which is first filled with `fill`. The parts must cover the
/// whole.
pub(in crate::io) fn place<T: Copy>(
    whole: &Extent,
    association: Association,
    fill: T,
    parts: impl Iterator<Item = (Extent, Vec<T>)>,
    combine: impl Fn(T, T) -> T,
) -> Vec<T> {
    let mut all = vec![fill; whole.count(association).unwrap_or(0)];
    for (extent, part) in parts {
        for (from, to, n) in extent.rows(whole, association) {
            for (old, &new) in all[to..to + n].iter_mut().zip(&part[from..from + n]) {
                *old = combine(*old, new);
            }
        }
    }
    all
}

/// Refuses parts that leave holes. This bounds the memory: the parts' samples are in memory already, and the
/// whole may not have more.
pub(in crate::io) fn check_cover(
    path: &Path,
    whole: &Extent,
    extents: &[Extent],
    association: Association,
    element: &str,
) -> Result<()> {
    let error = |expected: String, found: String| {
        let advice = "save the grid as one piece";
        Err(Error::format(path, element, expected, found, advice))
    };
    let count = whole.count(association).unwrap_or(usize::MAX);
    let present = extents.iter().fold(0_usize, |sum, extent| {
        sum.saturating_add(extent.count(association).unwrap_or(0))
    });
    if count > present {
        return error(
            format!("pieces that cover the whole extent of {count} samples"),
            format!("{present} samples"),
        );
    }
    let mut covered = vec![false; count];
    for extent in extents {
        for (_, to, n) in extent.rows(whole, association) {
            covered[to..to + n].fill(true);
        }
    }
    match covered.iter().position(|&c| !c) {
        None => Ok(()),
        Some(hole) => error(
            "pieces that cover the whole extent".to_owned(),
            format!("sample {hole} in none of them"),
        ),
    }
}
