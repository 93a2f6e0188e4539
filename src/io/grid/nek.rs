//! Reads field files of Nek5000 and NekRS, and the files (`.nek5000`) that name those of each time.
//!
//! | bytes | content of a field file |
//! |---|---|
//! | 132 | text: `#std`, bytes of a number, nodes along x, y and z in an element, elements here and in all files, time, step, number of this file and of files, letters of the fields |
//! | 4 | 6.54321 in single precision, which shows the byte order |
//! | 4 each | numbers of the elements |
//! | the rest | of each field element by element, of vectors all x before all y: `X` positions, `U` velocities, `P`, `T`, `S01` ... |
//!
//! Nodes lie at Gauss-Lobatto-Legendre points. The cells between neighbouring nodes of an element are drawn as linear
//! hexahedra, or quadrilaterals in two dimensions. A file without positions takes those of an earlier one beside it.
//!
//! | line | content of a `.nek5000` file |
//! |---|---|
//! | `filetemplate:` | names with `%01d` for a part and, last, `%05d` for a time |
//! | `firsttimestep:`, `numtimesteps:` | the numbers of the times |
//!
//! Source: "Field files" in Nek5000's documentation.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use glam::DVec3;

use super::block_cells;
use super::budget::Budget;
use super::zones::too_many_entries;
use crate::data::association::Association;
use crate::data::cells::CellMesh;
use crate::data::dataset::{Dataset, Field, FieldSource};
use crate::error::{Error, Result};
use crate::io::bytes::file::Input;
use crate::io::bytes::scalars::{Encoding, ScalarType, Stride, doubles, values};
use crate::io::format::Recognise;
use crate::io::options::{OpenOptions, ReadAs};
use crate::io::time_steps::{self, Part, TimeStep};
use crate::io::volume::voxels::beside_as;
use crate::io::vtk;
use crate::io::vtk::collection;
use crate::io::vtk::xml::clip;
use crate::scene::Values;

/// First bytes of a field file.
const MAGIC: &[u8] = b"#std ";

/// Length in bytes of the text before the numbers.
const HEADER: usize = 132;

/// The number that shows the byte order, and how far it may be off in single precision.
const TEST: (f32, f32) = (6.543_21, 1e-4);

/// Greatest number of nodes along an edge of an element.
const MOST_NODES: usize = 64;

/// Greatest number of earlier files that are looked at for positions.
const MOST_EARLIER: u32 = 100;

/// Greatest number of files of one time.
const MOST_PARTS: usize = 1 << 16;

const DAMAGED: &str = "the file is damaged: copy it again";

/// Whether a file that begins with `head` is a field file.
fn is_field(head: &[u8]) -> bool {
    head.starts_with(MAGIC)
}

/// Whether a file that begins with `head` is a field file, or names field files.
pub(in crate::io) fn looks_like(head: &[u8]) -> bool {
    const TEMPLATE: &[u8] = b"filetemplate:";
    is_field(head) || head.windows(TEMPLATE.len()).any(|bytes| bytes == TEMPLATE)
}

/// Reads a field file, or the first file of the first time that a file names.
///
/// # Errors
/// A damaged file; no positions in it or in an earlier file beside it.
pub(in crate::io) fn read(
    input: Input<'_>,
    options: &OpenOptions,
    recognise: Recognise,
) -> Result<Dataset> {
    let (head, _) = input.head(HEADER)?;
    match is_field(&head) {
        true => read_field(input, options.read_as),
        false => collection::read_first(input, &steps(input)?, options, recognise),
    }
}

/// The time of a field file, or the times and files that a file names.
///
/// # Errors
/// A damaged file; a file that is named and does not exist.
pub(in crate::io) fn steps(input: Input<'_>) -> Result<Vec<TimeStep>> {
    let (head, _) = input.head(HEADER)?;
    match is_field(&head) {
        true => {
            let header = Header::parse(input.path, &head)?;
            Ok(time_steps::of_file(input.path, &[header.time]))
        }
        false => named(input),
    }
}

