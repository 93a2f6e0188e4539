//! Column densities that leave the module.

use ewa_splat::io::png_bytes;
use ewa_splat::{ColumnImage, Image};
use std::path::Path;
use wasm_bindgen::prelude::*;

use crate::thrown;

/// A column density with its picture.
#[wasm_bindgen]
#[derive(Debug)]
pub struct Column {
    pub(crate) column: ColumnImage,
    pub(crate) image: Image,
    pub(crate) about: String,
}

#[wasm_bindgen]
impl Column {
    /// Values, row by row.
    pub fn values(&self) -> Vec<f32> {
        self.column.values.clone()
    }

    /// Pixels in sRGB with straight alpha, as a canvas takes them.
    pub fn pixels(&self) -> Vec<u8> {
        self.image.to_srgb8()
    }

    /// Bytes of the PNG file that the program writes.
    ///
    /// # Errors
    /// A picture without pixels.
    pub fn png(&self) -> Result<Vec<u8>, JsError> {
        png_bytes(Path::new("columns.png"), &self.image).map_err(thrown)
    }

    /// Facts about the columns, as JSON: `camera`, `bars`, `sum`, `title`, `unit`.
    #[wasm_bindgen(getter)]
    pub fn about(&self) -> String {
        self.about.clone()
    }
}
