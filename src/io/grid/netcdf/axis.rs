//! Interprets coordinate variables: longitudes, latitudes, lengths, depths, pressures.
//!
//! By CF, units take precedence, then `standard_name`, then `axis`; names are used for files that have none of
//! these.

use netcdf_reader::NcVariable;

use super::text;

/// Metres per degree of latitude, on a sphere of the earth's mean radius, 6371.0088 km.
pub(super) const METRES_PER_DEGREE: f64 = 6_371_008.8 * std::f64::consts::PI / 180.0;

/// Height in metres over which pressure falls to 1/e, as usual for log-pressure heights.
const SCALE_HEIGHT: f64 = 7000.0;

/// Pressure in pascals at height 0.
const SURFACE_PRESSURE: f64 = 100_000.0;

/// Quantity of a horizontal coordinate.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Horizontal {
    Longitude,
    Latitude,
    /// A distance eastwards or to the right, and the metres of its unit; `None` if it has no unit.
    X(Option<f64>),
    /// A distance northwards or upwards.
    Y(Option<f64>),
}

/// Quantity of a vertical coordinate.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Vertical {
    /// Upwards, in units of this many metres; negative for depths.
    Metres(f64),
    /// Pressure, in units of this many pascals.
    Pressure(f64),
    /// Upwards, or downwards, by a quantity that is no length.
    Level { is_down: bool },
}

/// Whether a variable contains times.
pub(super) fn is_time(variable: &NcVariable) -> bool {
    let is = |name: &str, value: &str| {
        text(variable.attributes(), name).is_some_and(|t| t.eq_ignore_ascii_case(value))
    };
    let units = text(variable.attributes(), "units").unwrap_or_default();
    units.contains(" since ") || is("standard_name", "time") || is("axis", "T")
}

/// Quantity of a horizontal coordinate; `None` for other variables.
pub(super) fn horizontal(variable: &NcVariable) -> Option<Horizontal> {
    let attribute = |name: &str| text(variable.attributes(), name).unwrap_or_default();
    let units = attribute("units").to_ascii_lowercase();
    let standard = attribute("standard_name").to_ascii_lowercase();
    let name = variable.name().to_ascii_lowercase();
    let begins = |starts: &[&str]| starts.iter().any(|start| name.starts_with(start));
    let is_degrees = |of: &str| {
        let unit = units
            .strip_prefix("degree")
            .map(|u| u.strip_prefix('s').unwrap_or(u));
        unit == Some(of) || unit == Some(&of[..2])
    };
    let has_no_other_unit = units.is_empty() || units.starts_with("degree");
    if is_degrees("_east") || standard == "longitude" {
        return Some(Horizontal::Longitude);
    }
    if is_degrees("_north") || standard == "latitude" {
        return Some(Horizontal::Latitude);
    }
    if has_no_other_unit && begins(&["lon", "nav_lon", "glam", "xlong"]) {
        return Some(Horizontal::Longitude);
    }
    if has_no_other_unit && begins(&["lat", "nav_lat", "gphi", "xlat"]) {
        return Some(Horizontal::Latitude);
    }
    let metres = metres(&units);
    let is_length = metres.is_some() || units.is_empty() || units == "1";
    let is_x = standard == "projection_x_coordinate"
        || attribute("axis").eq_ignore_ascii_case("x")
        || name == "x"
        || begins(&["x_", "xc", "xt"]);
    let is_y = standard == "projection_y_coordinate"
        || attribute("axis").eq_ignore_ascii_case("y")
        || name == "y"
        || begins(&["y_", "yc", "yt"]);
    match (is_length, is_x, is_y) {
        (true, true, false) => Some(Horizontal::X(metres)),
        (true, false, true) => Some(Horizontal::Y(metres)),
        _ => None,
    }
}

/// Quantity of a vertical coordinate.
pub(super) fn vertical(variable: &NcVariable) -> Vertical {
    let attribute = |name: &str| {
        text(variable.attributes(), name)
            .unwrap_or_default()
            .to_ascii_lowercase()
    };
    let (units, standard) = (attribute("units"), attribute("standard_name"));
    let name = variable.name().to_ascii_lowercase();
    let positive = attribute("positive");
    let sounds_down = ["dep", "gdep", "sigma", "hybrid"]
        .iter()
        .any(|start| name.starts_with(start) || standard.contains(start));
    let is_down = positive == "down" || positive != "up" && sounds_down;
    let sign = if is_down { -1.0 } else { 1.0 };
    let pascals = match units.as_str() {
        "pa" | "pascal" | "pascals" => Some(1.0),
        "hpa" | "mb" | "mbar" | "millibar" | "millibars" | "hectopascal" | "hectopascals" => {
            Some(100.0)
        }
        "kpa" => Some(1000.0),
        _ => None,
    };
    if let Some(pascals) = pascals {
        return Vertical::Pressure(pascals);
    }
    // In the sea, pressure grows by a decibar each metre.
    if matches!(units.as_str(), "dbar" | "decibar" | "decibars") {
        return Vertical::Metres(-1.0);
    }
    match metres(&units) {
        Some(metres) => Vertical::Metres(sign * metres),
        None => Vertical::Level { is_down },
    }
}

/// Length in metres of a unit.
pub(super) fn metres(units: &str) -> Option<f64> {
    match units {
        "m" | "meter" | "meters" | "metre" | "metres" => Some(1.0),
        "km" | "kilometer" | "kilometers" | "kilometre" | "kilometres" => Some(1000.0),
        "cm" | "centimeter" | "centimeters" | "centimetre" | "centimetres" => Some(0.01),
        "ft" | "foot" | "feet" => Some(0.3048),
        _ => None,
    }
}

/// The log-pressure height in metres: the height in an isothermal atmosphere.
pub(super) fn pressure_height(pascals: f64) -> f64 {
    SCALE_HEIGHT * (SURFACE_PRESSURE / pascals).ln()
}
