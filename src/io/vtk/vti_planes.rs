//! Reads planes of VTK image data, from the pieces that an index (`.pvti`) names, or from one file (`.vti`).
//!
//! The index states each piece's nodes, and in `PPointData` and `PCellData` the arrays. A piece is opened when
//! some of its planes are wanted, and must agree with the index. If an array is appended raw and not
//! compressed, only the wanted planes are read; otherwise whole files are read, one at a time.

use std::collections::HashSet;
use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::ops::Range;
use std::path::{Path, PathBuf};

use roxmltree::{Document, Node};

use super::array::{Array, Declared, Decoder, declared};
use super::codec::MOST_RATIO;
use super::extent::Extent;
use super::pieces::{data_set, element_of, piece_nodes};
use super::vti::{self, FORMAT};
use super::xml::{Frame, child, file_type};
use crate::data::association::Association;
use crate::data::dataset::{Dataset, Field, FieldSource, Geometry};
use crate::error::{Error, Result};
use crate::io::bytes::file::{HEAD, Input, open_regular, read_all};
use crate::io::volume::plain_numbers::PlainNumbers;
use crate::scene::Values;

const KIND: &str = "ImageData";
const INDEX: &str = "PImageData";

/// Number of bytes of a file in which the elements before its appended data are looked for.
const MOST_ELEMENTS_LEN: u64 = 1 << 16;

/// Greatest number of pieces visited to find whether they cover all nodes: some forty visits for each of a
/// hundred thousand pieces.
const MOST_LOOKS: usize = 1 << 22;

/// Location of an image's values.
#[derive(Debug)]
pub(in crate::io) struct Pieces {
    whole: Extent,
    /// Files and their nodes; if pieces overlap, the last one counts.
    pieces: Vec<(PathBuf, Extent)>,
    /// The arrays of nodes and of cells that every piece has, sorted.
    arrays: [Vec<Kind>; 2],
    is_index: bool,
}

