//! Reads PLOT3D grids, solutions and functions: one or several grids, as written by NASA's codes.
//!
//! Grid (`.xyz`, `.x`, `.g`, `.p3d`, `.bin`), i fastest, then j, then k:
//!
//! | content | type |
//! |---|---|
//! | number of grids G; may be missing if it is 1 | i32 |
//! | ni, nj, nk of every grid | i32 x 3 G |
//! | for each grid in turn: all x, all y, all z | f32 or f64, N = ni nj nk each |
//! | ... and iblank, optional | i32 x N |
//!
//! Solution (`.q`, `.bin`):
//!
//! | content | type |
//! |---|---|
//! | number of grids G; may be missing if it is 1 | i32 |
//! | ni, nj, nk of every grid | i32 x 3 G |
//! | for each grid in turn: free-stream Mach number, angle of attack, Reynolds number, time | f32 or f64, x 4 |
//! | ... and density, momentum x, y, z, energy | f32 or f64, N each |
//!
//! Functions (`.f`, `.fun`), with their names in a file `.nam` of the same name, one in each line:
//!
//! | content | type |
//! |---|---|
//! | number of grids G; may be missing if it is 1 | i32 |
//! | ni, nj, nk and the number of functions M of every grid | i32 x 4 G |
//! | for each grid in turn: its functions, one after another | f32 or f64, M N |
//!
//! Fortran programs put a u32 with the record's byte count before and after each row of these tables
//! (coordinates and iblank of a grid are one record, and so are its functions). Either byte order is read. Text
//! has the same numbers, separated by white space or commas.
//!
//! The file does not state which of these layouts it has. The reader takes the layout whose size agrees with
//! the file's, in bytes (for text, in numbers), and whose record marks, if any, are right. If several agree, it
//! takes the first in this order, and the data set's notes say so: record marks before none, a grid count
//! before none, single before double precision, little before big endian, no iblank before one. (A grid count
//! comes before none because a coordinate's first bits are hardly ever a small count.) Solutions and functions
//! may be followed by zero bytes; grids may not.
//!
//! Files of two dimensions have no nk, no z and no momentum along z. They are tried if no layout of three
//! dimensions agrees, and are a layer at z = 0.
//!
//! Coordinates are stored whole, not by planes of k. Files by planes are refused if record marks show the
//! planes; without marks they cannot be distinguished.

mod companion;
mod functions;
mod layout;
mod solution;
mod text;

use std::collections::HashSet;
use std::path::{Path, PathBuf};

use glam::DVec3;

use self::layout::{Content, Contents, Kind, Layout, describe_dims};
use crate::data::association::Association;
use crate::data::dataset::{CurvilinearBlock, Dataset, Field, FieldSource, Geometry};
use crate::error::{Advice, Error, Hint, Result};
use crate::io::bytes::file::Input;
use crate::scene::Values;

/// Greatest number of bytes after the numbers of a file that is recognised.
const MOST_PADDING: u64 = 4095;

/// Whether a binary file of `len` bytes that begins with `head` has the size of a PLOT3D grid.
///
/// - `has_its_name`: whether solutions, functions and grids of two dimensions are accepted, too.
pub(crate) fn looks_like(head: &[u8], len: u64, has_its_name: bool) -> bool {
    let contents = [Content::Grid, Content::Solution, Content::Functions];
    let kinds = [3, 2].map(|axes| contents.map(|content| Kind::of(content, axes)));
    let count = if has_its_name { 6 } else { 1 };
    let mut kinds = kinds.into_iter().flatten().take(count);
    kinds.any(|kind| {
        // Some programs fill a solution's last block.
        let most = match kind.content {
            Content::Solution => MOST_PADDING,
            Content::Grid | Content::Functions => 0,
        };
        let mut layouts = Layout::all(Contents::Bytes(head), kind);
        layouts.any(|layout| {
            let end = layout.end(kind).map(|end| end as u64);
            end.is_some_and(|end| end <= len && len - end <= most)
        })
    })
}

