//! Draws column densities, and means along rays, of a session.

use super::forked::usable;
use super::options::Drawing;
use super::sampled::{Purpose, Summed};
use super::state::Session;
use super::view::{View, camera};
use crate::blocks::AmplitudeSummary;
use crate::error::{Error, Result};
use crate::frame::backend::Backend;
use crate::frame::settings::ColumnSettings;
use crate::image::ColumnImage;
use crate::render::{ColumnMeans, Renderer};
use crate::sample::{MeanPart, PeriodicBox};
use crate::task::{Task, check};
use crate::view::{Along, Bounds, Camera, Lens, left_of};

/// Column density to be drawn, or mean of a field along each ray.
#[derive(Debug, Clone, Copy)]
pub struct ColumnRequest<'a> {
    /// The camera; `None` looks along z, orthographic.
    pub view: Option<&'a View>,
    /// Width and height, pixels.
    pub size: [usize; 2],
    /// Settings that columns share with pictures.
    pub drawing: &'a Drawing,
    /// Quantity that is summed, or weighs the mean: "mass" or a field.
    pub of: Option<&'a str>,
    /// Field whose mean is drawn.
    pub mean: Option<&'a str>,
    /// Coordinate along the camera's axis of the plane that is drawn instead of columns.
    pub slice: Option<f64>,
}

/// Column density with its camera and the quantity that is summed.
#[derive(Debug)]
pub struct DrawnColumn {
    /// Values.
    pub column: ColumnImage,
    /// Camera of the picture.
    pub camera: Camera,
    /// Sums of the quantity over the particles.
    pub amplitudes: AmplitudeSummary,
    /// Name and unit of the field.
    pub title: (Option<String>, Option<String>),
}

impl Session {
    /// Draws a column density of a checked size.
    ///
    /// # Errors
    /// Data that cannot be sampled or have no masses; settings that do not fit the scene; cancelled work.
    pub fn columns(&self, request: ColumnRequest<'_>, task: &Task) -> Result<DrawnColumn> {
        let ColumnRequest {
            view,
            size,
            drawing,
            of,
            mean,
            slice,
        } = request;
        let shared = &drawing.settings;
        let defaults = ColumnSettings::default();
        let mut state = self.lock(task)?;
        let begun = self.begin(task, || format!("columns {request:?}"))?;
        let (given, task) = (task, begun.as_ref().unwrap_or(task));
        if mean.is_some() && self.is_shared() {
            return Err(Error::invalid(
                "mean",
                "use",
                "one process",
                "data that ranks share",
                "draw the columns of two quantities, and divide them",
            ));
        }
        let purpose = Purpose {
            for_columns: true,
            mean: match mean {
                Some(_) => MeanPart::Weights,
                None => MeanPart::None,
            },
            summed: Some(Summed::of(of)),
            normals: false,
            models: false,
            detail: false,
            indices: false,
            shapes: state.keeps_shapes(),
            transfer: None,
        };
        let lens = Lens::OrthoHeight(None);
        let up = state.up(view);
        let periodic = state.periodic()?;
        let mut clip = shared.clip.clone();
        clip.extend(periodic.iter().flat_map(PeriodicBox::planes));
        let of_boxes = |boxes: &[Bounds]| camera(view, up, boxes, lens, size, 0);
        let ready = state.prepare(purpose.clone(), &of_boxes, &clip, task)?;
        let boxes = left_of(ready.renderer.boxes(), &clip);
        // The picture of a periodic box shows the box alone, if it has its shape.
        let filled = periodic.filter(|_| view.is_none()).and_then(|periodic| {
            let window = Along::Z.window(periodic.corners());
            let has_shape = window.has_shape(size);
            has_shape.then(|| Along::Z.camera(&window, &boxes, size))
        });
        let camera = filled.unwrap_or_else(|| of_boxes(&boxes));
        let through = match slice {
            None => None,
            Some(at) => Some(point_of_slice(&camera, at)?),
        };
        let fields = match mean {
            None => None,
            Some(field) => {
                let of_field = Purpose {
                    summed: Some(Summed::of(Some(field))),
                    mean: MeanPart::Field,
                    ..purpose.clone()
                };
                let weights = state.sample(&purpose, &of_boxes, &clip, task)?;
                let fields = state.sample(&of_field, &of_boxes, &clip, task)?;
                Some((weights, fields))
            }
        };
        let backend = usable(state.backend())?;
        let ready = state.opened(&camera)?;
        let mut settings = ColumnSettings {
            tolerance: shared.tolerance,
            filter: shared.filter,
            low_pass_variance_px2: match drawing.has_low_pass {
                true => shared.low_pass_variance_px2,
                false => defaults.low_pass_variance_px2,
            },
            cutoff: shared.cutoff.unwrap_or(defaults.cutoff),
            smoothing: ready.smoothing,
            slice: through,
            clip,
            simd: shared.advanced.simd,
            task: Some(task.clone()),
        };
        if mean.is_some() {
            settings = ColumnMeans::settings(&settings);
        }
        self.agreed("drawing columns", check(Some(given)))?;
        let column = ready.renderer.column_density(&camera, &settings);
        let mut column = self.agreed("the end of columns", column.cloned())?;
        let mut title = ready.title.clone();
        if let Some((weights, fields)) = fields {
            let on = |renderer: &Renderer| match backend {
                Backend::Auto if renderer.suits_cpu(&camera, 1) => Backend::Cpu,
                backend => backend,
            };
            let mut means =
                ColumnMeans::new(&weights.volumes, &fields.volumes, slice.is_some())?.on(on)?;
            column = means.draw(&column, &camera, &settings)?;
            title = fields.title();
        }
        Ok(DrawnColumn {
            column,
            camera,
            amplitudes: ready.renderer.amplitudes(),
            title,
        })
    }
}

/// Returns a point of the plane at a coordinate along the axis that a camera looks along.
fn point_of_slice(camera: &Camera, at: f64) -> Result<glam::DVec3> {
    let fault = |place: &str, expected: &str, found: String| {
        Error::invalid("slice", place, expected, found, "correct it")
    };
    if !at.is_finite() {
        return Err(fault("coordinate", "a finite number", at.to_string()));
    }
    let along = Along::of_camera(camera);
    let expected = "one that looks along an axis";
    let along = along.ok_or_else(|| fault("camera", expected, "another one".into()))?;
    Ok(along.axis() * at)
}
