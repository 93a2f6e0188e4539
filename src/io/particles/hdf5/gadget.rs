//! Reads snapshots of Gadget, and of the codes that share its format: Gizmo, Arepo, SWIFT.
//!
//! | quantity | place |
//! |---|---|
//! | gas | group `PartType0`; dark matter `PartType1`, ...: [`ParticleType`] |
//! | positions | `Coordinates`, (N, 3) |
//! | masses | `Masses`; without it `Header`'s attribute `MassTable`, one per type |
//! | densities | `Density`, in SWIFT `Densities` |
//! | lengths | `SmoothingLength`, in SWIFT `SmoothingLengths` |
//!
//! Gadget's `SmoothingLength` is the radius at which the kernel ends. SWIFT's is two standard deviations of the kernel,
//! for every kernel (Dehnen & Aly 2012). The radius at which a cubic spline ends is 1.825742 of SWIFT's lengths.

use hdf5_reader::group::Group;

use super::super::table;
use super::super::types::choose;
use super::file::SnapshotFile;
use super::gas;
use crate::data::dataset::{Dataset, FieldSource};
use crate::data::particle_type::{ParticleCount, ParticleType};
use crate::data::smoothing::{LengthMeaning, Smoothing, SphKernel};
use crate::error::Result;
use crate::io::vtk::xml::clip;
use crate::math::narrowed;
use crate::scene::Values;

/// Names of the groups, and the types in them. SWIFT stores neutrinos in the last group.
pub(in crate::io) const TYPES: [(&str, &[ParticleType]); 7] = [
    ("PartType0", &[ParticleType::Gas]),
    ("PartType1", &[ParticleType::DarkMatter]),
    ("PartType2", &[ParticleType::Disk]),
    (
        "PartType3",
        &[ParticleType::Bulge, ParticleType::Dust, ParticleType::Sinks],
    ),
    ("PartType4", &[ParticleType::Stars]),
    (
        "PartType5",
        &[ParticleType::BlackHoles, ParticleType::Boundary],
    ),
    ("PartType6", &[]),
];

/// Name of the field with SWIFT's lengths, converted to standard deviations.
const SIGMA: &str = "sigma";

/// Note on the meaning of lengths; the next one explains sizes without lengths.
pub(in crate::io) const LENGTH_NOTE: &str = "Smoothing lengths are taken as the radius at which a cubic spline ends, as \
                                             Gadget defines them.";
pub(in crate::io) const NO_LENGTH_NOTE: &str =
    "No smoothing lengths: sizes come from mass over density, or from the distances.";

/// Returns the edges of the box from the header: one for a cube, none if absent.
pub(super) fn box_size(file: &SnapshotFile<'_>) -> Result<Vec<f64>> {
    let header = file.group("Header")?;
    let size = header.and_then(|header| file.attribute(&header, "BoxSize"));
    Ok(size.unwrap_or_default())
}

/// Returns the particle types that a file has groups for, with the index of each.
pub(super) fn present(file: &SnapshotFile<'_>) -> Result<Vec<(usize, Group, ParticleCount)>> {
    let mut present = Vec::new();
    for (kind, (name, types)) in TYPES.iter().enumerate() {
        if let Some(group) = file.group(name)?
            && file.has(&group, "Coordinates")?
        {
            let count = ParticleCount {
                name: (*name).to_owned(),
                types: types.to_vec(),
                count: file.row_count(&group, "Coordinates")?,
                is_read: false,
            };
            present.push((kind, group, count));
        }
    }
    Ok(present)
}

/// Notes that a file is one of several whose names are not known.
pub(super) fn note_other_files(file: &SnapshotFile<'_>) -> Result<()> {
    let header = file.group("Header")?;
    let files = header.and_then(|header| file.attribute(&header, "NumFilesPerSnapshot"));
    if let Some(files) = files.and_then(|n| n.first().copied()).filter(|n| *n > 1.0) {
        file.note(format!(
            "The snapshot consists of {files} files; only this one is read."
        ));
    }
    Ok(())
}

/// Returns the index of the first type in a snapshot of several files. Each file's header states the totals.
pub(super) fn first_of_all(file: &SnapshotFile<'_>) -> Result<Option<usize>> {
    let Some(header) = file.group("Header")? else {
        return Ok(None);
    };
    let totals = ["NumPart_Total", "NumPart_Total_HighWord"];
    let totals = totals
        .into_iter()
        .filter_map(|name| file.attribute(&header, name));
    let found = totals.filter_map(|total| total.iter().position(|n| *n > 0.0));
    Ok(found.min())
}

