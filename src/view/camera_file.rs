//! Reads cameras from JSON.
//!
//! ```json
//! { "eye": [0, -10, 3], "target": [0, 0, 0], "up": [0, 0, 1], "fov_deg": 40 }
//! ```
//!
//! `ortho_height` in place of `fov_deg` makes an orthographic camera. Calibrated cameras state `focal_px` \[fx,
//! fy\] and `centre_px` \[cx, cy\], with the `size` \[width, height\] for which these hold; they are scaled to
//! the rendered size. Such cameras may state `camera_from_world` (three rows: right, down, forward) in place of
//! `target` and `up`, and `projection` (`perspective`, `orthographic`).

use std::path::Path;

use glam::{DMat3, DVec2, DVec3};
use serde::Deserialize;

use super::camera::{Camera, Projection, is_rotation};
use crate::error::{Error, Result};

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct CameraFile {
    eye: [f64; 3],
    target: Option<[f64; 3]>,
    up: Option<[f64; 3]>,
    camera_from_world: Option<[[f64; 3]; 3]>,
    projection: Option<String>,
    fov_deg: Option<f64>,
    ortho_height: Option<f64>,
    focal_px: Option<[f64; 2]>,
    centre_px: Option<[f64; 2]>,
    size: Option<[usize; 2]>,
}

/// Reads a camera in this library's JSON, for pictures of `size` pixels or, if that is `None`, of the size in the file.
///
/// # Errors
/// A text that is not such JSON, or does not describe a camera: a field of view outside (0, 180), a matrix that is no
/// rotation, a number that is not finite, a focal length without its size.
pub(super) fn camera_of(path: &Path, text: &str, size: Option<[usize; 2]>) -> Result<Camera> {
    let file: CameraFile = serde_json::from_str(text).map_err(|e| {
        Error::format(
            path,
            format!("line {}, column {}", e.line(), e.column()),
            "a camera: eye, target, up and fov_deg or ortho_height",
            e.to_string(),
            "see docs/command-line.md",
        )
    })?;
    camera(&file, size).map_err(|(place, expected, found)| {
        Error::format(path, place, expected, found, "see docs/command-line.md")
    })
}

type Problem = (&'static str, &'static str, String);

fn camera(file: &CameraFile, size: Option<[usize; 2]>) -> Result<Camera, Problem> {
    let size = size.or(file.size).unwrap_or([1024, 1024]);
    let eye = DVec3::from(file.eye);
    let up = file.up.map_or(DVec3::Z, DVec3::from);
    let target = file.target.map_or(DVec3::ZERO, DVec3::from);
    let mut camera = match (file.fov_deg, file.ortho_height, file.focal_px) {
        (Some(fov), None, None) if fov > 0.0 && fov < 180.0 => {
            Camera::perspective(eye, target, up, fov, size)
        }
        (None, Some(height), None) if height > 0.0 => {
            Camera::orthographic(eye, target, up, height, size)
        }
        (None, None, Some(focal)) if focal[0] > 0.0 && focal[1] > 0.0 => {
            let calibrated = file.size.ok_or((
                "size",
                "the width and height that focal_px belongs to",
                "nothing".to_string(),
            ))?;
            let scale = DVec2::new(
                size[0] as f64 / calibrated[0] as f64,
                size[1] as f64 / calibrated[1] as f64,
            );
            let centre = file.centre_px.map_or(
                DVec2::new(calibrated[0] as f64, calibrated[1] as f64) / 2.0,
                DVec2::from,
            );
            Camera {
                projection: match file.projection.as_deref() {
                    None | Some("perspective") => Projection::Perspective,
                    Some("orthographic") => Projection::Orthographic,
                    Some(other) => {
                        return Err(("projection", "perspective or orthographic", other.into()));
                    }
                },
                focal_px: DVec2::from(focal) * scale,
                centre_px: centre * scale,
                ..Camera::perspective(eye, target, up, 90.0, size)
            }
        }
        other => {
            return Err((
                "fov_deg, ortho_height, focal_px",
                "exactly one of them, positive, fov_deg below 180",
                format!("{other:?}"),
            ));
        }
    };
    if let Some(rows) = file.camera_from_world {
        let m = DMat3::from_cols_array_2d(&rows).transpose();
        if !is_rotation(m) {
            return Err(("camera_from_world", "a rotation", format!("{rows:?}")));
        }
        camera.camera_from_world = m;
    }
    let finite = camera.eye.is_finite()
        && camera.camera_from_world.is_finite()
        && camera.focal_px.is_finite()
        && camera.centre_px.is_finite();
    if !finite {
        return Err(("numbers", "finite numbers", "NaN or infinity".into()));
    }
    Ok(camera)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(text: &str) -> Result<Camera, Problem> {
        camera(&serde_json::from_str(text).unwrap(), Some([200, 100]))
    }

    #[test]
    fn a_calibrated_camera_equals_the_look_at_camera() {
        let look = parse(r#"{"eye": [1, -5, 2], "target": [1, 0, 2], "fov_deg": 90}"#).unwrap();
        let calibrated = parse(
            r#"{"eye": [1, -5, 2], "camera_from_world": [[1, 0, 0], [0, 0, -1], [0, 1, 0]],
                "focal_px": [25, 25], "size": [100, 50]}"#,
        )
        .unwrap();
        let p = DVec3::new(0.3, 0.7, 2.2);
        let distance = (look.project(p).unwrap() - calibrated.project(p).unwrap()).length();
        assert!(distance < 1e-9);
    }

    #[test]
    fn impossible_cameras_are_refused() {
        for text in [
            r#"{"eye": [0, 0, 0], "fov_deg": 180}"#,
            r#"{"eye": [0, 0, 0]}"#,
            r#"{"eye": [0, 0, 0], "fov_deg": 40, "ortho_height": 2}"#,
            r#"{"eye": [0, 0, 0], "focal_px": [9, 9]}"#,
            r#"{"eye": [0, 0, 0], "fov_deg": 40,
                "camera_from_world": [[2, 0, 0], [0, 1, 0], [0, 0, 1]]}"#,
        ] {
            assert!(parse(text).is_err(), "{text}");
        }
    }
}