/// An array's properties that must be equal in all pieces: name, components, type.
type Kind = (String, usize, &'static str);

/// Locates the values of an image. Of the pieces of an index only the first is opened.
///
/// # Errors
/// The errors of [`vti::read`] for an index, and for a file's description of the lattice.
pub(in crate::io) fn find(input: Input<'_>) -> Result<Option<(Dataset, Pieces)>> {
    let (head, _) = input.head(HEAD)?;
    match file_type(&head) {
        Some(KIND) => find_in_file(input),
        Some(INDEX) => find_in_index(input),
        _ => Ok(None),
    }
}

fn find_in_file(input: Input<'_>) -> Result<Option<(Dataset, Pieces)>> {
    let path = input.path;
    let (_, _, head) = open_head(path)?;
    let Some(frame) = Frame::of_head(path, &head) else {
        return Ok(None);
    };
    let document = frame.document()?;
    let image = data_set(path, &document, KIND)?;
    let (whole, lattice) = vti::shape(path, image)?;
    let Ok(Some((extent, piece))) = only_piece(path, &whole, image) else {
        return Ok(None);
    };
    let all = Association::BOTH.map(|association| arrays_of(piece, association));
    let arrays = all.each_ref().map(|all| kinds(all));
    let ([Some(nodes), Some(cells)], true) = (arrays, extent == whole) else {
        return Ok(None);
    };
    let fields = fields(&all[0], &cells);
    let pieces = Pieces {
        whole,
        pieces: vec![(path.to_path_buf(), whole)],
        arrays: [nodes, cells],
        is_index: false,
    };
    let geometry = Geometry::Lattice(lattice);
    let head = Dataset::new(path, FORMAT, geometry, fields);
    Ok(Some((head, pieces)))
}

fn find_in_index(input: Input<'_>) -> Result<Option<(Dataset, Pieces)>> {
    let path = input.path;
    let bytes = input.read_all()?;
    let frame = Frame::new(path, &bytes)?;
    let document = frame.document()?;
    let image = data_set(path, &document, INDEX)?;
    let (whole, lattice) = vti::shape(path, image)?;
    let Some(pieces) = named_pieces(path, &whole, image) else {
        return Ok(None);
    };
    let arrays = Association::BOTH.map(|association| {
        let element = child(image, &format!("P{}", element_of(association)));
        let all = element.map(|element| declared(element, "PDataArray"));
        kinds(&all.unwrap_or_default())
    });
    let ([Some(nodes), Some(cells)], true) = (arrays, covers(&whole, &pieces)) else {
        return Ok(None);
    };
    let pieces = Pieces {
        whole,
        pieces,
        arrays: [nodes, cells],
        is_index: true,
    };
    // Handwritten indices may lack the arrays, or have others.
    let Ok(fields) = pieces.fields_of_first() else {
        return Ok(None);
    };
    let head = Dataset::new(path, FORMAT, Geometry::Lattice(lattice), fields);
    Ok(Some((head, pieces)))
}

/// The pieces of an index; `None` if it lacks their extents, or names a file twice.
fn named_pieces(
    path: &Path,
    whole: &Extent,
    image: Node<'_, '_>,
) -> Option<Vec<(PathBuf, Extent)>> {
    let folder = path.parent().unwrap_or(Path::new(""));
    let mut named = HashSet::new();
    let mut pieces = Vec::new();
    for node in piece_nodes(image) {
        node.attribute("Extent")?;
        let extent = Extent::of_element(whole, path, node).ok()??;
        let source = node.attribute("Source").filter(|s| !s.is_empty())?;
        let file = folder.join(source);
        if !named.insert(file.clone()) {
            return None;
        }
        pieces.push((file, extent));
    }
    Some(pieces)
}

/// Whether pieces cover all nodes; also false if finding out takes too much work. The whole is cut recursively
/// at faces of pieces until one piece covers each part.
fn covers(whole: &Extent, pieces: &[(PathBuf, Extent)]) -> bool {
    let meets = |a: &Extent, b: &Extent| {
        (0..3).all(|axis| a.first[axis] <= b.last[axis] && b.first[axis] <= a.last[axis])
    };
    let contains = |a: &Extent, b: &Extent| {
        (0..3).all(|axis| a.first[axis] <= b.first[axis] && b.last[axis] <= a.last[axis])
    };
    let extents: Vec<&Extent> = pieces.iter().map(|(_, extent)| extent).collect();
    let mut looked_at = extents.len();
    let mut left = vec![(*whole, extents)];
    while let Some((part, near)) = left.pop() {
        if near.iter().any(|extent| contains(extent, &part)) {
            continue;
        }
        // Pieces are written in the order of their positions, so half of them lie on either side of the middle
        // one.
        let Some(middle) = near.get(near.len() / 2) else {
            return false;
        };
        let cut = (0..3).rev().find_map(|axis| {
            let inner = part.first[axis] + 1..=part.last[axis];
            let faces = [middle.first[axis], middle.last[axis] + 1];
            let face = faces.into_iter().find(|face| inner.contains(face));
            face.map(|face| (axis, face))
        });
        let Some((axis, face)) = cut else {
            return false;
        };
        let (mut before, mut behind) = (part, part);
        before.last[axis] = face - 1;
        behind.first[axis] = face;
        for part in [before, behind] {
            let near: Vec<&Extent> = near.iter().copied().filter(|e| meets(e, &part)).collect();
            looked_at += near.len();
            left.push((part, near));
        }
        if looked_at > MOST_LOOKS {
            return false;
        }
    }
    true
}

/// The arrays of a piece.
fn arrays_of<'d>(piece: Node<'d, 'd>, association: Association) -> Vec<Declared<'d>> {
    let element = child(piece, element_of(association));
    let all = element.map(|element| declared(element, "DataArray"));
    all.unwrap_or_default()
}

/// The arrays' properties that must be equal in all pieces, sorted; `None` if two arrays have one name, or one
/// is damaged.
fn kinds(arrays: &[Declared<'_>]) -> Option<Vec<Kind>> {
    let kind = |array: &Declared<'_>| {
        let components = array.component_count()?;
        let values = array.no_values();
        Some((array.name.clone(), components, values.type_name()))
    };
    let mut kinds: Vec<Kind> = arrays.iter().map(kind).collect::<Option<_>>()?;
    kinds.sort_unstable();
    let is_once = |pair: &[Kind]| pair[0].0 != pair[1].0;
    kinds.windows(2).all(is_once).then_some(kinds)
}

/// Fields without values. Fields of cells are never read.
fn fields(nodes: &[Declared<'_>], cells: &[Kind]) -> Vec<Field> {
    let field = |name: &str, association, source| Field {
        name: name.to_owned(),
        association,
        source,
        unit: None,
    };
    let of_nodes = nodes.iter().map(|array| {
        let source = match array.component_count() {
            Some(1) => FieldSource::Scalar(array.no_values()),
            _ => FieldSource::Vector(Vec::new()),
        };
        field(&array.name, Association::Nodes, source)
    });
    let of_cells = cells
        .iter()
        .map(|(name, ..)| field(name, Association::Cells, FieldSource::Vector(Vec::new())));
    of_nodes.chain(of_cells).collect()
}

/// The only piece of a file that has nodes, with its extent.
fn only_piece<'d>(
    path: &Path,
    whole: &Extent,
    image: Node<'d, 'd>,
) -> Result<Option<(Extent, Node<'d, 'd>)>> {
    let mut only = None;
    for node in piece_nodes(image) {
        let Some(extent) = Extent::of_element(whole, path, node)? else {
            continue;
        };
        if only.replace((extent, node)).is_some() {
            return Ok(None);
        }
    }
    Ok(only)
}

/// A file, its length, and its first bytes, which include the elements before the appended data.
fn open_head(path: &Path) -> Result<(File, u64, Vec<u8>)> {
    let (mut file, len) = open_regular(path)?;
    let mut head = Vec::new();
    Read::by_ref(&mut file)
        .take(MOST_ELEMENTS_LEN)
        .read_to_end(&mut head)
        .map_err(|e| unread(path, e))?;
    Ok((file, len, head))
}

fn unread(path: &Path, error: std::io::Error) -> Error {
    Error::io(path, "reading", error, "check the disk")
}

/// Location of a piece's values.
enum Place {
    Plain(PlainNumbers),
    /// The whole file must be read.
    Packed,
}

impl Pieces {
    /// Whether an array can be read by planes.
    pub(in crate::io) fn can_read(&self, array: &str) -> bool {
        // A single file that must be read whole is better read once.
        let mut pieces = self.pieces.iter();
        self.is_index
            || pieces.all(|(path, extent)| {
                let place = self.place(path, extent, array);
                matches!(place, Ok(Place::Plain(_)))
            })
    }

    /// The fields; those of nodes in the order of the first piece.
    fn fields_of_first(&self) -> Result<Vec<Field>> {
        let Some((path, extent)) = self.pieces.first() else {
            return Ok(Vec::new());
        };
        let read = |document: &Document<'_>| {
            let piece = self.checked(path, extent, document)?;
            let nodes = arrays_of(piece, Association::Nodes);
            Ok(fields(&nodes, &self.arrays[1]))
        };
        let (_, _, head) = open_head(path)?;
        match Frame::of_head(path, &head) {
            Some(frame) => read(&frame.document()?),
            None => read(&Frame::new(path, &read_all(path)?)?.document()?),
        }
    }

    /// Reads some planes of an array, run after run. A packed piece is unpacked once.
    ///
    /// - `empty`: no values, of the array's type.
    pub(in crate::io) fn read(
        &self,
        array: &str,
        empty: &Values,
        runs: &[Range<usize>],
    ) -> Result<Values> {
        let [nx, ny, _] = self.whole.dims(Association::Nodes);
        let mut wanted = Vec::new();
        for (path, extent) in &self.pieces {
            let [_, _, first] = extent.shift_from(&self.whole);
            let [_, _, count] = extent.dims(Association::Nodes);
            let mut parts = Vec::new();
            let mut before = 0;
            for run in runs {
                let own = run.start.max(first)..run.end.min(first + count);
                if !own.is_empty() {
                    let to = before + own.start - run.start;
                    parts.push((own.start - first..own.end - first, to));
                }
                before += run.len();
            }
            if !parts.is_empty() {
                // Each piece is checked to have its values before memory for all is allocated.
                let place = self.place(path, extent, array)?;
                wanted.push((path, extent, parts, place));
            }
        }
        let count = nx * ny * runs.iter().map(Range::len).sum::<usize>();
        let mut all = match empty {
            Values::U8(_) => Values::U8(vec![0; count]),
            Values::I16(_) => Values::I16(vec![0; count]),
            Values::U16(_) => Values::U16(vec![0; count]),
            Values::F32(_) | Values::F64(_) => Values::F32(vec![0.0; count]),
        };
        for (path, extent, parts, place) in wanted {
            let [dx, dy, _] = extent.shift_from(&self.whole);
            let [width, height, _] = extent.dims(Association::Nodes);
            let plane = width * height;
            let source = match place {
                Place::Plain(numbers) => Ok(numbers),
                Place::Packed => Err(self.unpacked(path, extent, array)?),
            };
            for (own, to) in parts {
                let read;
                let (part, skipped) = match &source {
                    Ok(numbers) => {
                        read = numbers.read(own.start * plane..own.end * plane)?;
                        (&read, 0)
                    }
                    Err(unpacked) => (unpacked, own.start),
                };
                let rows = (0..own.len()).flat_map(|k| (0..height).map(move |j| (k, j)));
                let rows = rows.map(|(k, j)| {
                    let from = ((k + skipped) * height + j) * width;
                    let to = ((to + k) * ny + dy + j) * nx + dx;
                    (from..from + width, to..to + width)
                });
                if let (Values::F32(narrow), Values::F64(_)) = (&all, part) {
                    all = Values::F64(narrow.iter().map(|&v| v.into()).collect());
                }
                match (&mut all, part) {
                    (Values::U8(all), Values::U8(part)) => copy(all, part, rows),
                    (Values::I16(all), Values::I16(part)) => copy(all, part, rows),
                    (Values::U16(all), Values::U16(part)) => copy(all, part, rows),
                    (Values::F32(all), Values::F32(part)) => copy(all, part, rows),
                    (Values::F64(all), Values::F64(part)) => copy(all, part, rows),
                    (Values::F64(all), Values::F32(part)) => {
                        let wide: Vec<f64> = part.iter().map(|&v| v.into()).collect();
                        copy(all, &wide, rows);
                    }
                    // The type was the same when the piece was checked.
                    _ => return Err(other_arrays(path, Association::Nodes)),
                }
            }
        }
        Ok(all)
    }

    /// Locates a piece's values, and checks their number against the file's length.
    fn place(&self, path: &Path, extent: &Extent, array: &str) -> Result<Place> {
        let count = extent.count(Association::Nodes).unwrap_or(usize::MAX);
        let (mut file, len, head) = open_head(path)?;
        if let Some(frame) = Frame::of_head(path, &head) {
            let document = frame.document()?;
            let array = self.array(path, extent, &document, array)?;
            let decoder = Decoder::new(&frame, &document)?;
            if let Some((offset, encoding)) = decoder.plain(&array) {
                let word_len = decoder.word_size();
                let wanted = count.checked_mul(encoding.scalar.size()).map(|n| n as u64);
                let at = (frame.start as u64).checked_add(offset);
                let start = at.and_then(|at| at.checked_add(word_len as u64));
                let end = start
                    .zip(wanted)
                    .and_then(|(start, n)| start.checked_add(n));
                if let (Some(at), Some(start), true) = (at, start, end.is_some_and(|n| n <= len)) {
                    let mut word = [0; 8];
                    let word = &mut word[..word_len.min(8)];
                    file.seek(SeekFrom::Start(at))
                        .and_then(|_| file.read_exact(word))
                        .map_err(|e| unread(path, e))?;
                    if Some(decoder.word(word)) == wanted {
                        return Ok(Place::Plain(PlainNumbers {
                            path: path.to_path_buf(),
                            start,
                            encoding,
                            scale: None,
                        }));
                    }
                }
                // The reader of the whole file reports the error.
            }
        }
        if count as u64 > len.saturating_mul(MOST_RATIO) {
            return Err(Error::format(
                path,
                "PointData",
                format!("{count} values, as its index says"),
                format!("{len} bytes, too few to hold them"),
                "save the image again",
            ));
        }
        Ok(Place::Packed)
    }

    /// All values of a piece.
    fn unpacked(&self, path: &Path, extent: &Extent, array: &str) -> Result<Values> {
        let count = extent.count(Association::Nodes).unwrap_or(usize::MAX);
        let bytes = read_all(path)?;
        let frame = Frame::new(path, &bytes)?;
        let document = frame.document()?;
        let array = self.array(path, extent, &document, array)?;
        let Array { components, .. } = Decoder::new(&frame, &document)?.array(array, count)?;
        let first = components.into_iter().next();
        first.ok_or_else(|| other_arrays(path, Association::Nodes))
    }

    /// An array of a file whose piece agrees with the index.
    fn array<'d>(
        &self,
        path: &Path,
        extent: &Extent,
        document: &'d Document<'_>,
        array: &str,
    ) -> Result<Declared<'d>> {
        let piece = self.checked(path, extent, document)?;
        let mut arrays = arrays_of(piece, Association::Nodes).into_iter();
        let found = arrays.find(|declared| declared.name == array);
        found.ok_or_else(|| other_arrays(path, Association::Nodes))
    }

    /// The piece of a file; an error if its nodes or arrays are not those of the index.
    fn checked<'d>(
        &self,
        path: &Path,
        extent: &Extent,
        document: &'d Document<'_>,
    ) -> Result<Node<'d, 'd>> {
        let image = data_set(path, document, KIND)?;
        let only = only_piece(path, &self.whole, image)?;
        let Some((_, piece)) = only.filter(|(found, _)| found == extent) else {
            let found = match only {
                Some((found, _)) => format!("{:?} to {:?}", found.first, found.last),
                None => "several pieces, or none".to_owned(),
            };
            return Err(Error::format(
                path,
                "Piece, `Extent`",
                format!(
                    "one piece of {:?} to {:?}, as its index says",
                    extent.first, extent.last
                ),
                found,
                "save the image again: index and pieces are of different ones",
            ));
        };
        for (association, expected) in Association::BOTH.into_iter().zip(&self.arrays) {
            // A piece one node thick has no cells.
            let is_empty = extent.count(association) == Some(0);
            let arrays = kinds(&arrays_of(piece, association));
            if !is_empty && arrays.as_ref() != Some(expected) {
                return Err(other_arrays(path, association));
            }
        }
        Ok(piece)
    }
}

