//! Converts keyword arguments to the library's options. Unknown arguments are refused by name.

use std::collections::HashMap;
use std::path::PathBuf;

use ewa_splat::sample::TransferChoice;
use ewa_splat::scene::{Lighting, TransferDefaults, TransferFunction};
use ewa_splat::session::{self, Arguments, Drawing, Opening, Sampling};
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::arrays::{Pixels, Plane};
use crate::errors::exception;

/// Keyword arguments, taken one by one.
pub(crate) struct Keywords<'py>(Option<Bound<'py, PyDict>>);

impl<'py> Keywords<'py> {
    pub(crate) fn new(dict: Option<&Bound<'py, PyDict>>) -> PyResult<Self> {
        Ok(Self(dict.map(|dict| dict.copy()).transpose()?))
    }

    /// Takes an argument that is given and not None.
    fn take<T>(&self, name: &str) -> PyResult<Option<T>>
    where
        T: for<'a> FromPyObject<'a, 'py>,
    {
        let Some(dict) = &self.0 else {
            return Ok(None);
        };
        let Some(value) = dict.get_item(name)? else {
            return Ok(None);
        };
        dict.del_item(name)?;
        if value.is_none() {
            return Ok(None);
        }
        let value = value.extract::<T>().map_err(|error| {
            let error: PyErr = error.into();
            let text = format!("{name}: {}", error.value(dict.py()));
            match error.is_instance_of::<PyValueError>(dict.py()) {
                true => PyValueError::new_err(text),
                false => PyTypeError::new_err(text),
            }
        });
        value.map(Some)
    }

    /// Refuses arguments that were not taken.
    fn end(self) -> PyResult<()> {
        let Some(dict) = self.0 else {
            return Ok(());
        };
        match dict.keys().iter().next() {
            None => Ok(()),
            Some(name) => Err(PyTypeError::new_err(format!(
                "{name}: no such keyword argument here"
            ))),
        }
    }
}

impl Arguments for Keywords<'_> {
    type Error = PyErr;

    fn flag(&mut self, name: &'static str) -> PyResult<Option<bool>> {
        self.take(name)
    }

    fn float(&mut self, name: &'static str) -> PyResult<Option<f64>> {
        self.take(name)
    }

    fn whole(&mut self, name: &'static str) -> PyResult<Option<i64>> {
        self.take(name)
    }

    fn count(&mut self, name: &'static str) -> PyResult<Option<usize>> {
        self.take(name)
    }

    fn text(&mut self, name: &'static str) -> PyResult<Option<String>> {
        self.take(name)
    }

    fn texts(&mut self, name: &'static str) -> PyResult<Option<Vec<String>>> {
        self.take(name)
    }

    fn pairs(&mut self, name: &'static str) -> PyResult<Option<Vec<(String, String)>>> {
        let pairs = self.take::<HashMap<String, String>>(name)?;
        Ok(pairs.map(|pairs| pairs.into_iter().collect()))
    }

    fn path(&mut self, name: &'static str) -> PyResult<Option<PathBuf>> {
        self.take(name)
    }

    fn floats<const N: usize>(&mut self, name: &'static str) -> PyResult<Option<[f64; N]>> {
        self.take(name)
    }

    fn counts<const N: usize>(&mut self, name: &'static str) -> PyResult<Option<[usize; N]>> {
        self.take(name)
    }

    fn rows<const N: usize>(&mut self, name: &'static str) -> PyResult<Option<Vec<[f64; N]>>> {
        self.take(name)
    }

    /// Takes a transfer function, passed as its kind and its name, path or text.
    fn transfer(&mut self, name: &'static str) -> PyResult<Option<TransferChoice>> {
        let given = self.take::<(String, String)>(name)?;
        Ok(given.map(|(kind, text)| match kind.as_str() {
            "name" => TransferChoice::Named(text),
            "path" => TransferChoice::File(text.into()),
            _ => TransferChoice::Text(text),
        }))
    }

    fn refused(text: impl Into<String>) -> PyErr {
        PyValueError::new_err(text.into())
    }
}

/// Returns what `of` takes of keyword arguments, which must be all.
fn all<'py, T>(
    dict: Option<&Bound<'py, PyDict>>,
    of: impl FnOnce(&mut Keywords<'py>) -> PyResult<T>,
) -> PyResult<T> {
    let mut said = Keywords::new(dict)?;
    let taken = of(&mut said)?;
    said.end()?;
    Ok(taken)
}

/// Returns the sampling options.
pub(crate) fn sample_options(dict: Option<&Bound<'_, PyDict>>) -> PyResult<Sampling> {
    all(dict, session::sampling)
}

/// Returns the options for opening files.
pub(crate) fn open_options(dict: Option<&Bound<'_, PyDict>>) -> PyResult<Opening> {
    all(dict, session::opening)
}

/// Returns the settings of a picture, and whether its error is measured.
///
/// # Errors
/// Unknown names; values outside a setting's domain; settings without others that they need.
pub(crate) fn drawing(dict: Option<&Bound<'_, PyDict>>) -> PyResult<(Drawing, bool)> {
    all(dict, |said| {
        let is_measured = said.flag("measure_error")?.unwrap_or(false);
        let depth = said.take::<Plane>("background_depth")?;
        let colours = said.take::<Pixels>("background_image")?;
        let mut drawing = session::drawing(said)?;
        drawing.backdrop.depth = depth.map(|depth| depth.0);
        drawing.backdrop.colours = colours.map(|colours| colours.0);
        Ok((drawing, is_measured))
    })
}

/// Takes the transfer function of keyword arguments.
pub(crate) fn transfer(dict: &Bound<'_, PyDict>) -> PyResult<Option<TransferChoice>> {
    Keywords::new(Some(dict))?.transfer("transfer_function")
}

/// Returns the lighting that is asked for, by default none.
pub(crate) fn lighting(
    lit: Option<bool>,
    lights: Option<&[[f64; 6]]>,
) -> PyResult<Option<Lighting>> {
    session::lighting::<Keywords<'_>>(lit, lights, false)
}

/// Parses a transfer function's text, so that its errors are reported when it is made.
#[pyfunction]
pub(crate) fn check_transfer_function(text: &str) -> PyResult<()> {
    let defaults = TransferDefaults {
        range: [0.0, 1.0],
        unit_distance: 1.0,
    };
    let read = TransferFunction::from_json("transfer function".as_ref(), text, &defaults);
    read.map(|_| ()).map_err(|error| exception(&error))
}
