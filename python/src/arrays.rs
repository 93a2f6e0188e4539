//! Converts contiguous arrays to the library's vectors.
//!
//! Each array is copied once, and the scene keeps the copy. The copy is made while the interpreter
//! is held, so that no other Python code changes the array meanwhile.

use ewa_splat::scene::Values;
use ewa_splat::session::with_workers;
use ewa_splat::{DepthImage, Image};
use glam::{DVec2, DVec3};
use numpy::{
    Element, PyArrayDescrMethods, PyReadonlyArray1, PyReadonlyArray2, PyReadonlyArray3,
    PyUntypedArray, PyUntypedArrayMethods,
};
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use rayon::prelude::*;

/// Rows of three numbers, float32 or float64.
pub(crate) struct Points(pub(crate) Vec<DVec3>);

/// Numbers in a type that the library stores: uint8, int16, uint16 or float32.
pub(crate) struct Numbers(pub(crate) Values);

/// One-dimensional float32 array.
pub(crate) struct Floats(pub(crate) Vec<f32>);

/// Depths of pixels: float32 of shape (height, width).
pub(crate) struct Plane(pub(crate) DepthImage);

/// Pixels: float32 of shape (height, width, 4).
pub(crate) struct Pixels(pub(crate) Image);

fn no_layout(what: &str) -> PyErr {
    PyTypeError::new_err(format!("expected a contiguous array of {what}"))
}

/// Converts the rows of a two-dimensional array.
fn rows<const N: usize, T: Element + Copy + Sync, U: Send>(
    array: &PyReadonlyArray2<'_, T>,
    of: impl Fn([T; N]) -> U + Sync + Send,
) -> PyResult<Vec<U>> {
    let what = || no_layout(&format!("rows of {N} numbers"));
    if array.shape()[1] != N {
        return Err(what());
    }
    let (rows, _) = array.as_slice().map_err(|_| what())?.as_chunks::<N>();
    Ok(with_workers(|| {
        rows.par_iter().map(|row| of(*row)).collect()
    }))
}

impl<'a, 'py> FromPyObject<'a, 'py> for Points {
    type Error = PyErr;

    fn extract(object: Borrowed<'a, 'py, PyAny>) -> PyResult<Self> {
        if let Ok(single) = object.extract::<PyReadonlyArray2<'py, f32>>() {
            return rows(&single, |row| DVec3::from(row.map(f64::from))).map(Self);
        }
        let double = object.extract::<PyReadonlyArray2<'py, f64>>()?;
        rows(&double, |row: [f64; 3]| DVec3::from(row)).map(Self)
    }
}

impl<'a, 'py> FromPyObject<'a, 'py> for Numbers {
    type Error = PyErr;

    fn extract(object: Borrowed<'a, 'py, PyAny>) -> PyResult<Self> {
        fn of<'py, T: Element + Copy>(object: Borrowed<'_, 'py, PyAny>) -> PyResult<Vec<T>> {
            let array = object.extract::<PyReadonlyArray1<'py, T>>()?;
            let slice = array.as_slice();
            Ok(slice.map_err(|_| no_layout("one dimension"))?.to_vec())
        }
        let array = object.cast::<PyUntypedArray>()?;
        let kind = array.dtype();
        Ok(Self(match (kind.kind(), kind.itemsize()) {
            (b'u', 1) => Values::U8(of(object)?),
            (b'i', 2) => Values::I16(of(object)?),
            (b'u', 2) => Values::U16(of(object)?),
            (b'f', 8) => of::<f64>(object)?.into(),
            _ => Values::F32(of(object)?),
        }))
    }
}

impl<'a, 'py> FromPyObject<'a, 'py> for Floats {
    type Error = PyErr;

    fn extract(object: Borrowed<'a, 'py, PyAny>) -> PyResult<Self> {
        let array = object.extract::<PyReadonlyArray1<'py, f32>>()?;
        let slice = array.as_slice();
        Ok(Self(
            slice.map_err(|_| no_layout("one dimension"))?.to_vec(),
        ))
    }
}

impl<'a, 'py> FromPyObject<'a, 'py> for Plane {
    type Error = PyErr;

    fn extract(object: Borrowed<'a, 'py, PyAny>) -> PyResult<Self> {
        let array = object.extract::<PyReadonlyArray2<'py, f32>>()?;
        let slice = array.as_slice().map_err(|_| no_layout("pixels"))?;
        Ok(Self(DepthImage {
            width: array.shape()[1],
            height: array.shape()[0],
            depths: slice.to_vec(),
        }))
    }
}

impl<'a, 'py> FromPyObject<'a, 'py> for Pixels {
    type Error = PyErr;

    fn extract(object: Borrowed<'a, 'py, PyAny>) -> PyResult<Self> {
        let array = object.extract::<PyReadonlyArray3<'py, f32>>()?;
        let slice = array.as_slice().map_err(|_| no_layout("pixels"))?;
        let (pixels, rest) = slice.as_chunks::<4>();
        if array.shape()[2] != 4 || !rest.is_empty() {
            return Err(no_layout("pixels of four numbers"));
        }
        Ok(Self(Image {
            width: array.shape()[1],
            height: array.shape()[0],
            pixels: pixels.to_vec(),
        }))
    }
}

/// Returns rows of three float32.
pub(crate) fn triples(array: &PyReadonlyArray2<'_, f32>) -> PyResult<Vec<[f32; 3]>> {
    rows(array, |row: [f32; 3]| row)
}

/// Returns rows of four float32.
pub(crate) fn quadruples(array: &PyReadonlyArray2<'_, f32>) -> PyResult<Vec<[f32; 4]>> {
    rows(array, |row: [f32; 4]| row)
}

/// Returns rows of three indices.
pub(crate) fn indices(array: &PyReadonlyArray2<'_, u32>) -> PyResult<Vec<[u32; 3]>> {
    rows(array, |row: [u32; 3]| row)
}

/// Returns rows of two numbers, for texture coordinates.
pub(crate) fn pairs(array: &PyReadonlyArray2<'_, f64>) -> PyResult<Vec<glam::Vec2>> {
    rows(array, |row: [f64; 2]| DVec2::from(row).as_vec2())
}