/// The error for a piece whose arrays differ from its index's.
fn other_arrays(path: &Path, association: Association) -> Error {
    let element = element_of(association);
    Error::format(
        path,
        element,
        format!("the arrays of its index's `P{element}`"),
        "others",
        "save the image again, each piece with the same arrays",
    )
}

/// Copies rows of a part into the whole.
fn copy<T: Copy>(
    all: &mut [T],
    part: &[T],
    rows: impl Iterator<Item = (Range<usize>, Range<usize>)>,
) {
    for (from, to) in rows {
        all[to].copy_from_slice(&part[from]);
    }
}

#[cfg(test)]
mod tests {
    use std::fs;
    use std::io::Write;

    use super::*;
    use crate::io::parts::planes::Planes;
    use crate::io::parts::planes::tests::{bits, check, joined, whole};
    use crate::io::{OpenOptions, open};

    /// The form of a piece's file.
    #[derive(Debug, Clone, Copy, PartialEq, Eq)]
    enum Form {
        Text,
        Raw { wide: bool, big_endian: bool },
        Zlib,
    }

    const RAW: Form = Form::Raw {
        wide: true,
        big_endian: false,
    };

    const FORMS: [Form; 4] = [
        Form::Text,
        RAW,
        Form::Raw {
            wide: false,
            big_endian: true,
        },
        Form::Zlib,
    ];

