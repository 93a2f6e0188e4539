//! Defines the options of the camera.

use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use crate::data::up::Up;
use crate::io::{is_gltf, read_gltf_cameras};
use crate::view::{
    Along, Bounds, Camera, ClipPlane, DEFAULT_FOV_DEG, Lens, NamedCamera, Viewpoint, Window,
    read_cameras, sphere_around,
};
use crate::{Error, Renderer, Result};
use clap::{Args, ValueEnum};
use glam::{DQuat, DVec3};

use super::parse;
use super::parse::WindowBox;
use super::progress::note;
use super::usage::first_given;

/// Default lens of a fitted camera.
pub(crate) const DEFAULT_LENS: Lens = Lens::FovDeg(DEFAULT_FOV_DEG);

/// Greatest number of names in an error.
const MOST_NAMES: usize = 8;

/// Default width and height of a rendering in pixels.
pub(crate) const DEFAULT_SIZE: [usize; 2] = [1024, 1024];

/// Horizon of a panorama.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Horizon {
    /// It lies across the middle, whatever the direction of view.
    Level,
    /// It turns with the direction of view.
    Free,
}

/// Defaults of a picture, for cameras whose options do not set them.
#[derive(Clone, Copy)]
pub(crate) struct Canvas {
    /// Width and height in pixels, if they were asked for.
    pub(crate) size: Option<[usize; 2]>,
    /// Width and height if neither the options nor a camera's file gives them.
    pub(crate) default_size: [usize; 2],
    /// Lens of a fitted camera.
    pub(crate) lens: Lens,
    /// Columns at the right that a fitted camera leaves free, if at least half of the picture
    /// remains.
    pub(crate) room_px: usize,
    /// Axis to look along if no option says from where.
    pub(crate) along: Option<Along>,
    /// Corners of a box that fills a picture along an axis if no option says what it shows, and if it has the picture's
    /// shape.
    pub(crate) filled_by: Option<[DVec3; 2]>,
    /// For panoramas, which are taken from the middle of the data unless an option gives the eye.
    pub(crate) within: Option<Horizon>,
}

impl Canvas {
    /// Returns the canvas of a picture of the given size, with no columns left free.
    pub(crate) fn of(size: Option<[usize; 2]>) -> Self {
        Self {
            size,
            default_size: DEFAULT_SIZE,
            lens: DEFAULT_LENS,
            room_px: 0,
            along: None,
            filled_by: None,
            within: None,
        }
    }

    /// Returns the size of the picture if no camera file gives one.
    pub(crate) fn size(&self) -> [usize; 2] {
        self.size.unwrap_or(self.default_size)
    }

    /// Returns the size of the part of the picture to which a camera is fitted.
    fn inner(&self) -> [usize; 2] {
        let [width, height] = self.size();
        let is_roomy = 2 * self.room_px <= width;
        [width - if is_roomy { self.room_px } else { 0 }, height]
    }
}

