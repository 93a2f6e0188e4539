//! Writes the command that makes the picture of the window.

use ewa_splat::Settings;
use ewa_splat::command::{Over, ViewRequest};
use ewa_splat::render::{Classification, Composite, Show};
use ewa_splat::scene::{Light, LightFrame, Shadows};

use crate::orbit::{Lens, Orbit};

/// Options that the window's state replaces.
const REPLACED: [&str; 31] = [
    "eye",
    "target",
    "up",
    "fov",
    "ortho",
    "azimuth",
    "elevation",
    "zoom",
    "fit",
    "camera",
    "camera-name",
    "size",
    "tolerance",
    "filter",
    "composite",
    "slab-thickness",
    "post-classification",
    "classify",
    "level-of-detail",
    "clip",
    "show",
    "background",
    "lit",
    "unlit",
    "light",
    "shadows",
    "shadow-softness",
    "series",
    "legend",
    "axes",
    "outline",
];

/// State that a window shows.
pub(crate) struct State<'a> {
    pub(crate) request: &'a ViewRequest,
    /// Chosen inputs.
    pub(crate) inputs: Vec<&'a str>,
    pub(crate) field: Option<&'a str>,
    /// File of an edited transfer function.
    pub(crate) function: Option<&'a str>,
    pub(crate) orbit: &'a Orbit,
    /// Settings asked for, and current settings.
    pub(crate) settings: [&'a Settings; 2],
    /// Overlays of the picture.
    pub(crate) over: Over,
    pub(crate) size: [usize; 2],
    pub(crate) out: &'a str,
}

/// Returns the arguments of the command, without a shell's quotes.
pub(crate) fn words(state: &State<'_>) -> Vec<String> {
    let mut words = vec!["ewa-splat".to_owned(), "render".to_owned()];
    words.extend(state.inputs.iter().map(|input| (*input).to_owned()));
    let mut say = |name: &str, value: Option<String>| {
        // With `=`, a value may begin with a dash.
        words.push(match value {
            Some(value) => format!("--{name}={value}"),
            None => format!("--{name}"),
        });
    };
    let [asked, now] = state.settings;
    const OF_LIGHT: [&str; 5] = ["lit", "unlit", "light", "shadows", "shadow-softness"];
    let lights_volumes = state
        .request
        .given()
        .iter()
        .any(|(name, _)| name != "unlit" && OF_LIGHT.contains(&name.as_str()));
    let keeps_light = asked.lighting == now.lighting;
    for (name, value) in state.request.given() {
        let is_light = OF_LIGHT.contains(&name.as_str());
        let is_replaced = REPLACED.contains(&name.as_str()) && !(is_light && keeps_light);
        let is_field = name == "field" && state.field.is_some();
        let is_function = [
            "transfer-function",
            "range",
            "scale",
            "opacity-scale",
            "unit-distance",
        ]
        .contains(&name.as_str())
            && state.function.is_some();
        if !(is_replaced || is_field || is_function) {
            say(name, value.clone());
        }
    }
    if let Some(field) = state.field {
        say("field", Some(field.to_owned()));
    }
    if let Some(function) = state.function {
        say("transfer-function", Some(function.to_owned()));
    }
    let vector = |v: glam::DVec3| Some(format!("{},{},{}", v.x, v.y, v.z));
    say("eye", vector(state.orbit.eye));
    say("target", vector(state.orbit.target));
    say("up", vector(state.orbit.up));
    match state.orbit.lens {
        Lens::Perspective(fov) => say("fov", Some(fov.to_string())),
        Lens::Orthographic(height) => say("ortho", Some(height.to_string())),
    }
    say("size", Some(format!("{}x{}", state.size[0], state.size[1])));
    settings([asked, now], lights_volumes, &mut say);
    let over = state.over;
    let annotations = [
        ("legend", over.legend),
        ("axes", over.axes),
        ("outline", over.outline),
    ];
    for (name, _) in annotations.into_iter().filter(|(_, is_on)| *is_on) {
        say(name, None);
    }
    say("out", Some(state.out.to_owned()));
    words
}

/// Adds the options that differ from the defaults.
///
/// - `lights_volumes`: whether the options of the command line light volumes.
fn settings(
    [asked, now]: [&Settings; 2],
    lights_volumes: bool,
    say: &mut impl FnMut(&str, Option<String>),
) {
    let default = Settings::default();
    let text = |text: &str| Some(text.to_owned());
    if now.tolerance != default.tolerance {
        say("tolerance", Some(now.tolerance.to_string()));
    }
    if now.filter != default.filter {
        say("filter", text(now.filter.name()));
    }
    if now.composite != Composite::Over {
        say("composite", text(now.composite.name()));
    }
    if now.classify == Classification::Slab {
        say("post-classification", None);
    }
    if let Some(thickness) = now.composite.thickness() {
        say("slab-thickness", Some(thickness.to_string()));
    }
    if now.classify == Classification::Particle {
        say("classify", text("particle"));
    }
    if !now.level_of_detail {
        say("level-of-detail", text("off"));
    }
    for plane in &now.clip {
        let n = plane.normal;
        say(
            "clip",
            Some(format!("{},{},{},{}", n.x, n.y, n.z, plane.distance)),
        );
    }
    match now.show {
        Show::Scene => {}
        Show::Choice => say("show", text("choice")),
        Show::Count => say("show", text("count")),
    }
    match now.background {
        _ if now.background == asked.background => {}
        Some([r, g, b]) => say("background", Some(format!("{r},{g},{b}"))),
        None => say("background", text("none")),
    }
    match &now.lighting {
        _ if asked.lighting == now.lighting => {}
        None => say("unlit", None),
        Some(lighting) => {
            let in_world = |light: &&Light| light.frame == LightFrame::World;
            let is_implied =
                lighting.shadows.is_some() || lighting.lights.iter().any(|l| in_world(&l));
            if lights_volumes && !is_implied {
                say("lit", None);
            }
            for light in lighting.lights.iter().filter(in_world) {
                let (d, [r, g, b]) = (light.direction, light.colour);
                say(
                    "light",
                    Some(format!("{},{},{},{r},{g},{b}", d.x, d.y, d.z)),
                );
            }
            match lighting.shadows {
                None => {}
                Some(Shadows::SHARP) => say("shadows", None),
                Some(Shadows { softness_deg }) => {
                    say("shadow-softness", Some(softness_deg.to_string()));
                }
            }
        }
    }
}

/// Quotes the arguments for a shell.
pub(crate) fn line(words: &[String]) -> String {
    let is_plain = |c: char| c.is_ascii_alphanumeric() || "-_./,=:+@%".contains(c);
    let quoted = words.iter().map(|word| match word.chars().all(is_plain) {
        true => word.clone(),
        false => format!("'{}'", word.replace('\'', r"'\''")),
    });
    quoted.collect::<Vec<_>>().join(" ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_with_blanks_and_quotes_stay_one() {
        let words = ["a", "b c", "it's", "x@y"].map(str::to_owned);
        assert_eq!(line(&words), r"a 'b c' 'it'\''s' x@y");
    }
}
