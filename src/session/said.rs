//! Takes settings from JSON text: an object whose names are the command line's, without the leading dashes.

use std::fmt;
use std::path::PathBuf;

use serde::de::{Deserialize, Deserializer, MapAccess, Visitor};
use serde_json::Value;

use super::arguments::Arguments;
use crate::sample::TransferChoice;

/// Distance of two names, in letters, up to which one may be a slip of the other.
const NEAR: usize = 3;

/// Text of the error for settings that cannot be used: `NAME: expected A, found B`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Refused(pub String);

impl fmt::Display for Refused {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

impl std::error::Error for Refused {}

/// Result with the error of settings.
type Result<T, E = Refused> = std::result::Result<T, E>;

/// Settings in JSON, taken one by one.
#[derive(Debug)]
pub struct Said {
    /// Names, with `_` for `-`, and values of the settings that were not taken yet.
    left: Vec<(String, Value)>,
    /// Names that were asked for.
    asked: Vec<&'static str>,
}

/// Entries of an object in their order, with repeated names.
struct Entries(Vec<(String, Value)>);

impl<'de> Deserialize<'de> for Entries {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> std::result::Result<Self, D::Error> {
        struct OfObject;
        impl<'de> Visitor<'de> for OfObject {
            type Value = Entries;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("an object of settings")
            }

            fn visit_map<A: MapAccess<'de>>(
                self,
                mut map: A,
            ) -> std::result::Result<Entries, A::Error> {
                let mut all = Vec::new();
                while let Some(entry) = map.next_entry()? {
                    all.push(entry);
                }
                Ok(Entries(all))
            }
        }
        deserializer.deserialize_map(OfObject)
    }
}

impl Said {
    /// Parses settings; no text, or an empty one, is none.
    ///
    /// # Errors
    /// Text that is no object in JSON; a name that occurs twice.
    pub fn parse(text: Option<&str>) -> Result<Self> {
        let text = text.map(str::trim).filter(|text| !text.is_empty());
        let Entries(entries) = match text {
            None => Entries(Vec::new()),
            Some(text) => serde_json::from_str(text).map_err(|error| {
                Refused(format!(
                    "settings: expected an object in JSON, found {error}"
                ))
            })?,
        };
        let mut left: Vec<(String, Value)> = Vec::new();
        for (name, value) in entries {
            let name = name.replace('-', "_");
            if left.iter().any(|(own, _)| *own == name) {
                return Err(Refused(format!("{name}: expected it once, found it twice")));
            }
            left.push((name, value));
        }
        Ok(Self {
            left,
            asked: Vec::new(),
        })
    }

    /// Returns what `of` takes of settings, which must be all.
    ///
    /// # Errors
    /// The errors of `of` and of [`parse`](Self::parse); settings that were not taken.
    pub fn all<T>(text: Option<&str>, of: impl FnOnce(&mut Self) -> Result<T>) -> Result<T> {
        let mut said = Self::parse(text)?;
        let taken = of(&mut said)?;
        match said.left.first() {
            None => Ok(taken),
            Some((name, _)) => Err(unknown(name, &said.asked)),
        }
    }

