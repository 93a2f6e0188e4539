//! Makes renderers, and draws pictures and columns.

use std::sync::Arc;

#[cfg(feature = "mpi")]
use ewa_splat::distributed::Collective;
use ewa_splat::image::DepthOf;
use ewa_splat::session::{
    Arguments, ColumnRequest, Drawable, Drawing, DrawnColumn, DrawnPicture, PictureRequest,
    Refused, Said, Session, View, check_size, choice, drawing,
};
use ewa_splat::{Backend, DeepImage, DepthImage, Image, Task};

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

/// Settings that deep images leave out.
const NOT_DEEP: [&str; 4] = ["background", "depth", "legend", "normals"];

/// Makes a renderer of scenes.
pub(crate) fn renderer(scenes: Vec<Arc<Drawable>>, text: Option<&str>) -> Result<Session> {
    let (backend, keep_shapes) = choices(&scenes, text)?;
    Ok(Session::new(scenes, backend, keep_shapes))
}

/// Makes a renderer of scenes of which each rank gives a part.
///
/// - `own`: this rank's scenes and options, if they could be read.
#[cfg(feature = "mpi")]
pub(crate) fn shared(
    own: Result<(Vec<Arc<Drawable>>, Option<&str>)>,
    communicator: impl Collective + 'static,
) -> Result<Session> {
    let own = own.and_then(|(scenes, text)| match choices(&scenes, text)? {
        (Backend::Gpu, _) => Err(Failure::invalid(
            "backend: expected cpu, on which ranks draw, found gpu",
        )),
        (_, true) => Err(Failure::invalid(
            "keep_shapes: expected false for data that ranks share, found true",
        )),
        _ => Ok(scenes),
    });
    Session::over_ranks(own, communicator)
}

/// Returns the options of a renderer.
fn choices(scenes: &[Arc<Drawable>], text: Option<&str>) -> Result<(Backend, bool)> {
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
        Ok((backend, keep_shapes))
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
/// - `wanted`: whether the caller has room for depths, and for normals; on ranks, whether the first one has.
pub(crate) fn render(
    session: &Session,
    view: Option<&View>,
    size: [usize; 2],
    text: Option<&str>,
    behind: [Option<Vec<f32>>; 2],
    wanted: [bool; 2],
    task: &Task,
) -> Result<DrawnPicture> {
    let drawing = picture(size, text, behind, wanted);
    let request = PictureRequest {
        view,
        size,
        drawing: &session.agreed("ewa_render", drawing)?,
    };
    let (drawn, ()) = session.render(request, task, |_, _, _, _| Ok(()))?;
    Ok(drawn)
}

/// Returns the settings of a picture.
fn picture(
    size: [usize; 2],
    text: Option<&str>,
    [depth, colours]: [Option<Vec<f32>>; 2],
    wanted: [bool; 2],
) -> Result<Drawing> {
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
    Ok(drawing)
}

/// Draws a deep image.
pub(crate) fn deep(
    session: &Session,
    view: Option<&View>,
    size: [usize; 2],
    text: Option<&str>,
    task: &Task,
) -> Result<DeepImage> {
    checked(size)?;
    let drawing = Said::all(text, |said| {
        for name in NOT_DEEP {
            if said.has(name) {
                return Err(Refused(format!("{name}: deep images have no such setting")));
            }
        }
        drawing(said)
    })?;
    let request = PictureRequest {
        view,
        size,
        drawing: &drawing,
    };
    Ok(session.render_deep(request, task)?.0)
}

/// Returns a depth of each pixel of a deep image.
pub(crate) fn depths(deep: &DeepImage, of: &str) -> Result<Vec<f32>> {
    let names = [
        ("half", DepthOf::Half),
        ("entry", DepthOf::Entry),
        ("exit", DepthOf::Exit),
        ("median", DepthOf::Median),
        ("mean", DepthOf::Mean),
    ];
    match names.iter().find(|(name, _)| *name == of) {
        Some((_, of)) => Ok(deep.depth(*of).depths),
        None => Err(Failure::invalid(format!(
            "of: expected half, entry, exit, median or mean, found {of}"
        ))),
    }
}

/// Draws a column density, or a mean along rays.
pub(crate) fn columns(
    session: &Session,
    view: Option<&View>,
    size: [usize; 2],
    text: Option<&str>,
    task: &Task,
) -> Result<DrawnColumn> {
    let said = checked(size).and_then(|()| {
        let said = Said::all(text, |said| {
            said.only(&COLUMN_SETTINGS)?;
            let (of, mean) = (said.text("of")?, said.text("mean")?);
            Ok((of, mean, said.float("slice")?, drawing(said)?))
        });
        Ok(said?)
    });
    let (of, mean, slice, drawing) = session.agreed("ewa_columns", said)?;
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
