//! Draws pictures of a session.

use std::borrow::Cow;
use std::sync::MutexGuard;

use super::options::Drawing;
use super::sampled::{Purpose, Ready};
use super::state::{Session, State};
use super::view::{View, camera};
use crate::error::{Error, Result};
use crate::frame::backdrop::GivenBackdrop;
use crate::frame::settings::Settings;
use crate::image::{DeepImage, Image};
use crate::legend::{check_legend_size, draw_legend, legend_width};
use crate::sample::PeriodicBox;
use crate::task::{Task, check};
use crate::view::{Bounds, Camera, DEFAULT_FOV_DEG, Lens, left_of};

/// Picture to be drawn.
#[derive(Debug, Clone, Copy)]
pub struct PictureRequest<'a> {
    /// The camera; `None` fits one to the data.
    pub view: Option<&'a View>,
    /// Width and height, pixels.
    pub size: [usize; 2],
    /// Settings.
    pub drawing: &'a Drawing,
}

/// Picture with its depths, normals and camera.
#[derive(Debug)]
pub struct DrawnPicture {
    /// Linear, premultiplied pixels.
    pub image: Image,
    /// Depth of each pixel, if the settings ask for it.
    pub depth: Option<Vec<f32>>,
    /// Normal of each pixel, if the settings ask for it.
    pub normals: Option<Vec<[f32; 3]>>,
    /// Camera of the picture.
    pub camera: Camera,
}

/// Checks the size of a picture.
///
/// # Errors
/// No pixels, or more than 65,535 along an edge.
pub fn check_size(size: [usize; 2]) -> Result<(), String> {
    if size.iter().all(|n| (1..=65_535).contains(n)) {
        return Ok(());
    }
    let [width, height] = size;
    Err(format!(
        "size: expected a width and a height from 1 to 65535, found {width}, {height}"
    ))
}

impl Session {
    /// Prepares a scene for a picture of a checked size; returns the state with the camera and settings.
    fn prepared(
        &self,
        request: PictureRequest<'_>,
        indices: bool,
        task: &Task,
    ) -> Result<(MutexGuard<'_, State>, Camera, Settings)> {
        let PictureRequest {
            view,
            size,
            drawing,
        } = request;
        let mut state = self.lock(task)?;
        let begun = self.begin(task, || said(request))?;
        let (given, task) = (task, begun.as_ref().unwrap_or(task));
        let backdrop = match &self.ranks {
            None => Cow::Borrowed(&drawing.backdrop),
            Some(ranks) => Cow::Owned(ranks.clone().first_backdrop(&drawing.backdrop)?),
        };
        if drawing.transfer.is_some() {
            state.set_transfer(drawing.transfer.clone())?;
        }
        let purpose = Purpose {
            indices,
            ..state.purpose(drawing)
        };
        let mut settings = drawing.settings.clone();
        settings
            .clip
            .extend(state.periodic()?.iter().flat_map(PeriodicBox::planes));
        let clip = &settings.clip;
        let lens = Lens::FovDeg(DEFAULT_FOV_DEG);
        let up = state.up(view);
        let of_boxes = |boxes: &[Bounds]| camera(view, up, boxes, lens, size, 0);
        let ready = state.prepare(purpose, &of_boxes, clip, task)?;
        let boxes = left_of(ready.renderer.fitted_boxes(), clip);
        let room = match drawing.legend {
            true => legend_width(&ready.bars, size),
            false => 0,
        };
        let camera = camera(view, up, &boxes, lens, size, room);
        if !drawing.has_low_pass {
            settings.low_pass_variance_px2 = ready.renderer.suitable_low_pass_px2();
        }
        settings.backdrop = backdrop.seen_by(&camera)?;
        settings.task = Some(task.clone());
        self.agreed("drawing a picture", check(Some(given)))?;
        Ok((state, camera, settings))
    }

    /// Prepares a scene for a picture of a checked size, and passes it on with the camera and settings.
    ///
    /// # Errors
    /// Data that cannot be sampled; settings that do not fit the scene; cancelled work.
    pub fn with_picture<T>(
        &self,
        request: PictureRequest<'_>,
        indices: bool,
        task: &Task,
        of: impl FnOnce(&mut Ready, Camera, Settings) -> Result<T>,
    ) -> Result<T> {
        let (mut state, camera, settings) = self.prepared(request, indices, task)?;
        let drawn = of(state.opened(&camera)?, camera, settings);
        self.agreed("the end of a picture", drawn)
    }

    /// Prepares the scene of a picture of a checked size, which pictures of these settings then draw.
    ///
    /// # Errors
    /// As [`with_picture`](Self::with_picture).
    pub fn ready(&self, request: PictureRequest<'_>, task: &Task) -> Result<()> {
        self.prepared(request, false, task).map(drop)
    }

    /// Draws a picture of a checked size. If ranks share the data, the images are those of the first rank; others get
    /// nothing of use.
    ///
    /// - `further`: called with the scene, the picture without its colour bar, the camera and the settings.
    ///
    /// # Errors
    /// As [`with_picture`](Self::with_picture); a colour bar of data without a field, or in too small a picture.
    pub fn render<T>(
        &self,
        request: PictureRequest<'_>,
        task: &Task,
        further: impl FnOnce(&mut Ready, &Image, &Camera, Settings) -> Result<T>,
    ) -> Result<(DrawnPicture, T)> {
        let is_first = self.is_first();
        self.with_picture(request, false, task, |ready, camera, settings| {
            check_legend(request, ready)?;
            let image = ready.renderer.render(&camera, &settings)?.clone();
            let drawn = (ready, image, camera, settings);
            finished(request, drawn, is_first, further)
        })
    }