#[derive(Args)]
#[command(next_help_heading = "Camera")]
pub(crate) struct CameraOptions {
    /// Camera in a file: JSON with eye, target, up and fov_deg or ortho_height; transforms.json, cameras.json or COLMAP's
    /// folder of a capture; a camera of glTF or three.js
    #[arg(long, value_name = "FILE", conflicts_with_all =
          ["eye", "target", "up", "fov", "ortho", "azimuth", "elevation", "zoom", "fit"])]
    camera: Option<PathBuf>,
    /// Camera of a file with several: the name of its picture, or a number from 0 [default: the first]
    #[arg(long, value_name = "NAME", requires = "camera")]
    camera_name: Option<String>,
    /// Camera in the file. It is read once, because a pipe cannot be read again.
    #[arg(skip)]
    read: OnceLock<NamedCamera>,
    /// Position of the eye; without it the camera is fitted to what is visible
    #[arg(long, value_name = "x,y,z", value_parser = parse::vector, allow_hyphen_values = true,
          conflicts_with_all = ["azimuth", "elevation", "zoom"])]
    eye: Option<DVec3>,
    /// Point looked at; a fitted camera is moved so that it is in the middle [default: the data's centre]
    #[arg(long, value_name = "x,y,z", value_parser = parse::vector, allow_hyphen_values = true)]
    target: Option<DVec3>,
    /// Direction that points up in the image [default: what `info` says of the data]
    #[arg(long, value_name = "x,y,z", value_parser = parse::direction, allow_hyphen_values = true)]
    up: Option<DVec3>,
    /// Vertical field of view in degrees, 1 to 179 [default: 35]
    #[arg(long, value_name = "DEG", value_parser = parse::fov)]
    fov: Option<f64>,
    /// Orthographic projection of this height in world units [column densities: fitted]
    #[arg(long, value_name = "HEIGHT", value_parser = parse::positive, conflicts_with = "fov")]
    ortho: Option<f64>,
    /// Fitted camera: degrees around what points up; 0 looks along +y, with y up along -z, with y
    /// down along +z [default: 30; splats of a scene's piece: from the scene's origin]
    #[arg(long, value_name = "DEG", value_parser = parse::finite, allow_hyphen_values = true)]
    azimuth: Option<f64>,
    /// Fitted camera: degrees above the horizon [default: 25]
    #[arg(long, value_name = "DEG", value_parser = parse::finite, allow_hyphen_values = true)]
    elevation: Option<f64>,
    /// Fitted camera: magnification
    #[arg(long, value_name = "F", value_parser = parse::positive)]
    zoom: Option<f64>,
    /// Look along this axis, orthographically: x, y, z or, from behind, -x, -y, -z [column densities: z]
    #[arg(long, value_name = "AXIS", value_parser = parse::along, allow_hyphen_values = true,
          conflicts_with_all = ["eye", "camera", "azimuth", "elevation", "up", "fov"])]
    along: Option<Along>,
    /// Coordinates at the edges of a picture along an axis, across and upwards, and between which it is cut along the
    /// axis, if wanted
    #[arg(long, value_name = "x0,x1,y0,y1[,z0,z1]", value_parser = parse::window, allow_hyphen_values = true,
          conflicts_with_all = ["eye", "camera", "azimuth", "elevation", "up", "fov", "ortho", "target", "zoom", "fit"])]
    window: Option<WindowBox>,
    /// Fit the camera to the data, as large as this view of them allows (stray splats do not count), or to the sphere
    /// around all of them, which is as large from every side
    #[arg(long, value_enum, value_name = "WHAT", conflicts_with_all = ["eye", "camera"])]
    fit: Option<Fit>,
}

#[derive(Clone, Copy, PartialEq, ValueEnum)]
enum Fit {
    View,
    All,
}

impl CameraOptions {
    /// Returns the point that was named as the middle of the picture.
    pub(crate) fn target(&self) -> Option<DVec3> {
        self.target
    }

    /// Returns the boxes that a camera is fitted to.
    pub(crate) fn boxes(&self, renderer: &Renderer) -> Vec<Bounds> {
        match self.fit {
            Some(Fit::All) => renderer.visible_boxes(),
            Some(Fit::View) | None => renderer.fitted_boxes(),
        }
    }

    /// Returns a note on stray splats, which a fitted camera ignores.
    ///
    /// - `boxes`: the boxes of [`CameraOptions::boxes`].
    pub(crate) fn strays(&self, renderer: &Renderer, boxes: &[Bounds]) -> Option<String> {
        /// Least ratio of the radii for which the note is given.
        const LEAST: f64 = 1.05;
        if self.fit == Some(Fit::All) || self.eye.is_some() || self.camera.is_some() {
            return None;
        }
        let (_, all) = sphere_around(&renderer.visible_boxes())?;
        let (_, fitted) = sphere_around(boxes)?;
        (all > LEAST * fitted).then(|| {
            format!(
                "the camera is fitted to what 99.5 % of the splats' opacity times area lie in; stray ones reach {:.3} \
                 times as far: --fit all shows them, --crop leaves them out",
                all / fitted
            )
        })
    }

    /// Reads the camera's file, if one is named and was not read before.
    ///
    /// - `is_bent`: whether the picture is drawn as the camera's lens bends it.
    pub(crate) fn read_file(
        &self,
        size: Option<[usize; 2]>,
        is_bent: impl Fn(&NamedCamera) -> bool,
    ) -> Result<()> {
        if let (Some(path), None) = (&self.camera, self.read.get()) {
            let cameras = match is_gltf(path) {
                true => read_gltf_cameras(path, size, None)?,
                false => read_cameras(path, size)?,
            };
            let camera = self.chosen(path, cameras)?;
            if camera.mapping.is_some() && !is_bent(&camera) {
                note!(
                    "the camera's lens distorts, the picture does not (render --projection lens)"
                );
            }
            self.read.get_or_init(|| camera);
        }
        Ok(())
    }