    /// Numbers that identify nodes, and the piece if several share them.
    fn numbers(extent: [i64; 6], piece: usize) -> Vec<f32> {
        let [i0, i1, j0, j1, k0, k1] = extent;
        let mut all = Vec::new();
        for k in k0..=k1 {
            for j in j0..=j1 {
                for i in i0..=i1 {
                    all.push((i + 10 * j + 100 * k) as f32 + 0.125 * piece as f32);
                }
            }
        }
        all
    }

    #[expect(clippy::cast_possible_truncation, reason = "some hundreds, cut off")]
    fn short(x: f32) -> i16 {
        x as i16
    }

    /// A file of one piece with an array of floats, one of shorts, and the content of `more`.
    fn file(form: Form, extent: [i64; 6], piece: usize, more: &str) -> Vec<u8> {
        let numbers = numbers(extent, piece);
        let (wide, big_endian) = match form {
            Form::Raw { wide, big_endian } => (wide, big_endian),
            _ => (false, false),
        };
        let floats = numbers.iter().flat_map(|x| match big_endian {
            true => x.to_be_bytes(),
            false => x.to_le_bytes(),
        });
        let shorts = numbers.iter().flat_map(|x| match big_endian {
            true => short(*x).to_be_bytes(),
            false => short(*x).to_le_bytes(),
        });
        let arrays: [Vec<u8>; 2] = [floats.collect(), shorts.collect()];
        let word = |n: usize| match (wide, big_endian) {
            (false, false) => u32::try_from(n).unwrap().to_le_bytes().to_vec(),
            (false, true) => u32::try_from(n).unwrap().to_be_bytes().to_vec(),
            (true, false) => (n as u64).to_le_bytes().to_vec(),
            (true, true) => (n as u64).to_be_bytes().to_vec(),
        };
        let mut appended = Vec::new();
        let elements = arrays.iter().zip(["Float32", "Int16"]).zip(["T [K]", "s"]);
        let elements = elements.map(|((bytes, kind), name)| {
            let start = format!("<DataArray type=\"{kind}\" Name=\"{name}\" ");
            if form == Form::Text {
                let text: Vec<String> = match kind {
                    "Int16" => numbers.iter().map(|x| short(*x).to_string()).collect(),
                    _ => numbers.iter().map(f32::to_string).collect(),
                };
                return format!("{start} format=\"ascii\">{}</DataArray>", text.join(" "));
            }
            let offset = appended.len();
            if form == Form::Zlib {
                let mut zlib = flate2::write::ZlibEncoder::new(Vec::new(), Default::default());
                zlib.write_all(bytes).unwrap();
                let packed = zlib.finish().unwrap();
                appended.extend([1, bytes.len(), 0, packed.len()].map(word).concat());
                appended.extend(packed);
            } else {
                appended.extend(word(bytes.len()));
                appended.extend(bytes);
            }
            format!("{start} format=\"appended\" offset=\"{offset}\"/>")
        });
        let elements: String = elements.collect();
        let order = if big_endian { "Big" } else { "Little" };
        let word = if wide { "UInt64" } else { "UInt32" };
        let packed = match form {
            Form::Zlib => "compressor=\"vtkZLibDataCompressor\"",
            _ => "",
        };
        let extent = extent.map(|n| n.to_string()).join(" ");
        let text = format!(
            "<VTKFile type=\"ImageData\" byte_order=\"{order}Endian\" header_type=\"{word}\" {packed}>\
             <ImageData WholeExtent=\"{extent}\" {PLACE}><Piece Extent=\"{extent}\">\
             <PointData>{elements}</PointData>{more}</Piece></ImageData>"
        );
        let mut file = text.into_bytes();
        if form != Form::Text {
            file.extend(b"<AppendedData encoding=\"raw\">\n _");
            file.extend(appended);
            file.extend(b"\n</AppendedData>");
        }
        file.extend(b"</VTKFile>\n");
        file
    }