/// Reads the particles of the wanted type; if it is `None`, of the first type with particles. Returns `None` if the
/// file has no groups of particles.
pub(super) fn read(
    file: &SnapshotFile<'_>,
    wanted: Option<ParticleType>,
) -> Result<Option<Dataset>> {
    let (mut present, mut counts) = (Vec::new(), Vec::new());
    for (kind, group, count) in self::present(file)? {
        present.push((kind, group));
        counts.push(count);
    }
    if present.is_empty() {
        return Ok(None);
    }
    let numbers: Vec<usize> = present.iter().map(|(kind, _)| *kind).collect();
    let (at, note) = choose(file.path, &mut counts, &numbers, wanted)?;
    note.into_iter().for_each(|note| file.note(note));
    let (kind, group) = &present[at];
    let kind = *kind;

    let positions = file.positions(group, "Coordinates")?;
    let count = positions.len();
    let mut fields = file.fields(group, count, &["Coordinates"])?;
    let find = |names: &[&str]| {
        let found = fields.iter().find(|f| names.contains(&f.name.as_str()));
        found.map(|f| f.name.clone())
    };
    let density = find(&["Density", "Densities"]);
    let gadget_length = find(&["SmoothingLength"]);
    let swift_length = find(&["SmoothingLengths"]);
    let mut mass = find(&["Masses", "Mass"]);

    let header = file.group("Header")?;
    let attribute = |name: &str| file.attribute(header.as_ref()?, name);
    let table_mass = attribute("MassTable").and_then(|masses| masses.get(kind).copied());
    if mass.is_none()
        && let Some(of_type) = table_mass.filter(|m| *m > 0.0)
    {
        let masses = Values::F32(vec![narrowed(of_type); count]);
        fields.push(table::scalar_field("Masses", masses));
        file.note("All masses are that of the header's MassTable.");
        mass = Some("Masses".to_owned());
    }

    let first = |name: &str| attribute(name).and_then(|v| v.first().copied());
    let units = file.group("Units")?;
    let swift_unit = || file.attribute(units.as_ref()?, "Unit length in cgs (U_L)");
    let unit = first("UnitLength_in_cm").or_else(|| swift_unit()?.first().copied());
    if let Some(unit) = unit {
        file.note(format!("The unit of length is {unit:e} cm."));
    }

    let (length, meaning, kernel) = if let Some(length) = swift_length {
        let kernel = swift_kernel(file)?;
        let lengths = fields.iter().find(|f| f.name == length);
        let lengths = lengths.and_then(|f| match &f.source {
            FieldSource::Scalar(values) => Some(values),
            _ => None,
        });
        let sigmas = lengths.map(|l| (0..l.len()).map(|i| 0.5 * l.get(i)).collect());
        if let Some(sigmas) = sigmas {
            fields.push(table::scalar_field(SIGMA, Values::F32(sigmas)));
        }
        file.note(
            "SWIFT's smoothing lengths are two standard deviations of its kernel; the field \
             `sigma` is half of them.",
        );
        (Some(SIGMA.to_owned()), LengthMeaning::Sigma, kernel)
    } else {
        file.note(match gadget_length {
            Some(_) => LENGTH_NOTE,
            None => NO_LENGTH_NOTE,
        });
        (
            gadget_length,
            LengthMeaning::Support,
            SphKernel::CubicSpline,
        )
    };

    let gas = gas::state(file, group, &fields)?;
    let mut dataset = table::dataset(file.path, "Gadget snapshot", positions, fields)?;
    dataset.gas = gas;
    dataset.smoothing = Some(Smoothing {
        length,
        meaning,
        kernel,
        mass,
        density,
    });
    dataset.particle_types = counts;
    dataset.notes = file.notes.take();
    Ok(Some(dataset))
}

/// Returns the kernel that SWIFT's attribute `HydroScheme/Kernel function` names.
fn swift_kernel(file: &SnapshotFile<'_>) -> Result<SphKernel> {
    let scheme = file.group("HydroScheme")?;
    let name = scheme
        .and_then(|group| group.attribute("Kernel function").ok())
        .and_then(|attribute| attribute.read_string().ok())
        .unwrap_or_default();
    let kernels = [
        ("cubic", SphKernel::CubicSpline),
        ("quartic", SphKernel::QuarticSpline),
        ("quintic", SphKernel::QuinticSpline),
        ("wendland c2", SphKernel::WendlandC2),
        ("wendland c4", SphKernel::WendlandC4),
        ("wendland c6", SphKernel::WendlandC6),
    ];
    let lower = name.to_ascii_lowercase().replace('-', " ");
    let known = kernels.iter().find(|(words, _)| lower.contains(words));
    if known.is_none() {
        file.note(format!(
            "The kernel is not known (`{}`): taken as a cubic spline.",
            clip(&name)
        ));
    }
    Ok(known.map_or(SphKernel::CubicSpline, |(_, kernel)| *kernel))
}
