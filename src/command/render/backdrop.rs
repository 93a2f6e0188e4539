//! Defines the options of what stands in a picture already, as another renderer drew it.

use std::path::PathBuf;

use crate::command::parse;
use crate::command::usage::first_given;
use crate::io::{read_depth, read_image};
use crate::render::{DepthKind, GivenBackdrop};
use crate::{Error, Result};
use clap::{Args, ValueEnum};

#[derive(Args)]
#[command(next_help_heading = "Other renderers")]
pub(in crate::command) struct BackdropOptions {
    /// Depths of what another renderer drew from the same camera: volumes and splats end there. exr, npy or pfm, of
    /// the picture's size
    #[arg(long, value_name = "FILE", conflicts_with_all = ["column_density", "camera_path", "turntable", "series"])]
    depth_in: Option<PathBuf>,
    /// Meaning of the numbers of --depth-in
    #[arg(long, value_enum, default_value = "z", requires = "depth_in")]
    depth_in_is: DepthName,
    /// Distances of the near and the far plane, for --depth-in-is opengl
    #[arg(long, value_name = "NEAR,FAR", value_parser = parse::near_and_far, requires = "depth_in",
          allow_hyphen_values = true)]
    depth_in_range: Option<[f64; 2]>,
    /// Picture behind the scene, of the same size: png, exr, pfm or npy. Without it what --depth-in hides is left
    /// transparent, or in the colour of --background
    #[arg(long, value_name = "FILE", conflicts_with_all = ["column_density", "camera_path", "turntable", "series"])]
    background_image: Option<PathBuf>,
    /// The files, once they are read.
    #[arg(skip)]
    pub(in crate::command) given: GivenBackdrop,
}

#[derive(Clone, Copy, PartialEq, ValueEnum)]
enum DepthName {
    /// Distance from the plane of the eye, as --depth writes it; infinite where nothing stands
    Z,
    /// Distance from the eye along the ray of each pixel
    Distance,
    /// A depth buffer of OpenGL, 0 to 1, between the planes of --depth-in-range
    Opengl,
}

impl BackdropOptions {
    /// Returns the name of an option, if one is given.
    pub(super) fn first(&self) -> Option<&'static str> {
        first_given([
            ("--depth-in", self.depth_in.is_some()),
            ("--background-image", self.background_image.is_some()),
        ])
    }

    /// Reads the files. Returns the size of a picture with this backdrop, if there is one.
    ///
    /// # Errors
    /// Files that cannot be read; a range that is missing, or has no meaning.
    pub(in crate::command) fn read(&mut self) -> Result<Option<[usize; 2]>> {
        let is_range_wanted = self.depth_in_is == DepthName::Opengl;
        if is_range_wanted != self.depth_in_range.is_some() {
            let [option, expected, found] = match is_range_wanted {
                true => [
                    "--depth-in-is opengl",
                    "--depth-in-range NEAR,FAR beside it",
                    "none",
                ],
                false => [
                    "--depth-in-range",
                    "--depth-in-is opengl beside it",
                    "another kind",
                ],
            };
            let advice = "add it";
            return Err(Error::invalid(option, "depths", expected, found, advice));
        }
        let depth = self.depth_in.as_deref().map(read_depth).transpose()?;
        let colours = self.background_image.as_deref();
        let colours = colours.map(read_image).transpose()?;
        let size = depth.as_ref().map(|depth| [depth.width, depth.height]);
        let size = size.or(colours.as_ref().map(|image| [image.width, image.height]));
        self.given = GivenBackdrop {
            depth,
            kind: self.kind(),
            colours,
        };
        Ok(size)
    }

    /// Returns the files that are read.
    pub(in crate::command) fn files(&self) -> impl Iterator<Item = &PathBuf> {
        let files = [&self.depth_in, &self.background_image];
        files.into_iter().flatten()
    }

    /// Returns whether another renderer's picture or its depths are given.
    pub(in crate::command) fn is_given(&self) -> bool {
        self.files().next().is_some()
    }

    fn kind(&self) -> DepthKind {
        match (self.depth_in_is, self.depth_in_range) {
            (DepthName::Distance, _) => DepthKind::Distance,
            (DepthName::Opengl, Some([near, far])) => DepthKind::OpenGl { near, far },
            _ => DepthKind::Z,
        }
    }
}
