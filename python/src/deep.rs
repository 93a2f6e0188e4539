//! Keeps deep images for Python.

use std::path::PathBuf;

use ewa_splat::image::{DeepImage, DepthOf};
use ewa_splat::io;
use numpy::{IntoPyArray, PyArray1, PyArray2, PyArray3, PyArrayMethods};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use crate::arrays::Plane;
use crate::errors::exception;
use crate::task::detached;

/// A deep image.
#[pyclass(frozen, module = "ewa_splat._core")]
pub(crate) struct Deep(pub(crate) DeepImage);

#[pymethods]
impl Deep {
    /// Returns the number of samples of each pixel.
    fn counts<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<i64>>> {
        let counts = self.0.firsts.windows(2).map(|pair| pair[1] - pair[0]);
        let counts: Vec<i64> = counts.map(|n| n.try_into().unwrap_or(i64::MAX)).collect();
        counts
            .into_pyarray(py)
            .reshape([self.0.height, self.0.width])
    }

    /// Returns the front and the back of each sample, and its colour and opacity.
    #[expect(clippy::type_complexity, reason = "the package names its parts")]
    fn samples<'py>(
        &self,
        py: Python<'py>,
    ) -> PyResult<(
        Bound<'py, PyArray1<f32>>,
        Bound<'py, PyArray1<f32>>,
        Bound<'py, PyArray2<f32>>,
    )> {
        let samples = &self.0.samples;
        let front: Vec<f32> = samples.iter().map(|sample| sample.front).collect();
        let back: Vec<f32> = samples.iter().map(|sample| sample.back).collect();
        let rgba: Vec<f32> = samples.iter().flat_map(|sample| sample.rgba).collect();
        let rgba = rgba.into_pyarray(py).reshape([samples.len(), 4])?;
        Ok((front.into_pyarray(py), back.into_pyarray(py), rgba))
    }

    /// Returns the pixels in front of depths; those of all samples without depths.
    #[pyo3(signature = (depth))]
    fn before<'py>(
        &self,
        py: Python<'py>,
        depth: Option<Plane>,
    ) -> PyResult<Bound<'py, PyArray3<f32>>> {
        let image = match &depth {
            Some(depth) => self.0.before(&depth.0),
            None => Some(self.0.flat()),
        };
        let [width, height] = [self.0.width, self.0.height];
        let Some(image) = image else {
            let text = format!("depth: expected an array of shape ({height}, {width})");
            return Err(PyValueError::new_err(text));
        };
        let pixels = image.pixels.into_flattened().into_pyarray(py);
        pixels.reshape([height, width, 4])
    }

    /// Returns the share of light that reaches the eye from a depth.
    fn transmittance<'py>(
        &self,
        py: Python<'py>,
        depth: f32,
    ) -> PyResult<Bound<'py, PyArray2<f32>>> {
        let shares = self.0.transmittance(depth).into_pyarray(py);
        shares.reshape([self.0.height, self.0.width])
    }

    /// Returns a depth of each pixel.
    fn depth<'py>(&self, py: Python<'py>, of: &str) -> PyResult<Bound<'py, PyArray2<f32>>> {
        let of = match of {
            "half" => DepthOf::Half,
            "entry" => DepthOf::Entry,
            "exit" => DepthOf::Exit,
            "median" => DepthOf::Median,
            "mean" => DepthOf::Mean,
            other => {
                let text = format!("of: expected half, entry, exit, median or mean, found {other}");
                return Err(PyValueError::new_err(text));
            }
        };
        let depths = self.0.depth(of).depths.into_pyarray(py);
        depths.reshape([self.0.height, self.0.width])
    }

    /// Writes a deep EXR file.
    fn write(&self, py: Python<'_>, path: PathBuf) -> PyResult<()> {
        detached(py, || io::write_deep(&path, &self.0)).map_err(|error| exception(&error))
    }
}
