//! Converts options to the view that a page opens with: camera, settings and transfer function, as a link of the page holds
//! them.

use glam::{DQuat, DVec3};
use serde_json::{Map, Value, json};

use super::options::Arguments;
use crate::command::parse::Background;
use crate::command::render::{self, Shown};
use crate::image::{byte, srgb_from_linear};
use crate::io::StepChoice;
use crate::load::Input;
use crate::scene::{COLOUR_MAP_NAMES, Light, LightFrame};
use crate::view::{Camera, Projection};
use crate::{Error, Result};

/// Greatest cosine between the view and what is up in the data at which the camera turns about it, as the page has it.
const MOST_ALONG: f64 = 0.999;

/// Returns the view of data as they are.
///
/// # Errors
/// Options that the page has in a simpler form.
pub(super) fn of_data(arguments: &Arguments, shown: &Shown, named: &Input) -> Result<Value> {
    let own = &arguments.render;
    let (data, method) = (&own.data, &own.method);
    let mut settings = common(own)?;
    let mut set = |name: &str, value: Value| {
        if !value.is_null() {
            settings.insert(name.into(), value);
        }
    };
    let field = named.field.as_ref().or(data.field.as_ref());
    let asked = named.function.as_ref().or(data.transfer_function.as_ref());
    let map = asked.filter(|name| COLOUR_MAP_NAMES.contains(&name.as_str()));
    let function = asked.filter(|_| map.is_none());
    if method.column_density {
        if let Some(file) = function {
            let expected = "the name of a colour map, for columns";
            return refused("--transfer-function", expected, file);
        }
        set("columns", true.into());
        set("of", json!(field));
        set("mean", json!(method.column_mean));
    } else {
        set("field", json!(field));
        set("isosurface", json!(data.flatten));
        set("surface", json!(data.surface.then_some(true)));
        // A function from a file has them already.
        let opacity = (data.opacity_scale != 1.0).then_some(data.opacity_scale);
        set("opacity", json!(opacity.filter(|_| function.is_none())));
        set(
            "composite",
            json!(
                arguments
                    .is_given("composite")
                    .then(|| method.composite().name())
            ),
        );
        set("thickness", json!(method.slab_thickness));
        light(own, &mut set)?;
    }
    set("map", json!(map));
    if function.is_none() {
        set("range", json!(data.range));
        set("scale", json!(data.scale_name().map(|scale| scale.name())));
    }
    let step = match data.step {
        None => Value::Null,
        Some(StepChoice::Number(number)) => json!(number),
        Some(StepChoice::Last) => json!(-1),
        Some(StepChoice::Time(time)) => {
            return refused("--time", "the number of a step", &time.to_string());
        }
    };
    set("step", step);
    let function = match (&shown.function, function) {
        (Some(function), Some(_)) => serde_json::from_str(&function.to_json()).unwrap_or_default(),
        _ => Value::Null,
    };
    let camera = arguments
        .has_camera()
        .then(|| camera(shown, DQuat::IDENTITY));
    Ok(json!({ "camera": camera, "settings": settings, "function": function }))
}

/// Returns the view of splats made of the data.
///
/// - `turn`: rotation from the data to the splats.
///
/// # Errors
/// Several clip planes.
pub(super) fn of_splats(own: &render::Arguments, shown: &Shown, turn: DQuat) -> Result<Value> {
    let mut settings = common(own)?;
    if let Some([x, y, z, d]) = plane(own)? {
        let normal = turn * DVec3::new(x, y, z);
        settings.insert("clip".into(), json!([normal.x, normal.y, normal.z, d]));
    }
    Ok(json!({ "camera": camera(shown, turn), "settings": settings, "function": null }))
}

/// Returns the settings of all that a page shows.
fn common(own: &render::Arguments) -> Result<Map<String, Value>> {
    let mut settings = Map::new();
    if let Some(tolerance) = own.method.tolerance {
        settings.insert("tolerance".into(), json!(wide(tolerance)));
    }
    if let Some(plane) = plane(own)? {
        settings.insert("clip".into(), json!(plane));
    }
    let background = match own.output.background {
        None => None,
        Some(Background::None) => Some(String::new()),
        Some(Background::Colour(rgb)) => {
            let [r, g, b] = rgb.map(|c| byte(srgb_from_linear(c)));
            Some(format!("#{r:02x}{g:02x}{b:02x}"))
        }
    };
    if let Some(background) = background {
        settings.insert("background".into(), background.into());
    }
    Ok(settings)
}

