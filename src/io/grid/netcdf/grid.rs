//! Reads grids by the CF conventions, and those of ROMS and NEMO: the variables of one grid at one time.
//!
//! | dimensions of a variable | use |
//! |---|---|
//! | the first, if a variable of times or its name marks it | the step |
//! | (level, y, x) or (y, x) | the grid: the one with most dimensions, among those one that is not staggered, among those the one with most variables |
//!
//! | positions | from |
//! |---|---|
//! | horizontal | longitudes and latitudes, or x and y, in two dimensions (`coordinates` names them) or one each; or else indices |
//! | vertical | ROMS' terrain-following coordinate; depths of each node; the levels' own variable; or else indices |
//!
//! Numbers are scaled and masked by their attributes: missing ones, such as land in the sea, are NaN. Sources:
//! the CF conventions 1.11, and ROMS' *Vertical S-coordinate*.

use std::collections::BTreeSet;

use netcdf_reader::{NcDimension, NcType, NcVariable};

use super::axis::{Horizontal, Vertical, horizontal, is_time, vertical};
use super::place::{self, Heights, Plane};
use super::{NetcdfFile, text};
use crate::data::association::Association;
use crate::data::dataset::{Dataset, Field, FieldSource};
use crate::data::unit;
use crate::error::{Error, Result};
use crate::io::particles::table::list;
use crate::io::time_steps::chosen;
use crate::io::vtk::xml::clip;

/// The file's variables and time dimensions.
struct Contents<'f> {
    file: &'f NetcdfFile<'f>,
    variables: &'f [NcVariable],
    /// Names of the dimensions of time.
    time_dimensions: BTreeSet<&'f str>,
}

/// The dimensions in space of a variable, and the indices along the dimensions before them.
struct Shape<'f> {
    at: Vec<usize>,
    dimensions: &'f [NcDimension],
}

/// The times of the steps.
///
/// # Errors
/// A damaged file.
pub(super) fn times(file: &NetcdfFile<'_>) -> Result<Vec<f64>> {
    Contents::of(file)?.times()
}

/// Reads the variables of the grid at one time.
///
/// # Errors
/// No variable on a grid, a damaged file.
pub(super) fn read(file: &NetcdfFile<'_>, time_step: Option<usize>) -> Result<Dataset> {
    let contents = Contents::of(file)?;
    let times = contents.times()?;
    let (step, note) = chosen(file.path, &times, time_step)?;
    let mut notes: Vec<String> = note.into_iter().collect();
    let (chosen, others) = contents.main_variables(step)?;
    if !others.is_empty() {
        notes.push(format!(
            "Left out, because they are of another grid: {}.",
            list(others.iter().map(|v| v.name()))
        ));
    }
    let Some((first, shape)) = chosen.first() else {
        return Err(Error::format(
            file.path,
            "variables",
            "numbers of at least two dimensions of space",
            list(contents.variables.iter().map(|v| v.name())),
            "save the grid itself, or export points as CSV",
        ));
    };
    let mut fields = Vec::new();
    for (variable, shape) in &chosen {
        let units = text(variable.attributes(), "units");
        fields.push(Field {
            name: variable.name().to_owned(),
            association: Association::Nodes,
            source: FieldSource::Scalar(file.unpacked(variable, &shape.at)?),
            unit: units.and_then(|units| unit::cleaned(&units)),
        });
    }
    let named: Vec<String> = chosen
        .iter()
        .filter_map(|(variable, _)| text(variable.attributes(), "coordinates"))
        .collect();
    let plane = contents.plane(shape, step, &named, &mut notes)?;
    let heights = contents.heights(first, shape, step, &plane, &named, &mut notes)?;
    let geometry = place::geometry(file, plane, heights, &mut fields, &mut notes)?;
    Ok(Dataset {
        notes,
        ..Dataset::new(file.path, "netCDF grid", geometry, fields)
    })
}

