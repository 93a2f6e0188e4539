//! The columns of particles that hold lengths and shapes.

use glam::{DMat3, DQuat};

use crate::io::{Association, Dataset, Field, FieldSource, LENGTHS, SCALES, VARIANCE};
use crate::math::{factor_of_variance, lower_matrix, scales_and_rotation, symmetric};
use crate::scene::Values;

/// The last four of [`SCALES`].
const ROTATION: [&str; 4] = {
    let [_, _, _, w, x, y, z] = SCALES;
    [w, x, y, z]
};

/// Whether a rotation of a placement takes axes to axes.
pub(super) fn is_of_axes(rotation: DMat3) -> bool {
    let is_whole = |x: f64| (x - x.round()).abs() <= 0.0;
    rotation.to_cols_array().into_iter().all(is_whole)
}

/// Multiplies what has a length in it, and turns shapes.
///
/// - `size`: what lengths are multiplied by.
/// - `rotation`: a rotation matrix.
pub(super) fn place(dataset: &mut Dataset, size: f64, rotation: DMat3) {
    dataset.volume_scale *= size.powi(3);
    if let Some(smoothing) = &dataset.smoothing {
        // Names that mean something in tables say nothing here.
        if let Some(length) = smoothing.length.clone() {
            multiply(dataset, &length, size);
        }
        return;
    }
    for name in LENGTHS {
        multiply(dataset, name, size);
    }
    multiply(dataset, "volume", size.powi(3));
    multiply(dataset, "extinction", 1.0 / size);
    // Extinction times volume.
    multiply(dataset, "mass", size * size);
    if columns(dataset, SCALES).is_some() {
        for name in &SCALES[..3] {
            multiply(dataset, name, size);
        }
        turn_quaternions(dataset, rotation);
    }
    turn_variances(dataset, size, rotation);
}

#[expect(clippy::cast_possible_truncation, reason = "rounding to f32 is meant")]
pub(super) fn narrowed(x: f64) -> f32 {
    x as f32
}

/// The place of a column among the fields, if it is there.
fn index_of(dataset: &Dataset, name: &str) -> Option<usize> {
    let is_column = |f: &Field| {
        f.association == Association::Nodes
            && f.name.eq_ignore_ascii_case(name)
            && matches!(f.source, FieldSource::Scalar(_))
    };
    dataset.fields.iter().position(is_column)
}

/// All columns of a set, if they are there and of one length.
fn columns<const N: usize>(dataset: &Dataset, names: [&str; N]) -> Option<([usize; N], usize)> {
    let mut places = [0; N];
    let mut count = None;
    for (place, name) in places.iter_mut().zip(names) {
        *place = index_of(dataset, name)?;
        let len = values(dataset, *place).len();
        if *count.get_or_insert(len) != len {
            return None;
        }
    }
    count.map(|count| (places, count))
}

fn values(dataset: &Dataset, place: usize) -> &Values {
    match &dataset.fields[place].source {
        FieldSource::Scalar(values) => values,
        _ => unreachable!("a column was looked for"),
    }
}

/// A column times a factor.
fn multiply(dataset: &mut Dataset, name: &str, factor: f64) {
    let is_one = (factor - 1.0).abs() <= 0.0;
    let Some(place) = index_of(dataset, name).filter(|_| !is_one) else {
        return;
    };
    let column = values(dataset, place);
    let product = (0..column.len()).map(|i| column.wide(i) * factor);
    let product = product.collect::<Vec<f64>>().into();
    dataset.fields[place].source = FieldSource::Scalar(product);
}

/// Applies `each` to the rows of a set of columns.
fn map_rows<const N: usize>(
    dataset: &mut Dataset,
    names: [&str; N],
    each: impl Fn([f64; N]) -> [f64; N],
) {
    let Some((places, count)) = columns(dataset, names) else {
        return;
    };
    let mut moved = [(); N].map(|()| Vec::with_capacity(count));
    for i in 0..count {
        let row = places.map(|place| f64::from(values(dataset, place).get(i)));
        for (column, x) in moved.iter_mut().zip(each(row)) {
            column.push(narrowed(x));
        }
    }
    for (place, column) in places.into_iter().zip(moved) {
        dataset.fields[place].source = FieldSource::Scalar(Values::F32(column));
    }
}

/// V becomes size² R V Rᵀ. At an angle to the axes thin kernels would lose their thickness in single precision: there
/// the columns become those of standard deviations and a rotation, which keep it.
fn turn_variances(dataset: &mut Dataset, size: f64, rotation: DMat3) {
    if is_of_axes(rotation) {
        map_rows(dataset, VARIANCE, |[xx, xy, xz, yy, yz, zz]| {
            let v = DMat3::from_cols_array(&[xx, xy, xz, xy, yy, yz, xz, yz, zz]);
            symmetric(rotation * v * rotation.transpose()).map(|v| v * size * size)
        });
        return;
    }
    let Some((places, count)) = columns(dataset, VARIANCE) else {
        return;
    };
    let mut moved = [(); 7].map(|()| Vec::with_capacity(count));
    for i in 0..count {
        let variance = places.map(|place| f64::from(values(dataset, place).get(i)));
        let row = match factor_of_variance(variance) {
            Some(factor) => {
                let ([x, y, z], q) = scales_and_rotation(rotation * lower_matrix(factor));
                [size * x, size * y, size * z, q.w, q.x, q.y, q.z]
            }
            // Left out and counted where it is sampled, as it would have been.
            None => [f64::NAN; 7],
        };
        for (column, x) in moved.iter_mut().zip(row) {
            column.push(narrowed(x));
        }
    }
    let mut places = places.into_iter();
    for (name, column) in SCALES.into_iter().zip(moved) {
        let field = Field {
            name: name.into(),
            association: Association::Nodes,
            unit: None,
            source: FieldSource::Scalar(Values::F32(column)),
        };
        match places.next() {
            Some(place) => dataset.fields[place] = field,
            None => dataset.fields.push(field),
        }
    }
}

fn turn_quaternions(dataset: &mut Dataset, rotation: DMat3) {
    if rotation == DMat3::IDENTITY {
        return;
    }
    let by = DQuat::from_mat3(&rotation);
    map_rows(dataset, ROTATION, |[w, x, y, z]| {
        let q = by * DQuat::from_xyzw(x, y, z, w);
        [q.w, q.x, q.y, q.z]
    });
}
