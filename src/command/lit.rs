//! Defines the options of light.

use crate::scene::{Light, Lighting, Shadows};
use clap::Args;

use super::parse;

#[derive(Args)]
#[command(next_help_heading = "Light")]
pub(crate) struct LightOptions {
    /// Light volumes, too, by their field's gradient: a headlight over the left shoulder and a dim light from the
    /// right, unless --light says otherwise. Meshes and iso-surfaces are lit anyway, by their normals
    #[arg(long, conflicts_with_all = ["reference", "column_density"])]
    lit: bool,
    /// Light nothing: meshes show the colours of their materials
    #[arg(long, conflicts_with_all = ["lit", "lights"])]
    unlit: bool,
    /// Direction towards a light, in the world, and its linear colour [default: white]; may be
    /// repeated, up to 8 times. Implies --lit
    #[arg(long = "light", value_name = "x,y,z[,r,g,b]", value_parser = parse::light,
          allow_hyphen_values = true, conflicts_with_all = ["reference", "column_density"])]
    lights: Vec<Light>,
    /// Let everything that is shown cast shadows of the lights. Implies --lit
    #[arg(long, conflicts_with_all = ["unlit", "reference", "column_density"])]
    shadows: bool,
    /// Size of the lights, 0 to 15 degrees (a standard deviation): shadows blur with distance
    /// [default: 0]. Implies --shadows
    #[arg(long, value_name = "DEG", value_parser = parse::softness, allow_hyphen_values = true,
          conflicts_with_all = ["unlit", "reference", "column_density"])]
    shadow_softness: Option<f64>,
}

impl LightOptions {
    /// Returns true if surfaces are drawn unlit.
    pub(crate) fn is_unlit(&self) -> bool {
        self.unlit
    }

    /// Returns the lighting of volumes, if they are lit.
    pub(crate) fn lighting(&self) -> Option<Lighting> {
        let shadows = (self.shadows || self.shadow_softness.is_some()).then(|| Shadows {
            softness_deg: self.shadow_softness.unwrap_or_default(),
        });
        let lighting = lighting(self.lit || shadows.is_some(), &self.lights);
        lighting.map(|lighting| Lighting {
            shadows,
            ..lighting
        })
    }
}

/// Options of light for files.
#[derive(Args)]
#[command(next_help_heading = "Light")]
pub(crate) struct FileLightOptions {
    /// Bake light into the colours of surfaces and fields, as harmonics of degree 2; in a prepared scene, keep
    /// normals for pictures with --lit or --light
    #[arg(long)]
    lit: bool,
    /// Bake a light from this direction, with its linear colour [default: a headlight that follows the viewer]; up to
    /// 8 times. Implies --lit
    #[arg(long = "light", value_name = "x,y,z[,r,g,b]", value_parser = parse::light,
          allow_hyphen_values = true)]
    lights: Vec<Light>,
}

impl FileLightOptions {
    /// Returns the lighting that is asked for.
    pub(crate) fn lighting(&self) -> Option<Lighting> {
        lighting(self.lit, &self.lights)
    }

    /// Returns whether lights of their own are given.
    pub(crate) fn has_lights(&self) -> bool {
        !self.lights.is_empty()
    }
}

fn lighting(lit: bool, lights: &[Light]) -> Option<Lighting> {
    if !lights.is_empty() {
        return Some(Lighting {
            lights: lights.to_vec(),
            ..Lighting::default()
        });
    }
    lit.then(Lighting::default)
}
