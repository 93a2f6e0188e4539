//! Reads point clouds as text (`.xyz`, `.txt`, `.pts`, `.asc`): a line per point, without names of columns.
//!
//! ```text
//! 3
//! 1.25 0.5 -3.0 -312 128 90 77
//! ...
//! ```
//!
//! Numbers are separated by blanks, tabs, commas or semicolons. Lines that begin with `#` or `//` are comments.
//! A first line of one number is the count of points (`.pts`). The columns after x, y and z are recognised by
//! their numbers: three of length 1 are a normal; three whole numbers from 0 to 255, or three numbers from 0 to
//! 1, are a colour; one number is an intensity.

use std::path::Path;

use glam::DVec3;

use super::{DAMAGED, colour_fields, column};
use crate::data::dataset::{Dataset, Field};
use crate::error::{Error, Result};
use crate::io::bytes::file::Input;
use crate::io::bytes::probe::Probe;
use crate::io::grid::plot3d;
use crate::io::particles::table::dataset;
use crate::io::vtk::xml::clip;
use crate::math::narrowed;

/// Least and greatest number of columns: files with more hold other data.
const COLUMNS: std::ops::RangeInclusive<usize> = 3..=10;

/// Tolerance of a normal's length, for numbers rounded to some digits.
const UNIT: f64 = 0.02;

/// Whether the first lines are two or more rows with equal numbers of numbers, and no PLOT3D grid.
pub(in crate::io) fn looks_like(probe: &Probe<'_>) -> bool {
    let is_whole = probe.head.len() as u64 == probe.len;
    let end = match is_whole {
        true => Some(probe.head.len()),
        // The last line may be cut.
        false => probe.head.iter().rposition(|b| *b == b'\n'),
    };
    let Some(Ok(head)) = end.map(|end| str::from_utf8(&probe.head[..end])) else {
        return false;
    };
    let mut rows = rows(head).map(|(_, line)| numbers(line)).peekable();
    let is_count = |row: &Option<Vec<f64>>| row.as_ref().is_some_and(|row| row.len() == 1);
    let has_count = rows.next_if(is_count).is_some();
    let Some(Some(first)) = rows.next() else {
        return false;
    };
    let is_table = rows.peek().is_some()
        && COLUMNS.contains(&first.len())
        && rows.all(|row| row.is_some_and(|row| row.len() == first.len()));
    let is_size = |x: &f64| *x >= 1.0 && x.fract() == 0.0;
    let may_be_grid = first.len() % 3 == 0 && first.iter().all(is_size);
    let is_grid = || (has_count || may_be_grid) && plot3d::is_text_grid(probe.input);
    is_table && !is_grid()
}

/// Lines with numbers, and their line numbers, counted from 1.
fn rows(text: &str) -> impl Iterator<Item = (usize, &str)> {
    let lines = text.lines().enumerate();
    let lines = lines.map(|(i, line)| (i + 1, line.trim()));
    lines.filter(|(_, line)| !line.is_empty() && !line.starts_with('#') && !line.starts_with("//"))
}

fn words(line: &str) -> impl Iterator<Item = &str> {
    let is_blank = |c: char| c.is_whitespace() || matches!(c, ',' | ';');
    line.split(is_blank).filter(|word| !word.is_empty())
}

fn numbers(line: &str) -> Option<Vec<f64>> {
    words(line).map(|word| word.parse().ok()).collect()
}

/// Reads a cloud.
///
/// # Errors
/// A line with another number of columns than the first; fewer lines than the stated count.
pub(in crate::io) fn read(input: Input<'_>) -> Result<Dataset> {
    let path = input.path;
    let bytes = input.read_all()?;
    let text = String::from_utf8_lossy(&bytes);
    let text = text.strip_prefix('\u{feff}').unwrap_or(&text);
    let mut rows = rows(text).peekable();
    let count = rows.next_if(|(_, line)| words(line).count() == 1);
    let width = rows.peek().map_or(0, |(_, line)| words(line).count());
    if !COLUMNS.contains(&width) {
        let expected = "lines of 3 to 10 numbers: x, y and z first";
        let found = format!("{width} in the first line");
        let advice = "give what separates the columns as blanks or commas";
        return Err(Error::format(path, "first line", expected, found, advice));
    }
    let mut columns = vec![Vec::new(); width];
    for (at, line) in rows {
        let row = numbers(line).filter(|row| row.len() == width);
        let row = row.ok_or_else(|| {
            let place = format!("line {at}");
            let expected = format!("{width} numbers, as in the first line");
            let found = format!("`{}`", clip(line));
            Error::format(path, place, expected, found, "correct the line")
        })?;
        for (column, number) in columns.iter_mut().zip(row) {
            column.push(number);
        }
    }
    check_count(path, count, columns[0].len())?;
    let rest = columns.split_off(3);
    let positions = (0..columns[0].len())
        .map(|i| DVec3::new(columns[0][i], columns[1][i], columns[2][i]))
        .collect();
    dataset(path, "text point cloud", positions, fields(rest))
}

