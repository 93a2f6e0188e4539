//! Particle tables: what CSV, NPY and PLY files share.
//!
//! A table has named columns. `x`, `y` and `z` (in either case) are needed and become the
//! positions, in double precision; every other numeric column becomes a field. What the
//! columns mean (`h`, `sigma`, `mass`, ...) is decided when the table is sampled: of lengths, `sigma`
//! and `radius` are one standard deviation, `h` is the smoothing length of the cubic spline, which
//! ends at 2 h ([`crate::irregular`]).

use std::path::Path;

use glam::DVec3;

use super::dataset::{Association, Dataset, Field, FieldSource, Geometry};
use crate::error::{Advice, Error, Result};
use crate::scene::Values;

/// What ParaView calls the position columns of the tables that it writes.
pub(crate) const PARAVIEW: [&str; 3] = ["Points:0", "Points:1", "Points:2"];

/// Which columns are x, y and z.
///
/// # Errors
/// One is missing or stands there twice.
pub(crate) fn position_columns<'a>(
    path: &Path,
    names: impl Iterator<Item = &'a str> + Clone,
) -> Result<[usize; 3]> {
    let mut columns = [0; 3];
    let is_there = |wanted: &str| names.clone().any(|name| name.eq_ignore_ascii_case(wanted));
    let wanted = match PARAVIEW.iter().all(|name| is_there(name)) && !is_there("x") {
        true => PARAVIEW,
        false => ["x", "y", "z"],
    };
    for (column, wanted) in columns.iter_mut().zip(wanted) {
        let mut matching = names
            .clone()
            .enumerate()
            .filter(|(_, name)| name.eq_ignore_ascii_case(wanted));
        let found = match (matching.next(), matching.next()) {
            (Some((index, _)), None) => {
                *column = index;
                continue;
            }
            (Some(_), Some(_)) => format!("more than one column `{wanted}`"),
            (None, _) => format!("no column `{wanted}` among {}", list(names)),
        };
        return Err(Error::format(
            path,
            "column names",
            "one column each for x, y and z",
            found,
            "name the position columns x, y and z",
        ));
    }
    Ok(columns)
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
/// There is not a single particle.
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

/// A scalar column as a field.
pub(crate) fn scalar_field(name: impl Into<String>, values: Values) -> Field {
    Field {
        name: name.into(),
        association: Association::Nodes,
        source: FieldSource::Scalar(values),
        unit: None,
    }
}
