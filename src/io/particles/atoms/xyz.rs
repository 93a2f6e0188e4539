//! Reads extended XYZ, and the plain XYZ of molecules.
//!
//! ```text
//! 2                                                             number of atoms
//! Lattice="5 0 0 0 5 0 0 0 5" Properties=species:S:1:pos:R:3:forces:R:3 pbc="T T T" Time=0.5
//! O 0 0 0 .1 0 0
//! H 0 0 .96 0 0 .1
//! ```
//!
//! `Properties` lists columns as name, type (`S` words, `R` and `I` numbers, `L` flags) and number; without it, or in plain
//! files, they are `species:S:1:pos:R:3`. `Lattice` has the three edges of the box one after another, `Origin` its
//! corner. With a `Lattice`, all axes are periodic unless `pbc` states otherwise.

use glam::DVec3;

use super::cell::Cell;
use super::columns::{Columns, Kind, Named, positions, repeated, taken};
use super::frames::{self, Frame, Rows};
use super::lines::Lines;
use crate::data::association::Association;
use crate::data::dataset::{Dataset, Field, FieldSource};
use crate::error::Result;
use crate::io::bytes::file::Input;
use crate::io::particles::table::scalar_field;
use crate::io::time_steps::TimeStep;
use crate::io::vtk::xml::clip;
use crate::scene::Values;

const PLAIN: &str = "species:S:1:pos:R:3";

/// Greatest number of columns, far more than any program writes.
const MOST_COLUMNS: usize = 4096;

/// Keys of the time, in the order of preference.
const TIMES: [&str; 2] = ["time", "timestep"];

/// Returns true if the first bytes are a count of atoms, a comment, and an element with its position in each line; or if
/// the comment lists properties or a lattice.
pub(in crate::io) fn looks_like(head: &[u8]) -> bool {
    let text = String::from_utf8_lossy(head);
    let text = text.strip_prefix('\u{feff}').unwrap_or(&text);
    let mut lines = text.lines();
    let count = lines.next().and_then(|line| line.trim().parse().ok());
    let (Some(count @ 1_u64..), Some(comment)) = (count, lines.next()) else {
        return false;
    };
    if ["Properties=", "Lattice="]
        .iter()
        .any(|key| comment.contains(key))
    {
        return true;
    }
    let numbers = |line: &str| {
        line.split_whitespace()
            .all(|word| word.parse::<f64>().is_ok())
    };
    // Rows of numbers alone are a point cloud or a grid, unless a comment precedes them.
    let is_comment = !comment.trim().is_empty() && !numbers(comment);
    let is_element = |word: &str| {
        let letters = word.chars().take_while(char::is_ascii_alphabetic).count();
        let is_number = || {
            word.parse()
                .is_ok_and(|number: u8| (1..=118).contains(&number))
        };
        (1..=3).contains(&letters) || is_comment && is_number()
    };
    let is_atom = |line: &&str| {
        let mut words = line.split_whitespace();
        words.next().is_some_and(is_element)
            && words.clone().count() >= 3
            && words.take(3).all(|word| word.parse::<f64>().is_ok())
    };
    let most = usize::try_from(count).unwrap_or(usize::MAX).min(8);
    let atoms: Vec<&str> = lines.take(most).collect();
    // The last line of the first bytes may be cut.
    let whole = atoms.len().saturating_sub(1).max(1);
    !atoms.is_empty() && atoms.iter().take(whole).all(is_atom)
}

/// Returns the frames as time steps.
///
/// # Errors
/// The first frame is damaged, or the first lines of another.
pub(in crate::io) fn steps(input: Input<'_>) -> Result<Vec<TimeStep>> {
    frames::steps(input, &mut frame)
}

/// Reads a frame; the first if none is given.
///
/// # Errors
/// The frame is damaged or does not exist.
pub(in crate::io) fn read(input: Input<'_>, time_step: Option<usize>) -> Result<Dataset> {
    frames::read(input, "XYZ file of atoms", time_step, &mut frame)
}

/// A property, which has one column or several.
#[derive(Debug, Clone, PartialEq)]
struct Property {
    name: String,
    kind: Kind,
    width: usize,
}

impl Property {
    /// Name of a column.
    fn column(&self, i: usize) -> String {
        match self.width {
            1 => self.name.clone(),
            _ => format!("{}:{i}", self.name),
        }
    }

    /// Takes the property's columns as a field; `None` if they hold words.
    fn field(&self, columns: &mut Named) -> Option<Field> {
        let components = (0..self.width).map(|i| taken(columns, &self.column(i)));
        let mut components = components.collect::<Option<Vec<Values>>>()?;
        let source = match self.width {
            1 => FieldSource::Scalar(components.pop()?),
            _ => FieldSource::Vector(components),
        };
        Some(Field {
            name: self.name.clone(),
            association: Association::Nodes,
            source,
            unit: None,
        })
    }
}

