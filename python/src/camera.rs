//! Reads cameras from the package's dictionaries. Most cameras can be completed only with a scene
//! and a picture's size.

use ewa_splat::view::{Along, Bounds, Camera, DEFAULT_FOV_DEG, Lens, Projection, Viewpoint};
use glam::{DMat3, DVec2, DVec3};
use pyo3::FromPyObject;

/// Description of a camera.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(crate) struct View {
    /// `fit`, `look_at`, `along` or `calibrated`.
    kind: String,
    /// Camera along an axis: its name, and what lies in the middle of the picture.
    #[pyo3(default)]
    axis: Option<String>,
    #[pyo3(default)]
    centre: Option<[f64; 3]>,
    /// Width of an orthographic picture.
    #[pyo3(default)]
    ortho_width: Option<f64>,
    /// Fitted camera: angles, if they differ from those that the data suggest.
    #[pyo3(default)]
    azimuth: Option<f64>,
    #[pyo3(default)]
    elevation: Option<f64>,
    /// Degrees added to azimuth and elevation.
    #[pyo3(default)]
    turn: Option<f64>,
    #[pyo3(default)]
    rise: Option<f64>,
    #[pyo3(default)]
    zoom: Option<f64>,
    /// True if the camera is fitted to the sphere around all data.
    #[pyo3(default)]
    around: Option<bool>,
    #[pyo3(default)]
    up: Option<[f64; 3]>,
    #[pyo3(default)]
    fov: Option<f64>,
    #[pyo3(default)]
    ortho_height: Option<f64>,
    /// True if the camera is orthographic, with the height of the data.
    #[pyo3(default)]
    orthographic: Option<bool>,
    #[pyo3(default)]
    eye: Option<[f64; 3]>,
    #[pyo3(default)]
    target: Option<[f64; 3]>,
    /// Calibrated camera: rows right, down, forward.
    #[pyo3(default)]
    rotation: Option<[[f64; 3]; 3]>,
    #[pyo3(default)]
    focal_px: Option<[f64; 2]>,
    #[pyo3(default)]
    centre_px: Option<[f64; 2]>,
    #[pyo3(default)]
    size: Option<[usize; 2]>,
}

impl View {
    /// Returns the direction up, if it is given.
    pub(crate) fn up(&self) -> Option<DVec3> {
        self.up.map(DVec3::from)
    }

    /// Returns the camera along an axis for a picture of this size; `None` if it looks from elsewhere, or if it is fitted
    /// to boxes and there are none.
    pub(crate) fn along(&self, boxes: &[Bounds], size: [usize; 2]) -> Option<Camera> {
        let along = Along::of_name(self.axis.as_deref()?)?;
        let centre = self.centre.map(DVec3::from);
        let boxes = match (centre, boxes) {
            // There is nothing to fit, but the place is given.
            (Some(centre), []) => &[(centre, DVec3::ONE)],
            (_, boxes) => boxes,
        };
        let fitted = along.fitted(boxes, None, size)?;
        let focal_px = match self.ortho_width {
            Some(width) => DVec2::splat(size[0] as f64 / width),
            None => fitted.focal_px,
        };
        let forward = fitted.forward();
        let eye = centre.map(|centre| centre - forward * forward.dot(centre - fitted.eye));
        Some(Camera {
            eye: eye.unwrap_or(fitted.eye),
            focal_px,
            ..fitted
        })
    }

    /// Returns the camera for a picture of this size.
    ///
    /// - `viewpoint`: default viewpoint of a fitted camera.
    /// - `lens`: default lens of a fitted camera.
    /// - `fitted`: fits a camera with this viewpoint and lens, around all data or as near as
    ///   possible; returns `None` if nothing is visible.
    pub(crate) fn camera(
        &self,
        size: [usize; 2],
        viewpoint: Viewpoint,
        lens: Lens,
        fitted: impl FnOnce(Viewpoint, Lens, bool) -> Option<Camera>,
    ) -> Camera {
        let fov = self.fov.unwrap_or(DEFAULT_FOV_DEG);
        match (self.eye, self.target, self.rotation, self.focal_px) {
            (Some(eye), _, Some(rows), Some(focal)) => {
                let own = self.size.unwrap_or(size);
                let scale = DVec2::new(
                    size[0] as f64 / own[0] as f64,
                    size[1] as f64 / own[1] as f64,
                );
                let middle = [own[0] as f64 / 2.0, own[1] as f64 / 2.0];
                Camera {
                    projection: match self.orthographic {
                        Some(true) => Projection::Orthographic,
                        _ => Projection::Perspective,
                    },
                    eye: eye.into(),
                    camera_from_world: DMat3::from_cols_array_2d(&rows).transpose(),
                    focal_px: DVec2::from(focal) * scale,
                    centre_px: DVec2::from(self.centre_px.unwrap_or(middle)) * scale,
                    width: size[0],
                    height: size[1],
                }
            }
            (Some(eye), Some(target), ..) if self.kind == "look_at" => {
                let (eye, target) = (eye.into(), target.into());
                let up = self.up().unwrap_or(viewpoint.up);
                match self.ortho_height {
                    Some(height) => Camera::orthographic(eye, target, up, height, size),
                    None => Camera::perspective(eye, target, up, fov, size),
                }
            }
            _ => {
                let viewpoint = Viewpoint {
                    azimuth_deg: self.azimuth.unwrap_or(viewpoint.azimuth_deg)
                        + self.turn.unwrap_or(0.0),
                    elevation_deg: self.elevation.unwrap_or(viewpoint.elevation_deg)
                        + self.rise.unwrap_or(0.0),
                    zoom: self.zoom.unwrap_or(viewpoint.zoom),
                    up: viewpoint.up,
                };
                let lens = match (self.ortho_height, self.orthographic, self.fov) {
                    (Some(height), ..) => Lens::OrthoHeight(Some(height)),
                    (None, Some(true), _) => Lens::OrthoHeight(None),
                    (None, _, Some(fov)) => Lens::FovDeg(fov),
                    (None, _, None) => lens,
                };
                // The camera of an empty picture looks anywhere.
                let nowhere = || Camera::perspective(DVec3::ZERO, DVec3::Y, DVec3::Z, fov, size);
                fitted(viewpoint, lens, self.around == Some(true)).unwrap_or_else(nowhere)
            }
        }
    }
}
