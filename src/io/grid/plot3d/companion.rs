//! Finds and reads files that accompany a grid: solutions and functions, in the layout that agrees with the
//! grid.

use std::path::{Path, PathBuf};

use super::layout::{Content, Contents, Kind, Layout, describe_dims};
use super::text;
use crate::error::{Error, Hint, Result};
use crate::io::bytes::file::Input;
use crate::scene::Values;

/// A file with numbers at the nodes of a grid.
#[derive(Debug, Clone, Copy)]
pub(super) struct Companion<'a> {
    path: &'a Path,
    /// The file of the grid.
    grid: &'a Path,
    /// Solution or functions, with the grid's number of dimensions.
    kind: Kind,
}

/// The file beside a grid with the grid's name, if there is one. Its name has `ending` in place of `xyz`, or in
/// place of the extension `x`, `g` or `p3d`.
///
/// - `ending`: in lower case.
pub(super) fn beside(input: Input<'_>, ending: &str) -> Option<PathBuf> {
    let grid = input.path;
    let name = grid.file_name()?.to_str()?;
    let lower = name.to_ascii_lowercase();
    let (at, len) = match lower.rfind("xyz") {
        Some(at) => (at, 3),
        None => {
            let (stem, extension) = lower.rsplit_once('.')?;
            let known = matches!(extension, "x" | "g" | "p3d");
            known.then_some((stem.len() + 1, extension.len()))?
        }
    };
    let ending = if name[at..].starts_with(|c: char| c.is_ascii_uppercase()) {
        ending.to_ascii_uppercase()
    } else {
        ending.to_owned()
    };
    let beside = grid.with_file_name(format!("{}{ending}{}", &name[..at], &name[at + len..]));
    let len = input.len_beside(&beside)?;
    (len > 0).then_some(beside)
}

/// The numbers of a companion that agrees with its grid.
pub(super) struct Body<'a> {
    pub(super) of: Companion<'a>,
    contents: Contents<'a>,
    pub(super) layout: Layout,
    /// Offset and number of nodes of each grid's numbers.
    grids: Vec<(usize, usize)>,
}

impl Body<'_> {
    /// One number for each node, grid after grid.
    ///
    /// # Errors
    /// Fewer numbers than the layout states.
    pub(super) fn values(&self, number: usize) -> Result<Values> {
        let form = self.layout.form;
        let mut all: Vec<f64> = Vec::with_capacity(self.grids.iter().map(|(_, count)| count).sum());
        for &(start, count) in &self.grids {
            let at = start + number * count * form.real_size();
            let part = self.contents.numbers(form, true, at, count);
            let part = part.ok_or_else(|| self.of.broken())?;
            all.extend(part);
        }
        Ok(all.into())
    }
}

impl<'a> Companion<'a> {
    /// - `content`: solution or functions.
    pub(super) fn new(path: &'a Path, grid: &'a Path, content: Content, layout: &Layout) -> Self {
        let kind = Kind::of(content, layout.axes);
        Self { path, grid, kind }
    }