    const PLACE: &str = "Origin=\"1 2 3\" Spacing=\"0.5 1 2\" Direction=\"0 -1 0 1 0 0 0 0 1\"";

    const ARRAYS: &str = "<PPointData><PDataArray type=\"Float32\" Name=\"T [K]\"/>\
                          <PDataArray type=\"Int16\" Name=\"s\"/></PPointData>";

    fn index(whole: &str, arrays: &str, pieces: &[([i64; 6], String)]) -> String {
        let piece = |(extent, file): &([i64; 6], String)| {
            let extent = extent.map(|n| n.to_string()).join(" ");
            format!("<Piece Extent=\"{extent}\" Source=\"{file}\"/>")
        };
        let pieces: String = pieces.iter().map(piece).collect();
        format!(
            "<VTKFile type=\"PImageData\"><PImageData WholeExtent=\"{whole}\" {PLACE}>{arrays}{pieces}\
             </PImageData></VTKFile>"
        )
    }

    /// Pieces that have nodes in common, and one within another.
    const EXTENTS: [[i64; 6]; 6] = [
        [-1, 1, 0, 3, 2, 4],
        [1, 4, 0, 3, 2, 4],
        [-1, 4, 0, 1, 4, 7],
        [-1, 4, 1, 3, 4, 7],
        [0, 2, 0, 2, 3, 5],
        [-1, 4, 0, 3, 8, 8],
    ];
    const WHOLE: &str = "-1 4 0 3 2 8";

