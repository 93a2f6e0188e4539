//! Derives temperatures of gas from internal energies.

use crate::data::association::Association;
use crate::data::dataset::{Dataset, Field, FieldSource};
use crate::error::{Error, Result};
use crate::math::narrowed;
use crate::scene::Values;

/// Name of the derived field.
pub(crate) const TEMPERATURE: &str = "temperature";

/// Ratio of specific heats of a monatomic gas.
pub(crate) const MONATOMIC: f64 = 5.0 / 3.0;

/// Share of hydrogen in the mass of primordial gas, as simulations have it.
pub(crate) const PRIMORDIAL_HYDROGEN: f64 = 0.76;

/// Mass of the proton \[g\] over Boltzmann's constant \[erg/K\] (CODATA 2018).
const PROTON_MASS_OVER_BOLTZMANN: f64 = 1.672_621_923_69e-24 / 1.380_649e-16;

/// Half of the interval of temperatures \[K\] in which SWIFT takes the transition temperature itself.
const SWIFT_TRANSITION: f64 = 1.0;

/// Facts of a snapshot from which the temperature of its gas follows: T = (gamma - 1) u mu m_p / k_B.
#[derive(Debug, Clone, PartialEq)]
pub struct GasState {
    /// Name of the field of the internal energy per mass, u.
    pub energy: String,
    /// Factor from that field to erg/g; `None` if the file does not state it.
    pub erg_per_gram: Option<f64>,
    /// Ratio of specific heats; `None` if the file does not state it. It is then 5/3.
    pub gamma: Option<f64>,
    /// Source of the mean molecular weight mu; `None` if the file has none.
    pub weight: Option<MeanWeight>,
}

/// Source of the mean molecular weight of gas.
#[derive(Debug, Clone, PartialEq)]
pub enum MeanWeight {
    /// mu = 4 / (1 + 3 X + 4 X e), where X is the share of hydrogen in the mass.
    Electrons {
        /// Name of the field of e, the number of electrons for each hydrogen nucleus.
        electrons: String,
        /// Source of X.
        hydrogen: HydrogenShare,
    },
    /// mu = 4 / (1 + 3 X) of neutral gas, or 4 / (3 + 5 X) of ionised gas above a temperature.
    Transition {
        /// X.
        hydrogen: f64,
        /// Temperature \[K\] at which the gas is ionised.
        temperature: f64,
    },
}

/// Source of the share of hydrogen in the mass of gas.
#[derive(Debug, Clone, PartialEq)]
pub enum HydrogenShare {
    /// The same for all particles.
    Constant(f64),
    /// The first component of a field.
    Field(String),
}

impl GasState {
    /// Names what the file lacks for temperatures; `None` if it has everything.
    fn missing(&self) -> Option<&'static str> {
        match (&self.erg_per_gram, &self.weight) {
            (None, _) => Some("the unit of internal energies or velocities"),
            (_, None) => Some("an electron abundance"),
            _ => None,
        }
    }

    /// States how temperatures follow, for people.
    fn note(&self) -> String {
        let gamma = match self.gamma {
            Some(gamma) => format!("gamma {gamma:.4}"),
            None => "gamma 5/3 (not stated)".to_owned(),
        };
        let weight = match &self.weight {
            Some(MeanWeight::Electrons {
                electrons,
                hydrogen,
            }) => {
                let hydrogen = match hydrogen {
                    HydrogenShare::Constant(share) => share.to_string(),
                    HydrogenShare::Field(name) => format!("the first component of `{name}`"),
                };
                format!("mu = 4 / (1 + 3 X + 4 X e), e of `{electrons}`, X = {hydrogen}")
            }
            Some(MeanWeight::Transition {
                hydrogen,
                temperature,
            }) => format!(
                "mu = {:.3}, above {temperature} K {:.3} (X = {hydrogen:.3})",
                neutral(*hydrogen),
                ionised(*hydrogen)
            ),
            None => "no mu".to_owned(),
        };
        format!(
            "`{TEMPERATURE}` [K] is derived from `{}` if it is asked for: {gamma}, {weight}.",
            self.energy
        )
    }
}

fn neutral(hydrogen: f64) -> f64 {
    4.0 / (1.0 + 3.0 * hydrogen)
}

fn ionised(hydrogen: f64) -> f64 {
    4.0 / (3.0 + 5.0 * hydrogen)
}

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

    /// Returns the reason why a field that is asked for is not derived, if it is the temperature of gas.
    pub(crate) fn not_derived(&self, selector: &str) -> Option<String> {
        let gas = self.gas.as_ref()?;
        let is_meant = selector.eq_ignore_ascii_case(TEMPERATURE);
        let missing = gas.missing().filter(|_| is_meant)?;
        Some(format!(
            "no field of that name; it is not derived from `{}`, because the file does not state {missing}",
            gas.energy
        ))
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
