//! PLOT3D solutions: the flow at the nodes of a grid, and what follows from it.
//!
//! Derived fields use PLOT3D's non-dimensional perfect gas (velocities in units of the
//! free-stream speed of sound, gamma = 1.4).

use std::path::{Path, PathBuf};

use super::super::dataset::{Dataset, Field, FieldSource};
use super::super::file::Input;
use super::super::scalars::narrow;
use super::layout::{Contents, Kind, Layout, describe_dims};
use super::{node_field, text};
use crate::error::{Error, Hint, Result};
use crate::scene::Values;

/// Ratio of specific heats of air.
const GAMMA: f32 = 1.4;

/// The solution beside a grid, if there is such a file: `xyz` in its name replaced by `q`, or
/// its extension `x`, `g` or `p3d`.
pub(super) fn beside(input: Input<'_>) -> Option<PathBuf> {
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
    let q = if name[at..].starts_with(|c: char| c.is_ascii_uppercase()) {
        "Q"
    } else {
        "q"
    };
    let beside = grid.with_file_name(format!("{}{q}{}", &name[..at], &name[at + len..]));
    let len = input.len_beside(&beside)?;
    (len > 0).then_some(beside)
}

/// The fields of the solution of a grid, for all its nodes, one grid after another.
///
/// # Errors
/// The solution is of another grid, or of no readable size.
pub(super) fn read(
    path: &Path,
    grid: Input<'_>,
    grid_layout: &Layout,
) -> Result<(Vec<Field>, Vec<String>)> {
    let bytes = grid.read_beside(path)?;
    let grid = grid.path;
    let node_counts = grid_layout.node_counts().unwrap_or_default();
    let node_count: usize = node_counts.iter().sum();
    let numbers;
    let contents = if text::looks_like_text(&bytes) {
        let header = 1 + 7 * node_counts.len();
        let most = node_count.saturating_mul(5).saturating_add(header);
        numbers = text::numbers(path, &bytes, most.max(bytes.len()))?;
        Contents::Numbers(&numbers)
    } else {
        Contents::Bytes(&bytes)
    };

    let mut found_dims = None;
    let mut sizes = Vec::new();
    let mut fitting: Vec<Layout> = Vec::new();
    for layout in Layout::all(contents, Kind::Solution) {
        let Some(end) = layout.end(Kind::Solution) else {
            continue;
        };
        if layout.dims == grid_layout.dims {
            sizes.push(format!("{end} for {}", layout.describe()));
            if layout.fits_padded(contents, Kind::Solution) {
                fitting.push(layout);
            }
        } else if end <= contents.len() && layout.marks_agree(contents, Kind::Solution) {
            // In the wrong byte order, dimensions are far too large for the file.
            found_dims = found_dims.or(Some(layout.dims));
        }
    }
    // Trailing zeros make a large all-zero tail look like padding: exact sizes win, then the
    // grid's own way of writing, then the order of `Layout::all`.
    let exact = |l: &&Layout| l.end(Kind::Solution) == Some(contents.len());
    let like_grid = |l: &&Layout| (l.form, l.counted) == (grid_layout.form, grid_layout.counted);
    let chosen = fitting
        .iter()
        .find(exact)
        .or_else(|| fitting.iter().find(like_grid))
        .or_else(|| fitting.first());
    let unit = match contents {
        Contents::Bytes(_) => "bytes",
        Contents::Numbers(_) => "numbers",
    };
    let place = || format!("PLOT3D solution of {}", grid.display());
    let Some(layout) = chosen else {
        let dims = describe_dims(&grid_layout.dims);
        let (expected, found) = if sizes.is_empty() {
            match found_dims {
                Some(found) => disagreement(&grid_layout.dims, &found),
                None => (
                    format!("the grid's {dims} nodes"),
                    "no dimensions (or no PLOT3D solution)".to_owned(),
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
        return Err(Error::format(
            path,
            place(),
            expected,
            found,
            Hint::NameOwnSolution,
        ));
    };

    let broken = || {
        Error::format(
            path,
            place(),
            "five variables per node",
            "fewer",
            "write the solution again",
        )
    };
    let (starts, _) = layout.bodies(Kind::Solution).ok_or_else(broken)?;
    let variable = |v: usize| -> Result<Values> {
        let mut all = Vec::with_capacity(node_count);
        for (&start, &count) in starts.iter().zip(&node_counts) {
            let at = start + v * count * layout.form.real_size();
            let part = contents.numbers(layout.form, true, at, count);
            all.extend(part.ok_or_else(broken)?.into_iter().map(narrow));
        }
        Ok(Values::F32(all))
    };
    let (density, energy) = (variable(0)?, variable(4)?);
    // What is nowhere above 0 was not stored, and nothing follows from it.
    let is_stored = |values: &Values| values.finite_range().is_some_and(|[_, most]| most > 0.0);
    let has = [is_stored(&density), is_stored(&energy)];
    let mut fields = vec![
        node_field("density", FieldSource::Scalar(density)),
        node_field(
            "momentum",
            FieldSource::Vector(vec![variable(1)?, variable(2)?, variable(3)?]),
        ),
        node_field("energy", FieldSource::Scalar(energy)),
    ];
    let mut notes = Vec::new();
    let mut derive = |name: &str, needs: &[usize], how: fn(&Dataset) -> Result<Values>| match needs
        .iter()
        .find(|variable| !has[**variable])
    {
        None => fields.push(node_field(name, FieldSource::Derived(how))),
        Some(variable) => {
            let missing = ["density", "energy"][*variable];
            notes.push(format!(
                "{name} is not derived: {missing} is nowhere above 0"
            ));
        }
    };
    derive("velocity_magnitude", &[0], velocity_magnitude);
    derive("pressure", &[0, 1], pressure);
    derive("mach", &[0, 1], mach);
    Ok((fields, notes))
}

/// Where the dimensions of a grid and of a solution part: what was expected, what was found.
fn disagreement(grid: &[[usize; 3]], found: &[[usize; 3]]) -> (String, String) {
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
        format!("{} (or no PLOT3D solution)", one(found)),
    )
}

/// Applies `f(density, |momentum|, energy)` to every node.
fn derive(data: &Dataset, f: fn(f32, f32, f32) -> f32) -> Result<Values> {
    let (_, density) = data.scalar("density")?;
    let (_, momentum) = data.scalar("momentum")?;
    let (_, energy) = data.scalar("energy")?;
    let nodes = 0..density.len();
    Ok(Values::F32(
        nodes
            .map(|i| f(density.get(i), momentum.get(i), energy.get(i)))
            .collect(),
    ))
}

/// |u| = |rho u| / rho.
fn velocity_magnitude(data: &Dataset) -> Result<Values> {
    derive(data, |density, momentum, _| momentum / density)
}

/// p = (gamma - 1) (e - rho |u|² / 2).
fn perfect_gas_pressure(density: f32, momentum: f32, energy: f32) -> f32 {
    (GAMMA - 1.0) * (energy - 0.5 * momentum * momentum / density)
}

fn pressure(data: &Dataset) -> Result<Values> {
    derive(data, perfect_gas_pressure)
}

/// |u| / c with the speed of sound c = sqrt(gamma p / rho).
fn mach(data: &Dataset) -> Result<Values> {
    derive(data, |density, momentum, energy| {
        let pressure = perfect_gas_pressure(density, momentum, energy);
        momentum / density / (GAMMA * pressure / density).sqrt()
    })
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::super::super::dataset::Geometry;
    use super::*;

    #[test]
    fn uniform_flow_has_its_mach_number_and_pressure() {
        // Free stream of Mach 2 along x: rho = 1, a = 1, p = 1 / gamma,
        // e = p / (gamma - 1) + rho u² / 2.
        let energy = 1.0 / (GAMMA * (GAMMA - 1.0)) + 2.0;
        let data = Dataset::new(
            Path::new("free-stream"),
            "",
            Geometry::Points {
                positions: vec![DVec3::ZERO],
            },
            vec![
                node_field("density", FieldSource::Scalar(Values::F32(vec![1.0]))),
                node_field(
                    "momentum",
                    FieldSource::Vector([2.0, 0.0, 0.0].map(|m| Values::F32(vec![m])).into()),
                ),
                node_field("energy", FieldSource::Scalar(Values::F32(vec![energy]))),
            ],
        );
        // A few roundings of f32.
        let close = |values: Values, x: f32| (values.get(0) - x).abs() < 1e-6 * x;
        assert!(close(pressure(&data).unwrap(), 1.0 / GAMMA));
        assert!(close(mach(&data).unwrap(), 2.0));
        assert!(close(velocity_magnitude(&data).unwrap(), 2.0));
    }

    #[test]
    fn the_solution_is_looked_for_by_name() {
        let folder = tempfile::tempdir().unwrap();
        let found = |grid: &str| {
            super::beside(Input::of_file(&folder.path().join(grid)))
                .map(|p| p.file_name().unwrap().to_str().unwrap().to_owned())
        };
        assert_eq!(found("finxyz.bin"), None);
        for name in ["finq.bin", "fin.q", "FINQ.BIN"] {
            std::fs::write(folder.path().join(name), [1]).unwrap();
        }
        assert_eq!(found("finxyz.bin").as_deref(), Some("finq.bin"));
        assert_eq!(found("fin.xyz").as_deref(), Some("fin.q"));
        assert_eq!(found("FINXYZ.BIN").as_deref(), Some("FINQ.BIN"));
        assert_eq!(found("fin.bin"), None);
    }
}
