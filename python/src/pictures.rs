//! Reads, writes and compares pictures.

use std::path::PathBuf;

use ewa_splat::image::{ColumnImage, DARK_GREY, Image};
use ewa_splat::io;
use ewa_splat::scene::ScaleName;
use numpy::{
    IntoPyArray, PyArray3, PyArrayMethods, PyReadonlyArray2, PyReadonlyArray3,
    PyUntypedArrayMethods,
};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyBytes;

use crate::errors::exception;
use crate::task::detached;

/// Converts an array of four float32 a pixel to a picture.
fn image(pixels: &PyReadonlyArray3<'_, f32>) -> PyResult<Image> {
    let [height, width, 4] = *pixels.shape() else {
        let text = format!(
            "image: expected (height, width, 4), found {:?}",
            pixels.shape()
        );
        return Err(PyValueError::new_err(text));
    };
    let (pixels, _) = pixels.as_slice()?.as_chunks::<4>();
    Ok(Image {
        width,
        height,
        pixels: pixels.to_vec(),
    })
}

/// Writes a picture in the format of the path's extension. Without a path, it returns the bytes of
/// a PNG. Formats for display get a dark grey background, unless `transparent`.
#[pyfunction]
#[pyo3(signature = (pixels, path, transparent))]
pub(crate) fn write_image<'py>(
    py: Python<'py>,
    pixels: PyReadonlyArray3<'py, f32>,
    path: Option<PathBuf>,
    transparent: bool,
) -> PyResult<Option<Bound<'py, PyBytes>>> {
    let image = image(&pixels)?;
    let is_png = path.as_ref().is_none_or(|path| {
        let ending = path.extension();
        ending.is_some_and(|ending| ending.eq_ignore_ascii_case("png"))
    });
    let bytes = detached(py, || {
        let image = match is_png && !transparent {
            true => image.over(DARK_GREY),
            false => image,
        };
        match &path {
            Some(path) => io::write_image(path, &image).map(|()| None),
            None => io::png_bytes("picture".as_ref(), &image).map(Some),
        }
    });
    let bytes = bytes.map_err(|error| exception(&error))?;
    Ok(bytes.map(|bytes| PyBytes::new(py, &bytes)))
}

/// Reads a picture from a file.
#[pyfunction]
pub(crate) fn read_image(py: Python<'_>, path: PathBuf) -> PyResult<Bound<'_, PyArray3<f32>>> {
    let image = detached(py, || io::read_image(&path));
    let image = image.map_err(|error| exception(&error))?;
    let pixels = image.pixels.into_flattened().into_pyarray(py);
    pixels.reshape([image.height, image.width, 4])
}

/// Writes a column density in the format of the path's extension.
#[pyfunction]
pub(crate) fn write_column(
    py: Python<'_>,
    values: PyReadonlyArray2<'_, f32>,
    pixel_area: Option<f64>,
    path: PathBuf,
) -> PyResult<()> {
    let column = column(&values, pixel_area)?;
    let written = detached(py, || io::write_column(&path, &column));
    written.map_err(|error| exception(&error))
}

/// Converts an array to a column density.
fn column(values: &PyReadonlyArray2<'_, f32>, pixel_area: Option<f64>) -> PyResult<ColumnImage> {
    Ok(ColumnImage {
        width: values.shape()[1],
        height: values.shape()[0],
        values: values.as_slice()?.to_vec(),
        pixel_area,
    })
}

/// Returns the scale of a name.
fn scale_of(text: Option<String>) -> PyResult<Option<ScaleName>> {
    let Some(text) = text else { return Ok(None) };
    let names = [ScaleName::Linear, ScaleName::Log, ScaleName::Symlog];
    let known = names.into_iter().find(|name| name.name() == text);
    let unknown = || {
        let text = format!("scale: expected linear, log or symlog, found {text}");
        PyValueError::new_err(text)
    };
    known.map(Some).ok_or_else(unknown)
}

/// Returns the colours of a column density, linear and premultiplied.
///
/// - `map`, `range`, `scale`: the colour map's name, the range of the values, and "linear", "log" or "symlog", each if asked
///   for.
#[pyfunction]
#[pyo3(signature = (values, map, range, scale))]
pub(crate) fn column_colours<'py>(
    py: Python<'py>,
    values: PyReadonlyArray2<'py, f32>,
    map: Option<String>,
    range: Option<[f32; 2]>,
    scale: Option<String>,
) -> PyResult<Bound<'py, PyArray3<f32>>> {
    let (column, scale) = (column(&values, None)?, scale_of(scale)?);
    let picture = detached(py, || {
        let colours = io::column_colours(&column, map.as_deref(), range, scale)?;
        Ok(match colours {
            Some(colours) => io::column_picture(&column, &colours),
            None => Image::new(column.width, column.height),
        })
    });
    let picture = picture.map_err(|error: ewa_splat::Error| exception(&error))?;
    let [width, height] = [picture.width, picture.height];
    let pixels = picture.pixels.into_flattened().into_pyarray(py);
    pixels.reshape([height, width, 4])
}

/// Returns the colour map, the scale, and the values at the ends of the colours of a column density; no ends if there is
/// nothing to show.
///
/// - `map`, `scale`: as for [`column_colours`].
#[pyfunction]
#[pyo3(signature = (values, map, scale))]
pub(crate) fn column_look(
    py: Python<'_>,
    values: PyReadonlyArray2<'_, f32>,
    map: Option<String>,
    scale: Option<String>,
) -> PyResult<(String, &'static str, Option<[f64; 2]>)> {
    let (column, scale) = (column(&values, None)?, scale_of(scale)?);
    let (name, own_map) = io::column_look(&column, scale);
    let map = map.unwrap_or_else(|| own_map.into());
    let colours = detached(py, || io::column_colours(&column, Some(&map), None, scale));
    let colours = colours.map_err(|error| exception(&error))?;
    let ends = colours.map(|colours| {
        let scale = colours.value_scale();
        colours.range().map(|end| scale.value(end))
    });
    Ok((map, name.name(), ends))
}

/// Returns the differences of two pictures, as JSON.
#[pyfunction]
pub(crate) fn compare(
    py: Python<'_>,
    first: PyReadonlyArray3<'_, f32>,
    second: PyReadonlyArray3<'_, f32>,
) -> PyResult<String> {
    let (first, second) = (image(&first)?, image(&second)?);
    let errors = detached(py, || ewa_splat::measure::compare(&first, &second));
    let errors = errors.map_err(|error| exception(&error))?;
    Ok(serde_json::json!(errors).to_string())
}
