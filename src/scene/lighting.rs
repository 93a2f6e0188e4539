//! Defines lights, and how particles reflect them.

use glam::DVec3;

use crate::constants::MAX_LIGHTS;
use crate::error::{Error, Result};

/// Directional lights and a material that all particles share: Blinn-Phong shading, once per
/// particle and never per pixel (Chen et al. 2004, section 4.4).
///
/// A particle of colour C with normal n, seen from the direction v, becomes
/// C (ambient + diffuse Σ L (n . l)) + specular Σ L (n . h)^shininess, h halfway between l and v,
/// over lights of colour L in direction l. Highlights have the colour of the light: white ones
/// show shape whatever the transfer function's colours are.
///
/// [`crate::shading`] explains where normals come from, why the model is Blinn-Phong, and what the sign of a
/// dot product means.
#[derive(Debug, Clone, PartialEq)]
pub struct Lighting {
    /// At most [`MAX_LIGHTS`].
    pub lights: Vec<Light>,
    /// Share of a colour that is present without any light.
    pub ambient: f32,
    /// Share of a colour that a light of colour 1 adds at normal incidence.
    pub diffuse: f32,
    /// Linear light that a light of colour 1 adds in the middle of a highlight.
    pub specular: f32,
    /// Exponent of highlights, 1 to 1000: the greater, the smaller the highlights.
    pub shininess: f32,
    /// Shadows of the lights; `None` lets light pass everything.
    pub shadows: Option<Shadows>,
}

/// Shadows: each light's diffuse and specular terms are multiplied by the transmittance toward the light.
/// [`crate::shading`] describes the method and its error.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Shadows {
    /// Size of each light, 0 to [`MAX_SOFTNESS_DEG`]: the standard deviation, in degrees, of a light that is a
    /// Gaussian in the sky. An edge's shadow blurs with the distance from the edge, by the angle's tangent.
    pub softness_deg: f64,
}

/// Greatest [`Shadows::softness_deg`]. Beyond it the light's directions differ too much for one grid.
pub const MAX_SOFTNESS_DEG: f64 = 15.0;

impl Shadows {
    /// Shadows of lights that are points in the sky.
    pub const SHARP: Self = Self { softness_deg: 0.0 };
}

/// A directional light: so far away that its direction is the same everywhere.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Light {
    /// Direction towards the light, of any length.
    pub direction: DVec3,
    /// Frame of the direction.
    pub frame: LightFrame,
    /// Linear RGB, from 0 up.
    pub colour: [f32; 3],
}

/// The frame to which a light is fixed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LightFrame {
    /// The world: the lit sides stay lit when the camera moves.
    World,
    /// The camera, whose x points right, y down and z away from the eye.
    Camera,
}

impl Default for Lighting {
    /// A headlight over the left shoulder, and one of a quarter of its strength from the right. A surface that
    /// faces the eye reflects about .9 of its colour; at no angle does one reflect more than all of it.
    /// Highlights add .2 at most.
    fn default() -> Self {
        let light = |direction, colour| Light {
            direction,
            frame: LightFrame::Camera,
            colour: [colour; 3],
        };
        Self {
            lights: vec![
                light(DVec3::new(-0.35, -0.45, -1.0), 1.0),
                light(DVec3::new(0.9, 0.1, -0.4), 0.25),
            ],
            ambient: 0.25,
            diffuse: 0.65,
            specular: 0.2,
            shininess: 32.0,
            shadows: None,
        }
    }
}

impl Lighting {
    /// Checks that there are at most [`MAX_LIGHTS`] lights and that every number is in range.
    ///
    /// # Errors
    /// The first number out of range.
    pub fn validate(&self) -> Result<()> {
        let refuse = |place: &str, expected: String, found: String| {
            Err(Error::invalid(
                "lighting",
                place,
                expected,
                found,
                "change it",
            ))
        };
        if self.lights.len() > MAX_LIGHTS {
            let expected = format!("at most {MAX_LIGHTS}");
            return refuse("lights", expected, self.lights.len().to_string());
        }
        for (place, share) in [
            ("ambient", self.ambient),
            ("diffuse", self.diffuse),
            ("specular", self.specular),
        ] {
            if !(share >= 0.0 && share.is_finite()) {
                return refuse(place, "a number from 0 up".into(), share.to_string());
            }
        }
        if !(1.0..=1000.0).contains(&self.shininess) {
            let found = self.shininess.to_string();
            return refuse("shininess", "a number from 1 to 1000".into(), found);
        }
        if let Some(Shadows { softness_deg }) = self.shadows
            && !(0.0..=MAX_SOFTNESS_DEG).contains(&softness_deg)
        {
            let expected = format!("degrees from 0 to {MAX_SOFTNESS_DEG}");
            return refuse("softness of shadows", expected, softness_deg.to_string());
        }
        for light in &self.lights {
            if light.direction.try_normalize().is_none() {
                let found = light.direction.to_string();
                return refuse("direction of a light", "a direction".into(), found);
            }
            if !light.colour.iter().all(|c| *c >= 0.0 && c.is_finite()) {
                let found = format!("{:?}", light.colour);
                return refuse("colour of a light", "three numbers from 0 up".into(), found);
            }
        }
        Ok(())
    }
}
