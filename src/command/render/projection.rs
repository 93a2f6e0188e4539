//! Defines the options of projections other than a plane: panoramas.

use clap::{Args, ValueEnum};

use crate::command::parse;
use crate::view::{Camera, FisheyeRule, MOST_FISHEYE_DEG, Mapping, NamedCamera, Panorama};
use crate::{Error, Result};

/// Pixels along a base pixel of an all-sky map if no option says it: pixels of half a degree.
const DEFAULT_NSIDE: u32 = 128;

/// Field of view of fisheyes and domes, degrees, if no option says it.
const DEFAULT_FISHEYE_DEG: f64 = 180.0;

#[derive(Args)]
#[command(next_help_heading = "Camera")]
pub(in crate::command) struct ProjectionOptions {
    /// How directions become places in the picture. Panoramas are taken from --eye, a camera's file, or the middle of the data
    #[arg(long, value_enum, value_name = "NAME")]
    projection: Option<ProjectionName>,
    /// Full angle across the circle of a fisheye or a dome, degrees, up to 360 [default: 180]
    #[arg(long, value_name = "DEG", value_parser = fisheye_fov, requires = "projection")]
    fisheye_fov: Option<f64>,
    /// Distance from the middle of a fisheye: in proportion to the angle, or so that pixels see equal solid angles
    /// [default: equidistant]
    #[arg(long, value_enum, value_name = "NAME", requires = "projection")]
    fisheye: Option<FisheyeName>,
    /// Pixels along the side of a base pixel of a healpix map, a power of two up to 2048: the map has 12 n² pixels
    /// [default: 128]
    #[arg(long, value_name = "N", value_parser = nside, requires = "projection", conflicts_with = "size")]
    nside: Option<u32>,
    /// Two pictures, the left eye's over the right eye's, from eyes this far apart in world units that look in one direction
    #[arg(long, value_name = "D", value_parser = parse::positive, conflicts_with_all = ["reference", "measure_error", "calibrate",
          "mpi", "column_density", "deep", "depth_of", "depth_in", "background_image", "legend", "axes", "outline", "scale_bar",
          "title", "time_stamp"])]
    stereo: Option<f64>,
}

#[derive(Debug, Clone, Copy, PartialEq, ValueEnum)]
enum ProjectionName {
    /// A plane before the eye [default]
    Perspective,
    /// Parallel rays: --ortho, of a fitted height without it
    Ortho,
    /// 360 degrees across, 180 down: the panorama that viewers of spherical pictures read
    Equirect,
    /// A circle around the direction of view
    Fisheye,
    /// The master of a dome: a fisheye around what is up; the lower edge is in front
    Dome,
    /// Six squares in a row: right, left, up, down, front, back
    Cube,
    /// As the lens of --camera's file sees it: distorted, a fisheye or a sphere [default for the last two]
    Lens,
    /// An all-sky map in ring order and the axes of the data, fits or npy
    Healpix,
}

#[derive(Debug, Clone, Copy, PartialEq, ValueEnum)]
enum FisheyeName {
    Equidistant,
    Equisolid,
}

fn fisheye_fov(text: &str) -> std::result::Result<f64, String> {
    let angle = text
        .parse()
        .ok()
        .filter(|fov| *fov > 0.0 && *fov <= MOST_FISHEYE_DEG);
    angle.ok_or_else(|| "degrees above 0, at most 360".into())
}

fn nside(text: &str) -> std::result::Result<u32, String> {
    let number = text.parse().ok();
    let number = number.filter(|n: &u32| n.is_power_of_two() && *n <= 2048);
    number.ok_or_else(|| "a power of two, at most 2048".into())
}

impl ProjectionOptions {
    /// Returns true if the picture is a panorama.
    ///
    /// - `named`: the camera of a file, if it is one.
    pub(super) fn is_panorama(&self, named: Option<&NamedCamera>) -> bool {
        let plane = [
            None,
            Some(ProjectionName::Perspective),
            Some(ProjectionName::Ortho),
        ];
        named.is_some_and(|named| self.is_lens_of(named)) || !plane.contains(&self.projection)
    }

