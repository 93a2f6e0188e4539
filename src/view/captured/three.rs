//! Reads cameras of three.js, alone or in a scene, and the clips that move them.

use std::path::Path;

use glam::{DAffine3, DMat4};
use serde::Deserialize;
use serde::de::DeserializeOwned;
use serde_json::Value;

use super::moving::{Interpolation, LensOfShot, NodeOfShot, Shot, Track, stated_of};
use super::{Stated, angle, fault};
use crate::error::Result;

/// Members of an object of a scene.
#[derive(Deserialize)]
struct Object {
    #[serde(rename = "type")]
    kind: String,
    name: Option<String>,
    uuid: Option<String>,
    matrix: Option<Vec<f64>>,
    children: Option<Vec<Value>>,
}

/// The lens of a camera.
#[derive(Deserialize)]
struct OfCamera {
    #[serde(rename = "type")]
    kind: String,
    fov: Option<f64>,
    zoom: Option<f64>,
    top: Option<f64>,
    bottom: Option<f64>,
    left: Option<f64>,
    right: Option<f64>,
    #[serde(rename = "filmOffset")]
    film_offset: Option<f64>,
    view: Option<SubView>,
}

/// A part of a larger picture.
#[derive(Deserialize)]
struct SubView {
    enabled: Option<bool>,
}

/// An animation.
#[derive(Deserialize)]
struct Clip {
    #[serde(default)]
    tracks: Vec<Keys>,
}

/// Keys of one property of one object.
#[derive(Deserialize)]
struct Keys {
    /// `OBJECT.PROPERTY`.
    name: String,
    times: Vec<f64>,
    values: Vec<f64>,
    interpolation: Option<u32>,
}

/// Three.js's numbers of the courses between keys.
const DISCRETE: u32 = 2300;
const LINEAR: u32 = 2301;

/// Vertical angle of view of a camera that states none, degrees: three.js's own default.
const DEFAULT_FOV: f64 = 50.0;

/// An object, and what moves it.
struct Placed {
    object: Object,
    value: Value,
    parent: Option<usize>,
    node: NodeOfShot,
    /// Vertical angle of view, radians.
    fov: Option<Track<1>>,
}

/// Returns the cameras of a scene, a camera or a clip.
pub(super) fn stated(path: &Path, value: Value, rate: Option<f64>) -> Result<Vec<Stated>> {
    let clips = match value.get("object") {
        None => Value::Array(vec![value.clone()]),
        Some(_) => value
            .get("animations")
            .cloned()
            .unwrap_or(Value::Array(Vec::new())),
    };
    let clips: Vec<Clip> = parsed(path, "animations", clips)?;
    let mut placed = match value.get("object") {
        Some(object) => objects(path, object.clone())?,
        None => objects(path, moved_by(path, &clips)?)?,
    };
    let is_alone = value.get("object").is_none();
    for keys in clips.iter().flat_map(|clip| &clip.tracks) {
        let Some((name, property)) = keys.name.rsplit_once('.') else {
            continue;
        };
        let is_named = |own: &&mut Placed| {
            let names = [&own.object.name, &own.object.uuid];
            is_alone || names.iter().any(|own| own.as_deref() == Some(name))
        };
        let of_name = match name {
            "" => placed.first_mut(),
            _ => placed.iter_mut().find(is_named),
        };
        let Some(own) = of_name else { continue };
        // Of several clips the first counts.
        match property {
            "position" if own.node.position.is_none() => {
                own.node.position = Some(track(path, keys, 1.0)?);
            }
            "quaternion" if own.node.rotation.is_none() => {
                own.node.rotation = Some(track(path, keys, 1.0)?);
            }
            "fov" if own.fov.is_none() => own.fov = Some(track(path, keys, 1_f64.to_radians())?),
            _ => {}
        }
    }
    let mut shots = Vec::new();
    for (i, own) in placed.iter().enumerate() {
        if !["PerspectiveCamera", "OrthographicCamera"].contains(&own.object.kind.as_str()) {
            continue;
        }
        let mut nodes = Vec::new();
        let mut next = Some(i);
        while let Some(at) = next {
            nodes.push(placed[at].node.clone());
            next = placed[at].parent;
        }
        nodes.reverse();
        let name = own.object.name.clone();
        let name = name
            .filter(|name| !name.is_empty())
            .unwrap_or_else(|| shots.len().to_string());
        let of_camera = parsed(path, "object", own.value.clone())?;
        let lens = lens(path, &name, &of_camera, own.fov.clone())?;
        shots.push(Shot { name, nodes, lens });
    }
    if shots.is_empty() {
        let expected = "a PerspectiveCamera or an OrthographicCamera";
        return Err(fault(
            path,
            "object",
            expected,
            placed[0].object.kind.clone(),
        ));
    }
    stated_of(path, &shots, rate)
}