/// Reads a frame; returns `None` at the end of the file.
fn frame(lines: &mut Lines<'_>, keep: bool) -> Result<Option<Frame>> {
    if !lines.advance_to_text()? {
        return Ok(None);
    }
    let expected = "the number of atoms";
    let count = lines.text().trim().parse();
    let count: u64 = count.map_err(|_| lines.fault(expected, &lines.shown()))?;
    lines.need("a line of comment")?;
    let comment = lines.text().into_owned();
    let keys = keys(&comment);
    let value = |wanted: &str| {
        let mut found = keys
            .iter()
            .filter(|(key, _)| key.eq_ignore_ascii_case(wanted));
        found.next().map(|(_, value)| value.as_str())
    };
    let is_plain = value("Properties").is_none();
    let mut properties = properties(lines, value("Properties").unwrap_or(PLAIN))?;
    let cell = cell(lines, value)?;
    let time = TIMES.iter().find_map(|key| stated(&comment, key));
    let columns = properties.iter();
    let columns = columns.flat_map(|p| (0..p.width).map(|i| (p.column(i), p.kind)));
    let mut columns = Columns::new(columns);
    if is_plain {
        columns = columns.and_others();
    }
    columns.read(lines, count, keep)?;
    if !keep {
        return Ok(Some(Frame { time, rows: None }));
    }
    let (mut columns, notes) = columns.finish();
    let axes = [0, 1, 2].map(|axis| taken(&mut columns, &format!("pos:{axis}")));
    properties.retain(|property| property.name != "pos");
    let fields = properties.iter();
    let mut fields: Vec<Field> = fields
        .filter_map(|property| property.field(&mut columns))
        .collect();
    // What is left are the columns of plain files that have no names.
    fields.extend(
        columns
            .into_iter()
            .map(|(name, values)| scalar_field(name, values)),
    );
    Ok(Some(Frame {
        time,
        rows: Some(Rows {
            fields,
            positions: positions(&axes, |at| at),
            notes,
            cell,
        }),
    }))
}

/// Parses a list of properties, which must have positions.
fn properties(lines: &Lines<'_>, list: &str) -> Result<Vec<Property>> {
    let fault = |found: &str| {
        let expected = "Properties=NAME:TYPE:COUNT:..., of the types S, R, I and L, with pos:R:3";
        lines.fault(expected, &format!("`{}`", clip(found)))
    };
    let parts: Vec<&str> = list.split(':').collect();
    let mut properties: Vec<Property> = Vec::new();
    for part in parts.chunks(3) {
        let [name, kind, width] = part else {
            return Err(fault(list));
        };
        let kind = match *kind {
            "R" | "I" => Kind::Numbers,
            "S" => Kind::Unknown,
            "L" => Kind::Flags,
            _ => return Err(fault(&part.join(":"))),
        };
        let width = width
            .parse()
            .ok()
            .filter(|n| (1..=MOST_COLUMNS).contains(n));
        properties.push(Property {
            name: (*name).to_owned(),
            kind,
            width: width.ok_or_else(|| fault(&part.join(":")))?,
        });
    }
    let total: usize = properties.iter().map(|property| property.width).sum();
    let is_position = |p: &Property| p.name == "pos" && p.kind == Kind::Numbers && p.width == 3;
    let names = properties.iter().map(|p| p.name.as_str());
    let is_whole =
        total <= MOST_COLUMNS && properties.iter().any(is_position) && repeated(names).is_none();
    match is_whole {
        true => Ok(properties),
        false => Err(fault(list)),
    }
}

