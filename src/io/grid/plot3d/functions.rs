//! Reads PLOT3D function files: any quantities at the nodes of a grid, with their names from a file beside
//! them.

use std::path::Path;

use super::companion::{Body, Companion};
use super::layout::{Content, Layout};
use super::{node_field, text};
use crate::data::dataset::{Field, FieldSource};
use crate::error::{Error, Result};
use crate::io::bytes::file::Input;
use crate::io::bytes::file::extension;

/// Extensions of such files.
pub(super) const ENDINGS: [&str; 2] = ["f", "fun"];

/// Greatest number of functions, more than any code writes: each is a field, which takes more memory than a
/// number in a file.
const MOST: usize = 4096;

/// Whether a file with the name of a grid's functions contains functions: `.f` is also the extension of Fortran
/// programs.
///
/// # Errors
/// A file that cannot be read.
pub(super) fn is_no_program(path: &Path, grid: Input<'_>) -> Result<bool> {
    let head = grid.with_beside(path, |file| Ok(file.head(256)?.0))?;
    let is_text = text::looks_like_text(&head);
    Ok(!is_text || text::begins_with_number(&head))
}

/// Whether a file given with a grid contains functions: by its extension, or because it is not a solution of
/// that grid and agrees as functions.
///
/// # Errors
/// A file that cannot be read.
pub(super) fn is_given(path: &Path, grid: Input<'_>, grid_layout: &Layout) -> Result<bool> {
    let ending = extension(path);
    if ENDINGS.contains(&ending.as_str()) || ending == "q" {
        return Ok(ending != "q");
    }
    let bytes = grid.read_beside(path)?;
    let fits = |content: Content| {
        Companion::new(path, grid.path, content, grid_layout).fits(&bytes, grid_layout)
    };
    Ok(!fits(Content::Solution) && fits(Content::Functions))
}

/// The functions at all nodes, grid after grid, and notes on what was left out.
///
/// # Errors
/// A file of another grid, or of no readable size.
pub(super) fn read(
    path: &Path,
    grid: Input<'_>,
    grid_layout: &Layout,
) -> Result<(Vec<Field>, Vec<String>)> {
    let bytes = grid.read_beside(path)?;
    let companion = Companion::new(path, grid.path, Content::Functions, grid_layout);
    companion.read(&bytes, grid_layout, |body| of_body(path, grid, body))
}

fn of_body(path: &Path, grid: Input<'_>, body: &Body<'_>) -> Result<(Vec<Field>, Vec<String>)> {
    let functions = &body.layout.functions;
    let shared = functions.iter().copied().min().unwrap_or(0);
    let most = functions.iter().copied().max().unwrap_or(0);
    if most > MOST {
        return Err(Error::format(
            path,
            body.of.place(),
            format!("at most {MOST} functions"),
            most.to_string(),
            "write those that are looked at to a file of their own",
        ));
    }
    let mut notes = Vec::new();
    if shared < most {
        notes.push(format!(
            "Of {most} functions in {} the first {shared} are read: some grids have no more.",
            path.display()
        ));
    }
    let (names, about_names) = names(path, grid, most)?;
    notes.extend(about_names);
    let mut fields = Vec::new();
    for (i, name) in names.iter().enumerate().take(shared) {
        fields.push(node_field(name, FieldSource::Scalar(body.values(i)?)));
    }
    Ok((fields, notes))
}

/// Names of `count` functions, from the file beside theirs with the extension `.nam`; others are `f1`, `f2`,
/// ... Also returns a note on faults of that file.
///
/// In FieldView's files the name of a vector follows that of its first component, after a semicolon.
///
/// # Errors
/// The file exists and cannot be read.
fn names(path: &Path, grid: Input<'_>, count: usize) -> Result<(Vec<String>, Option<String>)> {
    let is_upper = path
        .extension()
        .is_some_and(|e| e.to_string_lossy().starts_with('F'));
    let file = path.with_extension(if is_upper { "NAM" } else { "nam" });
    let numbered = |i: usize| format!("f{}", i + 1);
    if grid.len_beside(&file).is_none_or(|len| len == 0) {
        return Ok(((0..count).map(numbered).collect(), None));
    }
    let bytes = grid.read_beside(&file)?;
    let text = String::from_utf8_lossy(&bytes);
    let named: Vec<&str> = text
        .lines()
        .map(|line| line.split(';').next().unwrap_or(line).trim())
        .filter(|name| !name.is_empty())
        .collect();
    let name = |i: usize| {
        named
            .get(i)
            .map_or_else(|| numbered(i), |n| (*n).to_owned())
    };
    let note = (named.len() != count).then(|| {
        format!(
            "{} names {} functions of {count}: those without a name are called by their numbers.",
            file.display(),
            named.len()
        )
    });
    Ok(((0..count).map(name).collect(), note))
}
