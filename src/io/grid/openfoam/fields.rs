//! Reads the fields of a case: one file for each, in the folder of its time.

use super::text::{CaseFile, Kind, Scanner};
use crate::data::association::Association;
use crate::data::dataset::{Field, FieldSource};
use crate::error::Result;
use crate::scene::Values;

/// Names of the components of tensors.
const SYMMETRIC: [&str; 6] = ["xx", "xy", "xz", "yy", "yz", "zz"];
const FULL: [&str; 9] = ["xx", "xy", "xz", "yx", "yy", "yz", "zx", "zy", "zz"];

/// A field, joined from the pieces read so far.
#[derive(Debug)]
pub(super) struct Gathered {
    pub(super) name: String,
    pub(super) association: Association,
    unit: Option<String>,
    components: Vec<Vec<f64>>,
}

/// Content of a file in the folder of a time.
#[derive(Debug)]
pub(super) enum Found {
    Field(Gathered),
    /// Numbers of another kind, or no numbers: the class in its header.
    Other(String),
    /// A field whose values are computed when the case is run.
    Computed,
}

/// The association of a class of fields, and the number of numbers per value.
fn layout(class: &str) -> Option<(Association, usize)> {
    let class = class.strip_suffix("::Internal").unwrap_or(class);
    let (association, rank) = if let Some(rank) = class.strip_prefix("vol") {
        (Association::Cells, rank)
    } else {
        (Association::Nodes, class.strip_prefix("point")?)
    };
    let components = match rank {
        "ScalarField" | "SphericalTensorField" => 1,
        "VectorField" => 3,
        "SymmTensorField" => 6,
        "TensorField" => 9,
        _ => return None,
    };
    Some((association, components))
}

/// Reads a file in the folder of a time.
///
/// - `counts`: number of cells and of nodes.
///
/// # Errors
/// A damaged file, or a field with another number of values.
pub(super) fn read(file: &CaseFile, counts: [usize; 2]) -> Result<Found> {
    let Ok(mut scanner) = Scanner::new(file) else {
        return Ok(Found::Other("no header".to_owned()));
    };
    let class = scanner.header.class.clone();
    let Some((association, components)) = layout(&class) else {
        return Ok(Found::Other(class));
    };
    let count = match association {
        Association::Cells => counts[0],
        Association::Nodes => counts[1],
    };
    let mut unit = None;
    loop {
        match scanner.word() {
            b"" => return Err(scanner.fault("`internalField`")),
            b"dimensions" => {
                unit = read_unit(&mut scanner);
                scanner.skip_entry(b"")?;
            }
            b"internalField" | b"value" => break,
            key => scanner.skip_entry(key)?,
        }
    }
    let numbers = match scanner.word() {
        b"uniform" => {
            if matches!(scanner.peek(), Some(b'$' | b'#')) {
                return Ok(Found::Computed);
            }
            let mut value = Vec::new();
            scanner.value(components, &mut value)?;
            value.repeat(count)
        }
        b"nonuniform" => {
            // The type of the list may be missing.
            if scanner.peek().is_some_and(|b| !b.is_ascii_digit()) {
                scanner.word();
            }
            scanner.list(Kind::Scalars(components), Some(count))?
        }
        word if word.starts_with(b"$") || word.starts_with(b"#") => return Ok(Found::Computed),
        _ => return Err(scanner.fault("`uniform` or `nonuniform` before this")),
    };
    let component = |i: usize| {
        let of_component = numbers.iter().skip(i).step_by(components);
        of_component.copied().collect()
    };
    Ok(Found::Field(Gathered {
        name: file.name.rsplit('/').next().unwrap_or_default().to_owned(),
        association,
        unit,
        components: (0..components).map(component).collect(),
    }))
}

/// The unit of `[0 1 -1 0 0 0 0]`: exponents of kilogram, metre, second, kelvin, mole, ampere and candela.
/// `None` if there is none, or if it has another form.
fn read_unit(scanner: &mut Scanner<'_>) -> Option<String> {
    const NAMES: [&str; 7] = ["kg", "m", "s", "K", "mol", "A", "cd"];
    scanner.expect(b'[').ok()?;
    let mut exponents = [0.0; 7];
    for exponent in &mut exponents {
        if scanner.peek() == Some(b']') {
            break;
        }
        *exponent = scanner.number().ok()?;
    }
    if exponents == [1.0, -1.0, -2.0, 0.0, 0.0, 0.0, 0.0] {
        return Some("Pa".to_owned());
    }
    let power = |(name, &exponent): (&&str, &f64)| match exponent.abs() {
        1.0 => (*name).to_owned(),
        power => format!("{name}^{power}"),
    };
    let named = || NAMES.iter().zip(&exponents);
    let above: Vec<String> = named().filter(|(_, e)| **e > 0.0).map(power).collect();
    let below: Vec<String> = named().filter(|(_, e)| **e < 0.0).map(power).collect();
    let above_text = match above.as_slice() {
        [] => "1".to_owned(),
        some => some.join(" "),
    };
    match below.as_slice() {
        [] if above.is_empty() => None,
        [] => Some(above_text),
        [one] => Some(format!("{above_text}/{one}")),
        some => Some(format!("{above_text}/({})", some.join(" "))),
    }
}

impl Gathered {
    /// Size of its values in bytes.
    pub(super) fn size(&self) -> usize {
        self.components.iter().map(|c| 4 * c.len()).sum()
    }

    /// Appends the values of another piece of the case. Returns whether it is the same kind of field.
    pub(super) fn append(&mut self, other: Self) -> bool {
        let is_same = self.association == other.association
            && self.components.len() == other.components.len();
        if is_same {
            for (values, more) in self.components.iter_mut().zip(other.components) {
                values.extend(more);
            }
        }
        is_same
    }

    /// The field; a tensor becomes one field for each component.
    pub(super) fn fields(self) -> Vec<Field> {
        let (association, unit) = (self.association, self.unit);
        let field = |name: String, source| Field {
            name,
            association,
            source,
            unit: unit.clone(),
        };
        let mut components: Vec<Values> = self.components.into_iter().map(Values::from).collect();
        let names: &[&str] = match components.len() {
            6 => &SYMMETRIC,
            9 => &FULL,
            3 => return vec![field(self.name, FieldSource::Vector(components))],
            _ => {
                let only = components.pop().unwrap_or(Values::F32(Vec::new()));
                return vec![field(self.name, FieldSource::Scalar(only))];
            }
        };
        let named = names.iter().zip(components);
        let of_tensor = named.map(|(component, values)| {
            let name = format!("{}_{component}", self.name);
            field(name, FieldSource::Scalar(values))
        });
        of_tensor.collect()
    }
}
