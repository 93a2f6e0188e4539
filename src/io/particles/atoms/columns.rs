//! Gathers the columns of rows.

use std::collections::HashSet;

use glam::DVec3;

use super::elements::atomic_number;
use super::lines::Lines;
use crate::error::Result;
use crate::io::particles::table::list;
use crate::io::vtk::xml::clip;
use crate::scene::Values;

/// Columns while their rows are read.
pub(super) struct Columns {
    columns: Vec<Column>,
    /// True until a row determines the number of further columns.
    is_open: bool,
}

struct Column {
    name: String,
    values: Vec<f64>,
    kind: Kind,
}

/// Contents of a column.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Kind {
    /// The first cell determines the contents.
    Unknown,
    Numbers,
    /// `T` and `F`, which become 1 and 0.
    Flags,
    /// Atomic numbers stand for symbols of elements.
    Elements,
    /// Other words, which are not kept.
    Words,
}

/// Names and values of columns.
pub(super) type Named = Vec<(String, Values)>;

impl Columns {
    pub(super) fn new(columns: impl Iterator<Item = (String, Kind)>) -> Self {
        let columns = columns.map(|(name, kind)| Column {
            name,
            values: Vec::new(),
            kind,
        });
        Self {
            columns: columns.collect(),
            is_open: false,
        }
    }

    /// Allows further columns without names, whose number the first row determines.
    pub(super) fn and_others(mut self) -> Self {
        self.is_open = true;
        self
    }

    /// Reads the rows of a frame.
    ///
    /// - `keep`: true to keep the values. Otherwise only the end of the file is examined.
    ///
    /// # Errors
    /// There are fewer rows; a row has too few words or too many; a word stands in a column of numbers.
    pub(super) fn read(&mut self, lines: &mut Lines<'_>, count: u64, keep: bool) -> Result<()> {
        for row in 0..count {
            if !lines.advance()? {
                return Err(lines.ends(&format!("{count} rows, of which {row} are there")));
            }
            if keep || lines.has_ended {
                self.check(lines)?;
            }
            if keep {
                let text = lines.text();
                let cells = self.columns.iter_mut().zip(text.split_whitespace());
                for (column, word) in cells {
                    column.add(word, lines)?;
                }
            }
        }
        Ok(())
    }

    /// Returns an error if the current line has another number of words.
    fn check(&mut self, lines: &Lines<'_>) -> Result<()> {
        let found = lines.text().split_whitespace().count();
        if std::mem::take(&mut self.is_open) {
            let others = (self.columns.len()..found).map(|i| Column {
                name: format!("column {}", i + 1),
                values: Vec::new(),
                kind: Kind::Unknown,
            });
            self.columns.extend(others);
        }
        if found == self.columns.len() {
            return Ok(());
        }
        let expected = format!("{} words, one per column", self.columns.len());
        Err(lines.fault(&expected, &found.to_string()))
    }

    /// Returns the columns of numbers, and notes on those of words.
    pub(super) fn finish(self) -> (Named, Vec<String>) {
        let names = |kind: Kind| -> Vec<&str> {
            let of_kind = self.columns.iter().filter(|column| column.kind == kind);
            of_kind.map(|column| column.name.as_str()).collect()
        };
        let mut notes = Vec::new();
        let (elements, words) = (names(Kind::Elements), names(Kind::Words));
        if !elements.is_empty() {
            let names = list(elements.into_iter());
            notes.push(format!("Elements are read as atomic numbers: {names}."));
        }
        if !words.is_empty() {
            let names = list(words.into_iter());
            notes.push(format!("Left out, because they hold words: {names}."));
        }
        let kept = self.columns.into_iter().filter(|c| c.kind != Kind::Words);
        (kept.map(|c| (c.name, c.values.into())).collect(), notes)
    }
}

/// Returns a name that occurs more than once.
pub(super) fn repeated<'a>(names: impl Iterator<Item = &'a str>) -> Option<&'a str> {
    let mut seen = HashSet::new();
    { names }.find(|name| !seen.insert(*name))
}

/// Removes a column and returns its values.
pub(super) fn taken(columns: &mut Named, name: &str) -> Option<Values> {
    let at = columns.iter().position(|(other, _)| other == name)?;
    Some(columns.remove(at).1)
}

/// Returns the positions of rows from their coordinates; an axis without coordinates is at 0.
pub(super) fn positions(axes: &[Option<Values>; 3], place: impl Fn(DVec3) -> DVec3) -> Vec<DVec3> {
    let count = axes.iter().flatten().map(Values::len).max().unwrap_or(0);
    let at = |i: usize| {
        axes.each_ref()
            .map(|axis| axis.as_ref().map_or(0.0, |values| values.wide(i)))
    };
    (0..count)
        .map(|i| place(DVec3::from_array(at(i))))
        .collect()
}

impl Column {
    fn add(&mut self, word: &str, lines: &Lines<'_>) -> Result<()> {
        let number: Option<f64> = word.parse().ok();
        if self.kind == Kind::Unknown {
            self.kind = match number {
                Some(_) => Kind::Numbers,
                None => Kind::Elements,
            };
        }
        let value = match self.kind {
            Kind::Numbers | Kind::Unknown => number,
            Kind::Flags => match word {
                "T" | "True" | "true" | "TRUE" => Some(1.0),
                "F" | "False" | "false" | "FALSE" => Some(0.0),
                _ => number,
            },
            Kind::Words => return Ok(()),
            Kind::Elements => match atomic_number(word) {
                Some(number) => Some(f64::from(number)),
                None => {
                    self.kind = Kind::Words;
                    self.values = Vec::new();
                    return Ok(());
                }
            },
        };
        let value = value.ok_or_else(|| {
            let place = format!(", column `{}`", clip(&self.name));
            lines.fault_at(&place, "a number", &format!("`{}`", clip(word)))
        })?;
        self.values.push(value);
        Ok(())
    }
}
