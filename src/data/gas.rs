//! States what temperatures of gas follow from.

/// Name of the derived field.
pub(crate) const TEMPERATURE: &str = "temperature";

/// Share of hydrogen in the mass of primordial gas, as simulations have it.
pub(crate) const PRIMORDIAL_HYDROGEN: f64 = 0.76;

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
    pub(super) fn missing(&self) -> Option<&'static str> {
        match (&self.erg_per_gram, &self.weight) {
            (None, _) => Some("the unit of internal energies or velocities"),
            (_, None) => Some("an electron abundance"),
            _ => None,
        }
    }

    /// Returns the reason why a field that is asked for is not derived, if it is the temperature.
    pub(crate) fn not_derived(&self, selector: &str) -> Option<String> {
        let is_meant = selector.eq_ignore_ascii_case(TEMPERATURE);
        let missing = self.missing().filter(|_| is_meant)?;
        Some(format!(
            "no field of that name; it is not derived from `{}`, because the file does not state {missing}",
            self.energy
        ))
    }

    /// States how temperatures follow, for people.
    pub(super) fn note(&self) -> String {
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

pub(super) fn neutral(hydrogen: f64) -> f64 {
    4.0 / (1.0 + 3.0 * hydrogen)
}

pub(super) fn ionised(hydrogen: f64) -> f64 {
    4.0 / (3.0 + 5.0 * hydrogen)
}
