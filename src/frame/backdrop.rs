//! Defines what stands in a picture already, as another renderer drew it: depths at which rays end, and colours
//! behind the scene.

use std::sync::Arc;

use glam::DVec2;

use crate::error::{Error, Result};
use crate::image::{DepthImage, Image};
use crate::math::narrowed;
use crate::view::{Camera, Projection};

/// Depths, and perhaps colours, that another renderer drew from the same camera.
///
/// The ray of a pixel ends at the pixel's depth: kernels are integrated up to there, as up to an opaque surfel, and
/// surfels beyond it are hidden. Colours, if there are any, stand behind the scene.
#[derive(Debug, Clone, PartialEq)]
pub struct Backdrop {
    depth: DepthImage,
    colours: Option<Image>,
}

/// Meaning of the depths of a picture.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum DepthKind {
    /// The camera-space z, world units: the distance from the plane through the eye. Infinite where nothing stands.
    #[default]
    Z,
    /// The distance from the eye along the ray through the pixel's centre, world units; under an orthographic camera
    /// from the plane through the eye. Infinite where nothing stands.
    Distance,
    /// A depth buffer of OpenGL, as windows hold it: 0 at the near plane, 1 at the far one and where nothing stands.
    OpenGl {
        /// Distance of the near plane, world units.
        near: f64,
        /// Distance of the far plane.
        far: f64,
    },
}

impl Backdrop {
    /// Makes a backdrop of depths of another kind.
    ///
    /// # Errors
    /// The errors of [`Backdrop::new`]; an image of another size than the camera's; planes in the wrong order, or depths
    /// of OpenGL below 0 or above 1.
    pub fn of_kind(depth: DepthImage, kind: DepthKind, camera: &Camera) -> Result<Self> {
        let Self { mut depth, .. } = Self::new(depth)?;
        let [width, height] = [camera.width, camera.height];
        if [depth.width, depth.height] != [width, height] {
            let expected = format!("{width} x {height} pixels, as the picture");
            let found = format!("{} x {}", depth.width, depth.height);
            return Err(refusal(&expected, found));
        }
        let is_orthographic = camera.projection == Projection::Orthographic;
        let convert: Box<dyn Fn(usize, f64) -> f64> = match kind {
            DepthKind::Z => return Self::new(depth),
            DepthKind::Distance if is_orthographic => return Self::new(depth),
            DepthKind::Distance => Box::new(|i, distance| {
                let pixel = DVec2::new((i % width) as f64, (i / width) as f64) + 0.5;
                let slope = (pixel - camera.centre_px) / camera.focal_px;
                distance / slope.extend(1.0).length()
            }),
            DepthKind::OpenGl { near, far } => {
                let is_sound = near < far && far.is_finite() && (is_orthographic || near > 0.0);
                if !is_sound {
                    let expected = "a near plane in front of the eye, and a far one behind it";
                    return Err(refusal(expected, format!("{near} and {far}")));
                }
                let is_inside = |depth: &f32| (0.0..=1.0).contains(depth);
                let beyond = depth.depths.iter().find(|depth| !is_inside(depth));
                if let Some(beyond) = beyond {
                    return Err(refusal("depths of OpenGL, 0 to 1", beyond.to_string()));
                }
                Box::new(move |_, depth| match depth {
                    1.0 => f64::INFINITY,
                    _ if is_orthographic => near + depth * (far - near),
                    _ => near * far / (far - depth * (far - near)),
                })
            }
        };
        for (i, depth) in depth.depths.iter_mut().enumerate() {
            *depth = narrowed(convert(i, f64::from(*depth)));
        }
        Self::new(depth)
    }

    /// Makes a backdrop at which no ray ends, for colours.
    pub fn without_depth(width: usize, height: usize) -> Self {
        Self {
            depth: DepthImage {
                width,
                height,
                depths: vec![f32::INFINITY; width.saturating_mul(height)],
            },
            colours: None,
        }
    }

    /// Returns the part of a backdrop that a part of the picture has.
    ///
    /// - `first`: its first pixel; the part lies within the picture.
    pub(crate) fn part(&self, first: [usize; 2], [width, height]: [usize; 2]) -> Self {
        fn cut<T: Copy>(
            of: &[T],
            columns: usize,
            [x, y]: [usize; 2],
            [width, height]: [usize; 2],
        ) -> Vec<T> {
            let row = |row: usize| &of[(y + row) * columns + x..][..width];
            (0..height).flat_map(row).copied().collect()
        }
        let columns = self.depth.width;
        Self {
            depth: DepthImage {
                width,
                height,
                depths: cut(&self.depth.depths, columns, first, [width, height]),
            },
            colours: self.colours.as_ref().map(|colours| Image {
                width,
                height,
                pixels: cut(&colours.pixels, columns, first, [width, height]),
            }),
        }
    }

    /// Makes a backdrop of depths alone: the picture is transparent where the scene is.
    ///
    /// - `depth`: camera-space z of what stands in each pixel, world units; infinite where nothing stands.
    ///
    /// # Errors
    /// Another number of depths than of pixels; depths that are NaN.
    pub fn new(depth: DepthImage) -> Result<Self> {
        let pixels = depth.width.checked_mul(depth.height);
        if pixels != Some(depth.depths.len()) {
            let expected = format!("{} x {} depths", depth.width, depth.height);
            return Err(refusal(&expected, depth.depths.len().to_string()));
        }
        let nans = depth.depths.iter().filter(|z| z.is_nan()).count();
        if nans > 0 {
            let expected = "numbers, infinite where nothing stands";
            return Err(refusal(expected, format!("NaN in {nans} pixels")));
        }
        Ok(Self {
            depth,
            colours: None,
        })
    }