/// Header: the text before the numbers.
struct Header {
    word: ScalarType,
    dims: [usize; 3],
    elements: usize,
    all_elements: usize,
    time: f64,
    letters: String,
}

impl Header {
    fn parse(path: &Path, head: &[u8]) -> Result<Self> {
        let text = String::from_utf8_lossy(head.get(..HEADER).unwrap_or(head));
        let words: Vec<&str> = text.split_whitespace().collect();
        let fault = || {
            let expected = "`#std`, sizes, counts, a time and letters of fields in 132 bytes";
            let found = clip(&text);
            Error::format(path, "header", expected, format!("`{found}`"), DAMAGED)
        };
        if !is_field(head) {
            return Err(fault());
        }
        let [_, word, x, y, z, elements, all, time, _, _, _, letters, ..] = words[..] else {
            return Err(fault());
        };
        let count = |word: &str| word.parse::<usize>().map_err(|_| fault());
        let dims = [count(x)?, count(y)?, count(z)?];
        let is_sound = dims[0] > 1 && dims[1] > 1 && dims[2] > 0;
        if !is_sound || dims.iter().any(|&n| n > MOST_NODES) {
            return Err(fault());
        }
        Ok(Self {
            word: match word {
                "4" => ScalarType::F32,
                "8" => ScalarType::F64,
                _ => return Err(fault()),
            },
            dims,
            elements: count(elements)?,
            all_elements: count(all)?,
            time: time.parse().map_err(|_| fault())?,
            letters: letters.to_owned(),
        })
    }

    fn per_element(&self) -> usize {
        self.dims.iter().product()
    }

    /// Returns the dimensions of positions and velocities.
    fn axes(&self) -> usize {
        if self.dims[2] > 1 { 3 } else { 2 }
    }

    /// Returns the fields in their order, with their numbers of components.
    fn fields(&self, path: &Path) -> Result<Vec<(String, usize)>> {
        let mut fields = Vec::new();
        let mut rest = self.letters.chars();
        while let Some(letter) = rest.next() {
            match letter {
                'X' => fields.push(("X".to_owned(), self.axes())),
                'U' => fields.push(("Velocity".to_owned(), self.axes())),
                'P' => fields.push(("Pressure".to_owned(), 1)),
                'T' => fields.push(("Temperature".to_owned(), 1)),
                'S' => {
                    let digits: String = rest.by_ref().take(2).collect();
                    let count = digits.parse::<usize>().unwrap_or(0);
                    fields.extend((1..=count).map(|i| (format!("S{i:02}"), 1)));
                }
                _ => {
                    let expected = "letters of fields: X, U, P, T, S and a count";
                    let found = clip(&self.letters);
                    return Err(Error::format(path, "header", expected, found, DAMAGED));
                }
            }
        }
        Ok(fields)
    }
}

/// A field file whose length has been checked.
struct FieldFile<'a> {
    header: Header,
    encoding: Encoding,
    /// Numbers of the elements.
    elements: Vec<u32>,
    /// Name, number of components and bytes of each field.
    fields: Vec<(String, usize, &'a [u8])>,
}

