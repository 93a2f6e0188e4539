//! Draws annotations and legends on pictures that are written.

use std::borrow::Cow;

use ewa_splat::annotate::{Annotations, draw};
use ewa_splat::legend::{ColourBar, columns_beside_legend, draw_legend};
use ewa_splat::view::Camera;
use ewa_splat::{Image, Result};

/// Annotations and legends that the library draws over a picture that is written.
#[derive(Debug, Clone, PartialEq, Default)]
pub(crate) struct Overlay {
    pub(crate) annotations: Annotations,
    pub(crate) bars: Vec<ColourBar>,
}

impl Overlay {
    /// Returns a picture with the overlay, as `ewa-splat render` draws it.
    ///
    /// # Errors
    /// A picture that is too small for the overlay.
    pub(crate) fn drawn<'a>(&self, image: &'a Image, camera: &Camera) -> Result<Cow<'a, Image>> {
        if *self == Self::default() {
            return Ok(Cow::Borrowed(image));
        }
        let mut image = image.clone();
        let size = [image.width, image.height];
        let annotations = Annotations {
            title_columns: Some(columns_beside_legend(&self.bars, size)?),
            ..self.annotations.clone()
        };
        draw(&mut image, camera, &annotations)?;
        draw_legend(&self.bars, &mut image)?;
        Ok(Cow::Owned(image))
    }
}
