//! Defines the options of projections other than a plane: panoramas.

use std::path::Path;

use clap::{Args, ValueEnum};

use super::options::{Arguments, ShowName};
use crate::io::{check_folder, is_fits};
use crate::view::{Camera, FisheyeRule, MOST_FISHEYE_DEG, Mapping, Panorama};
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
    pub(in crate::command) fn is_panorama(&self) -> bool {
        let plane = [ProjectionName::Perspective, ProjectionName::Ortho];
        self.projection.is_some_and(|name| !plane.contains(&name))
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
        self.is_panorama() && self.projection != Some(ProjectionName::Fisheye)
    }

    /// Returns the size of a panorama's picture if no option says it.
    pub(super) fn default_size(&self) -> Option<[usize; 2]> {
        match self.projection? {
            ProjectionName::Equirect => Some([2048, 1024]),
            ProjectionName::Cube => Some([3072, 512]),
            ProjectionName::Fisheye | ProjectionName::Dome => Some([1024, 1024]),
            ProjectionName::Perspective | ProjectionName::Ortho | ProjectionName::Healpix => None,
        }
    }

    /// Returns the panorama of a camera, or `None` for a picture of the camera itself.
    pub(super) fn panorama(&self, camera: &Camera) -> Option<Panorama> {
        let fov_deg = self.fisheye_fov.unwrap_or(DEFAULT_FISHEYE_DEG);
        let rule = match self.fisheye {
            Some(FisheyeName::Equisolid) => FisheyeRule::Equisolid,
            _ => FisheyeRule::Equidistant,
        };
        let of = |mapping| Some(Panorama::of_camera(camera, mapping));
        match self.projection? {
            ProjectionName::Perspective | ProjectionName::Ortho => None,
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
    fn check(&self) -> Result<()> {
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

impl Arguments {
    /// Refuses options that the projection has no use for.
    pub(super) fn check_projection(&self) -> Result<()> {
        self.projection.check()?;
        let fault = |option: &'static str, found: &str| {
            let expected = "perspective or ortho";
            Err(Error::invalid(
                option,
                "--projection",
                expected,
                found,
                "leave it out",
            ))
        };
        if !self.projection.is_panorama() {
            return match self.camera.of_perspective() {
                Some(option) if self.projection.is_ortho() => {
                    let expected = "perspective";
                    Err(Error::invalid(
                        option,
                        "--projection",
                        expected,
                        "ortho",
                        "leave it out",
                    ))
                }
                _ => Ok(()),
            };
        }
        let (method, output) = (&self.method, &self.output);
        let of_planes = [
            ("--reference", method.reference.is_some()),
            ("--measure-error", method.measure_error),
            ("--calibrate", method.calibrate),
            ("--slice", method.slice.is_some()),
            ("--column-mean", method.column_mean.is_some()),
            ("--deep", output.deep.is_some()),
            ("--depth-of", output.depth_of.of_deep().is_some()),
            ("--show count", matches!(output.show, ShowName::Count)),
            ("--depth-in", !self.backdrop.is_empty()),
            ("--mpi", self.mpi),
        ];
        let of_planes = of_planes
            .into_iter()
            .find_map(|(name, is_given)| is_given.then_some(name));
        let of_camera = || self.camera.of_planes().or(self.annotations.in_space());
        if let Some(option) = of_planes.or_else(of_camera) {
            return fault(option, "a panorama");
        }
        if !self.projection.is_sky() {
            return Ok(());
        }
        let sky = "an all-sky map, which is in the data's axes";
        if let Some(option) = self.camera.of_direction() {
            return fault(option, sky);
        }
        if self.size.is_some() {
            return fault("--size", "a healpix map, whose size --nside says");
        }
        if self.sequence.is_asked_for() || self.legend.legend || !self.annotations.is_empty() {
            return fault("a sequence, a legend or annotations", "an all-sky map");
        }
        check_sky_path(&self.out)
    }
}

/// Refuses formats that hold no all-sky map.
fn check_sky_path(path: &Path) -> Result<()> {
    let is_npy = path
        .extension()
        .is_some_and(|e| e.eq_ignore_ascii_case("npy"));
    if !is_npy && !is_fits(path) {
        let found = path.display().to_string();
        let expected = "fits or npy, for an all-sky map";
        return Err(Error::invalid(
            "--out",
            "format",
            expected,
            found,
            "name another",
        ));
    }
    check_folder(path)
}