impl<'f> Contents<'f> {
    fn of(file: &'f NetcdfFile<'f>) -> Result<Self> {
        let variables = file.variables()?;
        let mut time_dimensions = BTreeSet::new();
        for variable in variables {
            if let ([only], true) = (variable.dimensions(), is_time(variable)) {
                time_dimensions.insert(only.name.as_str());
            }
            if let Some(first) = variable.dimensions().first() {
                let name = first.name.to_ascii_lowercase();
                let is_named = name == "t" || name.contains("time");
                if is_named || first.is_unlimited {
                    time_dimensions.insert(first.name.as_str());
                }
            }
        }
        Ok(Self {
            file,
            variables,
            time_dimensions,
        })
    }

    fn times(&self) -> Result<Vec<f64>> {
        let is_of_time = |d: &&NcDimension| self.time_dimensions.contains(d.name.as_str());
        let mut of_time = self
            .variables
            .iter()
            .filter(|v| v.ndim() > 1)
            .filter_map(|v| v.dimensions().first().filter(is_of_time));
        let Some(dimension) = of_time.next() else {
            return Ok(Vec::new());
        };
        let is_coordinate = |v: &&NcVariable| {
            matches!(v.dimensions(), [only] if only.name == dimension.name) && is_number(v)
        };
        let mut coordinates = self.variables.iter().filter(is_coordinate);
        let by_name = coordinates.clone().find(|v| v.name() == dimension.name);
        if let Some(times) = by_name.or_else(|| coordinates.find(|v| is_time(v))) {
            return self.file.doubles(times, &[]);
        }
        let count = usize::try_from(dimension.size).ok();
        let place = || format!("dimension `{}`", dimension.name);
        self.file.spend(place, count, size_of::<f64>())?;
        Ok((0..count.unwrap_or(0)).map(|i| i as f64).collect())
    }

