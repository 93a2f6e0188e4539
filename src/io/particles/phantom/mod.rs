//! Makes data sets of Phantom's dumps, which are HDF5 files ([`hdf5`](super::hdf5)) or native ones ([`native`]).
//!
//! | quantity | name |
//! |---|---|
//! | smoothing lengths h; 0 or less for dead and accreted particles | `h` |
//! | types, from 1: [`ParticleType`] | `itype` |
//! | level l of refinement: the mass is divided by 2^(l - 1) | `apr_level` |
//! | mass of a particle of each type | header, `massoftype` |
//! | hfact | header, `hfact` |
//! | accretion radii of sinks | `h` |
//!
//! Phantom stores no densities. They are rho = m (hfact / h)³ (Price et al. 2018, eq. 6).

pub(in crate::io) mod native;

use std::collections::BTreeMap;
use std::path::Path;

use glam::DVec3;

use super::table;
use super::types::absent;
use crate::data::dataset::{Dataset, Field, FieldSource};
use crate::data::particle_type::{ParticleCount, ParticleType};
use crate::data::smoothing::{LengthMeaning, Smoothing, SphKernel};
use crate::error::{Error, Result};
use crate::math::narrowed;
use crate::scene::Values;

/// Name of the format.
const FORMAT: &str = "Phantom dump";

/// Opacity of a sink through its centre.
const SINK_OPACITY: f32 = 0.999;

/// First type of dust, if the header does not state it.
const IDUST: u32 = 7;

/// Radius of a sink that states none, as a fraction of the box of all particles.
const SINK_SHARE: f64 = 0.01;

/// A part of a dump.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Part {
    Particles,
    Sinks,
}

/// A dump in either format.
pub(super) trait Dump {
    fn path(&self) -> &Path;

    /// Returns numbers of the header; `None` if it has none of this name.
    ///
    /// # Errors
    /// The file is damaged.
    fn header(&self, name: &str) -> Result<Option<Vec<f64>>>;

    /// Returns the number of particles of a part.
    ///
    /// # Errors
    /// The file is damaged.
    fn count(&self, part: Part) -> Result<usize>;

    /// Returns the positions of a part.
    ///
    /// # Errors
    /// The file is damaged, or has none.
    fn positions(&self, part: Part) -> Result<Vec<DVec3>>;

    /// Returns a number for each particle of a part; `None` if there is no such column.
    ///
    /// # Errors
    /// The file is damaged.
    fn column(&self, part: Part, name: &str) -> Result<Option<Vec<f64>>>;

    /// Returns the fields of a part but those of some names.
    ///
    /// # Errors
    /// The file is damaged.
    fn fields(&self, part: Part, except: &[&str]) -> Result<Vec<Field>>;

    fn note(&self, note: String);

    /// Returns all notes, and forgets them.
    fn notes(&self) -> Vec<String>;
}

