//! Reads cameras from the package's dictionaries. Most cameras can be completed only with a scene
//! and a picture's size.

use ewa_splat::session::{self, Placement};
use ewa_splat::view::{Along, Camera, Lens, Projection};
use glam::{DMat3, DVec3};
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
    /// Returns the view that it describes.
    pub(crate) fn view(self) -> session::View {
        let lens = match (self.ortho_height, self.orthographic, self.fov) {
            (Some(height), ..) => Some(Lens::OrthoHeight(Some(height))),
            (None, Some(true), _) => Some(Lens::OrthoHeight(None)),
            (None, _, fov) => fov.map(Lens::FovDeg),
        };
        let axis = self.axis.as_deref().and_then(Along::of_name);
        let calibrated = self.rotation.zip(self.focal_px).zip(self.size);
        let placement = match (axis, self.eye, self.target, calibrated) {
            (Some(axis), ..) => Placement::Along {
                axis,
                centre: self.centre.map(DVec3::from),
                width: self.ortho_width,
            },
            (None, Some(eye), _, Some(((rows, focal), [width, height]))) => {
                let middle = [width as f64 / 2.0, height as f64 / 2.0];
                Placement::Calibrated(Camera {
                    projection: match self.orthographic {
                        Some(true) => Projection::Orthographic,
                        _ => Projection::Perspective,
                    },
                    eye: eye.into(),
                    camera_from_world: DMat3::from_cols_array_2d(&rows).transpose(),
                    focal_px: focal.into(),
                    centre_px: self.centre_px.unwrap_or(middle).into(),
                    width,
                    height,
                })
            }
            (None, Some(eye), Some(target), None) if self.kind == "look_at" => Placement::LookAt {
                eye: eye.into(),
                target: target.into(),
            },
            _ => Placement::Fitted {
                azimuth_deg: self.azimuth,
                elevation_deg: self.elevation,
                turn_deg: [self.turn.unwrap_or(0.0), self.rise.unwrap_or(0.0)],
                zoom: self.zoom,
                is_around: self.around == Some(true),
            },
        };
        session::View {
            placement,
            lens,
            up: self.up.map(DVec3::from),
        }
    }
}
