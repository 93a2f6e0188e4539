//! Reads text dumps of LAMMPS (styles `atom` and `custom`).
//!
//! ```text
//! ITEM: UNITS                                   once, if `dump_modify units yes`
//! metal
//! ITEM: TIME                                    if `dump_modify time yes`
//! 0.5
//! ITEM: TIMESTEP
//! 500
//! ITEM: NUMBER OF ATOMS
//! 2
//! ITEM: BOX BOUNDS pp pp pp                     lower and upper bounds
//! 0 1
//! 0 1
//! 0 1
//! ITEM: ATOMS id type x y z                     names of the columns, and a row for each atom
//! 1 1 .1 .2 .3
//! 2 1 .5 .5 .5
//! ```
//!
//! | bounds | each of three lines |
//! |---|---|
//! | `pp ff pp` | lower and upper bound |
//! | `xy xz yz pp pp pp` | bounds of the sheared box, and one of its three shears |
//! | `abc origin pp pp pp` | an edge as a vector, and a coordinate of the corner |
//!
//! Positions are `x y z`, or else `xs ys zs` (shares of the edges), `xu yu zu` (not wrapped), or `xsu ysu zsu`.

use glam::DVec3;

use super::cell::Cell;
use super::columns::{Columns, Kind, positions, repeated, taken};
use super::frames::{self, Frame, Rows};
use super::lines::Lines;
use crate::data::association::Association;
use crate::data::dataset::Dataset;
use crate::error::{Error, Result};
use crate::io::bytes::file::Input;
use crate::io::particles::table::{FLAT, joined, list};
use crate::io::time_steps::TimeStep;
use crate::io::vtk::xml::clip;

const ITEM: &str = "ITEM:";

/// Ends of the names of positions, in the order of preference; those with `s` are shares of the edges.
const SETS: [&str; 4] = ["", "s", "u", "su"];

const STYLE: &str = "give a dump of the style atom or custom";

/// Returns true if a text that begins with `head` is a dump.
pub(in crate::io) fn looks_like(head: &[u8]) -> bool {
    let head = head.strip_prefix(b"\xef\xbb\xbf").unwrap_or(head);
    head.starts_with(b"ITEM: ")
}

/// Returns the frames as time steps. Their times are those that the dump states, or else the numbers of the steps.
///
/// # Errors
/// The first frame is damaged, or a header of another.
pub(in crate::io) fn steps(input: Input<'_>) -> Result<Vec<TimeStep>> {
    let mut units = None;
    frames::steps(input, &mut |lines, keep| frame(lines, keep, &mut units))
}

/// Reads a frame; the first if none is given.
///
/// # Errors
/// The frame is damaged or does not exist, or has no positions.
pub(in crate::io) fn read(input: Input<'_>, time_step: Option<usize>) -> Result<Dataset> {
    let mut units = None;
    let mut read = |lines: &mut Lines<'_>, keep| frame(lines, keep, &mut units);
    let mut data = frames::read(input, "LAMMPS dump", time_step, &mut read)?;
    if let Some(units) = units {
        let note = format!("Numbers are in LAMMPS's units `{}`.", clip(&units));
        data.notes.push(note);
    }
    Ok(data)
}

/// Items before the rows.
#[derive(Default)]
struct Header {
    step: Option<f64>,
    time: Option<f64>,
    count: Option<u64>,
    cell: Option<Cell>,
}

/// Reads a frame; returns `None` at the end of the file.
fn frame(lines: &mut Lines<'_>, keep: bool, units: &mut Option<String>) -> Result<Option<Frame>> {
    let mut header = Header::default();
    let mut is_begun = false;
    while lines.advance_to_text()? {
        is_begun = true;
        let line = lines.text().trim().to_owned();
        let Some(item) = line.strip_prefix(ITEM).map(str::trim) else {
            return Err(lines.fault("a line `ITEM: ...`", &lines.shown()));
        };
        if item == "TIMESTEP" {
            header.step = Some(lines.number("the number of the time step")?);
        } else if item == "TIME" {
            header.time = Some(lines.number("the time")?);
        } else if item == "UNITS" {
            lines.need("the name of the units")?;
            *units = Some(lines.text().trim().to_owned());
        } else if item == "NUMBER OF ATOMS" {
            header.count = Some(lines.number("the number of atoms")?);
        } else if let Some(kind) = item.strip_prefix("BOX BOUNDS") {
            header.cell = Some(cell(lines, kind)?);
        } else if let Some(names) = item.strip_prefix("ATOMS") {
            let names: Vec<&str> = names.split_whitespace().collect();
            return atoms(lines, &header, &names, keep).map(Some);
        } else {
            let expected = "an item of a dump of atoms";
            let found = format!("`{}`", clip(&line));
            let place = "ITEM: ...".to_owned();
            return Err(Error::format(lines.path, place, expected, found, STYLE));
        }
    }
    match is_begun {
        true => Err(lines.ends("`ITEM: ATOMS` with the rows")),
        false => Ok(None),
    }
}

