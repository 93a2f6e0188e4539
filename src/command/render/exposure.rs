//! Defines the options of lens and shutter.

use crate::command::parse;
use crate::sample::Motion;
use crate::stages::blocks::BlockedVolume;
use crate::view::Aperture;
use crate::{Error, Renderer, Result};
use clap::Args;

/// Pictures of a lens with opaque surfaces, if no option says the number.
const PICTURES_OF_SURFACES: usize = 64;

/// Pictures while a camera moves, if no option says the number.
const PICTURES_OF_MOTION: usize = 32;

/// Options that blurred pictures have no use for, or that see all depths in focus.
const SHARP: [&str; 14] = [
    "reference",
    "measure_error",
    "calibrate",
    "mpi",
    "column_density",
    "depth",
    "normals",
    "deep",
    "depth_of",
    "depth_in",
    "background_image",
    "projection",
    "ortho",
    "thresholds",
];

#[derive(Args)]
#[command(next_help_heading = "Lens and shutter")]
pub(in crate::command) struct ExposureOptions {
    /// Blur what is out of focus: diameter of the lens's opening, world units
    #[arg(long, value_name = "D", value_parser = parse::positive, conflicts_with_all = SHARP)]
    aperture: Option<f64>,
    /// Depth in focus, world units along the direction of view [default: that of --target, or of the middle of the data]
    #[arg(long, value_name = "D", value_parser = parse::positive, requires = "aperture")]
    focus: Option<f64>,
    /// Blur motion in this time: for --velocity a length over a velocity of the data, for --turntable and --camera-path in
    /// pictures of the sequence
    #[arg(long, value_name = "T", value_parser = parse::positive, conflicts_with_all = SHARP, conflicts_with_all = ["series", "stereo"])]
    shutter: Option<f64>,
    /// Move particles by this vector field, or by three scalars, while the shutter is open
    #[arg(long, value_name = "NAME|X,Y,Z", requires = "shutter",
          conflicts_with_all = ["turntable", "camera_path", "flatten", "surface"])]
    velocity: Option<String>,
    /// Average this many pictures [default: 16; opaque surfaces 64; moving cameras 32]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=4096))]
    exposures: Option<u16>,
}

impl ExposureOptions {
    /// Refuses `--shutter` without motion, and `--exposures` without blur.
    ///
    /// - `camera_moves`: whether the cameras of a sequence follow a path.
    /// - `turns`: whether inputs are turned, and vector fields with them.
    pub(super) fn check(&self, camera_moves: bool, turns: bool) -> Result<()> {
        let fault = |option: &'static str, expected: &str| {
            let advice = "leave it out";
            Err(Error::invalid(option, "use", expected, "none", advice))
        };
        let is_of_scalars = self
            .velocity
            .as_ref()
            .is_some_and(|name| name.contains(','));
        if turns && is_of_scalars {
            return Err(Error::invalid(
                "--velocity",
                "use",
                "a vector field beside --rotate, which turns vectors",
                "three scalars",
                "leave --rotate out, and move the camera",
            ));
        }
        let moves = self.shutter.is_some() && camera_moves;
        if self.shutter.is_some() && !camera_moves && self.velocity.is_none() {
            return fault(
                "--shutter",
                "--velocity, or a camera that moves: --turntable or --camera-path",
            );
        }
        if self.exposures.is_some() && self.aperture.is_none() && !moves {
            return fault(
                "--exposures",
                "--aperture, or --shutter of a camera that moves",
            );
        }
        Ok(())
    }

    /// Returns the motion of particles while the shutter is open.
    pub(super) fn motion(&self) -> Option<Motion> {
        Some(Motion {
            field: self.velocity.clone()?,
            time: self.shutter?,
        })
    }

    /// Returns the opening's diameter and the depth in focus, if they are given; world units.
    pub(super) fn lens(&self) -> (Option<f64>, Option<f64>) {
        (self.aperture, self.focus)
    }

    /// Returns the time during which the camera moves, in pictures of the sequence, if it does.
    pub(super) fn of_camera(&self) -> Option<f64> {
        self.shutter.filter(|_| self.velocity.is_none())
    }

    /// Returns the number of averaged pictures.
    ///
    /// - `moves`: whether the camera moves while the shutter is open.
    pub(super) fn pictures(&self, renderer: &Renderer, moves: bool) -> usize {
        let asked = self.exposures.map(usize::from);
        let has_surfaces = || renderer.volumes().iter().any(BlockedVolume::is_surface);
        asked.unwrap_or_else(|| match moves {
            _ if self.aperture.is_some() && has_surfaces() => PICTURES_OF_SURFACES,
            true => PICTURES_OF_MOTION,
            false => Aperture::DEFAULT_PICTURES,
        })
    }
}