/// Returns the box of a frame.
fn cell<'v>(lines: &Lines<'_>, value: impl Fn(&str) -> Option<&'v str>) -> Result<Option<Cell>> {
    let Some(lattice) = value("Lattice") else {
        return Ok(None);
    };
    let numbers = |text: &str| -> Option<Vec<f64>> {
        let is_between = |c: char| c.is_whitespace() || matches!(c, ',' | '[' | ']' | '{' | '}');
        let words = text.split(is_between).filter(|word| !word.is_empty());
        words.map(|word| word.parse().ok()).collect()
    };
    let fault = |expected: &str, found: &str| lines.fault(expected, &format!("`{}`", clip(found)));
    let edges = numbers(lattice).filter(|numbers| numbers.len() == 9);
    let edges = edges.ok_or_else(|| fault("Lattice=\"nine numbers\"", lattice))?;
    let edge = |i: usize| DVec3::new(edges[3 * i], edges[3 * i + 1], edges[3 * i + 2]);
    let origin = match value("Origin") {
        None => DVec3::ZERO,
        Some(text) => match numbers(text).as_deref() {
            Some(&[x, y, z]) => DVec3::new(x, y, z),
            _ => return Err(fault("Origin=\"three numbers\"", text)),
        },
    };
    let is_periodic = match value("pbc") {
        None => [true; 3],
        Some(text) => {
            let is_yes = |c: &char| matches!(c.to_ascii_uppercase(), 'T' | '1');
            let is_flag = |c: &char| is_yes(c) || matches!(c.to_ascii_uppercase(), 'F' | '0');
            let words = text.split(|c: char| !c.is_alphanumeric());
            let flags: Vec<char> = words.filter_map(|word| word.chars().next()).collect();
            match flags.as_slice() {
                [x, y, z] if flags.iter().all(is_flag) => [x, y, z].map(is_yes),
                _ => return Err(fault("pbc=\"three of T and F\"", text)),
            }
        }
    };
    Ok(Some(Cell {
        origin,
        edges: [edge(0), edge(1), edge(2)],
        is_periodic,
    }))
}

/// Returns the keys of a comment with their values: `key=value`, or with the value in quotes or brackets.
fn keys(comment: &str) -> Vec<(String, String)> {
    let mut keys = Vec::new();
    let mut rest = comment.trim_start();
    while !rest.is_empty() {
        let end = rest.find(|c: char| c == '=' || c.is_whitespace());
        let (key, behind) = rest.split_at(end.unwrap_or(rest.len()));
        let Some(value) = behind.trim_start().strip_prefix('=') else {
            rest = behind.trim_start();
            continue;
        };
        let value = value.trim_start();
        let close = match value.chars().next() {
            Some(quote @ ('"' | '\'')) => Some(quote),
            Some('{') => Some('}'),
            Some('[') => Some(']'),
            _ => None,
        };
        let (value, behind) = match close {
            Some(close) => match value[1..].split_once(close) {
                Some(parts) => parts,
                None => (&value[1..], ""),
            },
            None => value.split_at(value.find(char::is_whitespace).unwrap_or(value.len())),
        };
        keys.push((key.to_owned(), value.to_owned()));
        rest = behind.trim_start_matches(|c: char| c.is_whitespace() || c == ']');
    }
    keys
}

/// Returns the number that a text states behind a word: `Time=0.5`, `time = 0.5,`, `Timestep: 100`.
pub(super) fn stated(text: &str, word: &str) -> Option<f64> {
    let lower = text.to_ascii_lowercase();
    let mut starts = lower.match_indices(word);
    starts.find_map(|(start, _)| {
        let is_within = lower[..start].ends_with(|c: char| c.is_alphanumeric() || c == '_');
        let behind = lower[start + word.len()..]
            .trim_start()
            .strip_prefix(['=', ':'])?;
        let behind = behind.trim_start().trim_start_matches(['"', '\'']);
        let end =
            behind.find(|c: char| !(c.is_ascii_alphanumeric() || matches!(c, '.' | '+' | '-')));
        let number: f64 = behind[..end.unwrap_or(behind.len())].parse().ok()?;
        (!is_within && number.is_finite()).then_some(number)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keys_have_values_in_quotes_and_brackets() {
        let comment =
            "Lattice=\"1 0 0\" flag Properties=species:S:1 pbc = 'T T F' a={1 2} b=[1, 2] c=";
        let keys = keys(comment);
        let pairs: Vec<(&str, &str)> = keys.iter().map(|(k, v)| (k.as_str(), v.as_str())).collect();
        let expected = [
            ("Lattice", "1 0 0"),
            ("Properties", "species:S:1"),
            ("pbc", "T T F"),
            ("a", "1 2"),
            ("b", "1, 2"),
            ("c", ""),
        ];
        assert_eq!(pairs, expected);
    }

    #[test]
    fn times_are_found_in_comments_of_any_kind() {
        for (comment, time) in [
            ("Time=0.5 a=1", Some(0.5)),
            (" i = 3, time =        1.500, E = -17.1", Some(1.5)),
            ("Atoms. Timestep: 100", Some(100.0)),
            ("t=   2.00000 step= 4", None),
            ("lifetime=3", None),
            ("time=soon", None),
        ] {
            let found = TIMES.iter().find_map(|key| stated(comment, key));
            assert_eq!(found, time, "{comment}");
        }
        assert_eq!(stated("water t=   2.5e1 step= 4", "t"), Some(25.0));
        assert_eq!(stated("weight=3", "t"), None);
    }
}