fn parsed<T: DeserializeOwned>(path: &Path, place: &'static str, value: Value) -> Result<T> {
    serde_json::from_value(value)
        .map_err(|e| fault(path, place, "objects of three.js", e.to_string()))
}

/// Returns the camera that a clip without a scene moves.
fn moved_by(path: &Path, clips: &[Clip]) -> Result<Value> {
    let tracks = clips.iter().flat_map(|clip| &clip.tracks);
    let mut names: Vec<&str> = tracks
        .filter_map(|keys| keys.name.rsplit_once('.'))
        .filter(|(_, property)| ["position", "quaternion", "fov"].contains(property))
        .map(|(name, _)| name)
        .collect();
    names.sort_unstable();
    names.dedup();
    match names[..] {
        [name] => Ok(serde_json::json!({ "type": "PerspectiveCamera", "name": name })),
        _ => {
            let expected =
                "tracks .position and .quaternion of one object, or the scene with its cameras";
            let found = format!("those of {} objects", names.len());
            Err(fault(path, "tracks", expected, found))
        }
    }
}

/// Returns an object and all below it, parents first.
fn objects(path: &Path, root: Value) -> Result<Vec<Placed>> {
    let (mut placed, mut open) = (Vec::new(), vec![(root, None)]);
    while let Some((mut value, parent)) = open.pop() {
        let children = value.get_mut("children").map(Value::take);
        let mut object: Object = parsed(path, "object", value.clone())?;
        object.children = parsed(path, "children", children.unwrap_or(Value::Null))?;
        let rest = match &object.matrix {
            None => DAffine3::IDENTITY,
            Some(numbers) => {
                let own = <&[f64; 16]>::try_from(numbers.as_slice()).map_err(|_| {
                    let found = format!("{} numbers", numbers.len());
                    fault(path, "matrix", "a matrix of 16 numbers", found)
                })?;
                DAffine3::from_mat4(DMat4::from_cols_array(own))
            }
        };
        let children = object.children.take().unwrap_or_default();
        open.extend(
            children
                .into_iter()
                .rev()
                .map(|own| (own, Some(placed.len()))),
        );
        placed.push(Placed {
            object,
            value,
            parent,
            node: NodeOfShot {
                rest,
                position: None,
                rotation: None,
            },
            fov: None,
        });
    }
    Ok(placed)
}

/// Returns the keys of a property, times a factor.
fn track<const N: usize>(path: &Path, keys: &Keys, factor: f64) -> Result<Track<N>> {
    let place = || format!("track {}", keys.name.chars().take(40).collect::<String>());
    let interpolation = match keys.interpolation {
        None | Some(LINEAR) => Interpolation::Linear,
        Some(DISCRETE) => Interpolation::Step,
        Some(other) => {
            let expected = "straight or discrete interpolation, 2301 or 2300";
            return Err(fault(path, place(), expected, other.to_string()));
        }
    };
    let (values, rest) = keys.values.as_chunks::<N>();
    let values = values.iter().map(|own| own.map(|x| x * factor)).collect();
    let track = Track::new(keys.times.clone(), values, interpolation);
    track.filter(|_| rest.is_empty()).ok_or_else(|| {
        let expected = format!("keys in the order of time, with {N} numbers for each");
        let found = format!(
            "{} keys with {} numbers",
            keys.times.len(),
            keys.values.len()
        );
        fault(path, place(), &expected, found)
    })
}

/// Returns the lens of a camera.
fn lens(path: &Path, name: &str, own: &OfCamera, fov: Option<Track<1>>) -> Result<LensOfShot> {
    let zoom = own.zoom.unwrap_or(1.0);
    let is_part = own
        .view
        .as_ref()
        .is_some_and(|view| view.enabled == Some(true));
    let middle = |a: Option<f64>, b: Option<f64>| a.zip(b).map_or(0.0, |(a, b)| a + b);
    let off = middle(own.left, own.right).abs() + middle(own.top, own.bottom).abs();
    let heights = own.top.zip(own.bottom);
    let size = heights.map_or(1.0, |(a, b)| (a - b).abs());
    if is_part || off > 1e-6 * size || own.film_offset.is_some_and(|offset| offset != 0.0) {
        let expected = "a camera whose axis is in the middle of the picture";
        let found = "a view, a film's offset or a frustum beside the axis";
        return Err(fault(path, "object", expected, found));
    }
    match (own.kind.as_str(), heights) {
        ("PerspectiveCamera", _) => {
            let rest = own.fov.unwrap_or(DEFAULT_FOV).to_radians();
            Ok(LensOfShot::Vertical(angle(path, name, rest)?, fov, zoom))
        }
        (_, Some((top, bottom))) => Ok(LensOfShot::Height((top - bottom) / zoom)),
        (other, None) => {
            let expected =
                "a PerspectiveCamera with fov, or an OrthographicCamera with top and bottom";
            Err(fault(path, "object", expected, other))
        }
    }
}
