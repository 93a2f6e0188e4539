//! Reads ParaView's file series (`.series`): a list of files with their times.
//!
//! ```text
//! { "file-series-version": "1.0",
//!   "files": [ { "name": "a_0.vtu", "time": 0 }, { "name": "a_1.vtu", "time": 0.5 } ] }
//! ```
//!
//! A `name` is relative to the folder of the series. If a file has no `time`, its index in the list is its time. Files
//! with the same time are drawn together.

use std::ffi::OsStr;
use std::path::{Path, PathBuf};

use serde::Deserialize;

use super::pvd;
use super::xml::clip;
use crate::error::{Error, Result};
use crate::io::bytes::file::Input;
use crate::io::time_steps::TimeStep;

/// Key that every series file contains.
const VERSION: &[u8] = b"\"file-series-version\"";

const DAMAGED: &str = "the series is damaged: save it again";

#[derive(Deserialize)]
struct Series {
    files: Vec<Entry>,
}

#[derive(Deserialize)]
struct Entry {
    name: String,
    time: Option<f64>,
}

/// Returns true if a file that begins with `head` is a series.
pub(in crate::io) fn looks_like(head: &[u8]) -> bool {
    let head = head.strip_prefix(b"\xef\xbb\xbf").unwrap_or(head);
    head.trim_ascii_start().starts_with(b"{") && head.windows(VERSION.len()).any(|w| w == VERSION)
}

/// Returns the time steps in order, at least one. Files that the series names are not opened.
///
/// # Errors
/// The file is no series, or names no file. A name is empty or that of another series, a time is not finite, or a file
/// occurs twice at one time.
pub(in crate::io) fn steps(input: Input<'_>) -> Result<Vec<TimeStep>> {
    let path = input.path;
    let bytes = pvd::list_bytes(input, "series")?;
    let bytes = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(&bytes);
    let series: Series = serde_json::from_slice(bytes).map_err(|e| {
        let place = format!("line {}, column {}", e.line(), e.column());
        let expected = "`files` with a `name` and a `time` each";
        Error::format(path, place, expected, e.to_string(), DAMAGED)
    })?;
    if series.files.is_empty() {
        let expected = "one file at least";
        return Err(Error::format(path, "files", expected, "none", DAMAGED));
    }
    let folder = path.parent().unwrap_or(Path::new(""));
    let part = |(i, entry): (usize, Entry)| -> Result<(f64, i64, PathBuf)> {
        let fault = |key: &str, expected: &str, found: String| {
            Error::format(path, format!("files[{i}].{key}"), expected, found, DAMAGED)
        };
        let time = entry.time.unwrap_or(i as f64);
        if !time.is_finite() {
            return Err(fault("time", "a finite number", time.to_string()));
        }
        let file = folder.join(&entry.name);
        let is_series = |ending: &OsStr| {
            let mut nested = ["series", "pvd"].iter();
            nested.any(|known| ending.eq_ignore_ascii_case(known))
        };
        if entry.name.trim().is_empty() || file.extension().is_some_and(is_series) {
            let found = format!("`{}`", clip(&entry.name));
            return Err(fault("name", "the name of a file of data", found));
        }
        // Adding zero turns -0 into +0, so both are one time.
        Ok((time + 0.0, i64::try_from(i).unwrap_or(i64::MAX), file))
    };
    let parts: Result<Vec<_>> = series.files.into_iter().enumerate().map(part).collect();
    pvd::by_time(input, parts?, DAMAGED)
}
