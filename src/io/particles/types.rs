//! Chooses one of a snapshot's types of particles.

use std::path::Path;

use super::table::list;
use crate::data::particle_type::{ParticleCount, ParticleType};
use crate::error::{Error, Parameter, Result};

/// Returns an error: the file has no particles of a type. It lists the types in the file.
pub(super) fn absent(path: &Path, wanted: ParticleType, present: &[ParticleCount]) -> Error {
    let present = present.iter().filter(|p| p.count > 0);
    let names: Vec<String> = present.map(ParticleCount::to_string).collect();
    Error::format(
        path,
        Parameter::ParticleType,
        format!("one of {}", list(names.iter().map(String::as_str))),
        format!("`{wanted}`, of which there are none"),
        "name one of these",
    )
}

/// Chooses the type to read and marks it. Returns its position in `counts`, and a note of the other types if `wanted`
/// is `None`.
///
/// - `counts`: the types, at least one.
/// - `numbers`: index of each type.
///
/// # Errors
/// There are no particles of the wanted type.
pub(super) fn choose(
    path: &Path,
    counts: &mut [ParticleCount],
    numbers: &[usize],
    wanted: Option<ParticleType>,
) -> Result<(usize, Option<String>)> {
    let number = |i: usize| u32::try_from(numbers[i]).ok();
    let found = match wanted {
        // An empty group counts only if every group is empty.
        None => Some(counts.iter().position(|c| c.count > 0).unwrap_or(0)),
        Some(wanted) => {
            let is = |i: &usize| counts[*i].count > 0 && counts[*i].is(number(*i), wanted);
            (0..counts.len()).find(is)
        }
    };
    let Some(at) = found else {
        let wanted = wanted.unwrap_or(ParticleType::Gas);
        return Err(absent(path, wanted, counts));
    };
    counts[at].is_read = true;
    let others = counts.iter().filter(|c| !c.is_read && c.count > 0);
    let others: Vec<&str> = others.map(|c| c.name.as_str()).collect();
    let note = (wanted.is_none() && !others.is_empty()).then(|| {
        let (name, others) = (&counts[at].name, others.join(", "));
        format!("Only {name} is shown; {others} left out.")
    });
    Ok((at, note))
}
