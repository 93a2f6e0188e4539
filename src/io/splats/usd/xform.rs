//! Computes the transform of a prim from its `xformOp` attributes.

use glam::{DAffine3, DMat3, DQuat, DVec3};

use super::stage::Prim;

const RESET: &str = "!resetXformStack!";
const INVERT: &str = "!invert!";

/// Greatest number of a prim's operations.
const MOST: usize = 64;

/// A prim's own transform.
#[derive(Debug, PartialEq)]
pub(super) struct Local {
    /// From the prim's space to its parent's.
    pub(super) transform: DAffine3,
    /// Whether the transforms of its ancestors do not apply.
    pub(super) is_reset: bool,
    /// Whether it changes in time.
    pub(super) is_sampled: bool,
}

/// The transform from a prim's space to its parent's.
///
/// Operations of `xformOpOrder` apply from the last to the first.
///
/// # Errors
/// The name of an operation that is not known, has another number of values, cannot be inverted, or is one too many.
pub(super) fn parent_from_prim(prim: &Prim) -> Result<Local, String> {
    let mut transform = DAffine3::IDENTITY;
    let mut is_sampled = false;
    let order = prim.words("xformOpOrder").unwrap_or_default();
    if let Some(name) = order.get(MOST) {
        return Err(name.clone());
    }
    let is_reset = order.iter().any(|name| name == RESET);
    // Operations before the mark do not apply either.
    let start = order.iter().rposition(|name| name == RESET);
    for name in &order[start.map_or(0, |at| at + 1)..] {
        let (attribute, is_inverse) = match name.strip_prefix(INVERT) {
            Some(attribute) => (attribute, true),
            None => (name.as_str(), false),
        };
        // An operation without a value has no effect.
        let Some(values) = prim.numbers(attribute) else {
            continue;
        };
        is_sampled |= prim.attributes[attribute].is_sampled;
        let step = operation(attribute, values).filter(DAffine3::is_finite);
        let step = step.map(|step| if is_inverse { step.inverse() } else { step });
        let step = step.filter(DAffine3::is_finite);
        transform *= step.ok_or_else(|| name.clone())?;
    }
    Ok(Local {
        transform,
        is_reset,
        is_sampled,
    })
}