impl<'a> FieldFile<'a> {
    fn parse(path: &Path, bytes: &'a [u8]) -> Result<Self> {
        let header = Header::parse(path, bytes)?;
        let fault = |place: &str, expected: String, found: String| {
            Error::format(path, place, expected, found, DAMAGED)
        };
        let test = bytes.get(HEADER..).and_then(<[u8]>::first_chunk::<4>);
        let is_test = |x: f32| (x - TEST.0).abs() < TEST.1;
        let big_endian = match test {
            Some(&word) if is_test(f32::from_le_bytes(word)) => false,
            Some(&word) if is_test(f32::from_be_bytes(word)) => true,
            _ => {
                let expected = "6.54321 in four bytes".to_owned();
                return Err(fault(
                    "byte 132",
                    expected,
                    test.map_or_else(
                        || "the end of the file".into(),
                        |bytes| format!("{bytes:?}"),
                    ),
                ));
            }
        };
        let encoding = Encoding {
            scalar: header.word,
            big_endian,
        };
        let mut rest = bytes.get(HEADER + 4..).unwrap_or_default();
        let mut take = |name: &str, count: Option<usize>, size: usize| {
            let wanted = count.and_then(|count| count.checked_mul(size));
            let split = wanted.and_then(|wanted| rest.split_at_checked(wanted));
            let Some((own, behind)) = split else {
                let expected = format!("{} elements", header.elements);
                let found = format!("{} bytes before the end", rest.len());
                return Err(fault(name, expected, found));
            };
            rest = behind;
            Ok(own)
        };
        let numbers = take("numbers of elements", Some(header.elements), 4)?;
        let number = |word: &[u8]| {
            let word = word.first_chunk::<4>().copied().unwrap_or_default();
            if big_endian {
                u32::from_be_bytes(word)
            } else {
                u32::from_le_bytes(word)
            }
        };
        let elements = numbers.chunks_exact(4).map(number).collect();
        let nodes = header.elements.checked_mul(header.per_element());
        let mut fields = Vec::new();
        for (name, components) in header.fields(path)? {
            let count = nodes.and_then(|nodes| nodes.checked_mul(components));
            let own = take(&format!("field `{name}`"), count, header.word.size())?;
            fields.push((name, components, own));
        }
        Ok(Self {
            header,
            encoding,
            elements,
            fields,
        })
    }

    /// Returns the bytes of one component of a field, element by element.
    fn component(&self, bytes: &[u8], components: usize, at: usize) -> Vec<u8> {
        let of_element = self.header.per_element() * self.encoding.scalar.size();
        let own = bytes
            .chunks_exact(of_element.max(1))
            .skip(at)
            .step_by(components);
        own.flatten().copied().collect()
    }

    fn stride(&self) -> Stride {
        Stride {
            first: 0,
            step: self.encoding.scalar.size(),
            count: self.elements.len() * self.header.per_element(),
        }
    }

    /// Returns the positions of all nodes; `None` if the file has none.
    fn positions(&self) -> Option<Vec<DVec3>> {
        let (_, components, bytes) = self.fields.iter().find(|(name, ..)| name == "X")?;
        let axis = |at: usize| {
            let own = self.component(bytes, *components, at);
            doubles(&own, self.encoding, self.stride())
        };
        let (x, y) = (axis(0)?, axis(1)?);
        let z = if *components > 2 {
            axis(2)?
        } else {
            vec![0.0; x.len()]
        };
        let nodes = x.into_iter().zip(y).zip(z);
        Some(nodes.map(|((x, y), z)| DVec3::new(x, y, z)).collect())
    }
}

fn read_field(input: Input<'_>, read_as: Option<ReadAs>) -> Result<Dataset> {
    let path = input.path;
    let bytes = input.read_all()?;
    let budget = Budget::new(path, bytes.len());
    let file = FieldFile::parse(path, &bytes)?;
    let header = &file.header;
    let mut notes = Vec::new();
    let nodes = match file.positions() {
        Some(nodes) => nodes,
        None => {
            let (nodes, from, len) = earlier_positions(input, &file)?;
            budget.add(len);
            let from = from
                .file_name()
                .unwrap_or_default()
                .to_string_lossy()
                .into_owned();
            notes.push(format!("The positions are those of `{from}`."));
            nodes
        }
    };
    if file.elements.len() < header.all_elements {
        notes.push(format!(
            "{} of {} elements: others are in files of the same time, which a `.nek5000` file names.",
            file.elements.len(),
            header.all_elements
        ));
    }
    budget.spend("cells of all elements", nodes.len(), 40)?;
    let mut mesh = CellMesh {
        offsets: vec![0],
        ..CellMesh::default()
    };
    for element in 0..file.elements.len() {
        let first = element * header.per_element();
        block_cells::append(&mut mesh, header.dims, first).ok_or_else(|| {
            too_many_entries(
                path,
                "elements",
                "write it in more files, each of fewer elements",
            )
        })?;
    }
    mesh.nodes = nodes;
    let mut fields = Vec::new();
    for (name, components, bytes) in file.fields.iter().filter(|(name, ..)| name != "X") {
        let component = |at: usize| match components {
            1 => values(bytes, file.encoding, file.stride()),
            _ => {
                let own = file.component(bytes, *components, at);
                values(&own, file.encoding, file.stride())
            }
        };
        let all: Option<Vec<Values>> = (0..*components).map(component).collect();
        let mut all = all.unwrap_or_default();
        fields.push(Field {
            name: name.clone(),
            association: Association::Nodes,
            source: match all.len() {
                1 => FieldSource::Scalar(all.remove(0)),
                _ => FieldSource::Vector(all),
            },
            unit: None,
        });
    }
    let mut data = vtk::grid::dataset(path, "Nek5000 field file", mesh, fields, read_as)?;
    data.notes.splice(0..0, notes);
    Ok(data)
}

