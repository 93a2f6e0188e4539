//! Phantom's dumps.
//!
//! | what | where |
//! |---|---|
//! | positions | `particles/xyz`, (N, 3) |
//! | smoothing lengths h; 0 or less for dead and accreted particles | `particles/h` |
//! | types, from 1 | `particles/itype` |
//! | mass of a particle of each type | `header/massoftype` |
//! | hfact | `header/hfact` |
//!
//! Phantom stores no densities: rho = m (hfact / h)³ (Price et al. 2018, eq. 6).

use hdf5_reader::group::Group;

use super::super::dataset::Dataset;
use super::super::scalars::narrow;
use super::super::smoothing::{LengthMeaning, Smoothing, SphKernel};
use super::super::table;
use super::SnapshotFile;
use crate::error::{Error, Result};
use crate::scene::Values;

pub(super) fn read(file: &SnapshotFile<'_>, particles: &Group) -> Result<Dataset> {
    let positions = file.positions(particles, "xyz")?;
    let count = positions.len();
    let header = file.group("header")?;
    let header_numbers = |name: &str| -> Result<Option<Vec<f64>>> {
        let Some(header) = &header else {
            return Ok(None);
        };
        Ok(file.array(header, name)?.and_then(|array| array.doubles(0)))
    };
    let column = |name: &str| -> Result<Option<Vec<f64>>> {
        let array = file.array(particles, name)?;
        Ok(array
            .filter(|a| a.count == count && a.components == 1)
            .and_then(|a| a.doubles(0)))
    };

    let missing = |what: &str| {
        Error::format(
            file.path,
            "Phantom dump",
            what,
            "none, or not one per particle",
            "check that the dump was written completely",
        )
    };
    let lengths = column("h")?.ok_or_else(|| missing("smoothing lengths `particles/h`"))?;
    let masses_of_types = header_numbers("massoftype")?
        .filter(|masses| !masses.is_empty())
        .ok_or_else(|| missing("masses `header/massoftype`"))?;
    let types = column("itype")?.unwrap_or_else(|| vec![1.0; count]);
    // A type without a mass gives NaN, which the sampler counts.
    let masses: Vec<f64> = types
        .iter()
        .map(|t| {
            #[allow(
                clippy::cast_possible_truncation,
                clippy::cast_sign_loss,
                reason = "types are 1 to 56; anything else finds no mass"
            )]
            let index = t.abs() as usize;
            let mass = index.checked_sub(1).and_then(|i| masses_of_types.get(i));
            mass.copied().unwrap_or(f64::NAN)
        })
        .collect();

    let scalar = |name: &str, numbers: &mut dyn Iterator<Item = f64>| {
        table::scalar_field(name, Values::F32(numbers.map(narrow).collect()))
    };
    let mut fields = vec![
        scalar("h", &mut lengths.iter().copied()),
        scalar("m", &mut masses.iter().copied()),
    ];
    let hfact = header_numbers("hfact")?.and_then(|h| h.first().copied());
    if let Some(hfact) = hfact {
        let mut rho = masses
            .iter()
            .zip(&lengths)
            .map(|(m, h)| m * (hfact / h.abs()).powi(3));
        fields.push(scalar("rho", &mut rho));
        file.note("Densities are m (hfact / h)³; the dump stores none.");
    }
    // `m` and `rho` would be there twice if a dump had them.
    fields.extend(file.fields(particles, count, &["xyz", "h", "m", "rho"])?);

    let dead = lengths.iter().filter(|h| !(**h > 0.0)).count();
    if dead > 0 {
        file.note(format!(
            "{dead} particles are dead or accreted (h is not positive)."
        ));
    }
    let mut kinds: Vec<f64> = types.iter().map(|t| t.abs()).collect();
    kinds.sort_by(f64::total_cmp);
    kinds.dedup();
    if kinds.len() > 1 {
        file.note(format!(
            "Particles of {} types are taken together; the field `itype` tells them apart.",
            kinds.len()
        ));
    }
    if let Some(sinks) = file.group("sinks")?
        && file.has(&sinks, "xyz")?
    {
        file.note("Sink particles are left out.");
    }
    if let Some(unit) = header_numbers("udist")?.and_then(|u| u.first().copied()) {
        file.note(format!("The unit of length is {unit:e} cm."));
    }

    let mut dataset = table::dataset(file.path, "Phantom dump", positions, fields)?;
    dataset.smoothing = Some(Smoothing {
        length: Some("h".to_owned()),
        meaning: LengthMeaning::SmoothingLength,
        kernel: SphKernel::CubicSpline,
        mass: Some("m".to_owned()),
        density: hfact.map(|_| "rho".to_owned()),
    });
    dataset.notes = file.notes.take();
    Ok(dataset)
}
