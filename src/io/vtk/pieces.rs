//! Reads the pieces of a VTK XML data set, from one file or from the files that a parallel index names.
//!
//! ```text
//! <VTKFile type="UnstructuredGrid">        <VTKFile type="PUnstructuredGrid">
//!   <UnstructuredGrid>                       <PUnstructuredGrid>
//!     <Piece ...>                              <PPointData> ... </PPointData>
//!       <PointData> ... </PointData>           <Piece Source="part_0.vtu"/>
//!       <CellData> ... </CellData> ...         <Piece Source="part_1.vtu"/>
//!     </Piece> ...                           </PUnstructuredGrid>
//!   </UnstructuredGrid>                    </VTKFile>
//! </VTKFile>
//! ```
//!
//! A `Source` is relative to the index's folder, and names a file of pieces, never another index. The index's
//! own list of arrays (`PPointData`, ...) is not needed, because each piece has one. One file at a time is in
//! memory; only the results for its pieces are kept.

use std::collections::{HashMap, HashSet};
use std::path::{Path, PathBuf};

use roxmltree::{Document, Node};

use super::array::{Array, Decoder};
use super::xml::{Frame, child, clip};
use super::xml::{file_type, looks_like};
use crate::data::association::Association;
use crate::data::dataset::{Field, FieldSource};
use crate::error::{Error, Result};
use crate::io::bytes::file::HEAD;
use crate::io::bytes::file::Input;

/// One `Piece` element of a file.
#[derive(Debug, Clone, Copy)]
pub(in crate::io) struct Piece<'p> {
    pub(in crate::io) path: &'p Path,
    pub(in crate::io) node: Node<'p, 'p>,
    pub(in crate::io) decoder: &'p Decoder<'p>,
}