    fn scene(forms: impl Fn(usize) -> Form) -> (tempfile::TempDir, PathBuf) {
        let folder = tempfile::tempdir().unwrap();
        let mut pieces = Vec::new();
        for (i, extent) in EXTENTS.into_iter().enumerate() {
            let name = format!("part_{i}.vti");
            fs::write(folder.path().join(&name), file(forms(i), extent, i, "")).unwrap();
            pieces.push((extent, name));
        }
        let path = folder.path().join("a.pvti");
        fs::write(&path, index(WHOLE, ARRAYS, &pieces)).unwrap();
        (folder, path)
    }

    fn planes(path: &Path, field: Option<&str>) -> Option<Planes> {
        Planes::open(path, &OpenOptions::default(), field).unwrap()
    }

    #[test]
    fn pieces_give_what_the_whole_has() {
        for shift in 0..FORMS.len() {
            let (_folder, path) = scene(|i| FORMS[(i + shift) % FORMS.len()]);
            for field in ["T [K]", "t", "S"] {
                let planes = check(&path, &OpenOptions::default(), Some(field)).unwrap();
                assert_eq!(planes.unit(), (field != "S").then_some("K"));
            }
            // Several fields, none named; a field that does not exist.
            assert!(planes(&path, None).is_none());
            assert!(planes(&path, Some("u")).is_none());
        }
    }

    #[test]
    fn only_pieces_that_meet_the_planes_are_opened() {
        let (folder, path) = scene(|_| RAW);
        let [t, _] = ["T [K]", "s"].map(|field| whole(&path, &OpenOptions::default(), field));
        let planes = planes(&path, Some("T [K]")).unwrap();
        for i in [0, 1, 4] {
            fs::remove_file(folder.path().join(format!("part_{i}.vti"))).unwrap();
        }
        assert_eq!(
            bits(&planes.read(4..7).unwrap()),
            bits(&t.part(4 * 24..7 * 24))
        );
        let error = planes.read(1..2).unwrap_err().to_string();
        assert!(error.contains("part_0.vti"), "{error}");
    }