    /// Returns the camera of the file, once it was read.
    pub(crate) fn named(&self) -> Option<&NamedCamera> {
        self.read.get()
    }

    /// Returns the camera that `--camera-name` names, or the first.
    fn chosen(&self, path: &Path, mut cameras: Vec<NamedCamera>) -> Result<NamedCamera> {
        let count = cameras.len();
        let index = match &self.camera_name {
            None => 0,
            Some(name) => {
                let named = cameras.iter().position(|camera| camera.name == *name);
                let numbered = || name.parse().ok().filter(|n: &usize| *n < count);
                named.or_else(numbered).ok_or_else(|| {
                    let names = cameras.iter().map(|camera| camera.name.as_str());
                    let some: Vec<&str> = names.take(MOST_NAMES).collect();
                    let expected = match count {
                        1 => format!("0, its only camera ({})", some.join(", ")),
                        _ => format!(
                            "0 to {}, or a name: {}{}",
                            count - 1,
                            some.join(", "),
                            if count > MOST_NAMES { ", ..." } else { "" }
                        ),
                    };
                    Error::invalid(
                        "--camera-name",
                        path.display().to_string(),
                        expected,
                        name.clone(),
                        "name another",
                    )
                })?
            }
        };
        let camera = cameras.swap_remove(index);
        if count > 1 && self.camera_name.is_none() {
            note!(
                "{} has {count} cameras: {} is taken; --camera-name takes another",
                path.display(),
                camera.name
            );
        }
        Ok(camera)
    }

    /// Returns the camera for data within `boxes`. If there are no boxes to fit, it returns an
    /// arbitrary camera. `default_up` points up unless an option gives the direction.
    pub(crate) fn camera(
        &self,
        boxes: &[Bounds],
        default_up: Up,
        canvas: &Canvas,
    ) -> Result<Camera> {
        self.read_file(canvas.size, |_| false)?;
        if let Some(named) = self.read.get() {
            return Ok(named.camera.clone());
        }
        if let Some(horizon) = canvas.within {
            return Ok(self.within(0.0, boxes, default_up, canvas, horizon));
        }
        if let Some(along) = self.axis(canvas) {
            return self.camera_along(along, boxes, canvas);
        }
        if self.window.is_some() {
            return Err(Error::invalid(
                "--window",
                "camera",
                "one that looks along an axis",
                "one that does not",
                "add --along x, y or z",
            ));
        }
        let size = canvas.size();
        let fov = self.fov.unwrap_or(DEFAULT_FOV_DEG);
        let up = self.up.unwrap_or(default_up.direction);
        let centre = sphere_around(boxes).map(|(centre, _)| centre);
        if let Some(eye) = self.eye {
            let target = self.target.or(centre).unwrap_or(eye + DVec3::Y);
            if target == eye {
                return Err(Error::invalid(
                    "--eye",
                    "camera",
                    "an eye away from the point looked at",
                    format!("both at {},{},{}", eye.x, eye.y, eye.z),
                    "move the eye, or name another --target",
                ));
            }
            return Ok(match self.ortho {
                Some(height) => Camera::orthographic(eye, target, up, height, size),
                None => Camera::perspective(eye, target, up, fov, size),
            });
        }
        let is_turned = self.fit == Some(Fit::All);
        Ok(self.fitted(0.0, boxes, default_up, canvas, is_turned))
    }

    /// Returns the axis that the camera looks along, if it looks along one.
    fn axis(&self, canvas: &Canvas) -> Option<Along> {
        let says_from_where = self.eye.is_some()
            || self.azimuth.is_some()
            || self.elevation.is_some()
            || self.up.is_some()
            || self.fov.is_some();
        self.along.or(canvas.along.filter(|_| !says_from_where))
    }

    /// Returns whether an option says to look along another axis than this one, from either side.
    pub(crate) fn looks_beside(&self, along: Along) -> bool {
        self.along.is_some_and(|own| own.axis() != along.axis())
    }

    /// Returns the planes between which `--window` shows the scene, if it says so.
    ///
    /// - `default`: the axis to look along if no option says it.
    pub(crate) fn depth_planes(&self, default: Option<Along>) -> Vec<ClipPlane> {
        let depth = self.window.and_then(|window| window.depth);
        let planes = depth
            .zip(self.along.or(default))
            .map(|([low, high], along)| {
                let plane = |sign: f64, bound: f64| ClipPlane {
                    normal: sign * along.axis(),
                    distance: -sign * bound,
                };
                [plane(1.0, low), plane(-1.0, high)]
            });
        planes.into_iter().flatten().collect()
    }