/// Returns the particles of a type, or all but the sinks.
///
/// # Errors
/// Lengths or masses do not exist, or there are no particles of the type.
pub(super) fn dataset(dump: &dyn Dump, wanted: Option<ParticleType>) -> Result<Dataset> {
    let positions = dump.positions(Part::Particles)?;
    let count = positions.len();
    let column = |name: &str| dump.column(Part::Particles, name);
    let missing = |what: &str| {
        Error::format(
            dump.path(),
            FORMAT,
            what,
            "none, or not one per particle",
            "check that the dump was written completely",
        )
    };
    let lengths = column("h")?.ok_or_else(|| missing("smoothing lengths `h`"))?;
    let masses_of_types = dump
        .header("massoftype")?
        .filter(|masses| !masses.is_empty())
        .ok_or_else(|| missing("masses `massoftype`"))?;
    let types = column("itype")?.unwrap_or_else(|| vec![1.0; count]);
    let dust = [
        dump.header("idust")?.map_or(IDUST, first_code),
        dump.header("idustbound")?.map_or(u32::MAX, first_code),
    ];
    let sink_count = dump.count(Part::Sinks)?;
    let mut counts = counted(&types, dust);
    let is_kept = |code: u32, count: &ParticleCount| wanted.is_none_or(|w| count.is(Some(code), w));
    for (code, count) in &mut counts {
        count.is_read = is_kept(*code, count);
    }
    let codes: Vec<u32> = counts
        .iter()
        .filter(|(_, c)| c.is_read)
        .map(|(code, _)| *code)
        .collect();
    let mut counts: Vec<ParticleCount> = counts.into_iter().map(|(_, count)| count).collect();
    if sink_count > 0 {
        counts.push(ParticleCount {
            name: "sinks".to_owned(),
            types: vec![ParticleType::Sinks],
            count: sink_count,
            is_read: wanted == Some(ParticleType::Sinks),
        });
    }
    if sink_count > 0 && wanted == Some(ParticleType::Sinks) {
        return sinks(dump, &positions, counts);
    }
    if let (Some(wanted), []) = (wanted, &codes[..]) {
        return Err(absent(dump.path(), wanted, &counts));
    }
    let kept = wanted.map(|_| {
        let rows = 0..u32::try_from(count).unwrap_or(u32::MAX);
        rows.filter(|&i| codes.binary_search(&code_of(types[i as usize])).is_ok())
            .collect::<Vec<u32>>()
    });
    // A type without a mass gives NaN, which the sampler counts.
    let mut masses: Vec<f64> = types
        .iter()
        .map(|t| {
            let index = code_of(*t) as usize;
            let mass = index.checked_sub(1).and_then(|i| masses_of_types.get(i));
            mass.copied().unwrap_or(f64::NAN)
        })
        .collect();
    if let Some(levels) = column("apr_level")? {
        for (mass, level) in masses.iter_mut().zip(levels) {
            *mass *= (1.0 - level).exp2();
        }
    }

    let scalar = |name: &str, numbers: &mut dyn Iterator<Item = f64>| {
        table::scalar_field(name, numbers.collect::<Vec<f64>>().into())
    };
    let mut fields = vec![
        scalar("h", &mut lengths.iter().copied()),
        scalar("m", &mut masses.iter().copied()),
    ];
    let hfact = dump.header("hfact")?.and_then(|h| h.first().copied());
    if let Some(hfact) = hfact {
        let mut rho = masses
            .iter()
            .zip(&lengths)
            .map(|(m, h)| m * (hfact / h.abs()).powi(3));
        fields.push(scalar("rho", &mut rho));
        dump.note("Densities are m (hfact / h)³; the dump stores none.".to_owned());
    }
    // Names that are set above are skipped, or `m` and `rho` could occur twice.
    fields.extend(dump.fields(Part::Particles, &["xyz", "h", "m", "rho"])?);

    let is_dead = |i: usize| lengths[i] <= 0.0 || lengths[i].is_nan();
    let dead = match &kept {
        None => (0..count).filter(|&i| is_dead(i)).count(),
        Some(kept) => kept.iter().filter(|&&i| is_dead(i as usize)).count(),
    };
    if dead > 0 {
        dump.note(format!(
            "{dead} particles are dead or accreted (h is not positive)."
        ));
    }
    let read_count = counts.iter().filter(|c| c.is_read).count();
    if read_count > 1 {
        dump.note(format!(
            "Particles of {read_count} types are taken together; the field `itype` tells them apart.",
        ));
    }
    if sink_count > 0 && wanted.is_none() {
        dump.note("Sink particles are left out.".to_owned());
    }
    if let Some(unit) = dump.header("udist")?.and_then(|u| u.first().copied()) {
        dump.note(format!("The unit of length is {unit:e} cm."));
    }

    let (positions, fields) = match &kept {
        None => (positions, fields),
        Some(kept) => rows(kept, &positions, fields),
    };
    let mut dataset = table::dataset(dump.path(), FORMAT, positions, fields)?;
    dataset.particle_types = counts;
    dataset.smoothing = Some(Smoothing {
        length: Some("h".to_owned()),
        meaning: LengthMeaning::SmoothingLength,
        kernel: SphKernel::CubicSpline,
        mass: Some("m".to_owned()),
        density: hfact.map(|_| "rho".to_owned()),
    });
    dataset.notes = dump.notes();
    Ok(dataset)
}

/// Returns the number of a type. Inactive particles store it with a negative sign.
#[allow(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "types are 1 to 56 or more with much dust; anything else finds no mass and no name"
)]
fn code_of(itype: f64) -> u32 {
    itype.abs() as u32
}

