//! Converts columns to particle tables, for CSV, NPY and PLY files.
//!
//! A table has named columns. `x`, `y` and `z` (in either case) are required and become the positions, in
//! double precision. Every other numeric column becomes a field. Sampling the table decides the meaning of
//! columns (`h`, `sigma`, `mass`, ...). Among lengths, `sigma` and `radius` are one standard deviation; `h` is
//! the smoothing length of the cubic spline, which ends at 2 h ([`crate::irregular`]).

use std::collections::{HashSet, VecDeque};
use std::path::Path;

use glam::DVec3;

use crate::data::association::Association;
use crate::data::dataset::{Dataset, Field, FieldSource, Geometry};
use crate::error::{Advice, Error, Result};
use crate::scene::Values;

/// ParaView's names of position columns in the tables that it writes.
pub(crate) const PARAVIEW: [&str; 3] = ["Points:0", "Points:1", "Points:2"];

/// Note on tables without a column z.
pub(crate) const FLAT: &str = "There is no column `z`: all particles are put at z = 0.";

/// The columns of positions.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct PositionColumns {
    pub(crate) x: usize,
    pub(crate) y: usize,
    /// `None` for particles in a plane, which lie at z = 0.
    pub(crate) z: Option<usize>,
}

impl PositionColumns {
    /// The columns of all three axes.
    ///
    /// # Errors
    /// There is no column z.
    pub(crate) fn of_space(&self, path: &Path) -> Result<[usize; 3]> {
        match self.z {
            Some(z) => Ok([self.x, self.y, z]),
            None => Err(misnamed(path, "no column `z`".to_owned())),
        }
    }

    pub(crate) fn contains(&self, column: usize) -> bool {
        self.x == column || self.y == column || self.z == Some(column)
    }

    /// The column of each axis; in a plane that of x in place of z, until [`Self::flatten`].
    pub(crate) fn axes(&self) -> [usize; 3] {
        [self.x, self.y, self.z.unwrap_or(self.x)]
    }

    /// Moves particles of a plane to z = 0; returns a note for their data set.
    pub(crate) fn flatten(&self, positions: &mut [DVec3]) -> Option<String> {
        if self.z.is_some() {
            return None;
        }
        positions.iter_mut().for_each(|p| p.z = 0.0);
        Some(FLAT.to_owned())
    }
}

/// The columns named x, y and z; z may be missing.
///
/// # Errors
/// x or y is missing, or one of the three occurs twice.
pub(crate) fn position_columns<'a>(
    path: &Path,
    names: impl Iterator<Item = &'a str> + Clone,
) -> Result<PositionColumns> {
    let is_there = |wanted: &str| names.clone().any(|name| name.eq_ignore_ascii_case(wanted));
    let wanted = match PARAVIEW.iter().all(|name| is_there(name)) && !is_there("x") {
        true => PARAVIEW,
        false => ["x", "y", "z"],
    };
    let column = |wanted: &str| {
        let mut matching = names
            .clone()
            .enumerate()
            .filter(|(_, name)| name.eq_ignore_ascii_case(wanted));
        let found = match (matching.next(), matching.next()) {
            (Some((index, _)), None) => return Ok(Some(index)),
            (None, _) => return Ok(None),
            (Some(_), Some(_)) => format!("more than one column `{wanted}`"),
        };
        Err(misnamed(path, found))
    };
    let [x, y, z] = [column(wanted[0])?, column(wanted[1])?, column(wanted[2])?];
    match (x, y) {
        (Some(x), Some(y)) => Ok(PositionColumns { x, y, z }),
        _ => {
            let missing = if x.is_none() { wanted[0] } else { wanted[1] };
            let found = format!("no column `{missing}` among {}", list(names));
            Err(misnamed(path, found))
        }
    }
}

fn misnamed(path: &Path, found: String) -> Error {
    Error::format(
        path,
        "column names",
        "one column each for x, y and z, or for x and y of a plane",
        found,
        "name the position columns x, y and z",
    )
}

/// A bounded list of names, for messages.
pub(crate) fn list<'a>(names: impl Iterator<Item = &'a str>) -> String {
    const MOST: usize = 16;
    let mut shown: Vec<String> = names
        .take(MOST + 1)
        .map(|n| format!("`{}`", n.chars().take(40).collect::<String>()))
        .collect();
    if shown.len() > MOST {
        shown[MOST] = "...".to_owned();
    }
    if shown.is_empty() {
        return "none at all".to_owned();
    }
    shown.join(", ")
}