/// Returns the positions in an earlier file of the same name, in the order of this file's elements; with that file's
/// path and length.
fn earlier_positions(
    input: Input<'_>,
    file: &FieldFile<'_>,
) -> Result<(Vec<DVec3>, PathBuf, usize)> {
    let path = input.path;
    let missing = || {
        let expected = "positions (`X`), here or in an earlier file beside it";
        let advice = "put the first file of the run beside it";
        Error::format(
            path,
            "header, letters of fields",
            expected,
            file.header.letters.clone(),
            advice,
        )
    };
    let name = path
        .file_name()
        .unwrap_or_default()
        .to_string_lossy()
        .into_owned();
    let start = name
        .rfind(|c: char| !c.is_ascii_digit())
        .map_or(0, |at| at + 1);
    let (stem, digits) = name.split_at(start);
    let own: u32 = digits.parse().map_err(|_| missing())?;
    let width = digits.len();
    // The first files of a run have them, or those that began it again.
    let first = 0..own.min(2);
    let last = (own.saturating_sub(MOST_EARLIER).max(2)..own).rev();
    for number in first.chain(last) {
        let other = path.with_file_name(format!("{stem}{number:0width$}"));
        if !input.has_beside(&other) {
            continue;
        }
        let (mut head, _) = input.open_beside(&other)?;
        let mut header = Vec::new();
        let read = std::io::Read::read_to_end(
            &mut std::io::Read::take(&mut head, HEADER as u64),
            &mut header,
        );
        read.map_err(|e| Error::io(&other, "reading the header", e, "check the disk"))?;
        let has_positions =
            Header::parse(&other, &header).is_ok_and(|header| header.letters.contains('X'));
        if !has_positions {
            continue;
        }
        let bytes = input.read_beside(&other)?;
        let earlier = FieldFile::parse(&other, &bytes)?;
        let Some(nodes) = earlier.positions() else {
            continue;
        };
        if earlier.header.dims != file.header.dims {
            let expected = format!("elements of {:?} nodes", file.header.dims);
            let found = format!("{:?}", earlier.header.dims);
            return Err(Error::format(
                &other,
                "header",
                expected,
                found,
                "put the first file of this run there",
            ));
        }
        if earlier.elements == file.elements {
            return Ok((nodes, other, bytes.len()));
        }
        if file.elements.len() > earlier.elements.len() {
            let expected = format!("{} elements", file.elements.len());
            let found = earlier.elements.len().to_string();
            let advice = "put the first file of this run there";
            return Err(Error::format(&other, "header", expected, found, advice));
        }
        let places: HashMap<u32, usize> = earlier.elements.iter().copied().zip(0..).collect();
        let per = file.header.per_element();
        let mut ordered = Vec::with_capacity(file.elements.len() * per);
        for element in &file.elements {
            let at = places.get(element).ok_or_else(|| {
                let expected = format!("element {element}");
                Error::format(
                    &other,
                    "numbers of elements",
                    expected,
                    "none",
                    "put the first file of this run there",
                )
            })?;
            ordered.extend_from_slice(&nodes[at * per..(at + 1) * per]);
        }
        return Ok((ordered, other, bytes.len()));
    }
    Err(missing())
}

