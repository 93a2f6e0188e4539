//! Transforms the columns of particles that contain lengths and shapes.

use glam::{DMat3, DQuat, DVec3};

use crate::data::association::Association;
use crate::data::dataset::{Dataset, Field, FieldSource};
use crate::data::shape_columns::{LENGTHS, SCALES, VARIANCE};
use crate::error::{Error, Result};
use crate::math::{factor_of_variance, lower_matrix, narrowed, scales_and_rotation, symmetric};
use crate::scene::Values;

/// Names of the rotation: the last four of [`SCALES`].
const ROTATION: [&str; 4] = {
    let [_, _, _, w, x, y, z] = SCALES;
    [w, x, y, z]
};

/// Returns true if a rotation maps coordinate axes to coordinate axes.
pub(super) fn is_of_axes(rotation: DMat3) -> bool {
    let is_whole = |x: f64| (x - x.round()).abs() <= 0.0;
    rotation.to_cols_array().into_iter().all(is_whole)
}

/// Multiplies columns with a dimension of length, and rotates shapes.
///
/// - `sizes`: factors of lengths along x, y and z.
/// - `rotation`: a rotation matrix.
///
/// # Errors
/// There are lengths, and the sizes differ.
pub(super) fn place(dataset: &mut Dataset, sizes: DVec3, rotation: DMat3) -> Result<()> {
    let of_smoothing = dataset.smoothing.as_ref().map(|s| s.length.clone());
    let lengths: Vec<String> = match &of_smoothing {
        // If the format defines the length, the names of table columns have no meaning here.
        Some(length) => length.iter().cloned().collect(),
        None => LENGTHS.map(str::to_owned).into(),
    };
    let volume = match even(sizes) {
        Some(size) => size.powi(3),
        None => sizes.element_product(),
    };
    let size = match even(sizes) {
        Some(size) => size,
        None => {
            let length = lengths
                .iter()
                .find(|name| index_of(dataset, name).is_some());
            if let Some(length) = length {
                return Err(Error::format(
                    &dataset.path,
                    "placement",
                    "one factor for particles with lengths, whose kernels stay round",
                    format!("three that differ, and lengths `{length}`"),
                    "give one factor, or write variances (vxx, vxy, vxz, vyy, vyz, vzz) in their place",
                ));
            }
            volume.cbrt()
        }
    };
    dataset.volume_scale *= volume;
    for name in &lengths {
        multiply(dataset, name, size);
    }
    if of_smoothing.is_some() {
        return Ok(());
    }
    multiply(dataset, "volume", volume);
    multiply(dataset, "extinction", 1.0 / size);
    // This `mass` is extinction times volume.
    multiply(dataset, "mass", size * size);
    turn_scales(dataset, sizes, rotation);
    turn_variances(dataset, sizes, rotation);
    Ok(())
}

/// Returns the common value of three sizes; `None` if they differ.
pub(super) fn even(DVec3 { x, y, z }: DVec3) -> Option<f64> {
    ((x - y).abs() <= 0.0 && (y - z).abs() <= 0.0).then_some(x)
}

/// Returns the index of a column among the fields, if it exists.
fn index_of(dataset: &Dataset, name: &str) -> Option<usize> {
    let is_column = |f: &Field| {
        f.association == Association::Nodes
            && f.name.eq_ignore_ascii_case(name)
            && matches!(f.source, FieldSource::Scalar(_))
    };
    dataset.fields.iter().position(is_column)
}

/// Returns the indices of all columns of a set and their length, if they all exist and have the same length.
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

/// Multiplies a column by a factor.
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

/// Replaces V by M V Mᵀ; M is the rotation times the sizes. At an angle to the axes, thin kernels would lose their
/// thickness in single precision. There the columns become standard deviations and a rotation, which keep it.
fn turn_variances(dataset: &mut Dataset, sizes: DVec3, rotation: DMat3) {
    let by = rotation * DMat3::from_diagonal(sizes);
    if is_of_axes(rotation) {
        map_rows(dataset, VARIANCE, |[xx, xy, xz, yy, yz, zz]| {
            let v = DMat3::from_cols_array(&[xx, xy, xz, xy, yy, yz, xz, yz, zz]);
            symmetric(by * v * by.transpose())
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
                let ([x, y, z], q) = scales_and_rotation(by * lower_matrix(factor));
                [x, y, z, q.w, q.x, q.y, q.z]
            }
            // The sampler leaves out and counts such a kernel, as it would have without this step.
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

/// Transforms standard deviations and their rotations. If the sizes differ, both change.
fn turn_scales(dataset: &mut Dataset, sizes: DVec3, rotation: DMat3) {
    if columns(dataset, SCALES).is_none() {
        return;
    }
    if let Some(size) = even(sizes) {
        for name in &SCALES[..3] {
            multiply(dataset, name, size);
        }
        if rotation != DMat3::IDENTITY {
            let by = DQuat::from_mat3(&rotation);
            map_rows(dataset, ROTATION, |[w, x, y, z]| {
                let q = by * DQuat::from_xyzw(x, y, z, w);
                [q.w, q.x, q.y, q.z]
            });
        }
        return;
    }
    let by = rotation * DMat3::from_diagonal(sizes);
    map_rows(dataset, SCALES, |[sx, sy, sz, w, x, y, z]| {
        let own = DMat3::from_quat(DQuat::from_xyzw(x, y, z, w).normalize());
        let factor = by * own * DMat3::from_diagonal(DVec3::new(sx, sy, sz));
        // The sampler leaves out and counts such a kernel.
        if !factor.is_finite() {
            return [f64::NAN; 7];
        }
        let ([sx, sy, sz], q) = scales_and_rotation(factor);
        [sx, sy, sz, q.w, q.x, q.y, q.z]
    });
}