    /// Returns the camera that looks along an axis.
    fn camera_along(&self, along: Along, boxes: &[Bounds], canvas: &Canvas) -> Result<Camera> {
        let (inner, whole) = (canvas.inner(), canvas.size());
        let room = whole[0] - inner[0];
        let shows = |window: Window, size: [usize; 2]| Camera {
            width: size[0] + room,
            ..along.camera(&window, boxes, size)
        };
        let size = |window: Window| {
            let [width, height] = window.lengths();
            match canvas.size {
                None => shaped(inner[0].max(inner[1]), width / height),
                Some(_) => inner,
            }
        };
        if let Some(WindowBox { window, .. }) = self.window {
            let size = size(window);
            if window.has_shape(size) {
                return Ok(shows(window, size));
            }
            let [width, height] = window.lengths();
            let [fit, _] = shaped_to(size[1], width / height);
            return Err(Error::invalid(
                "--window",
                "picture",
                format!("the shape of the window: {}x{} pixels", fit + room, size[1]),
                format!("{}x{} pixels", whole[0], whole[1]),
                "change --size, or leave it out",
            ));
        }
        let is_free = self.ortho.is_none() && self.target.is_none() && self.zoom.is_none();
        if let Some(corners) = canvas.filled_by.filter(|_| is_free) {
            let window = along.window(corners);
            let size = size(window);
            if window.has_shape(size) {
                return Ok(shows(window, size));
            }
        }
        let nowhere = [(DVec3::ZERO, DVec3::ONE)];
        let fitted = along.fitted(boxes, self.ortho, inner);
        let fitted = fitted.or_else(|| along.fitted(&nowhere, self.ortho, inner));
        let mut fitted = fitted.unwrap_or_else(|| unreachable!("there is a box"));
        fitted.focal_px *= self.zoom.unwrap_or(1.0);
        let widened = Camera {
            width: whole[0],
            ..fitted
        };
        Ok(self.aimed(widened, boxes))
    }

    /// Returns the camera fitted to the sphere around all data, turned by some degrees.
    pub(crate) fn turned(
        &self,
        turn_deg: f64,
        boxes: &[Bounds],
        default_up: Up,
        canvas: &Canvas,
    ) -> Result<Camera> {
        if let Some(horizon) = canvas.within {
            return Ok(self.within(turn_deg, boxes, default_up, canvas, horizon));
        }
        if self.fit == Some(Fit::View) {
            return Err(Error::invalid(
                "--fit",
                "value",
                "all, for a turn around the data",
                "view",
                "leave it out",
            ));
        }
        Ok(self.fitted(turn_deg, boxes, default_up, canvas, true))
    }

    fn fitted(
        &self,
        turn_deg: f64,
        boxes: &[Bounds],
        default_up: Up,
        canvas: &Canvas,
        is_around: bool,
    ) -> Camera {
        let default = Up {
            direction: self.up.unwrap_or(default_up.direction),
            ..default_up
        };
        let default = default.viewpoint();
        let (size, whole) = (canvas.inner(), canvas.size());
        let fov = self.fov.unwrap_or(DEFAULT_FOV_DEG);
        let viewpoint = Viewpoint {
            azimuth_deg: self.azimuth.unwrap_or(default.azimuth_deg) + turn_deg,
            elevation_deg: self.elevation.unwrap_or(default.elevation_deg),
            zoom: self.zoom.unwrap_or(default.zoom),
            up: default.up,
        };
        let lens = match (self.ortho, self.fov) {
            (Some(height), _) => Lens::OrthoHeight(Some(height)),
            (None, Some(fov)) => Lens::FovDeg(fov),
            (None, None) => canvas.lens,
        };
        // The camera of an empty picture looks anywhere.
        let unfitted = || Camera::perspective(DVec3::ZERO, DVec3::Y, DVec3::Z, fov, size);
        let fitted = match is_around {
            true => viewpoint.camera_around(boxes, lens, size),
            false => viewpoint.camera(boxes, lens, size),
        };
        // The columns left free lie to the right of the part that the camera was fitted to.
        let fitted = Camera {
            width: whole[0],
            ..fitted.unwrap_or_else(unfitted)
        };
        self.aimed(fitted, boxes)
    }

