//! Defines fields that may be chosen.

use crate::data::dataset::Field;
use crate::scene::Values;

/// A field that a data set could show if none is named.
#[derive(Debug, Clone, PartialEq)]
pub struct FieldChoice {
    /// The name by which [`Dataset::scalar`](crate::io::Dataset::scalar) finds the field.
    pub name: String,
    /// The least and the greatest value of each component; empty if they are not known without work.
    pub ranges: Vec<[f64; 2]>,
    /// The rank among the candidates: a lower one is more likely meant.
    pub rank: u8,
}

impl FieldChoice {
    /// Describes the choice of `field`.
    ///
    /// - `name`: the name that selects the field.
    /// - `rank`: lower for a field that is more likely meant.
    pub(in crate::sample) fn of(name: String, field: &Field, rank: u8) -> Self {
        let ranges = field.arrays().iter().filter_map(Values::finite_range);
        Self {
            name,
            ranges: ranges.collect(),
            rank,
        }
    }
}

/// Returns true if a field describes the grid or numbers its parts, and is not worth showing.
pub(crate) fn describes_the_grid(name: &str) -> bool {
    let lower = name.to_ascii_lowercase();
    let is_number = matches!(lower.as_str(), "id" | "ids" | "index" | "indices")
        || ["Id", "Ids", "_id", "_ids"]
            .iter()
            .any(|end| name.ends_with(end));
    lower == "iblank" || lower.starts_with("vtkghost") || is_number
}
