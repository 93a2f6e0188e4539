//! Reads `.gro` files of GROMACS: columns of fixed width.
//!
//! ```text
//! water t=   0.00000                                                        title, with the time in ps
//!     1                                                                     number of atoms
//!     1SOL     OW    1   0.126   1.624   1.679  0.1227 -0.0580  0.0434
//!    1.86206   1.86206   1.86206                                            box
//! ```
//!
//! | bytes | contents |
//! |---|---|
//! | 0, 5 each | number and name of the residue, name and number of the atom |
//! | 20, W each | position, nm; W is the distance between the decimal points |
//! | 20 + 3 W, W each | velocity, nm/ps; may be absent |
//!
//! The box is `xx yy zz`, or `xx yy zz xy xz yx yz zx zy`: the components of its three edges. A box of zeros is none.

use std::ops::Range;

use glam::DVec3;

use super::cell::Cell;
use super::frames::{self, Frame, Rows};
use super::lines::Lines;
use super::xyz::stated;
use crate::data::association::Association;
use crate::data::dataset::{Dataset, Field, FieldSource};
use crate::error::Result;
use crate::io::bytes::file::Input;
use crate::io::particles::table::scalar_field;
use crate::io::time_steps::TimeStep;
use crate::scene::Values;

/// First byte of the positions.
const START: usize = 20;

/// Returns true if the first bytes are a title, a count of atoms, and an atom in columns.
pub(in crate::io) fn looks_like(head: &[u8]) -> bool {
    let text = String::from_utf8_lossy(head);
    let mut lines = text.lines().skip(1);
    let has_count = lines
        .next()
        .is_some_and(|line| line.trim().parse::<u64>().is_ok());
    let is_atom = |line: &str| {
        let [residue, number] = [line.get(0..5), line.get(15..20)];
        let is_number =
            |text: Option<&str>| text.is_some_and(|text| text.trim().parse::<u64>().is_ok());
        let names = line.get(5..15).unwrap_or_default();
        let is_named = names.contains(|c: char| c.is_ascii_alphabetic());
        let has_position = || {
            let width = width(line.as_bytes())?;
            (0..3).try_for_each(|i| number_at(line.as_bytes(), column(width, i)).map(|_| ()))
        };
        is_number(residue) && is_number(number) && is_named && has_position().is_some()
    };
    has_count && lines.next().is_some_and(is_atom)
}

/// Returns the frames as time steps.
///
/// # Errors
/// The first frame is damaged, or the first lines or the box of another.
pub(in crate::io) fn steps(input: Input<'_>) -> Result<Vec<TimeStep>> {
    frames::steps(input, &mut frame)
}

/// Reads a frame; the first if none is given.
///
/// # Errors
/// The frame is damaged or does not exist.
pub(in crate::io) fn read(input: Input<'_>, time_step: Option<usize>) -> Result<Dataset> {
    let mut data = frames::read(input, "GROMACS structure", time_step, &mut frame)?;
    let has_velocity = data.fields.iter().any(|field| field.name == "velocity");
    let note = match has_velocity {
        true => "Positions are in nm, velocities in nm/ps.",
        false => "Positions are in nm.",
    };
    data.notes.insert(0, note.to_owned());
    Ok(data)
}

/// Returns the width of a position: the distance between the first two decimal points.
fn width(line: &[u8]) -> Option<usize> {
    let mut points = (START..line.len()).filter(|&i| line[i] == b'.');
    let (first, second) = (points.next()?, points.next()?);
    Some(second - first)
}

/// Returns the bytes of a number behind the names.
fn column(width: usize, i: usize) -> Range<usize> {
    START + i * width..START + (i + 1) * width
}

fn number_at(line: &[u8], column: Range<usize>) -> Option<f64> {
    // Trailing blanks may be missing.
    let end = column.end.min(line.len());
    let text = line.get(column.start..end)?;
    std::str::from_utf8(text).ok()?.trim().parse().ok()
}

/// Numbers of the rows, one vector per component.
#[derive(Default)]
struct Atoms {
    width: usize,
    has_velocity: bool,
    positions: Vec<DVec3>,
    velocity: [Vec<f64>; 3],
    residue: Vec<f64>,
    id: Vec<f64>,
}