/// Reads the bounds of a box.
///
/// - `kind`: words behind `BOX BOUNDS`.
fn cell(lines: &mut Lines<'_>, kind: &str) -> Result<Cell> {
    let mut words: Vec<&str> = kind.split_whitespace().collect();
    let (is_general, is_sheared) = (
        words.starts_with(&["abc", "origin"]),
        words.starts_with(&["xy", "xz", "yz"]),
    );
    let width = match (is_general, is_sheared) {
        (true, _) => 4,
        (_, true) => 3,
        _ => 2,
    };
    words.drain(..[0, 3, 2][width - 2]);
    let is_periodic = [0, 1, 2].map(|axis| words.get(axis) == Some(&"pp"));
    let mut rows = [[0.0; 4]; 3];
    for row in &mut rows {
        let expected = format!("{width} numbers of the box");
        lines.need(&expected)?;
        let numbers = lines.numbers().filter(|numbers| numbers.len() == width);
        let numbers = numbers.ok_or_else(|| lines.fault(&expected, &lines.shown()))?;
        row[..width].copy_from_slice(&numbers);
    }
    if is_general {
        return Ok(Cell {
            origin: DVec3::from_array(rows.map(|row| row[3])),
            edges: rows.map(|[x, y, z, _]| DVec3::new(x, y, z)),
            is_periodic,
        });
    }
    let [xy, xz, yz] = rows.map(|row| row[2]);
    // The bounds of a sheared box are those of all its corners.
    let [x, y] = [[0.0, xy, xz, xy + xz], [0.0, yz, 0.0, yz]];
    let least = |of: [f64; 4]| of.into_iter().fold(0.0, f64::min);
    let most = |of: [f64; 4]| of.into_iter().fold(0.0, f64::max);
    let lower = DVec3::new(rows[0][0] - least(x), rows[1][0] - least(y), rows[2][0]);
    let upper = DVec3::new(rows[0][1] - most(x), rows[1][1] - most(y), rows[2][1]);
    let size = upper - lower;
    Ok(Cell {
        origin: lower,
        edges: [
            DVec3::new(size.x, 0.0, 0.0),
            DVec3::new(xy, size.y, 0.0),
            DVec3::new(xz, yz, size.z),
        ],
        is_periodic,
    })
}

/// Columns of the positions.
#[derive(Clone, Copy)]
struct Places {
    x: usize,
    y: usize,
    /// `None` for atoms in a plane.
    z: Option<usize>,
    /// True for shares of the box's edges.
    is_scaled: bool,
}

impl Places {
    fn of(names: &[&str]) -> Option<Self> {
        SETS.into_iter().find_map(|end| {
            let find = |axis: &str| {
                let mut columns = names.iter();
                columns.position(|name| name.strip_prefix(axis) == Some(end))
            };
            let is_scaled = end.starts_with('s');
            let z = find("z");
            let is_whole = z.is_some() || !is_scaled;
            Some(Self {
                x: find("x")?,
                y: find("y")?,
                z,
                is_scaled,
            })
            .filter(|_| is_whole)
        })
    }

    fn contains(&self, column: usize) -> bool {
        self.x == column || self.y == column || self.z == Some(column)
    }
}

/// Reads the rows behind the header.
fn atoms(lines: &mut Lines<'_>, header: &Header, names: &[&str], keep: bool) -> Result<Frame> {
    if let Some(name) = repeated(names.iter().copied()) {
        let found = format!("`{}` twice", clip(name));
        return Err(lines.fault("columns of different names", &found));
    }
    let Some(places) = Places::of(names) else {
        let expected = "columns x y z, xs ys zs, xu yu zu or xsu ysu zsu";
        let found = list(names.iter().copied());
        return Err(lines.fault(expected, &found));
    };
    let Some(count) = header.count else {
        return Err(lines.fault("`ITEM: NUMBER OF ATOMS` before the rows", "none"));
    };
    let scale = header.cell.filter(|_| places.is_scaled);
    if places.is_scaled && scale.is_none() {
        return Err(lines.fault("`ITEM: BOX BOUNDS` before shares of its edges", "none"));
    }
    let kind = |column: usize| match places.contains(column) {
        true => Kind::Numbers,
        false => Kind::Unknown,
    };
    let named = names.iter().enumerate();
    let mut columns = Columns::new(named.map(|(i, name)| ((*name).to_owned(), kind(i))));
    columns.read(lines, count, keep)?;
    let time = header.time.or(header.step);
    if !keep {
        return Ok(Frame { time, rows: None });
    }
    let (mut columns, mut notes) = columns.finish();
    let axes = [Some(places.x), Some(places.y), places.z];
    let axes = axes.map(|column| column.and_then(|column| taken(&mut columns, names[column])));
    let positions = positions(&axes, |at| scale.map_or(at, |cell| cell.at(at)));
    if places.z.is_none() {
        notes.push(FLAT.to_owned());
    }
    let rows = Rows {
        positions,
        fields: joined(columns, Association::Nodes, 3),
        notes,
        cell: header.cell,
    };
    Ok(Frame {
        time,
        rows: Some(rows),
    })
}
