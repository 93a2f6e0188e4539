//! Opens prepared scenes as inputs.

use std::ops::Range;
use std::path::Path;

use crate::data::up::Up;
use crate::prepared::{About, PreparedScene, looks_like};
use crate::scene::{PointVolume, TransferDefaults, TransferFunction};
use crate::{Error, Renderer, RendererOptions, Result, SceneOptions};
use glam::DVec3;

use super::edit::Edit;
use super::facts::Corners;
use super::input::Input;

/// Prepared scenes, each with the range of the scene's volumes that stand in for its own.
pub type Members = Vec<(Range<usize>, PreparedScene)>;

/// Returns true if a file is a prepared scene. An unreadable file counts as none; reading it
/// reports the error.
pub fn is_prepared(path: &Path) -> bool {
    let mut head = [0; 8];
    let read = std::fs::File::open(path)
        .and_then(|mut file| std::io::Read::read_exact(&mut file, &mut head));
    read.is_ok() && looks_like(&head)
}

/// Opens a prepared scene, and checks that it was prepared for pictures or for column densities.
///
/// - `for_columns`: whether column densities are wanted.
pub(crate) fn open(input: &Input, for_columns: bool) -> Result<(PreparedScene, About)> {
    let (scene, about) = open_any(input)?;
    if about.for_columns != for_columns {
        let (expected, found) = match for_columns {
            true => ("a scene prepared with --column-density", "one for pictures"),
            false => ("a scene prepared for pictures", "one for column densities"),
        };
        let advice = "prepare another";
        return Err(Error::format(
            &input.path,
            "prepared scene",
            expected,
            found,
            advice,
        ));
    }
    Ok((scene, about))
}

/// Opens a prepared scene. Refuses options that the prepared scene can no longer satisfy.
pub(crate) fn open_any(input: &Input) -> Result<(PreparedScene, About)> {
    let refuse = |place: &str, expected: &str, found: &str, advice: &str| {
        Err(Error::format(&input.path, place, expected, found, advice))
    };
    if input.field.is_some() || input.function.is_some() {
        let expected = "its file alone";
        let advice = "name the field and the function when the scene is prepared";
        return refuse(
            "prepared scene",
            expected,
            "a field or a function of it",
            advice,
        );
    }
    if input.edit != Edit::default() {
        let advice = "place the data when the scene is prepared";
        return refuse(
            "prepared scene",
            "data as they were prepared",
            "another place",
            advice,
        );
    }
    PreparedScene::open(&input.path)
}

/// Replaces the transfer function of a scene by one from a file. Its values must lie on the scale
/// of the function that the scene was prepared with.
pub(crate) fn with_function(
    mut scene: PreparedScene,
    path: &Path,
    function: &Path,
) -> Result<PreparedScene> {
    let text = std::fs::read_to_string(function)
        .map_err(|e| Error::io(function, "reading", e, "check the path and its permissions"))?;
    crate::opened::note(function);
    let own: Vec<Option<TransferFunction>> = scene.transfer_functions();
    for (volume, own) in own.into_iter().enumerate() {
        let Some(own) = own else {
            continue;
        };
        let defaults = TransferDefaults {
            range: own.range(),
            unit_distance: own.unit_distance(),
        };
        let transfer = TransferFunction::from_json(function, &text, &defaults)?;
        let Some(transfer) = transfer.moved_to(own.value_scale()) else {
            let advice = "prepare the scene with this function";
            let (expected, found) = ("values on the function's scale", "another scale");
            return Err(Error::format(
                path,
                "prepared scene",
                expected,
                found,
                advice,
            ));
        };
        scene.set_transfer_function(volume, transfer)?;
    }
    Ok(scene)
}

/// Returns the direction up of the data that a scene was prepared from.
pub(crate) fn up_of(about: &About) -> Up {
    Up {
        direction: DVec3::from(about.up),
        reason: "as the scene was prepared",
        front: about.front.map(DVec3::from),
        is_plane: about.is_plane,
        is_of_mesh: about.is_of_mesh,
    }
}

/// Returns the corners of the data that a scene was prepared from.
pub(crate) fn corners_of(about: &About) -> impl Iterator<Item = Corners> {
    let corners = about.corners.iter();
    corners.map(|[a, b]| (DVec3::from(*a), DVec3::from(*b)))
}

/// Returns a renderer of the volumes, with prepared scenes in place of the volumes that stand in
/// for them.
pub(crate) fn renderer(
    mut volumes: Vec<PointVolume>,
    prepared: Members,
    options: &SceneOptions,
) -> Result<Renderer> {
    if prepared.is_empty() {
        return Renderer::with_options(volumes, options);
    }
    let mut scenes = Vec::new();
    for (place, scene) in prepared.into_iter().rev() {
        scenes.push(PreparedScene::new(volumes.split_off(place.end), options)?);
        volumes.truncate(place.start);
        scenes.push(scene);
    }
    scenes.push(PreparedScene::new(volumes, options)?);
    scenes.reverse();
    Renderer::with_options(scenes, RendererOptions::default())
}