impl Atoms {
    /// Appends the current line.
    fn add(&mut self, lines: &Lines<'_>) -> Result<()> {
        let line = lines.bytes();
        if self.positions.is_empty() {
            let expected = "an atom in columns, with decimal points in its position";
            let width = width(line).ok_or_else(|| lines.fault(expected, &lines.shown()))?;
            self.width = width;
            self.has_velocity = !line
                .get(column(width, 3).start..)
                .unwrap_or_default()
                .trim_ascii()
                .is_empty();
        }
        let number = |column: Range<usize>, name: &str| {
            number_at(line, column.clone()).ok_or_else(|| {
                let place = format!(", bytes {} to {}", column.start + 1, column.end);
                lines.fault_at(&place, &format!("a number of {name}"), &lines.shown())
            })
        };
        let triple = |first: usize, name: &str| -> Result<DVec3> {
            let at = |i: usize| number(column(self.width, first + i), name);
            Ok(DVec3::new(at(0)?, at(1)?, at(2)?))
        };
        let position = triple(0, "the position")?;
        let (residue, id) = (number(0..5, "the residue")?, number(15..20, "the atom")?);
        if self.has_velocity {
            let velocity = triple(3, "the velocity")?.to_array();
            for (all, v) in self.velocity.iter_mut().zip(velocity) {
                all.push(v);
            }
        }
        self.positions.push(position);
        self.residue.push(residue);
        self.id.push(id);
        Ok(())
    }

    fn rows(self, cell: Option<Cell>) -> Rows {
        let mut fields = vec![
            scalar_field("id", self.id.into()),
            scalar_field("residue", self.residue.into()),
        ];
        if self.has_velocity {
            fields.push(Field {
                name: "velocity".to_owned(),
                association: Association::Nodes,
                source: FieldSource::Vector(self.velocity.map(Values::from).into()),
                unit: Some("nm/ps".to_owned()),
            });
        }
        Rows {
            positions: self.positions,
            fields,
            notes: vec![
                "Left out, because they are words: names of residues and atoms.".to_owned(),
            ],
            cell,
        }
    }
}

/// Reads a frame; returns `None` at the end of the file.
fn frame(lines: &mut Lines<'_>, keep: bool) -> Result<Option<Frame>> {
    // The title may be blank, but blank lines may end the file, too.
    let title = loop {
        if !lines.advance()? {
            return Ok(None);
        }
        let title = lines.text().into_owned();
        let is_blank = title.trim().is_empty();
        if !lines.advance()? && is_blank {
            return Ok(None);
        }
        if !is_blank || !lines.text().trim().is_empty() {
            break title;
        }
    };
    let expected = "the number of atoms";
    let count = lines.text().trim().parse();
    let count: u64 = count.map_err(|_| lines.fault(expected, &lines.shown()))?;
    let mut atoms = Atoms::default();
    for row in 0..count {
        if !lines.advance()? {
            return Err(lines.ends(&format!("{count} atoms, of which {row} are there")));
        }
        if keep {
            atoms.add(lines)?;
        }
    }
    let cell = cell(lines)?;
    Ok(Some(Frame {
        time: stated(&title, "t"),
        rows: keep.then(|| atoms.rows(cell)),
    }))
}

/// Reads the line of the box.
fn cell(lines: &mut Lines<'_>) -> Result<Option<Cell>> {
    let expected = "3 or 9 numbers of the box";
    lines.need(expected)?;
    let numbers = lines.numbers();
    let edges = match numbers.as_deref() {
        Some(&[x, y, z]) => [DVec3::X * x, DVec3::Y * y, DVec3::Z * z],
        Some(&[xx, yy, zz, xy, xz, yx, yz, zx, zy]) => [
            DVec3::new(xx, xy, xz),
            DVec3::new(yx, yy, yz),
            DVec3::new(zx, zy, zz),
        ],
        _ => return Err(lines.fault(expected, &lines.shown())),
    };
    let is_there = edges != [DVec3::ZERO; 3];
    Ok(is_there.then_some(Cell {
        origin: DVec3::ZERO,
        edges,
        is_periodic: [true; 3],
    }))
}