/// Returns the type that an entry of the header names.
fn first_code(numbers: Vec<f64>) -> u32 {
    numbers.first().map_or(u32::MAX, |n| code_of(*n))
}

/// Counts the particles of each type, in the order of type numbers.
///
/// - `dust`: first type of dust, and first type of dust that is a boundary.
fn counted(types: &[f64], dust: [u32; 2]) -> Vec<(u32, ParticleCount)> {
    let mut counts: BTreeMap<u32, usize> = BTreeMap::new();
    for itype in types {
        *counts.entry(code_of(*itype)).or_default() += 1;
    }
    let named = |code: u32| match code {
        1 => vec![ParticleType::Gas],
        3 => vec![ParticleType::Boundary],
        _ if code >= dust[0] && code < dust[1] => vec![ParticleType::Dust],
        4 => vec![ParticleType::Stars],
        5 => vec![ParticleType::DarkMatter],
        6 => vec![ParticleType::Bulge],
        _ if code >= dust[1] => vec![ParticleType::Boundary],
        _ => Vec::new(),
    };
    let of_code = |(code, count)| {
        let name = format!("itype {code}");
        let types = named(code);
        (
            code,
            ParticleCount {
                name,
                types,
                count,
                is_read: false,
            },
        )
    };
    counts.into_iter().map(of_code).collect()
}

/// Returns the kept rows.
fn rows(kept: &[u32], positions: &[DVec3], fields: Vec<Field>) -> (Vec<DVec3>, Vec<Field>) {
    let positions = kept.iter().map(|&i| positions[i as usize]).collect();
    let of_kept = |field: Field| Field {
        source: match field.source {
            FieldSource::Scalar(values) => FieldSource::Scalar(values.gather(kept)),
            FieldSource::Vector(components) => {
                FieldSource::Vector(components.iter().map(|c| c.gather(kept)).collect())
            }
            derived @ FieldSource::Derived(_) => derived,
        },
        ..field
    };
    (positions, fields.into_iter().map(of_kept).collect())
}

/// Reads the sinks as opaque spheres of their accretion radii: a ball of radius R has the variance R²/5 along each
/// axis.
///
/// - `others`: positions of the other particles. They set the radius of sinks that state none.
fn sinks(dump: &dyn Dump, others: &[DVec3], counts: Vec<ParticleCount>) -> Result<Dataset> {
    let positions = dump.positions(Part::Sinks)?;
    let count = positions.len();
    let radii = dump.column(Part::Sinks, "h")?;
    let radii = radii.unwrap_or_else(|| vec![0.0; count]);
    let all = || {
        others
            .iter()
            .chain(&positions)
            .copied()
            .filter(|p| p.is_finite())
    };
    let (lower, upper) = (all().reduce(DVec3::min), all().reduce(DVec3::max));
    let extent = lower
        .zip(upper)
        .map_or(0.0, |(lower, upper)| (upper - lower).max_element());
    // A single sink has no extent.
    let stand_in = if extent > 0.0 {
        SINK_SHARE * extent
    } else {
        1.0
    };
    let is_stated = |r: f64| r > 0.0 && r.is_finite();
    let without = radii.iter().filter(|r| !is_stated(**r)).count();
    if without > 0 {
        dump.note(format!(
            "{without} sinks state no accretion radius: they are drawn with a radius of {stand_in:.3e}."
        ));
    }
    let sigma = |r: &f64| narrowed(if is_stated(*r) { *r } else { stand_in } / 5.0_f64.sqrt());
    let scalar = |name: &str, numbers: Vec<f32>| table::scalar_field(name, Values::F32(numbers));
    let mut fields = vec![
        scalar(
            "accretion_radius",
            radii.iter().copied().map(narrowed).collect(),
        ),
        scalar("sigma", radii.iter().map(sigma).collect()),
        scalar("opacity", vec![SINK_OPACITY; count]),
    ];
    let own = dump.fields(Part::Sinks, &["xyz", "h", "sigma", "opacity"])?;
    fields.extend(own);
    dump.note("Sinks are drawn as opaque spheres of their accretion radii.".to_owned());
    let mut dataset = table::dataset(dump.path(), FORMAT, positions, fields)?;
    dataset.particle_types = counts;
    dataset.notes = dump.notes();
    Ok(dataset)
}