/// Reads a file that names field files.
fn named(input: Input<'_>) -> Result<Vec<TimeStep>> {
    let path = input.path;
    let bytes = input.read_all()?;
    let text = String::from_utf8_lossy(&bytes);
    let line = |key: &str| {
        let lines = text.lines().map(str::trim);
        let found = lines.filter_map(|line| line.strip_prefix(key)).next();
        let value = found.map(|rest| rest.trim_start_matches(':').trim());
        value.filter(|value| !value.is_empty()).ok_or_else(|| {
            let advice = "write it as Nek5000's `visnek` does";
            Error::format(path, "lines", format!("`{key}:`"), "none", advice)
        })
    };
    let template = line("filetemplate")?;
    let number = |key: &str| {
        let value = line(key)?;
        value.parse::<u32>().map_err(|_| {
            let found = value.chars().take(40).collect::<String>();
            Error::format(path, format!("`{key}`"), "a number", found, "correct it")
        })
    };
    let (first, count) = (number("firsttimestep")?, number("numtimesteps")?);
    let mut steps = Vec::new();
    for step in first..first.saturating_add(count) {
        let mut parts = Vec::new();
        let mut time = None;
        for part in 0..MOST_PARTS {
            let (name, has_parts) = filled(path, template, part, step)?;
            let file = beside_as(path, "`filetemplate`", &name)?;
            if !input.has_beside(&file) {
                if part > 0 {
                    break;
                }
                let found = format!("no file `{}`", clip(&name));
                let expected = format!(
                    "files of the times {first} to {}",
                    first.saturating_add(count.saturating_sub(1))
                );
                let advice = "put the files beside it, or correct `numtimesteps`";
                return Err(Error::format(
                    path,
                    "`filetemplate`",
                    expected,
                    found,
                    advice,
                ));
            }
            // None of them may be a file that names others, perhaps this one.
            let header = input.with_beside(&file, |input| {
                let (head, _) = input.head(HEADER)?;
                Header::parse(input.path, &head)
            })?;
            time = time.or(Some(header.time));
            parts.push(Part {
                path: file,
                time_step: None,
            });
            if !has_parts {
                break;
            }
        }
        steps.push(TimeStep { time, parts });
    }
    if steps.is_empty() {
        let advice = "write the number of times there";
        return Err(Error::format(
            path,
            "`numtimesteps`",
            "one time or more",
            "none",
            advice,
        ));
    }
    Ok(steps)
}

/// Fills the numbers into a template: the last is the time, those before it the part. Also returns whether there are
/// some before it.
fn filled(path: &Path, template: &str, part: usize, step: u32) -> Result<(String, bool)> {
    let fault = || {
        let expected = "a name with `%05d` for the time, behind `%01d` for the part";
        let found = clip(template);
        Error::format(path, "`filetemplate`", expected, found, "correct it")
    };
    let mut pieces = Vec::new();
    let mut rest = template;
    while let Some((before, behind)) = rest.split_once('%') {
        let (width, after) = behind.split_once('d').ok_or_else(fault)?;
        let width = match width {
            "" => 0,
            digits => digits
                .parse::<usize>()
                .ok()
                .filter(|n| *n <= 20)
                .ok_or_else(fault)?,
        };
        pieces.push((before, width));
        rest = after;
    }
    let last = pieces.len().checked_sub(1).ok_or_else(fault)?;
    let mut name = String::new();
    for (i, (before, width)) in pieces.iter().enumerate() {
        name.push_str(before);
        name.push_str(&match i == last {
            true => format!("{step:0width$}"),
            false => format!("{part:0width$}"),
        });
    }
    name.push_str(rest);
    Ok((name, last > 0))
}
