//! Converts views and cameras from and to JSON.

use ewa_splat::session::{Placement, View};
use ewa_splat::view::{Along, Camera, Lens, Projection};
use glam::{DMat3, DVec2, DVec3};
use serde::Deserialize;
use serde_json::{Value, json};

/// View as the page states it; by default fitted to the data.
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct GivenView {
    eye: Option<[f64; 3]>,
    target: Option<[f64; 3]>,
    up: Option<[f64; 3]>,
    fov_deg: Option<f64>,
    ortho_height: Option<f64>,
    azimuth: Option<f64>,
    elevation: Option<f64>,
    zoom: Option<f64>,
    along: Option<String>,
    /// Rows right, down and forward, of a calibrated camera.
    camera_from_world: Option<[[f64; 3]; 3]>,
    focal_px: Option<[f64; 2]>,
    centre_px: Option<[f64; 2]>,
    size: Option<[usize; 2]>,
    projection: Option<String>,
}

impl GivenView {
    /// Returns true if the view says from where.
    pub(crate) fn is_given(&self) -> bool {
        self.eye.is_some()
            || self.along.is_some()
            || self.azimuth.is_some()
            || self.elevation.is_some()
    }

    /// Returns the view.
    ///
    /// # Errors
    /// Numbers that are no view, named in the text.
    pub(crate) fn view(&self) -> Result<View, String> {
        let lens = match (self.fov_deg, self.ortho_height) {
            (None, None) => None,
            (Some(fov), None) if fov > 0.0 && fov < 180.0 => Some(Lens::FovDeg(fov)),
            (None, Some(height)) if height > 0.0 && height.is_finite() => {
                Some(Lens::OrthoHeight(Some(height)))
            }
            _ => {
                let text = "fov_deg, ortho_height: expected one of them, above 0, and degrees below 180, found others";
                return Err(text.into());
            }
        };
        let up = match self.up.map(DVec3::from) {
            None => None,
            Some(up) => Some(
                up.try_normalize()
                    .ok_or("up: expected three numbers that are not all zero")?,
            ),
        };
        let placement = match (self.eye, &self.along) {
            (Some(eye), _) => match self.camera_from_world {
                Some(rows) => self.calibrated(eye.into(), rows)?,
                None => look_at(eye.into(), self.target.map(DVec3::from))?,
            },
            (None, Some(axis)) => Placement::Along {
                axis: Along::of_name(axis).ok_or_else(|| {
                    format!("along: expected x, y, z, -x, -y or -z, found {axis}")
                })?,
                centre: None,
                width: None,
            },
            (None, None) => Placement::Fitted {
                azimuth_deg: self.azimuth,
                elevation_deg: self.elevation,
                turn_deg: [0.0; 2],
                zoom: self.zoom,
                is_around: false,
            },
        };
        Ok(View {
            placement,
            lens,
            up,
        })
    }

    fn calibrated(&self, eye: DVec3, rows: [[f64; 3]; 3]) -> Result<Placement, String> {
        let expected = "focal_px, size: expected those of a calibrated camera, found none";
        let (Some(focal_px), Some(size)) = (self.focal_px, self.size) else {
            return Err(expected.into());
        };
        if size.contains(&0) {
            return Err("size: expected a width and a height above 0, found 0".into());
        }
        let middle = DVec2::new(size[0] as f64, size[1] as f64) / 2.0;
        let projection = match self.projection.as_deref() {
            None | Some("perspective") => Projection::Perspective,
            Some("orthographic") => Projection::Orthographic,
            Some(other) => {
                return Err(format!(
                    "projection: expected perspective or orthographic, found {other}"
                ));
            }
        };
        let camera = Camera {
            projection,
            eye,
            camera_from_world: DMat3::from_cols_array_2d(&rows).transpose(),
            focal_px: focal_px.into(),
            centre_px: self.centre_px.map_or(middle, DVec2::from),
            width: size[0],
            height: size[1],
        };
        camera.validate().map_err(|error| error.to_string())?;
        Ok(Placement::Calibrated(camera))
    }
}

fn look_at(eye: DVec3, target: Option<DVec3>) -> Result<Placement, String> {
    match target {
        Some(target) if eye.is_finite() && target.is_finite() && eye != target => {
            Ok(Placement::LookAt { eye, target })
        }
        _ => Err("eye, target: expected two different points, found others".into()),
    }
}

/// Describes a camera as its files do.
pub(crate) fn described(camera: &Camera) -> Value {
    let rows = camera.camera_from_world.transpose().to_cols_array_2d();
    json!({
        "eye": camera.eye.to_array(),
        "camera_from_world": rows,
        "focal_px": camera.focal_px.to_array(),
        "centre_px": camera.centre_px.to_array(),
        "size": [camera.width, camera.height],
        "projection": match camera.projection {
            Projection::Orthographic => "orthographic",
            Projection::Perspective => "perspective",
        },
    })
}
