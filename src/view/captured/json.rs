//! Reads cameras in JSON: of captures, of trained splats, of nerfstudio's paths; [`three`] reads those of three.js.

use std::path::Path;

use glam::{DMat3, DVec2, DVec3};
use serde::Deserialize;
use serde_json::Value;

use super::{Distortion, Optics, Stated, angle, fault, not_a_rotation, rotation, size_of, three};
use crate::error::Result;

/// Lens of a capture, which its frames may state anew.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(default)]
struct Lens {
    camera_model: Option<String>,
    is_fisheye: Option<bool>,
    camera_angle_x: Option<f64>,
    camera_angle_y: Option<f64>,
    fl_x: Option<f64>,
    fl_y: Option<f64>,
    cx: Option<f64>,
    cy: Option<f64>,
    w: Option<f64>,
    h: Option<f64>,
    k1: Option<f64>,
    k2: Option<f64>,
    k3: Option<f64>,
    k4: Option<f64>,
    k5: Option<f64>,
    k6: Option<f64>,
    p1: Option<f64>,
    p2: Option<f64>,
}

/// A picture of a capture.
#[derive(Deserialize)]
struct Frame {
    #[serde(default)]
    file_path: Option<String>,
    transform_matrix: Vec<Vec<f64>>,
    #[serde(flatten)]
    lens: Lens,
}

#[derive(Deserialize)]
struct Capture {
    frames: Vec<Frame>,
    #[serde(flatten)]
    lens: Lens,
}

/// A camera of trained splats.
#[derive(Deserialize)]
struct Trained {
    img_name: Option<String>,
    width: f64,
    height: f64,
    position: [f64; 3],
    rotation: [[f64; 3]; 3],
    fx: f64,
    fy: f64,
}

/// A frame of nerfstudio's camera path.
#[derive(Deserialize)]
struct PathFrame {
    camera_to_world: Vec<f64>,
    fov: f64,
}

#[derive(Deserialize)]
struct FramesOfPath {
    camera_path: Vec<PathFrame>,
    camera_type: Option<String>,
    render_width: Option<f64>,
    render_height: Option<f64>,
}

/// Reads the cameras of a text; `None` if it is JSON of another kind, or no JSON.
///
/// - `rate`: pictures per second of a camera that moves; without it the camera of its first key.
pub(super) fn stated(path: &Path, text: &str, rate: Option<f64>) -> Result<Option<Vec<Stated>>> {
    let wrong = |e: &serde_json::Error| {
        let place = format!("line {}, column {}", e.line(), e.column());
        fault(path, place, "cameras in JSON", e.to_string())
    };
    let Ok(value) = serde_json::from_str::<Value>(text) else {
        return Ok(None);
    };
    let has = |name: &str| value.get(name).is_some();
    let is_trained = value
        .get(0)
        .is_some_and(|first| first.get("rotation").is_some());
    let result = if is_trained {
        serde_json::from_str(text).map(|trained| of_trained(path, trained))
    } else if value.get("frames").is_some_and(Value::is_array) {
        serde_json::from_str(text).map(|capture| of_capture(path, capture))
    } else if has("camera_path") {
        serde_json::from_str(text).map(|frames| of_path(path, frames))
    } else if has("object") || has("tracks") {
        Ok(three::stated(path, value, rate))
    } else {
        return Ok(None);
    };
    result.map_err(|e| wrong(&e))?.map(Some)
}

/// Returns the eye and the rotation of a camera, from the matrix that takes its axes right, up and backward to the world.
fn pose(path: &Path, name: &str, rows: [[f64; 4]; 3]) -> Result<(DVec3, DMat3)> {
    let column = |j: usize| DVec3::from(rows.map(|row| row[j]));
    let turned = rotation(DMat3::from_cols(column(0), column(1), column(2)), true);
    let turned = turned.ok_or_else(|| not_a_rotation(path, name, &rows))?;
    Ok((column(3), turned))
}

/// Returns the three rows of a matrix whose sixteen numbers are stored by rows or by columns.
fn rows_of(path: &Path, name: &str, numbers: &[f64], by_columns: bool) -> Result<[[f64; 4]; 3]> {
    let Ok(numbers) = <[f64; 16]>::try_from(numbers) else {
        let found = format!("{} numbers", numbers.len());
        return Err(fault(
            path,
            format!("camera {name}"),
            "a matrix of 16 numbers",
            found,
        ));
    };
    Ok([0, 1, 2].map(|i| {
        [0, 1, 2, 3].map(|j| {
            if by_columns {
                numbers[4 * j + i]
            } else {
                numbers[4 * i + j]
            }
        })
    }))
}

