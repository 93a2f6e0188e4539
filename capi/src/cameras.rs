//! Makes views of the caller's numbers. A renderer checks cameras when they are complete.

use ewa_splat::session::{Placement, View};
use ewa_splat::view::{Along, Camera, Lens, Projection};
use glam::{DMat3, DVec2, DVec3};

use super::failure::{Failure, Result};

/// Returns a view that is fitted to the data. NaN stands for the default of a number.
pub(crate) fn fitted(azimuth: f64, elevation: f64, zoom: f64, orthographic: bool) -> View {
    let given = |x: f64| Some(x).filter(|x| !x.is_nan());
    View {
        placement: Placement::Fitted {
            azimuth_deg: given(azimuth),
            elevation_deg: given(elevation),
            turn_deg: [0.0; 2],
            zoom: given(zoom),
            is_around: false,
        },
        lens: orthographic.then_some(Lens::OrthoHeight(None)),
        up: None,
    }
}

/// Returns a view from an eye towards a target.
pub(crate) fn look_at(eye: DVec3, target: DVec3, up: Option<DVec3>, lens: Lens) -> Result<View> {
    let (name, number, is_good) = match lens {
        Lens::FovDeg(fov) => ("fov_deg", fov, fov > 0.0 && fov < 180.0),
        Lens::OrthoHeight(height) => {
            let height = height.unwrap_or(f64::NAN);
            ("height", height, height > 0.0 && height.is_finite())
        }
    };
    if !is_good {
        return Err(Failure::invalid(format!(
            "{name}: expected a number above 0, and degrees below 180, found {number}"
        )));
    }
    let all = [eye, target, up.unwrap_or(DVec3::Z)];
    if !all.iter().all(|vector| vector.is_finite()) || eye == target || up == Some(DVec3::ZERO) {
        let text = "eye, target, up: expected finite numbers, two different points and a direction, found others";
        return Err(Failure::invalid(text));
    }
    Ok(View {
        placement: Placement::LookAt { eye, target },
        lens: Some(lens),
        up,
    })
}

/// Returns an orthographic view along an axis.
///
/// - `width`: width of the picture, world units; 0 for that of the data.
pub(crate) fn along(axis: &str, centre: Option<DVec3>, width: f64) -> Result<View> {
    let found = Along::of_name(axis).ok_or_else(|| {
        Failure::invalid(format!(
            "axis: expected x, y, z, -x, -y or -z, found {axis}"
        ))
    })?;
    if !(width >= 0.0 && width.is_finite()) {
        let text = format!("width: expected a number from 0 up, found {width}");
        return Err(Failure::invalid(text));
    }
    Ok(View {
        placement: Placement::Along {
            axis: found,
            centre,
            width: Some(width).filter(|width| *width > 0.0),
        },
        ..View::default()
    })
}

/// Returns a calibrated view.
///
/// - `rotation`: rows right, down and forward.
pub(crate) fn calibrated(
    eye: DVec3,
    rotation: [f64; 9],
    focal_px: [f64; 2],
    centre_px: Option<[f64; 2]>,
    size: [usize; 2],
    orthographic: bool,
) -> Result<View> {
    if size.contains(&0) {
        return Err(Failure::invalid(
            "size: expected a width and a height above 0, found 0",
        ));
    }
    let middle = DVec2::new(size[0] as f64, size[1] as f64) / 2.0;
    Ok(View {
        placement: Placement::Calibrated(Camera {
            projection: match orthographic {
                true => Projection::Orthographic,
                false => Projection::Perspective,
            },
            eye,
            camera_from_world: DMat3::from_cols_array(&rotation).transpose(),
            focal_px: focal_px.into(),
            centre_px: centre_px.map_or(middle, DVec2::from),
            width: size[0],
            height: size[1],
        }),
        ..View::default()
    })
}