    /// Refuses settings of other names.
    pub fn only(&self, names: &[&'static str]) -> Result<()> {
        let other = self
            .left
            .iter()
            .find(|(own, _)| !names.contains(&own.as_str()));
        other.map_or(Ok(()), |(name, _)| Err(unknown(name, names)))
    }

    fn take<T>(
        &mut self,
        name: &'static str,
        expected: &str,
        of: impl FnOnce(&Value) -> Option<T>,
    ) -> Result<Option<T>> {
        self.asked.push(name);
        let Some(at) = self.left.iter().position(|(own, _)| own == name) else {
            return Ok(None);
        };
        let (_, value) = self.left.remove(at);
        if value.is_null() {
            return Ok(None);
        }
        match of(&value) {
            Some(taken) => Ok(Some(taken)),
            None => Err(Refused(format!(
                "{name}: expected {expected}, found {value}"
            ))),
        }
    }
}

/// Returns the failure for a name that none of the known ones is.
fn unknown(name: &str, known: &[&'static str]) -> Refused {
    let near = known.iter().map(|own| (distance(name, own), *own));
    let near = near.filter(|(distance, own)| *distance <= NEAR.min(own.len() / 2));
    Refused(match near.min() {
        Some((_, near)) => format!("{name}: no such setting here; did you mean {near}?"),
        None => {
            let known = known.join(", ");
            format!("{name}: no such setting here; known are {known}")
        }
    })
}

/// Returns the numbers of an array.
fn numbers<const N: usize, T>(value: &Value, of: impl Fn(&Value) -> Option<T>) -> Option<[T; N]> {
    let all: Option<Vec<T>> = value.as_array()?.iter().map(of).collect();
    all?.try_into().ok()
}

fn count(value: &Value) -> Option<usize> {
    value.as_u64().and_then(|n| usize::try_from(n).ok())
}

impl Arguments for Said {
    type Error = Refused;

    fn flag(&mut self, name: &'static str) -> Result<Option<bool>> {
        self.take(name, "true or false", Value::as_bool)
    }

    fn float(&mut self, name: &'static str) -> Result<Option<f64>> {
        self.take(name, "a number", Value::as_f64)
    }

    fn whole(&mut self, name: &'static str) -> Result<Option<i64>> {
        self.take(name, "a whole number", Value::as_i64)
    }

    fn count(&mut self, name: &'static str) -> Result<Option<usize>> {
        self.take(name, "a whole number from 0 up", count)
    }

    fn text(&mut self, name: &'static str) -> Result<Option<String>> {
        self.take(name, "a text", |value| value.as_str().map(String::from))
    }

    fn texts(&mut self, name: &'static str) -> Result<Option<Vec<String>>> {
        self.take(name, "an array of texts", |value| {
            let texts = value.as_array()?.iter();
            texts.map(|text| text.as_str().map(String::from)).collect()
        })
    }

    fn pairs(&mut self, name: &'static str) -> Result<Option<Vec<(String, String)>>> {
        self.take(name, "an object of texts", |value| {
            let pairs = value.as_object()?.iter();
            let pair =
                |(name, text): (&String, &Value)| Some((name.clone(), text.as_str()?.into()));
            pairs.map(pair).collect()
        })
    }

    fn path(&mut self, name: &'static str) -> Result<Option<PathBuf>> {
        self.take(name, "a path", |value| value.as_str().map(PathBuf::from))
    }

    fn floats<const N: usize>(&mut self, name: &'static str) -> Result<Option<[f64; N]>> {
        self.take(name, &format!("an array of {N} numbers"), |value| {
            numbers(value, Value::as_f64)
        })
    }

    fn counts<const N: usize>(&mut self, name: &'static str) -> Result<Option<[usize; N]>> {
        self.take(name, &format!("an array of {N} whole numbers"), |value| {
            numbers(value, count)
        })
    }

    fn rows<const N: usize>(&mut self, name: &'static str) -> Result<Option<Vec<[f64; N]>>> {
        self.take(name, &format!("arrays of {N} numbers"), |value| {
            let rows = value.as_array()?.iter();
            rows.map(|row| numbers(row, Value::as_f64)).collect()
        })
    }

    /// Takes a transfer function: an object in the form of its files, a colour map's name, or a path that ends in
    /// `.json` or `.xml`.
    fn transfer(&mut self, name: &'static str) -> Result<Option<TransferChoice>> {
        self.take(name, "an object, a colour map's name or a path", |value| {
            let is_file = |text: &str| text.ends_with(".json") || text.ends_with(".xml");
            match value {
                Value::String(text) if is_file(text) => Some(TransferChoice::File(text.into())),
                Value::String(text) => Some(TransferChoice::Named(text.clone())),
                Value::Object(_) => Some(TransferChoice::Text(value.to_string())),
                _ => None,
            }
        })
    }

    fn refused(text: impl Into<String>) -> Refused {
        Refused(text.into())
    }
}

/// Returns the number of letters to insert, drop or replace to turn one name into another.
fn distance(a: &str, b: &str) -> usize {
    let b: Vec<char> = b.chars().collect();
    let mut row: Vec<usize> = (0..=b.len()).collect();
    for (i, from) in a.chars().enumerate() {
        let mut corner = row[0];
        row[0] = i + 1;
        for (j, to) in b.iter().enumerate() {
            let replaced = corner + usize::from(from != *to);
            corner = row[j + 1];
            row[j + 1] = replaced.min(corner + 1).min(row[j] + 1);
        }
    }
    row[b.len()]
}