/// Checks that there are as many points as the first line states.
fn check_count(path: &Path, stated: Option<(usize, &str)>, found: usize) -> Result<()> {
    let Some((at, stated)) = stated else {
        return Ok(());
    };
    match stated.parse() == Ok(found) {
        true => Ok(()),
        false => Err(Error::format(
            path,
            format!("line {at}, the count"),
            format!("{} points", clip(stated)),
            format!("{found} lines"),
            DAMAGED,
        )),
    }
}

/// Names the columns after the positions.
fn fields(columns: Vec<Vec<f64>>) -> Vec<Field> {
    let mut named: Vec<Option<&str>> = vec![None; columns.len()];
    let free = |named: &[Option<&str>], at: usize| named[at..at + 3].iter().all(Option::is_none);
    let triples = 0..columns.len().saturating_sub(2);
    let find = |named: &[Option<&str>], is_so: &dyn Fn([&[f64]; 3]) -> bool| {
        let mut places = triples.clone();
        places.find(|&at| {
            let [a, b, c] = [&columns[at], &columns[at + 1], &columns[at + 2]];
            free(named, at) && is_so([a, b, c])
        })
    };
    if let Some(at) = find(&named, &are_normals) {
        for (i, name) in ["nx", "ny", "nz"].into_iter().enumerate() {
            named[at + i] = Some(name);
        }
    }
    let bytes = find(&named, &are_bytes).map(|at| {
        // An intensity before the colours may look like their first column, so the last three columns are tried
        // first.
        let last = columns.len() - 3;
        let is_last = free(&named, last)
            && are_bytes([&columns[last], &columns[last + 1], &columns[last + 2]]);
        (if is_last { last } else { at }, 255.0)
    });
    let shares = || find(&named, &are_shares).map(|at| (at, 1.0));
    let colours = bytes.or_else(shares);
    if let Some((at, _)) = colours {
        for place in &mut named[at..at + 3] {
            *place = Some("");
        }
    }
    let left = named.iter().filter(|name| name.is_none()).count();
    let mut fields = Vec::new();
    for (i, numbers) in columns.iter().enumerate() {
        match named[i] {
            None if left == 1 => fields.push(column("intensity", numbers)),
            None => fields.push(column(&format!("column {}", i + 4), numbers)),
            Some("") => {}
            Some(name) => fields.push(column(name, numbers)),
        }
    }
    if let Some((at, whole)) = colours {
        let channel = |i: usize| {
            columns[at + i]
                .iter()
                .map(|x| narrowed(x / whole))
                .collect()
        };
        fields.extend(colour_fields([channel(0), channel(1), channel(2)]));
    }
    fields
}

fn are_normals([x, y, z]: [&[f64]; 3]) -> bool {
    let points = x.iter().zip(y).zip(z);
    let mut lengths = points.map(|((x, y), z)| (x * x + y * y + z * z).sqrt());
    lengths.all(|length| (length - 1.0).abs() < UNIT)
}

/// Whether all numbers are whole and within a byte, and some are above 1.
fn are_bytes(triple: [&[f64]; 3]) -> bool {
    let is_byte = |x: &f64| (0.0..=255.0).contains(x) && x.fract() == 0.0;
    let mut all = triple.iter().copied().flatten();
    all.clone().all(is_byte) && all.any(|x| *x > 1.0)
}

fn are_shares(triple: [&[f64]; 3]) -> bool {
    triple
        .iter()
        .copied()
        .flatten()
        .all(|x| (0.0..=1.0).contains(x))
}