    fn name(&self) -> &'static str {
        match self.kind.content {
            Content::Functions => "functions",
            _ => "solution",
        }
    }

    pub(super) fn place(&self) -> String {
        format!("PLOT3D {} of {}", self.name(), self.grid.display())
    }

    /// Whether the bytes agree with the grid as this kind of file.
    pub(super) fn fits(&self, bytes: &[u8], grid_layout: &Layout) -> bool {
        let numbers = self.numbers(bytes, grid_layout);
        numbers.is_ok_and(|numbers| {
            let contents = Contents::of(bytes, numbers.as_deref());
            self.layout(contents, grid_layout).is_ok()
        })
    }

    /// Applies `read` to the numbers, if they agree with the grid.
    ///
    /// # Errors
    /// A file of another grid, or of no readable size; errors of `read`.
    pub(super) fn read<T>(
        &self,
        bytes: &[u8],
        grid_layout: &Layout,
        read: impl FnOnce(&Body<'_>) -> Result<T>,
    ) -> Result<T> {
        let numbers = self.numbers(bytes, grid_layout)?;
        let contents = Contents::of(bytes, numbers.as_deref());
        let layout = self.layout(contents, grid_layout)?;
        let bodies = layout.bodies(self.kind).map(|(starts, _)| starts);
        let starts = bodies.ok_or_else(|| self.broken())?;
        let counts = layout.node_counts().ok_or_else(|| self.broken())?;
        read(&Body {
            of: *self,
            contents,
            layout,
            grids: starts.into_iter().zip(counts).collect(),
        })
    }

    /// The error for fewer numbers than the layout states.
    fn broken(&self) -> Error {
        let (expected, advice) = match self.kind.content {
            Content::Functions => ("the functions of each node", "write the file again"),
            _ => (
                "density, momentum and energy of each node",
                "write the solution again",
            ),
        };
        Error::format(self.path, self.place(), expected, "fewer", advice)
    }

    /// The numbers of a text file. With repeat counts there may be more numbers than bytes, but no more than a
    /// solution of the grid has.
    ///
    /// # Errors
    /// A word that is no number, or more numbers.
    fn numbers(&self, bytes: &[u8], grid_layout: &Layout) -> Result<Option<Vec<f64>>> {
        if !text::looks_like_text(bytes) {
            return Ok(None);
        }
        let header = 1 + 8 * grid_layout.dims.len();
        let nodes: usize = grid_layout.node_counts().unwrap_or_default().iter().sum();
        let most = nodes.saturating_mul(5).saturating_add(header);
        text::numbers(self.path, bytes, most.max(bytes.len())).map(Some)
    }

    /// The layout that agrees with the grid and with the file's size. Zero bytes may follow.
    ///
    /// # Errors
    /// A file of another grid, or of no readable size.
    fn layout(&self, contents: Contents<'_>, grid_layout: &Layout) -> Result<Layout> {
        let mut found_dims = None;
        let mut sizes = Vec::new();
        let mut fitting: Vec<Layout> = Vec::new();
        for layout in Layout::all(contents, self.kind) {
            let Some(end) = layout.end(self.kind) else {
                continue;
            };
            if layout.dims == grid_layout.dims {
                sizes.push(format!("{end} for {}", layout.describe()));
                if layout.fits_padded(contents, self.kind) {
                    fitting.push(layout);
                }
            } else if end <= contents.len() && layout.marks_agree(contents, self.kind) {
                // In the wrong byte order, dimensions are far too large for the file.
                found_dims = found_dims.or(Some(layout.dims));
            }
        }
        // Trailing zeros make a large all-zero tail look like padding. So exact sizes take precedence, then the
        // grid's own layout, then the order of `Layout::all`.
        let exact = |l: &Layout| l.end(self.kind) == Some(contents.len());
        let like_grid = |l: &Layout| (l.form, l.counted) == (grid_layout.form, grid_layout.counted);
        let chosen = fitting
            .iter()
            .position(exact)
            .or_else(|| fitting.iter().position(like_grid))
            .unwrap_or(0);
        if chosen < fitting.len() {
            return Ok(fitting.swap_remove(chosen));
        }
        let unit = match contents {
            Contents::Bytes(_) => "bytes",
            Contents::Numbers(_) => "numbers",
        };
        let (expected, found) = if sizes.is_empty() {
            match found_dims {
                Some(found) => self.disagreement(&grid_layout.dims, &found),
                None => (
                    format!("the grid's {} nodes", describe_dims(&grid_layout.dims)),
                    format!("no dimensions (or no PLOT3D {})", self.name()),
                ),
            }
        } else {
            (
                format!(
                    "one of these counts of {unit}, then nothing but zeros: {}",
                    sizes.join("; ")
                ),
                format!("{} {unit}", contents.len()),
            )
        };
        let advice = Hint::NameOwnSolution;
        Err(Error::format(
            self.path,
            self.place(),
            expected,
            found,
            advice,
        ))
    }

    /// The difference between the dimensions of the grid and of the file: expected, found.
    fn disagreement(&self, grid: &[[usize; 3]], found: &[[usize; 3]]) -> (String, String) {
        if grid.len() != found.len() {
            let count = |dims: &[[usize; 3]]| match dims.len() {
                1 => format!("1 grid of {}", describe_dims(dims)),
                n => format!("{n} grids"),
            };
            return (format!("{}, as in the grid", count(grid)), count(found));
        }
        let differing = grid.iter().zip(found).position(|(a, b)| a != b);
        let at = differing.unwrap_or(0);
        let one = |dims: &[[usize; 3]]| describe_dims(&dims[at..=at]);
        let which = if grid.len() > 1 {
            format!(" in grid {}", at + 1)
        } else {
            String::new()
        };
        (
            format!("the grid's {} nodes{which}", one(grid)),
            format!("{} (or no PLOT3D {})", one(found), self.name()),
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_are_looked_for_by_the_grid_s_name() {
        let folder = tempfile::tempdir().unwrap();
        let found = |grid: &str, ending: &str| {
            super::beside(Input::of_file(&folder.path().join(grid)), ending)
                .map(|p| p.file_name().unwrap().to_str().unwrap().to_owned())
        };
        assert_eq!(found("finxyz.bin", "q"), None);
        for name in ["finq.bin", "fin.q", "FINQ.BIN", "fin.fun"] {
            std::fs::write(folder.path().join(name), [1]).unwrap();
        }
        assert_eq!(found("finxyz.bin", "q").as_deref(), Some("finq.bin"));
        assert_eq!(found("fin.xyz", "q").as_deref(), Some("fin.q"));
        assert_eq!(found("FINXYZ.BIN", "q").as_deref(), Some("FINQ.BIN"));
        assert_eq!(found("fin.bin", "q"), None);
        assert_eq!(found("fin.g", "fun").as_deref(), Some("fin.fun"));
        assert_eq!(found("fin.g", "f"), None);
    }
}