    /// Returns the camera of a panorama, turned by some degrees.
    fn within(
        &self,
        turn_deg: f64,
        boxes: &[Bounds],
        default_up: Up,
        canvas: &Canvas,
        horizon: Horizon,
    ) -> Camera {
        let up = self.up.unwrap_or(default_up.direction);
        let centre = sphere_around(boxes).map_or(DVec3::ZERO, |(centre, _)| centre);
        let eye = self.eye.unwrap_or(centre);
        let says_where = self.azimuth.is_some() || self.elevation.is_some();
        let looked_at = self.target.or(Some(centre)).filter(|_| !says_where);
        let forward = match looked_at.and_then(|at| (at - eye).try_normalize()) {
            Some(forward) => forward,
            None => {
                let viewpoint = Viewpoint {
                    azimuth_deg: self.azimuth.unwrap_or(0.0),
                    elevation_deg: self.elevation.unwrap_or(0.0),
                    zoom: 1.0,
                    up,
                };
                viewpoint.forward()
            }
        };
        let forward = match horizon {
            Horizon::Level => forward.reject_from_normalized(up),
            Horizon::Free => forward,
        };
        let turn = DQuat::from_axis_angle(up, turn_deg.to_radians());
        let forward = match forward.length() > 1e-9 {
            true => turn * forward,
            false => up.any_orthonormal_vector(),
        };
        // A direction is exact wherever the eye is.
        let camera = Camera::perspective(DVec3::ZERO, forward, up, 90.0, canvas.size());
        Camera { eye, ..camera }
    }

    /// Returns the name of an option that has no use for panoramas, if one is given.
    pub(crate) fn of_planes(&self) -> Option<&'static str> {
        first_given([
            ("--fov", self.fov.is_some()),
            ("--ortho", self.ortho.is_some()),
            ("--zoom", self.zoom.is_some()),
            ("--along", self.along.is_some()),
            ("--window", self.window.is_some()),
            ("--fit", self.fit.is_some()),
        ])
    }

    /// Returns the name of an option that has no use for parallel rays, if one is given.
    pub(crate) fn of_perspective(&self) -> Option<&'static str> {
        first_given([
            ("--fov", self.fov.is_some()),
            ("--camera", self.camera.is_some()),
            (
                "--eye without --ortho",
                self.eye.is_some() && self.ortho.is_none(),
            ),
        ])
    }

    /// Returns the name of an option that asks for parallel rays, if one is given.
    pub(crate) fn of_parallel_rays(&self) -> Option<&'static str> {
        first_given([
            ("--ortho", self.ortho.is_some()),
            ("--along", self.along.is_some()),
            ("--window", self.window.is_some()),
        ])
    }

    /// Returns true if a point and angles both say where to look.
    pub(crate) fn looks_twice(&self) -> bool {
        self.target.is_some() && (self.azimuth.is_some() || self.elevation.is_some())
    }

    /// Returns the name of an option that says where to look, if one is given.
    pub(crate) fn of_direction(&self) -> Option<&'static str> {
        first_given([
            ("--target", self.target.is_some()),
            ("--up", self.up.is_some()),
            ("--azimuth", self.azimuth.is_some()),
            ("--elevation", self.elevation.is_some()),
        ])
    }

    /// Moves a camera fitted to boxes so that the target is in the middle, if one is given.
    fn aimed(&self, fitted: Camera, boxes: &[Bounds]) -> Camera {
        let centre = sphere_around(boxes).map(|(centre, _)| centre);
        match (self.target, centre) {
            (Some(target), Some(centre)) => {
                // The target gets the distance from the eye that the data have.
                let forward = fitted.forward();
                let distance = (centre - fitted.eye).dot(forward);
                Camera {
                    eye: target - forward * distance,
                    ..fitted
                }
            }
            _ => fitted,
        }
    }
}

/// Returns the size of a picture of some shape, whose longer side has a number of pixels.
///
/// - `shape`: width over height.
fn shaped(longer: usize, shape: f64) -> [usize; 2] {
    match shape < 1.0 {
        true => shaped_to(longer, shape),
        false => {
            let [height, width] = shaped_to(longer, 1.0 / shape);
            [width, height]
        }
    }
}

/// Returns such a size from its height.
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "a cast saturates; NaN gives 0"
)]
fn shaped_to(height: usize, shape: f64) -> [usize; 2] {
    let width = (height as f64 * shape).round() as usize;
    [width.clamp(1, 65_535), height]
}
