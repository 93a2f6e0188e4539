//! Parses units of fields: stated in files, or in brackets after names.

/// Greatest length of a unit in characters: longer texts are descriptions.
const MOST: usize = 24;

/// Texts that files have for fields without a unit.
const NONE: [&str; 7] = [
    "dimensionless",
    "unitless",
    "none",
    "unknown",
    "n/a",
    "-",
    "1",
];

/// A unit for a legend: `None` if it is empty, states that there is none, or does not look like a unit.
pub(crate) fn cleaned(text: &str) -> Option<String> {
    let text = text.trim();
    let inner = text.strip_prefix('[').and_then(|t| t.strip_suffix(']'));
    let text = inner.unwrap_or(text).trim();
    let is_none = text.is_empty() || NONE.iter().any(|n| text.eq_ignore_ascii_case(n));
    let is_odd = |c: char| c.is_control() || matches!(c, '[' | ']');
    let is_unit = !is_none && text.chars().count() <= MOST && !text.contains(is_odd);
    is_unit.then(|| text.to_owned())
}

/// The name and the unit of `Temp [K]`; `None` if there is no such unit, as in `v[0]`.
pub(crate) fn divided(name: &str) -> Option<(&str, &str)> {
    let (bare, rest) = name.trim_end().rsplit_once('[')?;
    let unit = rest.strip_suffix(']')?.trim();
    let is_index = unit.bytes().all(|b| b.is_ascii_digit());
    let bare = bare.trim_end();
    let is_unit = !bare.is_empty() && !is_index && cleaned(unit).is_some();
    is_unit.then_some((bare, unit))
}

/// Returns the title of a field: its name, with its unit in brackets if the unit is known and not already in
/// the name.
///
/// ```
/// use ewa_splat::legend::title_of;
///
/// assert_eq!(title_of("pressure", Some("Pa")), "pressure [Pa]");
/// assert_eq!(title_of("Temp [K]", Some("K")), "Temp [K]");
/// assert_eq!(title_of("rho", None), "rho");
/// ```
#[cfg(any(feature = "legend", feature = "prepared"))]
#[cfg_attr(
    not(feature = "legend"),
    allow(unreachable_pub, reason = "legends re-export it")
)]
pub fn title_of(field: &str, unit: Option<&str>) -> String {
    match unit {
        Some(unit) if divided(field).is_none() => format!("{field} [{unit}]"),
        _ => field.to_owned(),
    }
}

/// Returns the name of a field without the unit behind it.
///
/// ```
/// assert_eq!(ewa_splat::legend::name_without_unit("Temp [K]"), "Temp");
/// ```
#[cfg(feature = "legend")]
pub fn name_without_unit(field: &str) -> &str {
    divided(field).map_or(field, |(bare, _)| bare)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn units_are_short_and_clean() {
        for (text, unit) in [
            (" g/cm^3 ", Some("g/cm^3")),
            ("[Msun]", Some("Msun")),
            ("[ - ]", None),
            ("Dimensionless", None),
            ("", None),
            ("K\u{7}", None),
            ("a [b] c", None),
            ("a unit of twenty-five chars", None),
            ("10^10 Msun / h", Some("10^10 Msun / h")),
        ] {
            assert_eq!(cleaned(text).as_deref(), unit, "{text}");
        }
    }

    #[test]
    fn units_stand_in_brackets_behind_names() {
        for (name, expected) in [
            ("Temp [K]", Some(("Temp", "K"))),
            ("rho[g/cm^3] ", Some(("rho", "g/cm^3"))),
            ("v[0]", None),
            ("x [-]", None),
            ("[K]", None),
            ("Temp", None),
            ("a]b[", None),
            ("a [b] c", None),
        ] {
            assert_eq!(divided(name), expected, "{name}");
        }
    }
}