/// The transform of one operation.
fn operation(name: &str, values: &[f64]) -> Option<DAffine3> {
    let kind = name.split(':').nth(1)?;
    let vector = || <[f64; 3]>::try_from(values).ok().map(DVec3::from);
    let number = || match values {
        [number] => Some(*number),
        _ => None,
    };
    let axis = |letter: char| match letter {
        'X' => Some(DVec3::X),
        'Y' => Some(DVec3::Y),
        'Z' => Some(DVec3::Z),
        _ => None,
    };
    let only = |letters: &str| match letters.as_bytes() {
        [letter] => axis(char::from(*letter)),
        _ => None,
    };
    match kind {
        "translate" => vector().map(DAffine3::from_translation),
        "scale" => vector().map(DAffine3::from_scale),
        "orient" => {
            let [w, x, y, z] = <[f64; 4]>::try_from(values).ok()?;
            let rotation = DQuat::from_xyzw(x, y, z, w);
            // OpenUSD takes zero for no rotation.
            Some(DAffine3::from_quat(match rotation.length() > 0.0 {
                true => rotation.normalize(),
                false => DQuat::IDENTITY,
            }))
        }
        "transform" => {
            // Rows are the images of the axes and of the origin.
            let m = <[f64; 16]>::try_from(values).ok()?;
            let row = |i: usize| DVec3::new(m[4 * i], m[4 * i + 1], m[4 * i + 2]);
            let linear = DMat3::from_cols(row(0), row(1), row(2));
            Some(DAffine3::from_mat3_translation(linear, row(3)))
        }
        _ => {
            if let Some(letters) = kind.strip_prefix("translate") {
                return Some(DAffine3::from_translation(only(letters)? * number()?));
            }
            if let Some(letters) = kind.strip_prefix("scale") {
                let axis = only(letters)?;
                return Some(DAffine3::from_scale(DVec3::ONE + axis * (number()? - 1.0)));
            }
            let letters = kind.strip_prefix("rotate")?;
            let angles = if letters.len() == 1 {
                let angle = number()?;
                DVec3::splat(angle)
            } else {
                vector().filter(|_| letters.len() == 3)?
            };
            // Angles are those about x, y and z; the first letter's rotation applies first.
            let mut rotation = DMat3::IDENTITY;
            for letter in letters.chars() {
                let about = axis(letter)?;
                let angle = about.dot(angles).to_radians();
                rotation = DMat3::from_axis_angle(about, angle) * rotation;
            }
            Some(DAffine3::from_mat3(rotation))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::stage::{Attribute, Value};
    use super::*;

    fn prim(order: &[&str], values: &[(&str, &[f64])]) -> Prim {
        let mut prim = Prim::default();
        let mut keep = |name: &str, value| {
            let attribute = Attribute {
                value,
                is_sampled: false,
                colour_space: None,
            };
            prim.keep(name, attribute);
        };
        let order = order.iter().map(|name| (*name).to_owned()).collect();
        keep("xformOpOrder", Value::Words(order));
        for (name, numbers) in values {
            keep(name, Value::Numbers(numbers.to_vec()));
        }
        prim
    }

    /// Numbers of `UsdGeom.Xformable.GetLocalTransformation` (usd-core 26.11) for the point (1, 2, 3).
    #[test]
    fn operations_are_those_of_another_program() {
        const T: &str = "xformOp:translate";
        const P: &str = "xformOp:translate:pivot";
        const S: &str = "xformOp:scale";
        const ANGLES: &[f64] = &[10.0, 20.0, 30.0];
        for (order, values, expected) in CASES {
            let prim = prim(order, values);
            let local = parent_from_prim(&prim).unwrap();
            let found = local.transform.transform_point3(DVec3::new(1.0, 2.0, 3.0));
            let apart = (found - DVec3::from(*expected)).length();
            // f64 rounding of a few products, and f32 angles in the other program.
            assert!(apart < 2e-6, "{order:?}: {found}");
            assert_eq!(local.is_reset, order.contains(&RESET));
        }
        let shear = prim(&[S, T], &[(T, &[1.0]), (S, ANGLES)]);
        assert_eq!(parent_from_prim(&shear).unwrap_err(), T);
        let flat = prim(&["!invert!xformOp:scale"], &[(S, &[1.0, 0.0, 1.0])]);
        assert!(parent_from_prim(&flat).is_err());
        let unknown = prim(&["xformOp:bend"], &[("xformOp:bend", &[1.0])]);
        assert!(parent_from_prim(&unknown).is_err());
        let missing = prim(&[T, P], &[]);
        let local = parent_from_prim(&missing).unwrap();
        assert_eq!(local.transform, DAffine3::IDENTITY);
        let many = prim(&[T; MOST + 1], &[]);
        assert_eq!(parent_from_prim(&many).unwrap_err(), T);
    }

    type Case = (
        &'static [&'static str],
        &'static [(&'static str, &'static [f64])],
        [f64; 3],
    );
    const CASES: &[Case] = &[
        (
            &["xformOp:translate", "xformOp:rotateXYZ", "xformOp:scale"],
            &[
                ("xformOp:translate", &[1.0, 2.0, 3.0]),
                ("xformOp:rotateXYZ", &[10.0, 20.0, 30.0]),
                ("xformOp:scale", &[2.0, 3.0, 4.0]),
            ],
            [4.524045376, 8.451417071, 14.400014121],
        ),
        (
            &["xformOp:rotateZYX"],
            &[("xformOp:rotateZYX", &[10.0, 20.0, 30.0])],
            [0.900165491, 1.700656298, 3.208967162],
        ),
        (
            &["xformOp:rotateYXZ"],
            &[("xformOp:rotateYXZ", &[10.0, 20.0, 30.0])],
            [0.932652606, 2.316104402, 2.786722002],
        ),
        (
            &["xformOp:rotateXZY"],
            &[("xformOp:rotateXZY", &[10.0, 20.0, 30.0])],
            [1.262399585, 1.754585864, 3.054140752],
        ),
        (
            &["xformOp:rotateY", "xformOp:translate"],
            &[
                ("xformOp:rotateY", &[40.0]),
                ("xformOp:translate", &[1.0, 0.0, 0.0]),
            ],
            [3.460451715, 2.0, 1.01255811],
        ),
        (
            &[
                "xformOp:translate:pivot",
                "xformOp:rotateX",
                "!invert!xformOp:translate:pivot",
            ],
            &[
                ("xformOp:translate:pivot", &[1.0, 2.0, 3.5]),
                ("xformOp:rotateX", &[90.0]),
            ],
            [1.0, 2.5, 3.5],
        ),
        (
            &["!invert!xformOp:scale"],
            &[("xformOp:scale", &[2.0, 4.0, 8.0])],
            [0.5, 0.5, 0.375],
        ),
        (
            &["xformOp:orient"],
            &[("xformOp:orient", &[0.5, 0.5, -0.5, 0.5])],
            [-2.0, -3.0, 1.0],
        ),
        (
            &["xformOp:transform"],
            &[(
                "xformOp:transform",
                &[
                    1.0, 2.0, 3.0, 0.0, 0.0, 1.0, 4.0, 0.0, 5.0, 6.0, 1.0, 0.0, 7.0, 8.0, 9.0, 1.0,
                ],
            )],
            [23.0, 30.0, 23.0],
        ),
        (
            &["xformOp:translateY", "xformOp:scaleZ"],
            &[("xformOp:translateY", &[5.0]), ("xformOp:scaleZ", &[2.0])],
            [1.0, 7.0, 6.0],
        ),
        (
            &["xformOp:translate", "!resetXformStack!", "xformOp:scale"],
            &[
                ("xformOp:translate", &[5.0, 5.0, 5.0]),
                ("xformOp:scale", &[2.0, 3.0, 4.0]),
            ],
            [2.0, 6.0, 12.0],
        ),
    ];
}
