//! Finds the facts from which temperatures of gas follow.
//!
//! | fact | place |
//! |---|---|
//! | internal energy per mass | `InternalEnergy`, in SWIFT `InternalEnergies` |
//! | its unit | attributes of that dataset: `Conversion factor to physical CGS ...` (SWIFT), `CGSConversionFactor` (Gadget-3 of EAGLE), `to_cgs` (Arepo); or else the square of `UnitVelocity_in_cm_per_s` (Gizmo: `UnitVelocity_In_CGS`) in `Header`, `Units` or `Parameters` |
//! | electrons for each hydrogen nucleus | `ElectronAbundance` |
//! | share of hydrogen in the mass | the first component of `GFM_Metals` (Arepo) or `ElementMassFractions` (SWIFT); or else `HydroScheme`'s attribute (SWIFT), or .76 |
//! | ratio of specific heats, temperature of ionisation | `HydroScheme`'s attributes (SWIFT) |

use hdf5_reader::group::Group;

use super::file::SnapshotFile;
use crate::data::dataset::Field;
use crate::data::gas::{GasState, HydrogenShare, MeanWeight, PRIMORDIAL_HYDROGEN};
use crate::error::Result;

const PHYSICAL: &str = "Conversion factor to physical CGS (including cosmological corrections)";
/// Present in files of SWIFT, whose numbers are comoving: then only [`PHYSICAL`] counts.
const COMOVING: &str = "Conversion factor to CGS (not including cosmological corrections)";

/// Returns the facts about a group's gas; `None` if it has no internal energies.
///
/// - `fields`: fields of the group.
pub(super) fn state(
    file: &SnapshotFile<'_>,
    group: &Group,
    fields: &[Field],
) -> Result<Option<GasState>> {
    let find = |names: &[&str]| {
        let mut found = fields.iter().filter(|f| names.contains(&f.name.as_str()));
        found.next().map(|f| f.name.clone())
    };
    let Some(energy) = find(&["InternalEnergy", "InternalEnergies"]) else {
        return Ok(None);
    };
    let scheme = file.group("HydroScheme")?;
    let of_scheme = |name: &str| {
        let number = file.attribute(scheme.as_ref()?, name)?.first().copied();
        number.filter(|number| number.is_finite() && *number > 0.0)
    };
    let share = of_scheme("Hydrogen mass fraction");
    let transition = of_scheme("Hydrogen ionization transition temperature");
    let weight = match (find(&["ElectronAbundance"]), share.zip(transition)) {
        (Some(electrons), _) => {
            let field = find(&["GFM_Metals", "ElementMassFractions"]);
            let constant = HydrogenShare::Constant(share.unwrap_or(PRIMORDIAL_HYDROGEN));
            Some(MeanWeight::Electrons {
                electrons,
                hydrogen: field.map_or(constant, HydrogenShare::Field),
            })
        }
        (None, Some((hydrogen, temperature))) => Some(MeanWeight::Transition {
            hydrogen,
            temperature,
        }),
        (None, None) => None,
    };
    Ok(Some(GasState {
        erg_per_gram: unit(file, group, &energy)?,
        gamma: of_scheme("Adiabatic index").filter(|gamma| *gamma > 1.0),
        energy,
        weight,
    }))
}

/// Returns the factor from stored energies to erg/g, if the file states it.
fn unit(file: &SnapshotFile<'_>, group: &Group, energy: &str) -> Result<Option<f64>> {
    let of_dataset = |name: &str| file.attribute_of(group, energy, name);
    let is_factor = |factor: &f64| factor.is_finite() && *factor > 0.0;
    if let Some(factor) = of_dataset(PHYSICAL) {
        return Ok(Some(factor).filter(is_factor));
    }
    if of_dataset(COMOVING).is_some() {
        return Ok(None);
    }
    for [factor, of_scale, of_hubble] in [
        [
            "CGSConversionFactor",
            "aexp-scale-exponent",
            "h-scale-exponent",
        ],
        ["to_cgs", "a_scaling", "h_scaling"],
    ] {
        // Arepo writes 0 where it knows no unit.
        let Some(factor) = of_dataset(factor).filter(is_factor) else {
            continue;
        };
        let mut exponents = [of_scale, of_hubble].into_iter().map(of_dataset);
        let is_physical = exponents.all(|exponent| exponent.unwrap_or(0.0) == 0.0);
        return Ok(is_physical.then_some(factor));
    }
    for name in ["Header", "Units", "Parameters"] {
        let Some(group) = file.group(name)? else {
            continue;
        };
        let mut names = ["UnitVelocity_in_cm_per_s", "UnitVelocity_In_CGS"].into_iter();
        let velocity = names.find_map(|name| file.attribute(&group, name)?.first().copied());
        if let Some(velocity) = velocity.filter(is_factor) {
            return Ok(Some(velocity * velocity).filter(is_factor));
        }
    }
    Ok(None)
}