impl Lens {
    /// Returns the lens of a frame: what the frame leaves open is the capture's.
    fn or(&self, whole: &Self) -> Self {
        let has_angle = self.camera_angle_x.is_some() && self.fl_x.is_none();
        let whole = &Self {
            // A frame's own angle is its focal length.
            fl_x: whole.fl_x.filter(|_| !has_angle),
            fl_y: whole.fl_y.filter(|_| !has_angle),
            ..whole.clone()
        };
        Self {
            camera_model: self
                .camera_model
                .clone()
                .or_else(|| whole.camera_model.clone()),
            is_fisheye: self.is_fisheye.or(whole.is_fisheye),
            camera_angle_x: self.camera_angle_x.or(whole.camera_angle_x),
            camera_angle_y: self
                .camera_angle_y
                .or(whole.camera_angle_y.filter(|_| !has_angle)),
            fl_x: self.fl_x.or(whole.fl_x),
            fl_y: self.fl_y.or(whole.fl_y),
            cx: self.cx.or(whole.cx),
            cy: self.cy.or(whole.cy),
            w: self.w.or(whole.w),
            h: self.h.or(whole.h),
            k1: self.k1.or(whole.k1),
            k2: self.k2.or(whole.k2),
            k3: self.k3.or(whole.k3),
            k4: self.k4.or(whole.k4),
            k5: self.k5.or(whole.k5),
            k6: self.k6.or(whole.k6),
            p1: self.p1.or(whole.p1),
            p2: self.p2.or(whole.p2),
        }
    }

    fn is_fisheye(&self) -> bool {
        match &self.camera_model {
            Some(model) => model.ends_with("FISHEYE"),
            None => self.is_fisheye == Some(true),
        }
    }

    /// Returns the distortion. The terms k4 to k6 of FULL_OPENCV are divisors; k4 of nerfstudio is not.
    fn distortion(&self) -> Option<Distortion> {
        let k =
            [self.k1, self.k2, self.k3, self.k4, self.k5, self.k6].map(Option::unwrap_or_default);
        let p = [self.p1, self.p2].map(Option::unwrap_or_default);
        let [k1, k2, k3, k4, k5, k6] = k;
        if self.is_fisheye() {
            return Some(Distortion::Fisheye([k1, k2, k3, k4]));
        }
        let is_divided = self.camera_model.as_deref() == Some("FULL_OPENCV");
        let (above, below) = match is_divided {
            true => ([k1, k2, k3, 0.0], [k4, k5, k6]),
            false => ([k1, k2, k3, k4], [0.0; 3]),
        };
        let is_bent = above
            .iter()
            .chain(&below)
            .chain(&p)
            .any(|term| *term != 0.0);
        is_bent.then_some(Distortion::Radial { above, below, p })
    }

    fn optics(&self, path: &Path, name: &str) -> Result<Optics> {
        let place = || format!("camera {name}");
        let known = [
            "PINHOLE",
            "SIMPLE_PINHOLE",
            "OPENCV",
            "SIMPLE_RADIAL",
            "RADIAL",
            "FULL_OPENCV",
            "OPENCV_FISHEYE",
            "SIMPLE_RADIAL_FISHEYE",
            "RADIAL_FISHEYE",
            "EQUIRECTANGULAR",
        ];
        let model = self.camera_model.as_deref();
        if self.is_fisheye == Some(true) && !self.is_fisheye() {
            let expected = "is_fisheye as camera_model says";
            return Err(fault(path, place(), expected, "true beside another lens"));
        }
        if let Some(other) = model.filter(|model| !known.contains(model)) {
            let expected = "a pinhole camera, distorted or not, a fisheye or EQUIRECTANGULAR";
            return Err(fault(path, place(), expected, other));
        }
        let size = match (self.w, self.h) {
            (Some(w), Some(h)) => {
                let size = size_of(w, h);
                Some(size.ok_or_else(|| {
                    fault(
                        path,
                        place(),
                        "w and h of 1 to 65535 pixels",
                        format!("{w} and {h}"),
                    )
                })?)
            }
            _ => None,
        };
        if model == Some("EQUIRECTANGULAR") {
            return Ok(Optics::Sphere(size));
        }
        let of_angle = |radians: f64, side: usize| {
            angle(path, name, radians).map(|radians| side as f64 / 2.0 / (radians / 2.0).tan())
        };
        let Some([width, height]) = size else {
            return match (self.camera_angle_x, self.fl_x, self.cx.or(self.cy)) {
                (Some(radians), None, None) => Ok(Optics::Horizontal(angle(path, name, radians)?)),
                _ => Err(fault(
                    path,
                    place(),
                    "w and h, or camera_angle_x alone",
                    "other numbers of a lens",
                )),
            };
        };
        let focal_x = match (self.fl_x, self.camera_angle_x) {
            (Some(fl_x), _) => fl_x,
            (None, Some(radians)) => of_angle(radians, width)?,
            (None, None) => return Err(fault(path, place(), "fl_x or camera_angle_x", "neither")),
        };
        let focal_y = match (self.fl_y, self.camera_angle_y) {
            (Some(fl_y), _) => fl_y,
            (None, Some(radians)) => of_angle(radians, height)?,
            (None, None) => focal_x,
        };
        let half = DVec2::new(width as f64, height as f64) / 2.0;
        Ok(Optics::Calibrated {
            focal_px: DVec2::new(focal_x, focal_y),
            centre_px: DVec2::new(self.cx.unwrap_or(half.x), self.cy.unwrap_or(half.y)),
            size: [width, height],
        })
    }
}

