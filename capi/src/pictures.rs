//! Makes renderers, and draws pictures and columns.

use std::sync::Arc;

use ewa_splat::session::{
    Arguments, ColumnRequest, Drawable, DrawnColumn, DrawnPicture, PictureRequest, Said, Session,
    View, check_size, choice, drawing,
};
use ewa_splat::{Backend, DepthImage, Image, Task};

use super::failure::{Failure, Result};

/// Settings that columns have.
const COLUMN_SETTINGS: [&str; 8] = [
    "clip",
    "cutoff",
    "filter",
    "low_pass",
    "mean",
    "of",
    "slice",
    "tolerance",
];

/// Makes a renderer of scenes.
pub(crate) fn renderer(scenes: Vec<Arc<Drawable>>, text: Option<&str>) -> Result<Session> {
    if scenes.is_empty() {
        return Err(Failure::invalid("scenes: expected one or more, found none"));
    }
    let made = Said::all(text, |said| {
        let backends = [
            ("auto", Backend::Auto),
            ("gpu", Backend::Gpu),
            ("cpu", Backend::Cpu),
        ];
        let backend = choice(said, "backend", &backends)?.unwrap_or(Backend::Auto);
        let keep_shapes = said.flag("keep_shapes")?.unwrap_or(false);
        Ok(Session::new(scenes, backend, keep_shapes))
    });
    Ok(made?)
}

/// Refuses the size of a picture that cannot be drawn.
fn checked(size: [usize; 2]) -> Result<()> {
    check_size(size).map_err(Failure::invalid)
}

/// Draws a picture.
///
/// - `behind`: depths and colours of a background, of the picture's size.
/// - `wanted`: whether the caller has room for depths, and for normals.
pub(crate) fn render(
    session: &Session,
    view: Option<&View>,
    size: [usize; 2],
    text: Option<&str>,
    [depth, colours]: [Option<Vec<f32>>; 2],
    wanted: [bool; 2],
    task: &Task,
) -> Result<DrawnPicture> {
    checked(size)?;
    let mut drawing = Said::all(text, drawing)?;
    let [width, height] = size;
    drawing.backdrop.depth = depth.map(|depths| DepthImage {
        width,
        height,
        depths,
    });
    drawing.backdrop.colours = colours.map(|rgba| Image {
        width,
        height,
        pixels: rgba.as_chunks().0.to_vec(),
    });
    let settings = &mut drawing.settings;
    let asked = [
        ("depth", &mut settings.depth),
        ("normals", &mut settings.normals),
    ];
    for ((name, asked), wanted) in asked.into_iter().zip(wanted) {
        if *asked && !wanted {
            let text = format!("{name}: expected a buffer for it, found NULL");
            return Err(Failure::invalid(text));
        }
        *asked = wanted;
    }
    let request = PictureRequest {
        view,
        size,
        drawing: &drawing,
    };
    let (drawn, ()) = session.render(request, task, |_, _, _, _| Ok(()))?;
    Ok(drawn)
}

/// Draws a column density, or a mean along rays.
pub(crate) fn columns(
    session: &Session,
    view: Option<&View>,
    size: [usize; 2],
    text: Option<&str>,
    task: &Task,
) -> Result<DrawnColumn> {
    checked(size)?;
    let (of, mean, slice, drawing) = Said::all(text, |said| {
        said.only(&COLUMN_SETTINGS)?;
        let (of, mean) = (said.text("of")?, said.text("mean")?);
        Ok((of, mean, said.float("slice")?, drawing(said)?))
    })?;
    let request = ColumnRequest {
        view,
        size,
        drawing: &drawing,
        of: of.as_deref(),
        mean: mean.as_deref(),
        slice,
    };
    Ok(session.columns(request, task)?)
}