/// A data set of particles.
///
/// # Errors
/// No particles.
pub(crate) fn dataset(
    path: &Path,
    format: &'static str,
    positions: Vec<DVec3>,
    fields: Vec<Field>,
) -> Result<Dataset> {
    if positions.is_empty() {
        return Err(Error::format(
            path,
            "rows",
            "at least one particle",
            "none",
            Advice::no_data("check that the table was written completely"),
        ));
    }
    let geometry = Geometry::Points { positions };
    Ok(Dataset::new(path, format, geometry, fields))
}

/// Converts columns to fields: consecutive ones with X, Y and Z after one name are a vector, and so are those of an
/// array of three, as LAMMPS names them: `c_a[1]`, `c_a[2]`, `c_a[3]`. They stay scalars if another column has the vector's name.
///
/// - `axes`: number of components, 2 or 3.
pub(crate) fn joined(
    columns: Vec<(String, Values)>,
    association: Association,
    axes: usize,
) -> Vec<Field> {
    let names: HashSet<String> = columns.iter().map(|(name, _)| name.clone()).collect();
    let mut fields = Vec::new();
    let mut rest = VecDeque::from(columns);
    while let Some((name, first)) = rest.pop_front() {
        let following = rest.iter().map(|(name, _)| name.as_str());
        let stem = vector_name(&name, following, axes);
        let stem = stem
            .filter(|stem| !names.contains(*stem))
            .map(str::to_owned);
        let (name, source) = match stem {
            Some(stem) => {
                let others = rest.drain(..axes - 1).map(|(_, values)| values);
                let all = std::iter::once(first).chain(others).collect();
                (stem, FieldSource::Vector(all))
            }
            None => (name, FieldSource::Scalar(first)),
        };
        fields.push(Field {
            name,
            association,
            source,
            unit: None,
        });
    }
    fields
}

/// The name of a vector with components of these names: `DISPL` for `DISPLX`, `DISPLY`, `DISPLZ`, `v` for `v_x`
/// ...
fn vector_name<'n>(
    first: &'n str,
    mut following: impl Iterator<Item = &'n str>,
    axes: usize,
) -> Option<&'n str> {
    let ends: [&[&str]; 3] = [
        &["X", "Y", "Z"],
        &["x", "y", "z"],
        &["[1]", "[2]", "[3]", "[4]"],
    ];
    let ends = ends.into_iter().find(|ends| first.ends_with(ends[0]))?;
    let stem = first.strip_suffix(ends[0])?;
    let mut next =
        |end: &str| following.next().and_then(|name| name.strip_suffix(end)) == Some(stem);
    let is_vector = ends[1..axes].iter().all(|end| next(end));
    // An array of more numbers, as the six of a tensor, is no vector.
    let is_longer = is_vector && ends[3..].iter().any(|end| next(end));
    let name = stem.trim_end_matches(['_', '-', ' ']);
    (is_vector && !is_longer && !name.is_empty()).then_some(name)
}

/// Replaces the column `diameter` by `radius`, half of it, unless there is one; returns a note.
pub(crate) fn halved_diameters(fields: &mut [Field]) -> Option<String> {
    let is_named = |field: &Field, name: &str| field.name.eq_ignore_ascii_case(name);
    if fields.iter().any(|field| is_named(field, "radius")) {
        return None;
    }
    let field = fields
        .iter_mut()
        .find(|field| is_named(field, "diameter"))?;
    let FieldSource::Scalar(values) = &field.source else {
        return None;
    };
    let halves: Vec<f64> = (0..values.len()).map(|i| values.wide(i) / 2.0).collect();
    let note = format!("The column `radius` is half of `{}`.", field.name);
    *field = scalar_field("radius", halves.into());
    Some(note)
}

/// A scalar column as a field.
pub(crate) fn scalar_field(name: impl Into<String>, values: Values) -> Field {
    Field {
        name: name.into(),
        association: Association::Nodes,
        source: FieldSource::Scalar(values),
        unit: None,
    }
}
