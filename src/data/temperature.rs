//! Derives temperatures of gas from internal energies.

use super::association::Association;
use super::dataset::{Dataset, Field, FieldSource};
use super::gas::{HydrogenShare, MeanWeight, TEMPERATURE, ionised, neutral};
use crate::error::{Error, Result};
use crate::math::narrowed;
use crate::scene::Values;

/// Ratio of specific heats of a monatomic gas.
const MONATOMIC: f64 = 5.0 / 3.0;

/// Mass of the proton \[g\] over Boltzmann's constant \[erg/K\] (CODATA 2018).
const PROTON_MASS_OVER_BOLTZMANN: f64 = 1.672_621_923_69e-24 / 1.380_649e-16;

/// Half of the interval of temperatures \[K\] in which SWIFT takes the transition temperature itself.
const SWIFT_TRANSITION: f64 = 1.0;

impl Dataset {
    /// Adds a derived field of temperatures, if the file states what they follow from and has none of its own.
    pub(crate) fn offer_temperature(&mut self) {
        let Some(gas) = &self.gas else {
            return;
        };
        let has = |name: &str| {
            self.fields
                .iter()
                .any(|f| f.name.eq_ignore_ascii_case(name))
        };
        if gas.missing().is_some() || !has(&gas.energy) || has(TEMPERATURE) || has("Temperatures") {
            return;
        }
        self.notes.push(gas.note());
        self.fields.push(Field {
            name: TEMPERATURE.to_owned(),
            association: Association::Nodes,
            source: FieldSource::Derived(temperature),
            unit: Some("K".to_owned()),
        });
    }

    /// Returns the first component of a field.
    fn first_component(&self, name: &str) -> Result<&Values> {
        let field = self.fields.iter().find(|field| field.name == name);
        let values = field.and_then(|field| field.arrays().first());
        values.ok_or_else(|| {
            let place = format!("field `{TEMPERATURE}`");
            let expected = format!("`{name}`, from which it is derived");
            Error::format(&self.path, place, expected, "none", "name another field")
        })
    }
}

/// Returns the temperatures \[K\] of the gas.
fn temperature(dataset: &Dataset) -> Result<Values> {
    let missing = |found: &str| {
        let expected = "internal energies with their unit, and a mean molecular weight";
        let place = format!("field `{TEMPERATURE}`");
        Error::format(&dataset.path, place, expected, found, "name another field")
    };
    let gas = dataset.gas.as_ref().ok_or_else(|| missing("none"))?;
    let (Some(unit), Some(weight)) = (gas.erg_per_gram, &gas.weight) else {
        return Err(missing(gas.missing().unwrap_or("none")));
    };
    let energies = dataset.first_component(&gas.energy)?;
    let count = energies.len();
    let gamma = gas.gamma.unwrap_or(MONATOMIC);
    let over_weight =
        |i: usize| (gamma - 1.0) * unit * PROTON_MASS_OVER_BOLTZMANN * energies.wide(i);
    let values: Vec<f32> = match weight {
        MeanWeight::Electrons {
            electrons,
            hydrogen,
        } => {
            let electrons = dataset.first_component(electrons)?;
            let (constant, shares) = match hydrogen {
                HydrogenShare::Constant(share) => (*share, None),
                HydrogenShare::Field(name) => (0.0, Some(dataset.first_component(name)?)),
            };
            if electrons.len() != count || shares.is_some_and(|shares| shares.len() != count) {
                return Err(missing("fields of different lengths"));
            }
            let of = |i: usize| {
                let share = shares.map_or(constant, |shares| shares.wide(i));
                let weight = 4.0 / (1.0 + 3.0 * share + 4.0 * share * electrons.wide(i));
                narrowed(over_weight(i) * weight)
            };
            (0..count).map(of).collect()
        }
        MeanWeight::Transition {
            hydrogen,
            temperature,
        } => {
            let (neutral, ionised) = (neutral(*hydrogen), ionised(*hydrogen));
            let of = |i: usize| {
                let over_weight = over_weight(i);
                narrowed(if over_weight * ionised > temperature + SWIFT_TRANSITION {
                    over_weight * ionised
                } else if over_weight * neutral < temperature - SWIFT_TRANSITION {
                    over_weight * neutral
                } else if over_weight.is_nan() {
                    f64::NAN
                } else {
                    *temperature
                })
            };
            (0..count).map(of).collect()
        }
    };
    Ok(Values::F32(values))
}
