//! Defines the options of light.

use crate::scene::{Light, Lighting};
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
}

impl LightOptions {
    /// Returns true if surfaces are drawn unlit.
    pub(crate) fn is_unlit(&self) -> bool {
        self.unlit
    }

    /// Returns the lighting of volumes, if they are lit.
    pub(crate) fn lighting(&self) -> Option<Lighting> {
        if !self.lights.is_empty() {
            return Some(Lighting {
                lights: self.lights.clone(),
                ..Lighting::default()
            });
        }
        self.lit.then(Lighting::default)
    }
}