    /// The shape of a variable, if it has two or three dimensions in space.
    fn shape(&self, variable: &'f NcVariable, step: usize) -> Option<Shape<'f>> {
        let mut dimensions = variable.dimensions();
        let mut at = Vec::new();
        while let [first, rest @ ..] = dimensions {
            if self.time_dimensions.contains(first.name.as_str()) {
                let last = usize::try_from(first.size).ok()?.checked_sub(1)?;
                at.push(step.min(last));
            } else if rest.len() >= 2 && first.size == 1 && rest.len() > 2 {
                at.push(0);
            } else {
                break;
            }
            dimensions = rest;
        }
        let is_grid = matches!(dimensions.len(), 2 | 3) && dimensions.iter().all(|d| d.size > 0);
        (is_grid && is_number(variable)).then_some(Shape { at, dimensions })
    }

    /// The variables of the chosen grid, and the names of others.
    #[expect(
        clippy::type_complexity,
        reason = "variables with their shapes, and others"
    )]
    fn main_variables(
        &self,
        step: usize,
    ) -> Result<(Vec<(&'f NcVariable, Shape<'f>)>, Vec<&'f NcVariable>)> {
        let mut named = BTreeSet::new();
        for variable in self.variables {
            for attribute in ["coordinates", "bounds", "formula_terms"] {
                let text = text(variable.attributes(), attribute).unwrap_or_default();
                named.extend(text.split_ascii_whitespace().map(str::to_owned));
            }
        }
        let mut all = Vec::new();
        for variable in self.variables {
            let is_place = matches!(
                horizontal(variable),
                Some(Horizontal::Longitude | Horizontal::Latitude)
            );
            if named.contains(variable.name()) || is_place || is_time(variable) {
                continue;
            }
            if let Some(shape) = self.shape(variable, step) {
                all.push((variable, shape));
            }
        }
        let rank = |shape: &Shape<'_>| {
            let count = all
                .iter()
                .filter(|(_, other)| other.dimensions == shape.dimensions)
                .count();
            (shape.dimensions.len(), !is_staggered(shape), count)
        };
        let best = all.iter().rev().max_by_key(|(_, shape)| rank(shape));
        let Some(dimensions) = best.map(|(_, shape)| shape.dimensions) else {
            return Ok((Vec::new(), Vec::new()));
        };
        let (main, others): (Vec<_>, Vec<_>) = all
            .into_iter()
            .partition(|(_, shape)| shape.dimensions == dimensions);
        Ok((main, others.into_iter().map(|(v, _)| v).collect()))
    }

    /// The variables with these dimensions, those named by `coordinates` first.
    fn over<'a>(
        &'a self,
        dimensions: &'a [NcDimension],
        step: usize,
        named: &'a [String],
    ) -> Vec<(&'f NcVariable, Vec<usize>)> {
        let mut found = Vec::new();
        for variable in self.variables.iter().filter(|v| is_number(v)) {
            let own = variable.dimensions();
            let Some(before) = own.len().checked_sub(dimensions.len()) else {
                continue;
            };
            let is_single =
                |d: &NcDimension| d.size == 1 || self.time_dimensions.contains(d.name.as_str());
            let is_same = own[before..] == *dimensions && own[..before].iter().all(is_single);
            if is_same && own.iter().all(|d| d.size > 0) {
                let last = |d: &NcDimension| usize::try_from(d.size - 1).unwrap_or(0);
                let at = own[..before].iter().map(|d| step.min(last(d)));
                found.push((variable, at.collect()));
            }
        }
        let is_named = |v: &NcVariable| {
            named
                .iter()
                .any(|names| names.split_ascii_whitespace().any(|name| name == v.name()))
        };
        found.sort_by_key(|(variable, _)| !is_named(variable));
        found
    }

    /// The horizontal positions, from the last two dimensions.
    fn plane(
        &self,
        shape: &Shape<'f>,
        step: usize,
        named: &[String],
        notes: &mut Vec<String>,
    ) -> Result<Plane> {
        let across = &shape.dimensions[shape.dimensions.len() - 2..];
        let size = |d: &NcDimension| usize::try_from(d.size).unwrap_or(usize::MAX);
        let dims = [size(&across[1]), size(&across[0])];
        let both = self.over(across, step, named);
        let of = |is: &dyn Fn(Horizontal) -> bool| {
            both.iter().find(|(v, _)| horizontal(v).is_some_and(is))
        };
        let degrees = of(&|h| h == Horizontal::Longitude).zip(of(&|h| h == Horizontal::Latitude));
        let lengths =
            || of(&|h| matches!(h, Horizontal::X(_))).zip(of(&|h| matches!(h, Horizontal::Y(_))));
        if let Some((x, y)) = degrees.or_else(lengths) {
            let kinds = [horizontal(x.0), horizontal(y.0)];
            let x = self.file.unpacked_doubles(x.0, &x.1)?;
            let y = self.file.unpacked_doubles(y.0, &y.1)?;
            return Ok(Plane::nodes(dims, kinds, x, y));
        }
        let mut kinds = [None; 2];
        let mut axes = [Vec::new(), Vec::new()];
        for (axis, dimension) in [&across[1], &across[0]].into_iter().enumerate() {
            let of_axis = self.over(std::slice::from_ref(dimension), step, named);
            let is_named = |v: &NcVariable| v.name() == dimension.name;
            let found = of_axis
                .iter()
                .find(|(v, at)| at.is_empty() && (is_named(v) || horizontal(v).is_some()));
            if let Some((variable, at)) = found {
                kinds[axis] = horizontal(variable);
                axes[axis] = self.file.unpacked_doubles(variable, at)?;
            } else {
                notes.push(format!(
                    "Places along `{}` are counted: there are no coordinates.",
                    clip(&dimension.name)
                ));
                axes[axis] = (0..dims[axis]).map(|i| i as f64).collect();
            }
        }
        let [x, y] = axes;
        Ok(Plane::axes(kinds, x, y))
    }

    /// The vertical positions, from the first of three dimensions.
    fn heights(
        &self,
        first: &NcVariable,
        shape: &Shape<'f>,
        step: usize,
        plane: &Plane,
        named: &[String],
        notes: &mut Vec<String>,
    ) -> Result<Heights> {
        let [level, ..] = shape.dimensions else {
            return Ok(Heights::None);
        };
        if shape.dimensions.len() < 3 {
            return Ok(Heights::None);
        }
        if let Some(terrain) = self.terrain_following(shape, step)? {
            return Ok(terrain);
        }
        let is_height = |v: &NcVariable| {
            let name = v.name().to_ascii_lowercase();
            let is_named = ["gdep", "dep", "z", "height", "altitude"]
                .iter()
                .any(|start| name.starts_with(start));
            let is_length = matches!(vertical(v), Vertical::Metres(_));
            let has_sense = text(v.attributes(), "positive").is_some();
            v.name() != first.name() && is_length && (is_named || has_sense)
        };
        let of_nodes = self.over(shape.dimensions, step, named);
        if let Some((variable, at)) = of_nodes.iter().find(|(v, _)| is_height(v)) {
            let numbers = self.file.unpacked_doubles(variable, at)?;
            return Ok(Heights::of_nodes(vertical(variable), numbers));
        }
        let of_levels = self.over(std::slice::from_ref(level), step, named);
        let is_level = |(v, at): &&(&NcVariable, Vec<usize>)| {
            at.is_empty() && (v.name() == level.name || is_height(v))
        };
        let count = usize::try_from(level.size).unwrap_or(usize::MAX);
        let name = clip(&level.name);
        let (kind, numbers) = match of_levels.iter().find(is_level) {
            Some((variable, at)) => (
                vertical(variable),
                self.file.unpacked_doubles(variable, at)?,
            ),
            None => {
                let counts = (0..count).map(|i| i as f64).collect();
                (Vertical::Level { is_down: false }, counts)
            }
        };
        Ok(Heights::of_levels(&name, kind, numbers, plane, notes))
    }

    /// ROMS' heights, if its variables exist.
    fn terrain_following(&self, shape: &Shape<'f>, step: usize) -> Result<Option<Heights>> {
        let [level, y, x] = shape.dimensions else {
            return Ok(None);
        };
        let (s, stretching) = match level.name.as_str() {
            "s_rho" => ("s_rho", "Cs_r"),
            "s_w" => ("s_w", "Cs_w"),
            _ => return Ok(None),
        };
        let variable = |name: &str| self.variables.iter().find(|v| v.name() == name);
        let (Some(s), Some(c), Some(hc), Some(h)) = (
            variable(s),
            variable(stretching),
            variable("hc"),
            variable("h"),
        ) else {
            return Ok(None);
        };
        let across = [y.clone(), x.clone()];
        let over = self.over(&across, step, &[]);
        let numbers = |name: &str| {
            let found = over.iter().find(|(v, _)| v.name() == name);
            found
                .map(|(v, at)| self.file.unpacked_doubles(v, at))
                .transpose()
        };
        let Some(depths) = numbers(h.name())? else {
            return Ok(None);
        };
        let single = |v: &NcVariable| {
            Ok::<f64, Error>(self.file.doubles(v, &[])?.first().copied().unwrap_or(0.0))
        };
        let standard = text(s.attributes(), "standard_name").unwrap_or_default();
        let transform = match variable("Vtransform") {
            Some(transform) => single(transform)?,
            None if standard.ends_with("_g2") => 2.0,
            None => 1.0,
        };
        let terrain = place::Terrain {
            is_second: transform == 2.0,
            critical_depth: single(hc)?,
            s: self.file.doubles(s, &[])?,
            stretching: self.file.doubles(c, &[])?,
            depths,
            surface: numbers("zeta")?,
        };
        terrain.heights(self.file, level).map(Some)
    }
}

/// Whether the values lie on faces or corners of cells, by the names of ROMS and WRF.
fn is_staggered(shape: &Shape<'_>) -> bool {
    let ends = ["_u", "_v", "_psi", "_w", "_stag"];
    let is = |d: &NcDimension| ends.iter().any(|end| d.name.ends_with(end));
    shape.dimensions.iter().any(is)
}

fn is_number(variable: &NcVariable) -> bool {
    variable.dtype().is_primitive() && !matches!(variable.dtype(), NcType::Char | NcType::String)
}