    /// As [`render`](Self::render), without waiting for a device: see [`Renderer::render_async`]. While the device
    /// draws, another call makes the scene again.
    ///
    /// # Errors
    /// As [`render`](Self::render).
    ///
    /// [`Renderer::render_async`]: crate::render::Renderer::render_async
    #[cfg(feature = "gpu")]
    pub async fn render_async<T>(
        &self,
        request: PictureRequest<'_>,
        task: &Task,
        further: impl FnOnce(&mut Ready, &Image, &Camera, Settings) -> Result<T>,
    ) -> Result<(DrawnPicture, T)> {
        let (ready, camera, settings) = {
            let (mut state, camera, settings) = self.prepared(request, false, task)?;
            check_legend(request, state.opened(&camera)?)?;
            (state.take_ready(), camera, settings)
        };
        let Some((mut ready, changes)) = ready else {
            unreachable!("it was opened above")
        };
        let drawn = ready.renderer.render_async(&camera, &settings).await;
        let image = drawn.cloned();
        let drawn = image.and_then(|image| {
            finished(
                request,
                (&mut ready, image, camera, settings),
                true,
                further,
            )
        });
        self.lock(task)?.put_ready((ready, changes));
        drawn
    }
}

/// Checks that a colour bar that is asked for can be drawn.
fn check_legend(request: PictureRequest<'_>, ready: &Ready) -> Result<()> {
    if !request.drawing.legend {
        return Ok(());
    }
    if ready.bars.is_empty() {
        return Err(Error::invalid(
            "legend",
            "data",
            "a field with a transfer function",
            "splats, meshes or particles with colours of their own",
            "leave it out",
        ));
    }
    check_legend_size(&ready.bars, request.size)
}

/// Completes a picture that was drawn.
///
/// - `is_first`: true if this process gets the picture.
fn finished<T>(
    request: PictureRequest<'_>,
    (ready, mut image, camera, settings): (&mut Ready, Image, Camera, Settings),
    is_first: bool,
    further: impl FnOnce(&mut Ready, &Image, &Camera, Settings) -> Result<T>,
) -> Result<(DrawnPicture, T)> {
    let renderer = &ready.renderer;
    let depth = renderer.depth().map(|depth| depth.depths.clone());
    let normals = renderer.normals().map(|normals| normals.normals.clone());
    let more = further(ready, &image, &camera, settings)?;
    if request.drawing.legend && is_first {
        draw_legend(&ready.bars, &mut image)?;
    }
    let drawn = DrawnPicture {
        image,
        depth,
        normals,
        camera,
    };
    Ok((drawn, more))
}

impl Session {
    /// Draws a deep image of a checked size. Returns it with its camera.
    ///
    /// # Errors
    /// As [`with_picture`](Self::with_picture); the errors of [`Renderer::render_deep`](crate::Renderer::render_deep);
    /// data that ranks share.
    pub fn render_deep(
        &self,
        request: PictureRequest<'_>,
        task: &Task,
    ) -> Result<(DeepImage, Camera)> {
        if self.is_shared() {
            return Err(Error::invalid(
                "deep image",
                "use",
                "one process",
                "data that ranks share",
                "draw pictures with a background's depths",
            ));
        }
        self.with_picture(request, false, task, |ready, camera, settings| {
            let deep = ready.renderer.render_deep(&camera, &settings)?;
            Ok((deep, camera))
        })
    }
}

/// Returns what ranks compare of a request: all but another renderer's images.
fn said(request: PictureRequest<'_>) -> String {
    let PictureRequest {
        view,
        size,
        drawing,
    } = request;
    let own = Drawing {
        backdrop: GivenBackdrop {
            kind: drawing.backdrop.kind,
            ..GivenBackdrop::default()
        },
        ..drawing.clone()
    };
    format!("picture {view:?} {size:?} {own:?}")
}

#[cfg(test)]
mod tests {
    use std::panic::{AssertUnwindSafe, catch_unwind};
    use std::sync::Arc;

    use glam::DVec3;

    use super::*;
    use crate::frame::backend::Backend;
    use crate::io::{Association, Geometry};
    use crate::session::arguments::Nothing;
    use crate::session::{Drawable, drawing, field, sampling};

    #[test]
    fn a_session_draws_again_after_a_panic_and_after_cancelled_work() {
        let positions: Vec<DVec3> = (0..64)
            .map(|i| DVec3::new(f64::from(i % 4), f64::from(i / 4 % 4), f64::from(i / 16)))
            .collect();
        let values: Vec<f32> = (0..64_u8).map(f32::from).collect();
        let fields = vec![field("value", values.into(), Association::Nodes)];
        let Ok(own) = sampling(&mut Nothing);
        let thing = Drawable::of("points", Geometry::Points { positions }, fields, own).unwrap();
        let session = Session::new(vec![Arc::new(thing)], Backend::Cpu, false);
        let Ok(drawing) = drawing(&mut Nothing);
        let request = PictureRequest {
            view: None,
            size: [24, 16],
            drawing: &drawing,
        };
        let draw = |task: &Task| session.render(request, task, |_, _, _, _| Ok(()));
        let (first, ()) = draw(&Task::new()).unwrap();
        assert!(first.image.pixels.iter().any(|pixel| pixel[3] > 0.1));
        let fails = || {
            let fault =
                |_: &mut Ready, _: &Image, _: &Camera, _| -> Result<()> { panic!("a test") };
            session.render(request, &Task::new(), fault)
        };
        assert!(catch_unwind(AssertUnwindSafe(fails)).is_err());
        let cancelled = Task::new();
        cancelled.cancel();
        assert!(matches!(draw(&cancelled), Err(Error::Cancelled)));
        let (again, ()) = draw(&Task::new()).unwrap();
        assert!(again.image == first.image);
    }
}