/// Returns the number that is written as a narrow one is: .01, not the narrow number nearest to it.
fn wide(narrow: f32) -> f64 {
    narrow.to_string().parse().unwrap_or(narrow.into())
}

/// Returns the clip plane, if there is one.
fn plane(own: &render::Arguments) -> Result<Option<[f64; 4]>> {
    match own.clip_planes().as_slice() {
        [] => Ok(None),
        [plane] => {
            let [x, y, z] = plane.normal.to_array();
            Ok(Some([x, y, z, plane.distance]))
        }
        several => refused(
            "--clip, --window",
            "one plane",
            &format!("{} of them", several.len()),
        ),
    }
}

/// Sets the light.
fn light(own: &render::Arguments, set: &mut impl FnMut(&str, Value)) -> Result<()> {
    if own.light.is_unlit() {
        set("light", "off".into());
        return Ok(());
    }
    let Some(lighting) = own.light.lighting() else {
        return Ok(());
    };
    set("light", "on".into());
    let is_default = lighting.lights == crate::scene::Lighting::default().lights;
    match lighting.lights.as_slice() {
        _ if is_default => {}
        [
            Light {
                direction,
                frame: LightFrame::World,
                colour: [1.0, 1.0, 1.0],
            },
        ] => set("direction", json!(direction.to_array())),
        [_] => return refused("--light", "a direction alone, of white light", "a colour"),
        several => {
            return refused(
                "--light",
                "one light",
                &format!("{} of them", several.len()),
            );
        }
    }
    if let Some(shadows) = lighting.shadows {
        set("shadows", true.into());
        set(
            "softness",
            json!((shadows.softness_deg > 0.0).then_some(shadows.softness_deg)),
        );
    }
    Ok(())
}

fn refused<T>(option: &'static str, expected: &str, found: &str) -> Result<T> {
    let advice = "change it, or add --size or --error, which make kernels of what is drawn";
    Err(Error::invalid(option, "page", expected, found, advice))
}

/// Returns a camera in the page's form: it looks at a point amid the data.
fn camera(shown: &Shown, turn: DQuat) -> Value {
    let own = &shown.camera;
    let corners = shown
        .boxes
        .iter()
        .map(|(centre, half)| (*centre - *half, *centre + *half));
    let (low, high) = corners
        .reduce(|a, b| (a.0.min(b.0), a.1.max(b.1)))
        .unwrap_or((own.eye - DVec3::ONE, own.eye + DVec3::ONE));
    let forward = own.forward();
    let least = ((high - low).length() * 1e-3).max(1e-30);
    let distance = ((low + high) / 2.0 - own.eye).dot(forward).max(least);
    let rows = own.camera_from_world.transpose();
    let (right, down) = (rows.x_axis, rows.y_axis);
    // What is up in the data stays up, unless the camera rolls or looks along it.
    let up = shown.up.direction;
    let is_level =
        up.dot(right).abs() < 1e-6 && up.dot(down) < 0.0 && up.dot(forward).abs() < MOST_ALONG;
    let up = if is_level { up } else { -down };
    let height = own.height as f64 / own.focal_px.y;
    let mut found = json!({
        "eye": (turn * own.eye).to_array(),
        "target": (turn * (own.eye + forward * distance)).to_array(),
        "up": (turn * up).to_array(),
    });
    match own.projection {
        Projection::Orthographic => found["ortho_height"] = json!(height),
        Projection::Perspective => {
            found["fov_deg"] = json!(2.0 * (height / 2.0).atan().to_degrees())
        }
    }
    found
}

/// Returns what the page changes of a camera from a file: it has square pixels, and looks at the middle.
pub(super) fn note(camera: &Camera) -> Option<String> {
    let middle = glam::DVec2::new(camera.width as f64, camera.height as f64) / 2.0;
    let off = (camera.centre_px - middle).abs().max_element();
    let ratio = camera.focal_px.x / camera.focal_px.y;
    (off > 0.5 || (ratio - 1.0).abs() > 1e-3).then(|| {
        format!(
            "the page shows the camera's view from its middle, with square pixels: the camera's is {off:.1} px off, with pixels of 1:{ratio:.4}"
        )
    })
}