    #[test]
    fn one_file_is_read_by_planes_where_its_bytes_are_plain() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.vti");
        for form in FORMS {
            fs::write(&path, file(form, [0, 3, -2, 0, 5, 9], 1, "")).unwrap();
            let found = check(&path, &OpenOptions::default(), Some("s"));
            assert_eq!(
                found.is_some(),
                matches!(form, Form::Raw { .. }),
                "{form:?}"
            );
        }
    }

    #[test]
    fn what_tells_of_blanked_nodes_or_holds_cells_is_left_to_the_whole() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.vti");
        let extent = [0, 1, 0, 1, 0, 1];
        let cells = |name: &str| {
            format!(
                "<CellData><DataArray type=\"UInt8\" Name=\"{name}\" format=\"ascii\">1</DataArray></CellData>"
            )
        };
        fs::write(&path, file(RAW, extent, 0, &cells("c"))).unwrap();
        assert!(check(&path, &OpenOptions::default(), Some("s")).is_some());
        assert!(planes(&path, Some("c")).is_none());
        fs::write(&path, file(RAW, extent, 0, &cells("vtkGhostType"))).unwrap();
        assert!(planes(&path, Some("s")).is_none());
        // For an index, too, whose first piece has no cells.
        let ghosts = "<PCellData><PDataArray type=\"UInt8\" Name=\"vtkGhostType\"/></PCellData>";
        let thin = [0, 1, 0, 1, 0, 0];
        fs::write(folder.path().join("thin.vti"), file(RAW, thin, 0, "")).unwrap();
        let pieces = [(thin, "thin.vti".to_owned()), (extent, "a.vti".to_owned())];
        let index = |arrays: &str| index("0 1 0 1 0 1", arrays, &pieces);
        let parallel = folder.path().join("a.pvti");
        fs::write(&parallel, index(&format!("{ARRAYS}{ghosts}"))).unwrap();
        assert!(open(&parallel, &OpenOptions::default()).is_ok());
        assert!(planes(&parallel, Some("s")).is_none());
    }

    #[test]
    fn pieces_that_are_not_what_the_index_says_are_named() {
        let (folder, path) = scene(|_| RAW);
        let planes = planes(&path, Some("s")).unwrap();
        let other = |i: usize, bytes: Vec<u8>| {
            let path = folder.path().join(format!("part_{i}.vti"));
            let before = fs::read(&path).unwrap();
            fs::write(&path, bytes).unwrap();
            let error = planes.read(0..7).unwrap_err().to_string();
            fs::write(&path, before).unwrap();
            assert!(error.contains(&format!("part_{i}.vti")), "{error}");
            error
        };
        let error = other(2, file(RAW, [-1, 4, 0, 1, 4, 6], 2, ""));
        assert!(error.contains("Extent"), "{error}");
        let text = String::from_utf8(file(Form::Text, EXTENTS[3], 3, "")).unwrap();
        let error = other(3, text.replace("Name=\"s\"", "Name=\"z\"").into_bytes());
        assert!(error.contains("PointData"), "{error}");
        let cut = file(RAW, EXTENTS[1], 1, "");
        other(1, cut[..cut.len() - 100].to_vec());
        other(5, b"<VTKFile".to_vec());
        assert_eq!(planes.read(0..7).unwrap().len(), 7 * 24);
    }

    #[test]
    fn indices_that_say_too_little_are_read_as_a_whole() {
        let (_folder, path) = scene(|_| RAW);
        let sound = fs::read_to_string(&path).unwrap();
        for (from, to) in [
            (ARRAYS, ""),
            ("Int16", "Int32"),
            ("Name=\"s\"", "Name=\"z\""),
            ("<Piece Extent=\"-1 1 0 3 2 4\"", "<Piece"),
            (
                "<Piece Extent=\"-1 4 0 3 8 8\"",
                "<Piece Extent=\"-1 4 0 3 8 7\"",
            ),
            // Pieces that leave a node out.
            (
                "<Piece Extent=\"-1 4 0 3 8 8\"",
                "<Piece Extent=\"-1 4 1 3 8 8\"",
            ),
            ("part_1.vti", "part_0.vti"),
        ] {
            let text = sound.replacen(from, to, 1);
            assert_ne!(text, sound);
            fs::write(&path, text).unwrap();
            assert!(planes(&path, Some("s")).is_none(), "{from} as {to}");
        }
    }

    #[test]
    fn what_covers_the_whole_is_told_from_what_leaves_holes() {
        let extent = |numbers: [i64; 6]| Extent::from_reals(numbers.map(|n| n as f64)).unwrap();
        let all = |extents: &[[i64; 6]]| -> Vec<(PathBuf, Extent)> {
            let extents = extents.iter();
            extents.map(|n| (PathBuf::new(), extent(*n))).collect()
        };
        let whole = extent([0, 3, 0, 3, 0, 3]);
        assert!(!covers(&whole, &[]));
        // Every node is tested against every piece, for random blocks.
        let mut state = 1_u64;
        let mut next = |most: i64| {
            state = state
                .wrapping_mul(6364136223846793005)
                .wrapping_add(1442695040888963407);
            (state >> 33) as i64 % (most + 1)
        };
        let mut sound = 0;
        for _ in 0..3000 {
            let blocks: Vec<[i64; 6]> = (0..2 + next(6))
                .map(|_| {
                    let mut ends = || {
                        let (a, b) = (next(3), next(3));
                        if next(2) == 0 {
                            [0, 3]
                        } else {
                            [a.min(b), a.max(b)]
                        }
                    };
                    let [[i0, i1], [j0, j1], [k0, k1]] = [ends(), ends(), ends()];
                    [i0, i1, j0, j1, k0, k1]
                })
                .collect();
            let has = |i, j, k| {
                let inside = |b: &[i64; 6]| {
                    (b[0]..=b[1]).contains(&i)
                        && (b[2]..=b[3]).contains(&j)
                        && (b[4]..=b[5]).contains(&k)
                };
                blocks.iter().any(inside)
            };
            let expected = (0..64).all(|n| has(n % 4, n / 4 % 4, n / 16));
            sound += i32::from(expected);
            assert_eq!(covers(&whole, &all(&blocks)), expected, "{blocks:?}");
        }
        assert!((300..2700).contains(&sound), "{sound}");
        // Thousands of blocks, with a layer in common between neighbours.
        let mut blocks = Vec::new();
        for n in 0..32_768 {
            let [i, j, k] = [n % 32, n / 32 % 32, n / 1024].map(|n| 8 * n);
            blocks.push([i, i + 8, j, j + 8, k, k + 8]);
        }
        let whole = extent([0, 256, 0, 256, 0, 256]);
        assert!(covers(&whole, &all(&blocks)));
        blocks.swap_remove(12_345);
        assert!(!covers(&whole, &all(&blocks)));
    }

    /// Any bytes give data or an error; data equal those of the whole.
    #[test]
    fn damaged_bytes_end_in_data_or_an_error() {
        let mut same = 0;
        for form in FORMS {
            let (folder, path) = scene(|_| form);
            let victims = [path.clone(), folder.path().join("part_2.vti")];
            for victim in victims {
                let sound = fs::read(&victim).unwrap();
                for at in (0..sound.len()).step_by(1 + sound.len() / 150) {
                    for bytes in [sound[..at].to_vec(), {
                        let mut bytes = sound.clone();
                        bytes[at] = if bytes[at] == b'9' { b'0' } else { b'9' };
                        bytes
                    }] {
                        fs::write(&victim, bytes).unwrap();
                        let options = OpenOptions::default();
                        let Ok(Some(planes)) = Planes::open(&path, &options, Some("s")) else {
                            continue;
                        };
                        if let (Ok(values), Ok(data)) = (joined(&planes, 2), open(&path, &options))
                        {
                            assert_eq!(bits(&values), bits(&data.scalar("s").unwrap().1));
                            same += 1;
                        }
                    }
                }
                fs::write(&victim, sound).unwrap();
            }
        }
        assert!(same > 100, "{same}");
    }

    #[test]
    fn claims_beyond_the_files_are_refused_before_memory_is_taken() {
        let folder = tempfile::tempdir().unwrap();
        let most = [0, 99_999, 0, 99_999, 0, 99];
        let extent = "0 99999 0 99999 0 99";
        for form in FORMS {
            let text = String::from_utf8_lossy(&file(form, [0, 1, 0, 1, 0, 1], 0, ""))
                .replace("0 1 0 1 0 1", extent);
            fs::write(folder.path().join("part.vti"), text).unwrap();
            let path = folder.path().join("a.pvti");
            let pieces = [(most, "part.vti".to_owned())];
            fs::write(&path, index(extent, ARRAYS, &pieces)).unwrap();
            let Some(planes) = planes(&path, Some("s")) else {
                panic!("{form:?}")
            };
            let error = planes.read(0..1).unwrap_err().to_string();
            assert!(error.contains("too few to hold them"), "{error}");
            let path = folder.path().join("part.vti");
            assert!(
                Planes::open(&path, &OpenOptions::default(), Some("s")).is_ok_and(|p| p.is_none())
            );
        }
    }
}
