//! Reads text headers of images field by field, for NRRD and MetaImage.

use std::path::{Path, PathBuf};
use std::str::FromStr;

use super::voxels;
use crate::error::{Error, Result};
use crate::io::vtk::xml::clip;

/// Advice for a damaged header.
pub(in crate::io) const DAMAGED: &str =
    "the header is damaged or breaks the format's rules: correct it or save the file again";

/// Fields of a header.
pub(in crate::io) struct Header<'h> {
    pub(in crate::io) path: &'h Path,
    /// Names, spelled as their format compares them, and values.
    pub(in crate::io) fields: Vec<(String, String)>,
    /// Lines behind a field that announces a list of files.
    pub(in crate::io) list: Vec<String>,
    /// Start of the numbers, if they follow the header.
    pub(in crate::io) end: Option<usize>,
}

impl<'h> Header<'h> {
    pub(in crate::io) fn new(path: &'h Path) -> Self {
        Self {
            path,
            fields: Vec::new(),
            list: Vec::new(),
            end: None,
        }
    }

    /// Returns the value of the first of these names that the header contains.
    pub(in crate::io) fn get(&self, names: &[&str]) -> Option<&str> {
        names.iter().find_map(|name| {
            let mut fields = self.fields.iter();
            fields
                .find(|(field, _)| field == name)
                .map(|(_, value)| value.as_str())
        })
    }

    pub(in crate::io) fn fault(
        &self,
        name: &str,
        expected: impl Into<String>,
        found: &str,
    ) -> Error {
        let found = match found {
            "" => "nothing".to_owned(),
            found => format!("`{}`", clip(found)),
        };
        let place = format!("header, `{name}`");
        Error::format(self.path, place, expected, found, DAMAGED)
    }

    pub(in crate::io) fn required(&self, name: &str) -> Result<&str> {
        let none = || self.fault(name, "this field", "");
        self.get(&[name]).ok_or_else(none)
    }

    /// Returns exactly `count` numbers, or `None` if the field is absent.
    ///
    /// - `expected`: noun in the error for another number of values.
    pub(in crate::io) fn numbers<T: FromStr>(
        &self,
        names: &[&str],
        count: usize,
        expected: &str,
    ) -> Result<Option<Vec<T>>> {
        let Some(text) = self.get(names) else {
            return Ok(None);
        };
        let numbers: Option<Vec<T>> = text.split_whitespace().map(|w| w.parse().ok()).collect();
        let numbers = numbers.filter(|n| n.len() == count);
        let fault = || self.fault(names[0], format!("{count} {expected}"), text);
        numbers.ok_or_else(fault).map(Some)
    }

    /// Returns the length to skip: 0 if absent, -1 for everything before the numbers at the end.
    pub(in crate::io) fn skipped(&self, name: &str) -> Result<i64> {
        let Some(text) = self.get(&[name]) else {
            return Ok(0);
        };
        let number = text.parse().ok().filter(|n: &i64| *n >= -1);
        number.ok_or_else(|| self.fault(name, "a whole number, at least -1", text))
    }

    /// Returns the listed files, relative to the header's folder.
    pub(in crate::io) fn listed(&self) -> Result<Vec<PathBuf>> {
        let names = self.list.iter();
        names.map(|name| voxels::beside(self.path, name)).collect()
    }
}
