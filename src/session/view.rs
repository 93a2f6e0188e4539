//! Defines views: cameras that may be completed only with a scene and a picture's size.

use glam::{DVec2, DVec3};

use crate::io::Up;
use crate::view::{Along, Bounds, Camera, DEFAULT_FOV_DEG, Lens, Viewpoint};

/// Description of a camera.
#[derive(Debug, Clone, Default)]
pub struct View {
    /// Position and orientation.
    pub placement: Placement,
    /// Field of view, or the height of an orthographic picture; by default the picture's.
    pub lens: Option<Lens>,
    /// Direction up, in place of the data's.
    pub up: Option<DVec3>,
}

/// Position and orientation of a camera.
#[derive(Debug, Clone)]
pub enum Placement {
    /// Fitted to the data.
    Fitted {
        /// Degrees, if they differ from those that the data suggest.
        azimuth_deg: Option<f64>,
        /// Degrees, if they differ from those that the data suggest.
        elevation_deg: Option<f64>,
        /// Degrees added to the azimuth and the elevation.
        turn_deg: [f64; 2],
        /// Factor on the size of the data in the picture, if it differs from 1.
        zoom: Option<f64>,
        /// True if the camera is fitted to the sphere around all data.
        is_around: bool,
    },
    /// From an eye towards a target, world units.
    LookAt {
        /// Position of the eye.
        eye: DVec3,
        /// Point in the middle of the picture.
        target: DVec3,
    },
    /// Along an axis, orthographic.
    Along {
        /// The axis.
        axis: Along,
        /// Point in the middle of the picture; by default the middle of the data.
        centre: Option<DVec3>,
        /// Width of the picture, world units; by default that of the data.
        width: Option<f64>,
    },
    /// A camera for a picture of its own size, from which pictures of another size are scaled.
    Calibrated(Camera),
}

impl Default for Placement {
    fn default() -> Self {
        Self::Fitted {
            azimuth_deg: None,
            elevation_deg: None,
            turn_deg: [0.0; 2],
            zoom: None,
            is_around: false,
        }
    }
}

impl View {
    /// Returns the camera along an axis for a picture of this size; `None` if it looks from elsewhere, or if it is fitted
    /// to boxes and there are none.
    fn along(&self, boxes: &[Bounds], size: [usize; 2]) -> Option<Camera> {
        let Placement::Along {
            axis,
            centre,
            width,
        } = &self.placement
        else {
            return None;
        };
        let boxes = match (*centre, boxes) {
            // There is nothing to fit, but the place is given.
            (Some(centre), []) => &[(centre, DVec3::ONE)],
            (_, boxes) => boxes,
        };
        let fitted = axis.fitted(boxes, None, size)?;
        let focal_px = match width {
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
    fn camera(
        &self,
        size: [usize; 2],
        viewpoint: Viewpoint,
        lens: Lens,
        fitted: impl FnOnce(Viewpoint, Lens, bool) -> Option<Camera>,
    ) -> Camera {
        let fov = match self.lens {
            Some(Lens::FovDeg(fov)) => fov,
            _ => DEFAULT_FOV_DEG,
        };
        // The camera of an empty picture looks anywhere.
        let nowhere = || Camera::perspective(DVec3::ZERO, DVec3::Y, DVec3::Z, fov, size);
        let lens = self.lens.unwrap_or(lens);
        match &self.placement {
            Placement::Calibrated(camera) => {
                let scale = DVec2::new(
                    size[0] as f64 / camera.width as f64,
                    size[1] as f64 / camera.height as f64,
                );
                Camera {
                    focal_px: camera.focal_px * scale,
                    centre_px: camera.centre_px * scale,
                    width: size[0],
                    height: size[1],
                    ..camera.clone()
                }
            }
            Placement::LookAt { eye, target } => {
                let up = self.up.unwrap_or(viewpoint.up);
                match self.lens {
                    Some(Lens::OrthoHeight(Some(height))) => {
                        Camera::orthographic(*eye, *target, up, height, size)
                    }
                    _ => Camera::perspective(*eye, *target, up, fov, size),
                }
            }
            Placement::Fitted {
                azimuth_deg,
                elevation_deg,
                turn_deg: [turn, rise],
                zoom,
                is_around,
            } => {
                let viewpoint = Viewpoint {
                    azimuth_deg: azimuth_deg.unwrap_or(viewpoint.azimuth_deg) + turn,
                    elevation_deg: elevation_deg.unwrap_or(viewpoint.elevation_deg) + rise,
                    zoom: zoom.unwrap_or(viewpoint.zoom),
                    up: viewpoint.up,
                };
                fitted(viewpoint, lens, *is_around).unwrap_or_else(nowhere)
            }
            Placement::Along { .. } => fitted(viewpoint, lens, false).unwrap_or_else(nowhere),
        }
    }
}

/// Returns the camera of a view.
///
/// - `room_px`: columns at the right that stay free.
pub fn camera(
    view: Option<&View>,
    up: Up,
    boxes: &[Bounds],
    lens: Lens,
    size: [usize; 2],
    room_px: usize,
) -> Camera {
    let viewpoint = up.viewpoint();
    let room = if 2 * room_px <= size[0] { room_px } else { 0 };
    let inner = [size[0] - room, size[1]];
    let fitted = |viewpoint: Viewpoint, lens, around| {
        let camera = match around {
            true => viewpoint.camera_around(boxes, lens, inner),
            false => viewpoint.camera(boxes, lens, inner),
        };
        // The columns left free lie to the right of the part that the camera was fitted to.
        camera.map(|camera| Camera {
            width: size[0],
            ..camera
        })
    };
    let along = match view {
        Some(view) => view.along(boxes, inner),
        // Column densities are seen along z.
        None if lens == Lens::OrthoHeight(None) => Along::Z.fitted(boxes, None, inner),
        None => None,
    };
    if let Some(camera) = along {
        return Camera {
            width: size[0],
            ..camera
        };
    }
    let view = view.cloned().unwrap_or_default();
    view.camera(size, viewpoint, lens, fitted)
}