/// Whether a text file has as many numbers as a PLOT3D grid with the dimensions in its first numbers.
pub(crate) fn is_text_grid(input: Input<'_>) -> bool {
    let numbers = input
        .read_all()
        .and_then(|bytes| text::numbers(input.path, &bytes, bytes.len()));
    numbers.is_ok_and(|numbers| {
        let mut fitting = Layout::fitting(Contents::Numbers(&numbers), Kind::GRID);
        fitting.next().is_some()
    })
}

/// Reads a grid, its solution and its functions: from `given`, and otherwise from files beside the grid.
///
/// # Errors
/// No layout agrees with a file's size; the sizes are listed.
pub(crate) fn read(input: Input<'_>, given: Option<&Path>) -> Result<Dataset> {
    let path = input.path;
    let bytes = input.read_all()?;
    let numbers;
    let contents = if text::looks_like_text(&bytes) {
        // Plain text has at most half as many numbers as bytes.
        numbers = text::numbers(path, &bytes, bytes.len())?;
        Contents::Numbers(&numbers)
    } else {
        Contents::Bytes(&bytes)
    };
    let broken = || no_grid(path, contents);
    let mut fitting: Vec<Layout> = Layout::fitting(contents, Kind::GRID).collect();
    if fitting.is_empty() && companion_of(contents, 3).is_none() {
        // A line of nodes is no surface either.
        let is_surface = |layout: &Layout| layout.dims.iter().all(|d| d[0] > 1 && d[1] > 1);
        fitting = Layout::fitting(contents, Kind::FLAT_GRID)
            .filter(is_surface)
            .collect();
    }
    let mut fitting = fitting.into_iter();
    let layout = fitting.next().ok_or_else(broken)?;
    let others: Vec<String> = fitting.map(|layout| layout.describe()).collect();
    let kind = Kind::of(Content::Grid, layout.axes);

    let (starts, _) = layout.bodies(kind).ok_or_else(broken)?;
    let node_counts = layout.node_counts().ok_or_else(broken)?;
    let mut blocks = Vec::with_capacity(starts.len());
    let mut blanks: Vec<i16> = Vec::new();
    for ((&dims, start), count) in layout.dims.iter().zip(starts).zip(node_counts) {
        let axis_size = count * layout.form.real_size();
        let axis = |i: usize| {
            let at = start + i * axis_size;
            contents
                .numbers(layout.form, true, at, count)
                .ok_or_else(broken)
        };
        let x = axis(0)?.into_iter();
        let mut nodes: Vec<DVec3> = x.map(|x| DVec3::new(x, 0., 0.)).collect();
        for (node, y) in nodes.iter_mut().zip(axis(1)?) {
            node.y = y;
        }
        if layout.axes == 3 {
            for (node, z) in nodes.iter_mut().zip(axis(2)?) {
                node.z = z;
            }
        }
        blocks.push(CurvilinearBlock { dims, nodes });
        if layout.blanked {
            let at = start + layout.axes * axis_size;
            let words = contents.numbers(layout.form, false, at, count);
            #[allow(
                clippy::cast_possible_truncation,
                reason = "clamped to the type's range"
            )]
            blanks.extend(
                words
                    .ok_or_else(broken)?
                    .into_iter()
                    .map(|b| b.clamp(f64::from(i16::MIN), f64::from(i16::MAX)) as i16),
            );
        }
    }

    let (mut fields, mut notes) = fields_of_nodes(input, &layout, given)?;
    if layout.blanked {
        let iblank = FieldSource::Scalar(Values::I16(blanks));
        let at = stored_count(&fields);
        fields.insert(at, node_field("iblank", iblank));
    }
    let geometry = Geometry::Curvilinear { blocks };
    let mut dataset = Dataset::new(path, "PLOT3D grid", geometry, fields);
    dataset.notes.append(&mut notes);
    if !others.is_empty() {
        dataset.notes.push(format!(
            "Read as {}; its size is also that of {}.",
            layout.describe(),
            others.join(", and of ")
        ));
    }
    Ok(dataset)
}