/// Reads the data set's own attributes with `head` and each piece with `piece`, which may leave out empty ones.
/// `kind` is the `type` of the pieces' files.
///
/// # Errors
/// A file of another type; a damaged file; a piece's missing file; errors of `head` and `piece`.
pub(in crate::io) fn read<H, P>(
    input: Input<'_>,
    kind: &str,
    head: impl FnOnce(&Path, Node<'_, '_>) -> Result<H>,
    mut piece: impl FnMut(&H, Piece<'_>) -> Result<Option<P>>,
) -> Result<(H, Vec<P>)> {
    let path = input.path;
    let bytes = input.read_all()?;
    let frame = Frame::new(path, &bytes)?;
    let document = frame.document()?;
    let index_kind = format!("P{kind}");
    let is_index = document.root_element().attribute("type") == Some(&index_kind);
    let element = data_set(path, &document, if is_index { &index_kind } else { kind })?;
    let head = head(path, element)?;
    if !is_index {
        let mut pieces = Vec::new();
        each_piece(path, &frame, &document, element, |p| {
            pieces.extend(piece(&head, p)?);
            Ok(())
        })?;
        return Ok((head, pieces));
    }
    let files = sources(input, element)?;
    let pieces = read_files(input, &files, kind, |p| piece(&head, p))?;
    Ok((head, pieces))
}

/// Applies `found` to an index of pieces; `None` for any other file.
///
/// - `kind`: the `type` of the pieces' files.
///
/// # Errors
/// A damaged index; errors of `found`.
pub(in crate::io) fn in_index<T>(
    path: &Path,
    kind: &str,
    found: impl FnOnce(Input<'_>, Node<'_, '_>) -> Result<T>,
) -> Result<Option<T>> {
    let input = Input::of_file(path);
    let index_kind = format!("P{kind}");
    let (head, _) = input.head(HEAD)?;
    if !looks_like(&head) || file_type(&head) != Some(&index_kind) {
        return Ok(None);
    }
    let bytes = input.read_all()?;
    let frame = Frame::new(path, &bytes)?;
    let document = frame.document()?;
    found(input, data_set(path, &document, &index_kind)?).map(Some)
}

/// The files that an index names, relative to its folder.
///
/// # Errors
/// A piece without a file; a missing file; a file that is named twice.
pub(in crate::io) fn sources(input: Input<'_>, element: Node<'_, '_>) -> Result<Vec<PathBuf>> {
    let path = input.path;
    let folder = path.parent().unwrap_or(Path::new(""));
    // A file named repeatedly would be in memory as many times.
    let mut named = HashSet::new();
    let mut files = Vec::new();
    for (i, node) in piece_nodes(element).enumerate() {
        let place = format!("Piece {i}, `Source`");
        let error = |expected: &str, found: String, advice: &str| {
            Err(Error::format(path, place.clone(), expected, found, advice))
        };
        let Some(source) = node.attribute("Source").filter(|s| !s.is_empty()) else {
            let advice = "the index is damaged: save it again";
            return error("the name of the piece's file", "none".into(), advice);
        };
        let file = folder.join(source);
        let Some(resolved) = input.resolved_beside(&file) else {
            let advice = "put the piece's file there, or save the whole as one file";
            let found = format!("no file `{}`", clip(source));
            return error("a file beside the index", found, advice);
        };
        if !named.insert(resolved) {
            let advice = "the index is damaged: save it again";
            return error(
                "each file once",
                format!("`{}` again", clip(source)),
                advice,
            );
        }
        files.push(file);
    }
    Ok(files)
}

/// The files of [`sources`], with the length of each.
pub(in crate::io) fn sources_with_lengths(
    input: Input<'_>,
    element: Node<'_, '_>,
) -> Result<Vec<(PathBuf, u64)>> {
    let with_length = |file: PathBuf| {
        let length = std::fs::metadata(&file).map_or(0, |meta| meta.len());
        (file, length)
    };
    let files = sources(input, element)?.into_iter();
    Ok(files.map(with_length).collect())
}

/// Reads the pieces of files that an index names with `piece`, which may leave out empty ones.
///
/// - `kind`: the `type` of the files.
///
/// # Errors
/// A file of another type; a damaged file; errors of `piece`.
pub(in crate::io) fn read_files<'f, P>(
    input: Input<'_>,
    files: impl IntoIterator<Item = &'f PathBuf>,
    kind: &str,
    mut piece: impl FnMut(Piece<'_>) -> Result<Option<P>>,
) -> Result<Vec<P>> {
    let mut pieces = Vec::new();
    for file in files {
        let bytes = input.read_beside(file)?;
        let frame = Frame::new(file, &bytes)?;
        let document = frame.document()?;
        let element = data_set(file, &document, kind)?;
        each_piece(file, &frame, &document, element, |p| {
            pieces.extend(piece(p)?);
            Ok(())
        })?;
    }
    Ok(pieces)
}

/// The data set's element, named after the file's `type`.
pub(in crate::io) fn data_set<'d>(
    path: &Path,
    document: &'d Document<'_>,
    kind: &str,
) -> Result<Node<'d, 'd>> {
    let root = document.root_element();
    let found = root.attribute("type").unwrap_or("");
    if root.tag_name().name() != "VTKFile" || found != kind {
        return Err(Error::format(
            path,
            "VTKFile, `type`",
            kind,
            format!("`{}`", clip(found)),
            "name a file of this type",
        ));
    }
    child(root, kind).ok_or_else(|| {
        let advice = "the file is damaged: save it again";
        Error::format(path, kind, "this element", "none", advice)
    })
}

pub(in crate::io) fn piece_nodes<'d, 'i>(
    element: Node<'d, 'i>,
) -> impl Iterator<Item = Node<'d, 'i>> {
    element.children().filter(|n| n.has_tag_name("Piece"))
}

fn each_piece(
    path: &Path,
    frame: &Frame<'_>,
    document: &Document<'_>,
    element: Node<'_, '_>,
    mut work: impl FnMut(Piece<'_>) -> Result<()>,
) -> Result<()> {
    let decoder = Decoder::new(frame, document)?;
    for node in piece_nodes(element) {
        work(Piece {
            path,
            node,
            decoder: &decoder,
        })?;
    }
    Ok(())
}

impl<'p> Piece<'p> {
    /// A count among the attributes; 0 if it is missing.
    pub(in crate::io) fn count(&self, name: &str) -> Result<usize> {
        let text = self.node.attribute(name).unwrap_or("0");
        text.trim().parse().map_err(|_| {
            let found = format!("`{}`", clip(text));
            let advice = "correct the attribute";
            let place = format!("Piece, `{name}`");
            Error::format(self.path, place, "a number", found, advice)
        })
    }

    /// The first array of an element: `Points`.
    pub(in crate::io) fn only_array(&self, element: &str) -> Result<Node<'p, 'p>> {
        let node = child(self.node, element).and_then(|e| child(e, "DataArray"));
        node.ok_or_else(|| self.missing(element))
    }

    /// All arrays of an element: `Coordinates`.
    pub(in crate::io) fn array_nodes(&self, element: &str) -> Vec<Node<'p, 'p>> {
        let element = child(self.node, element);
        let children = element.into_iter().flat_map(|e| e.children());
        children.filter(|n| n.has_tag_name("DataArray")).collect()
    }

    /// An array by the names of its element and its own.
    pub(in crate::io) fn array_named(&self, element: &str, name: &str) -> Option<Node<'p, 'p>> {
        let nodes = self.array_nodes(element);
        nodes
            .into_iter()
            .find(|n| n.attribute("Name") == Some(name))
    }

    /// The arrays of nodes or of cells, each of `count` tuples.
    pub(in crate::io) fn fields(
        &self,
        association: Association,
        count: usize,
    ) -> Result<Vec<Array>> {
        match child(self.node, element_of(association)) {
            Some(element) if count > 0 => self.decoder.arrays(element, count),
            _ => Ok(Vec::new()),
        }
    }

    /// The error for a missing array.
    pub(in crate::io) fn missing(&self, place: &str) -> Error {
        let advice = "the file is damaged: save it again";
        Error::format(self.path, place, "an array", "none", advice)
    }
}

/// The name of the element with arrays of this association.
pub(in crate::io) fn element_of(association: Association) -> &'static str {
    match association {
        Association::Nodes => "PointData",
        Association::Cells => "CellData",
    }
}

/// An array's name, and the kinds of its components' numbers.
pub(crate) type ArrayKey = (String, Vec<String>);

/// The arrays of a data set's parts, distinguished by name, number of components and kind of numbers.
#[derive(Debug, Clone, Default, PartialEq)]
pub(crate) struct ArraysSeen {
    /// Number of parts.
    pub(crate) parts: usize,
    /// Arrays in the order in which they were found, with the number of parts that have each.
    pub(crate) arrays: Vec<(ArrayKey, usize)>,
}

impl ArraysSeen {
    pub(in crate::io) fn of<A: AsRef<[Array]>>(parts: &[A]) -> Self {
        let mut seen = Self::default();
        let mut place_of = HashMap::new();
        for arrays in parts {
            seen.parts += 1;
            let mut of_part = HashSet::new();
            let is_first = |key: &ArrayKey| of_part.insert(key.clone());
            for key in arrays.as_ref().iter().map(key).filter(is_first) {
                seen.count(key, 1, &mut place_of);
            }
        }
        seen
    }

    fn count(&mut self, key: ArrayKey, parts: usize, place_of: &mut HashMap<ArrayKey, usize>) {
        let place = place_of.entry(key.clone()).or_insert_with(|| {
            self.arrays.push((key, 0));
            self.arrays.len() - 1
        });
        self.arrays[*place].1 += parts;
    }

    /// Adds the arrays of later parts.
    pub(crate) fn add(&mut self, later: Self) {
        let places = self.arrays.iter().enumerate();
        let mut place_of = places.map(|(i, (key, _))| (key.clone(), i)).collect();
        self.parts += later.parts;
        for (key, parts) in later.arrays {
            self.count(key, parts, &mut place_of);
        }
    }

    /// The arrays that all parts have, in the order of the first part.
    pub(crate) fn common(&self) -> impl Iterator<Item = &ArrayKey> {
        let is_common = |(_, parts): &&(ArrayKey, usize)| *parts == self.parts;
        self.arrays.iter().filter(is_common).map(|(key, _)| key)
    }

    /// Removes from a part all arrays that some part lacks, and sorts the others.
    pub(in crate::io) fn keep(&self, arrays: &mut Vec<Array>) {
        let rank: HashMap<&ArrayKey, usize> = self.common().zip(0..).collect();
        let mut seen = HashSet::new();
        arrays.retain(|array| rank.contains_key(&key(array)) && seen.insert(key(array)));
        arrays.sort_by_key(|array| rank.get(&key(array)).copied());
    }

    /// A note on the removed arrays; `None` if there are none.
    pub(crate) fn note(&self, element: &str) -> Option<String> {
        const MOST_NAMES: usize = 8;
        let others = self.arrays.iter().filter(|(_, n)| *n != self.parts);
        let mut names: Vec<String> = others
            .map(|((name, _), _)| format!("`{}`", clip(name)))
            .collect();
        names.dedup();
        let more = match names.len().saturating_sub(MOST_NAMES) {
            0 => String::new(),
            n => format!(" and {n} more"),
        };
        names.truncate(MOST_NAMES);
        let listed = names.join(", ");
        (!names.is_empty()).then(|| {
            format!(
                "arrays of {element} left out, as not all pieces have them alike: {listed}{more}"
            )
        })
    }
}

pub(in crate::io) fn key(array: &Array) -> ArrayKey {
    let kinds = array.components.iter().map(|c| c.kind_name().to_owned());
    (array.name.clone(), kinds.collect())
}

/// Keeps in each part only the arrays that all parts have, with the same name, number of components and kind of
/// numbers, in the order of the first part. Adds a note on the others to `notes`.
pub(in crate::io) fn keep_common(parts: &mut [Vec<Array>], element: &str, notes: &mut Vec<String>) {
    if parts.len() < 2 {
        return;
    }
    let seen = ArraysSeen::of(parts);
    parts.iter_mut().for_each(|arrays| seen.keep(arrays));
    notes.extend(seen.note(element));
}

/// Arrays as the fields of a data set.
pub(in crate::io) fn to_fields(arrays: Vec<Array>, association: Association) -> Vec<Field> {
    let to_field = |array: Array| {
        let mut components = array.components;
        Field {
            name: array.name,
            association,
            source: if components.len() == 1 {
                FieldSource::Scalar(components.remove(0))
            } else {
                FieldSource::Vector(components)
            },
            unit: None,
        }
    };
    arrays.into_iter().map(to_field).collect()
}