    /// Adds colours that stand behind the scene, wherever the depths are: linear and premultiplied.
    ///
    /// # Errors
    /// An image of another size; colours that are not finite.
    pub fn with_colours(self, colours: Image) -> Result<Self> {
        let size = |[width, height]: [usize; 2]| format!("{width} x {height} pixels");
        let own = [self.depth.width, self.depth.height];
        if [colours.width, colours.height] != own || !colours.is_whole() {
            let found = size([colours.width, colours.height]);
            return Err(refusal(&size(own), found));
        }
        let is_finite = |pixel: &[f32; 4]| pixel.iter().all(|c| c.is_finite());
        if !colours.pixels.iter().all(is_finite) {
            return Err(refusal("finite colours", "others".into()));
        }
        Ok(Self {
            colours: Some(colours),
            ..self
        })
    }

    /// Draws the colours, if there are any, and a background behind them under a linear picture.
    pub fn lay_under(&self, image: &mut Image, background: Option<[f32; 3]>) {
        self.lay_under_blended(image, background, false);
    }

    /// As [`Self::lay_under`].
    ///
    /// - `in_codes`: whether to composite sRGB codes.
    pub(crate) fn lay_under_blended(
        &self,
        image: &mut Image,
        background: Option<[f32; 3]>,
        in_codes: bool,
    ) {
        match (&self.colours, background) {
            (Some(colours), Some(background)) => image.lay_on(&colours.over(background), in_codes),
            (Some(colours), None) => image.lay_on(colours, in_codes),
            (None, _) => {}
        }
    }

    /// Returns the depths.
    pub fn depth(&self) -> &DepthImage {
        &self.depth
    }

    /// Returns the colours, if there are any.
    pub fn colours(&self) -> Option<&Image> {
        self.colours.as_ref()
    }
}

/// Images of a backdrop before the camera is known.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct GivenBackdrop {
    /// Depths.
    pub depth: Option<DepthImage>,
    /// Their meaning.
    pub kind: DepthKind,
    /// Colours behind the scene.
    pub colours: Option<Image>,
}

impl GivenBackdrop {
    /// Returns the backdrop of pictures by a camera; `None` if nothing is given.
    ///
    /// # Errors
    /// The errors of [`Backdrop::of_kind`] and [`Backdrop::with_colours`]; a kind without depths.
    pub fn seen_by(&self, camera: &Camera) -> Result<Option<Arc<Backdrop>>> {
        let backdrop = match (&self.depth, &self.colours) {
            (None, _) if self.kind != DepthKind::Z => {
                return Err(refusal("depths of the kind that is named", "none".into()));
            }
            (None, None) => return Ok(None),
            (Some(depth), _) => Backdrop::of_kind(depth.clone(), self.kind, camera)?,
            (None, Some(colours)) => Backdrop::without_depth(colours.width, colours.height),
        };
        let backdrop = match &self.colours {
            Some(colours) => backdrop.with_colours(colours.clone())?,
            None => backdrop,
        };
        Ok(Some(Arc::new(backdrop)))
    }
}

fn refusal(expected: &str, found: String) -> Error {
    Error::invalid("settings", "backdrop", expected, found, "change it")
}

/// Depths at which the rays of a picture end, or those of a part of it.
#[derive(Debug, Clone, PartialEq)]
pub struct RayEnds {
    backdrop: Arc<Backdrop>,
    /// First pixel of the part.
    first: [usize; 2],
    /// Samples along each side of a pixel, all of which have its depth.
    samples: usize,
}

impl RayEnds {
    pub(crate) fn of(backdrop: &Arc<Backdrop>) -> Self {
        Self {
            backdrop: Arc::clone(backdrop),
            first: [0; 2],
            samples: 1,
        }
    }

    /// Returns those of a part of the picture.
    ///
    /// - `first`: its first pixel.
    /// - `samples`: samples along each side of a pixel.
    pub(crate) fn part(&self, first: [usize; 2], samples: usize) -> Self {
        Self {
            backdrop: Arc::clone(&self.backdrop),
            first,
            samples,
        }
    }

    /// Returns the depth z at which the ray of a pixel, or of a sample, ends; infinite if it does not.
    pub(crate) fn at(&self, [x, y]: [usize; 2]) -> f32 {
        let depth = &self.backdrop.depth;
        let [x, y] = [
            x / self.samples + self.first[0],
            y / self.samples + self.first[1],
        ];
        let index = (x < depth.width).then_some(y * depth.width + x);
        let depth = index.and_then(|index| depth.depths.get(index));
        depth.copied().unwrap_or(f32::INFINITY)
    }
}

/// Returns a depth as surfels state theirs: its inverse under perspective, its negative otherwise. Surfels with smaller
/// ones lie beyond it.
pub(crate) fn of_surfels(depth: f32, is_orthographic: bool) -> f32 {
    if is_orthographic {
        -depth
    } else if depth > 0.0 {
        1.0 / depth
    } else {
        // Nothing is visible.
        f32::INFINITY
    }
}