/// The fields of the solution and of the functions of a grid, and notes on them.
fn fields_of_nodes(
    grid: Input<'_>,
    layout: &Layout,
    given: Option<&Path>,
) -> Result<(Vec<Field>, Vec<String>)> {
    let given_functions = match given {
        Some(path) if functions::is_given(path, grid, layout)? => Some(path.to_path_buf()),
        _ => None,
    };
    let given_solution = given.filter(|_| given_functions.is_none());
    let solution = given_solution
        .map(Path::to_path_buf)
        .or_else(|| companion::beside(grid, "q"));
    let functions = given_functions.map_or_else(|| functions_beside(grid), |f| Ok(Some(f)))?;

    let (mut fields, mut notes) = match solution {
        Some(solution) => solution::read(&solution, grid, layout)?,
        None => (Vec::new(), Vec::new()),
    };
    if let Some(functions) = functions {
        let (more, about) = functions::read(&functions, grid, layout)?;
        notes.extend(about);
        let at = stored_count(&fields);
        let mut taken: HashSet<String> = fields.iter().map(|f| f.name.to_lowercase()).collect();
        let more = more.into_iter().map(|mut field| {
            field.name = free_name(field.name, &mut taken);
            field
        });
        fields.splice(at..at, more);
    }
    Ok((fields, notes))
}

/// The file of functions beside a grid.
fn functions_beside(grid: Input<'_>) -> Result<Option<PathBuf>> {
    for ending in functions::ENDINGS {
        if let Some(path) = companion::beside(grid, ending)
            && functions::is_no_program(&path, grid)?
        {
            return Ok(Some(path));
        }
    }
    Ok(None)
}

/// A name that is not used yet, ignoring case: `pressure (2)` beside the solution's.
fn free_name(name: String, taken: &mut HashSet<String>) -> String {
    let numbered = (2..).map(|n| format!("{name} ({n})"));
    let mut names = std::iter::once(name.clone()).chain(numbered);
    let free = names.find(|name| taken.insert(name.to_lowercase()));
    free.unwrap_or(name)
}

/// Number of fields before the derived ones, which stay last.
fn stored_count(fields: &[Field]) -> usize {
    let is_stored = |f: &&Field| !matches!(f.source, FieldSource::Derived(_));
    fields.iter().take_while(is_stored).count()
}

fn node_field(name: &str, source: FieldSource) -> Field {
    Field {
        name: name.to_owned(),
        association: Association::Nodes,
        source,
        unit: None,
    }
}

/// The name of a file's content if it accompanies a grid: a solution, or functions.
fn companion_of(contents: Contents<'_>, axes: usize) -> Option<&'static str> {
    let solution = Kind::of(Content::Solution, axes);
    let mut solutions = Layout::all(contents, solution);
    if solutions.any(|layout| layout.fits_padded(contents, solution)) {
        return Some("a solution (density, momentum, energy)");
    }
    let functions = Kind::of(Content::Functions, axes);
    let mut fitting = Layout::fitting(contents, functions);
    fitting.next().map(|_| "functions at nodes")
}

/// The error for a file that is no readable grid: a solution, functions, planes, or another size.
fn no_grid(path: &Path, contents: Contents<'_>) -> Error {
    let error = |expected: String, found: String, advice: Advice| {
        Error::format(path, "PLOT3D grid", expected, found, advice)
    };
    if let Some(found) = companion_of(contents, 3).or_else(|| companion_of(contents, 2)) {
        let expected = "node positions".to_owned();
        return error(expected, found.to_owned(), Hint::GiveGridOfSolution.into());
    }
    let mut tried: Vec<String> = Vec::new();
    for layout in Layout::all(contents, Kind::GRID) {
        if layout.is_in_planes(contents) {
            return error(
                "all planes of a grid in one record".to_owned(),
                format!("a record for each plane of {}", describe_dims(&layout.dims)),
                "write the grid in PLOT3D's whole format".into(),
            );
        }
        if let Some(end) = layout.end(Kind::GRID)
            && end as u64 <= (contents.len() as u64).saturating_mul(1 << 20)
        {
            tried.push(format!("{end} for {}", layout.describe()));
        }
    }
    let unit = match contents {
        Contents::Bytes(_) => "bytes",
        Contents::Numbers(_) => "numbers",
    };
    let expected = if tried.is_empty() {
        "three node counts at the start, in either byte order".to_owned()
    } else {
        format!("one of these counts of {unit}: {}", tried.join("; "))
    };
    error(
        expected,
        format!("{} {unit}", contents.len()),
        "check that the file is whole and is a PLOT3D grid".into(),
    )
}