    /// Returns the distance of two eyes, if there are two.
    pub(super) fn stereo(&self) -> Option<f64> {
        self.stereo
    }

    /// Returns true if the picture is to be that of a file's lens.
    pub(super) fn is_lens(&self) -> bool {
        self.projection == Some(ProjectionName::Lens)
    }

    /// Returns whether the picture of a file's camera is drawn as its lens bends it.
    pub(super) fn is_lens_of(&self, named: &NamedCamera) -> bool {
        match self.projection {
            None => named.is_wide(),
            Some(name) => name == ProjectionName::Lens,
        }
    }

    /// Returns true if a plane in perspective is asked for.
    pub(super) fn is_perspective(&self) -> bool {
        self.projection == Some(ProjectionName::Perspective)
    }

    /// Returns true if the rays are parallel.
    pub(super) fn is_ortho(&self) -> bool {
        self.projection == Some(ProjectionName::Ortho)
    }

    /// Returns true if the picture is a map of the sphere.
    pub(super) fn is_sky(&self) -> bool {
        self.projection == Some(ProjectionName::Healpix)
    }

    /// Returns whether the horizon of a panorama is level, whatever the direction of view.
    pub(super) fn is_level(&self) -> bool {
        self.projection != Some(ProjectionName::Fisheye)
    }

    /// Returns the size of a panorama's picture if no option says it.
    pub(super) fn default_size(&self) -> Option<[usize; 2]> {
        match self.projection? {
            ProjectionName::Equirect => Some([2048, 1024]),
            ProjectionName::Cube => Some([3072, 512]),
            ProjectionName::Fisheye | ProjectionName::Dome => Some([1024, 1024]),
            ProjectionName::Perspective
            | ProjectionName::Ortho
            | ProjectionName::Lens
            | ProjectionName::Healpix => None,
        }
    }

    /// Returns the panorama of a camera, or `None` for a picture of the camera itself.
    pub(super) fn panorama(
        &self,
        camera: &Camera,
        named: Option<&NamedCamera>,
    ) -> Option<Panorama> {
        if let Some(named) = named.filter(|named| self.is_lens_of(named)) {
            return Some(Panorama::of_camera(camera, named.mapping?));
        }
        let fov_deg = self.fisheye_fov.unwrap_or(DEFAULT_FISHEYE_DEG);
        let rule = match self.fisheye {
            Some(FisheyeName::Equisolid) => FisheyeRule::Equisolid,
            _ => FisheyeRule::Equidistant,
        };
        let of = |mapping| Some(Panorama::of_camera(camera, mapping));
        match self.projection? {
            ProjectionName::Perspective | ProjectionName::Ortho | ProjectionName::Lens => None,
            ProjectionName::Equirect => of(Mapping::Equirectangular),
            ProjectionName::Fisheye => of(Mapping::Fisheye { rule, fov_deg }),
            ProjectionName::Dome => Some(Panorama::dome(camera, fov_deg)),
            ProjectionName::Cube => of(Mapping::Cube),
            ProjectionName::Healpix => {
                let n = self.nside.unwrap_or(DEFAULT_NSIDE);
                Some(Panorama::sky(camera.eye, n as usize))
            }
        }
    }

    /// Refuses options of another projection.
    pub(super) fn check(&self) -> Result<()> {
        let is_round = [ProjectionName::Fisheye, ProjectionName::Dome];
        let is_round = self.projection.is_some_and(|name| is_round.contains(&name));
        let is_fisheye = self.projection == Some(ProjectionName::Fisheye);
        for (option, is_given, has_use, expected) in [
            (
                "--fisheye-fov",
                self.fisheye_fov.is_some(),
                is_round,
                "fisheye or dome",
            ),
            ("--fisheye", self.fisheye.is_some(), is_fisheye, "fisheye"),
            ("--nside", self.nside.is_some(), self.is_sky(), "healpix"),
        ] {
            if is_given && !has_use {
                let found = "another projection";
                return Err(Error::invalid(
                    option,
                    "--projection",
                    expected,
                    found,
                    "leave it out",
                ));
            }
        }
        Ok(())
    }
}
