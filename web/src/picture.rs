//! Pictures that leave the module.

use std::path::Path;

use ewa_splat::Image;
use ewa_splat::io::png_bytes;
use wasm_bindgen::prelude::*;

use crate::thrown;

/// A picture with what is known of it.
#[wasm_bindgen]
#[derive(Debug)]
pub struct Picture {
    pub(crate) image: Image,
    pub(crate) depths: Option<Vec<f32>>,
    pub(crate) about: String,
}

#[wasm_bindgen]
impl Picture {
    /// Pixels in sRGB with straight alpha, as a canvas takes them.
    pub fn pixels(&self) -> Vec<u8> {
        self.image.to_srgb8()
    }

    /// Pixels as linear numbers, premultiplied.
    pub fn floats(&self) -> Vec<f32> {
        self.image.pixels.as_flattened().to_vec()
    }

    /// Depth of each pixel along the view, if `drawing.depth` asks for it.
    pub fn depths(&self) -> Option<Vec<f32>> {
        self.depths.clone()
    }

    /// Bytes of the PNG file that the program writes.
    ///
    /// # Errors
    /// A picture without pixels.
    pub fn png(&self) -> Result<Vec<u8>, JsError> {
        png_bytes(Path::new("picture.png"), &self.image).map_err(thrown)
    }

    /// Facts about the picture, as JSON: `camera`, `bars`, `particles`, `times`, `adapter`, `fallback`.
    #[wasm_bindgen(getter)]
    pub fn about(&self) -> String {
        self.about.clone()
    }
}