fn of_capture(path: &Path, capture: Capture) -> Result<Vec<Stated>> {
    let frames = capture.frames.iter().enumerate();
    let cameras = frames.map(|(i, frame)| {
        let name = frame.file_path.clone().unwrap_or_else(|| i.to_string());
        let lens = frame.lens.or(&capture.lens);
        let rows: Option<Vec<[f64; 4]>> = { frame.transform_matrix.iter().take(3) }
            .map(|row| row.as_slice().try_into().ok())
            .collect();
        let rows: Option<[[f64; 4]; 3]> = rows.and_then(|rows| rows.try_into().ok());
        let rows = rows.ok_or_else(|| not_a_rotation(path, &name, &frame.transform_matrix))?;
        let (eye, camera_from_world) = pose(path, &name, rows)?;
        Ok(Stated {
            optics: lens.optics(path, &name)?,
            distortion: lens.distortion(),
            name,
            eye,
            camera_from_world,
        })
    });
    cameras.collect()
}

fn of_trained(path: &Path, trained: Vec<Trained>) -> Result<Vec<Stated>> {
    let numbered = trained.into_iter().enumerate();
    let cameras = numbered.map(|(i, own)| {
        let name = own.img_name.unwrap_or_else(|| i.to_string());
        let axes = DMat3::from_cols_array_2d(&own.rotation).transpose();
        let turned =
            rotation(axes, false).ok_or_else(|| not_a_rotation(path, &name, &own.rotation))?;
        let size = size_of(own.width, own.height).ok_or_else(|| {
            let found = format!("{} x {}", own.width, own.height);
            fault(
                path,
                format!("camera {name}"),
                "a size of 1 to 65535 pixels",
                found,
            )
        })?;
        Ok(Stated {
            name,
            eye: DVec3::from(own.position),
            camera_from_world: turned,
            optics: Optics::Calibrated {
                focal_px: DVec2::new(own.fx, own.fy),
                centre_px: DVec2::from(size.map(|n| n as f64)) / 2.0,
                size,
            },
            distortion: None,
        })
    });
    let mut cameras: Vec<Stated> = cameras.collect::<Result<_>>()?;
    cameras.sort_by(|a, b| a.name.cmp(&b.name));
    Ok(cameras)
}

fn of_path(path: &Path, frames: FramesOfPath) -> Result<Vec<Stated>> {
    if let Some(other) = frames
        .camera_type
        .as_deref()
        .filter(|kind| *kind != "perspective")
    {
        return Err(fault(path, "camera_type", "perspective", other));
    }
    let size = frames
        .render_width
        .zip(frames.render_height)
        .and_then(|(w, h)| size_of(w, h));
    let numbered = frames.camera_path.iter().enumerate();
    let cameras = numbered.map(|(i, frame)| {
        let name = i.to_string();
        let rows = rows_of(path, &name, &frame.camera_to_world, false)?;
        let (eye, camera_from_world) = pose(path, &name, rows)?;
        Ok(Stated {
            optics: Optics::Vertical(angle(path, &name, frame.fov.to_radians())?, size),
            name,
            eye,
            camera_from_world,
            distortion: None,
        })
    });
    cameras.collect()
}
